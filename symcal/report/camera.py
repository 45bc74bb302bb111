"""The page of a camera calibration as text: its numbers in, strings for the template out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.words import fixed, number, plural

Content = Mapping[str, Any]

_UNITS = dict.fromkeys(("fx", "fy", "cx", "cy", "skew"), "px")


def camera_text(content: Content) -> dict[str, Any]:
    """Everything that the template `camera` prints.

    Args:
        content: as `symcal.runs.camera.camera_content` gives it.
    """
    used = sum(view["used"] for view in content["views"])
    listed = content["source"] == "corners"
    return {
        "title": "Camera calibration",
        "subtitle": (
            f"{content['board']}; {content['width']} x {content['height']} px, {plural(used, 'view')} used of "
            f"{plural(len(content['views']) + len(content['refusals']), 'view' if listed else 'image')}."
        ),
        "version": content["versions"].get("symcal", ""),
        "grade": content["grade"],
        "verdict": [content["summary"], *content["findings"]],
        "again": "To be looked at" if listed else "To be taken again",
        "nothing": "Every view fits as well as the others." if listed else "No view has to be taken again.",
        "retake": [[entry["view"], entry["why"]] for entry in content["retake"]],
        "numbers": [_number(name, entry) for name, entry in content["intrinsics"].items()],
        "note": (
            f"Standard deviations from the residuals, poses of the board taken out. {content['note']}"
            if content["note"]
            else "Standard deviations from the residuals, poses of the board taken out."
        ),
    }


def _number(name: str, entry: Mapping[str, Any]) -> list[str]:
    pixels = name in _UNITS
    value = fixed(entry["value"], 3) if pixels else fixed(entry["value"], 6)
    sigma = "held" if not entry["free"] else number(entry["sigma"], 2)
    return [name, value, sigma, _UNITS.get(name, "")]
