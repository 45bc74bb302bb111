"""What the report of an identification says about images: how they were measured, and what other ways make of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.words import MINUS, fixed, listed, number, percent, plural

Content = Mapping[str, Any]

_WAYS = {
    "pixels": "pixels: all image points at once",
    "p3p": "P3P, centroid of each image (the paper's way)",
    "p3p_points": "P3P, three points of each image",
    "p3p_covariance": "P3P, three points with full covariance",
}
_COUNTS = {2: "two", 3: "three", 4: "four"}


def images_text(content: Content) -> dict[str, Any] | None:
    """The section about images; None for measurements without a camera.

    Args:
        content: the results dictionary (results.json).
    """
    ways = content.get("comparison", {})
    if "residuals_px" not in content:
        return _measured(content) if "measured_images" in content else None
    return {
        "text": _sentences(content),
        "ways": [_way(name, ways[name]) for name in _WAYS if name in ways],
        "count": _COUNTS.get(len(ways), str(len(ways))),
        "note": _note(content) if ways else "",
        "camera": _camera(content.get("camera")),
        "calibration": _calibration(content.get("camera")),
    }


def _measured(content: Content) -> dict[str, Any]:
    """The section about images that were given, or rendered, and measured in the run."""
    text, entries = [], content["measured_images"]
    for name, facts in entries.items():
        called = f"'{name}': " if len(entries) > 1 else ""
        share = facts["points"] / (facts["measured"] * facts["points_of_an_image"])
        text.append(
            f"{called}{facts['measured']} of {plural(facts['given'], 'image')} were measured, with {facts['points']} "
            f"image points: {percent(share)} of the target's points in each, in the mean."
        )
        if "error_px" in facts:
            text.append(_against_truth(facts))
        if facts["where"]:
            text.append(f"{facts['where'][0].upper()}{facts['where'][1:]}.")
        text += [f"Not measured: {entry['image']}: {entry['reason']}." for entry in facts["failures"]]
    camera = content.get("camera")
    words = {"ways": [], "count": "", "note": ""}
    return {"text": text, **words, "camera": _camera(camera), "calibration": _calibration(camera)}


def _against_truth(facts: Mapping[str, Any]) -> str:
    return (
        f"The points came out within {number(facts['error_px']['rms'])} px rms of the truth "
        f"({number(facts['error_per_axis_px'])} px per axis). These are rendered images: real prints, light and lenses "
        "rarely leave less than 0.02 px."
    )


def _sentences(content: Content) -> list[str]:
    residual = content["residuals_px"]["after"]
    before = content["residuals_px"]["before"]["rms"]
    points = content["points_position_mm"]["after"]["rms"]
    sentences = []
    images = content.get("images")
    if images is not None:
        failures = images["failures"]
        sentences.append(
            f"The target was measured in {plural(images['measured'], 'image')}"
            + (f", not in {len(failures)}." if failures else ", in every one.")
        )
        sentences.append(_against_truth(images))
        sentences += [f"Not measured: {entry['image']}: {entry['reason']}." for entry in failures]
        if images["camera_found_from_images"]:
            sentences.append("Where camera and mount are was found from the images themselves.")
    sentences.append(
        f"In the image the nominal robot, its camera and mount fitted, is off by {number(before)} px rms; after the "
        f"identification {number(residual['rms'])} px are left. Errors in mm are of the target's centre; its single "
        f"points are off by {number(points)} mm rms."
    )
    return sentences


def _way(name: str, way: Mapping[str, Any]) -> dict[str, Any]:
    found = way["position_mm"]
    cells = [
        _WAYS[name],
        *(number(found[key]) for key in ("rms", "p95", "max")),
        f"{number(way['times_pixels'], 2)} ×",
        str(way["poses"]),
        f"{way['rank']} of {way['parameters']}",
    ]
    return {"cells": cells, "strong": name == "pixels"}


def _note(content: Content) -> str:
    ways = content["comparison"]
    labels = (("p3p", "the paper's centroid"), ("p3p_covariance", "P3P with full covariance"))
    behind = [f"of {label} {number(ways[name]['times_pixels'], 2)} times" for name, label in labels if name in ways]
    count = ways["pixels"]["position_mm"]["count"]
    return (
        f"Position error of the target's centre at {plural(count, 'unseen pose')} against the truth, after one rigid "
        f"alignment: {listed(behind)} that of the pixels. P3P keeps the camera as it was calibrated; the pixels move "
        "its numbers within their uncertainty."
    )


def _camera(facts: Mapping[str, Any] | None) -> list[list[str]]:
    rows = []
    for name, entry in (facts or {}).get("intrinsics", {}).items():
        decimals = 3 if name in ("fx", "fy", "cx", "cy") else 6
        error = entry["calibrated"] - entry["true"]
        sigma = number(entry["sigma"], 2) if entry["sigma"] else "held"
        signed = fixed(error, decimals)
        rows.append(
            [
                name,
                fixed(entry["true"], decimals),
                fixed(entry["calibrated"], decimals),
                signed if signed.startswith(MINUS) else f"+{signed}",
                sigma,
            ]
        )
    return rows


def _calibration(facts: Mapping[str, Any] | None) -> str:
    if facts is None:
        return ""
    parts = [f"{plural(facts['views'], 'view')} used", f"{number(facts['rms_px'])} px rms"]
    if facts["views_left_out"]:
        parts.insert(1, f"{facts['views_left_out']} left out")
    return f"{listed(parts).capitalize()}; lengths in px."
