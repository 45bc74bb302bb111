"""The report of an identification as text: results in, strings for the template out. Nothing is computed but units and rounding."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from symcal.report.verdict import judged, verdict
from symcal.words import fixed, listed, number, plural, symbol

Content = Mapping[str, Any]

_STATES = {
    "before_raw": "nominal, frames as given",
    "before": "before: nominal, frames fitted",
    "offsets_only": "joint offsets only",
    "after": "after the identification",
}
_PARTS = {
    "test": "held-out poses",
    "cross_validation": "cross-validated",
    "train": "training poses",
    "truth": "test poses, against the truth",
}
_COLUMNS = ("rms", "mean", "p95", "max")


def identification_text(content: Content) -> dict[str, Any]:
    """Everything that the template `identification` prints, by section."""
    return {
        "title": content.get("title") or content["name"],
        "subtitle": _subtitle(content),
        "name": content["name"],
        "version": content["versions"].get("symcal", ""),
        "verdict": verdict(content),
        "warnings": list(content.get("warnings", [])),
        "accuracy": _accuracy(content),
        "identifiability": _identifiability(content),
        "parameters": _parameters(content["identification"]["parameters"]),
        "frames": _frames(content.get("frames", {}), content["measurement"].get("estimate", [])),
        "facts": _facts(content),
        "inputs": [[path, digest] for path, digest in content["inputs"].items()],
    }


def _subtitle(content: Content) -> str:
    robot, measurement = content["robot"], content["measurement"]
    poses = listed([f"{count} {part}" for part, count in measurement["poses"].items() if count])
    points = measurement.get("points", [])
    tail = f" of {plural(len(points), 'point')}" if len(points) > 1 else ""
    return (
        f"{robot['name']}, {plural(robot['dof'], 'joint')}, {robot['convention']} link convention; {measurement['type']} measurements{tail}, {poses} "
        "poses"
    )


# -------------------------------------------------------------------------------------------------------------- accuracy


def _accuracy(content: Content) -> dict[str, Any]:
    groups = []
    angles = False
    for part in [p for p in _PARTS if p in content["accuracy"]]:
        states = content["accuracy"][part]
        rows = []
        for state in [s for s in _STATES if s in states]:
            position, angle = states[state]["position_mm"], states[state].get("orientation_deg")
            angles |= angle is not None
            cells = [number(position[c]) for c in _COLUMNS]
            cells += ["–"] * 4 if angle is None else [number(angle[c]) for c in _COLUMNS]
            rows.append({"label": _STATES[state], "cells": cells, "strong": state == "after"})
        groups.append({"label": _part_label(content, part), "rows": rows, "judges": part == judged(content)})
    if not angles:
        for group in groups:
            for row in group["rows"]:
                row["cells"] = row["cells"][:4]
    note = (
        f"Euclidean norms over observations{' and rotation angles over poses' if angles else ''}, against the {content['against']} unless the truth is "
        "named. 'Before' is the nominal kinematics with base and tool fitted on the training poses."
    )
    return {"groups": groups, "angles": angles, "note": note}


def _part_label(content: Content, part: str) -> str:
    facts = content["accuracy"][part]
    count = facts["after"]["position_mm"]["count"]
    folds = f", {facts['folds']} folds" if "folds" in facts else ""
    return f"{_PARTS[part]} ({plural(count, 'observation')}{folds})"


# ------------------------------------------------------------------------------------------------------- identifiability


def _identifiability(content: Content) -> dict[str, Any]:
    seen = content["identifiability"]
    total, rank, released = seen["parameters"], seen["rank"], seen.get("released", 0)
    hidden = total - rank
    text = (
        f"The model has {plural(total, 'parameter')}. At the noise of the measurement {plural(rank, 'direction')} in their space "
        f"{'is' if rank == 1 else 'are'} determined better than the plausible size of an error there"
    )
    if released:
        text += f" ({released} of them below that threshold, released because the data contradict the nominal value)"
    if seen.get("numerical_rank") is not None:
        text += f"; without noise it would be {seen['numerical_rank']}"
    text += "."
    if seen.get("condition_number") is not None:
        text += f" The condition number of the determined part is {number(seen['condition_number'])}."
    if hidden:
        text += (
            f" The following {'direction is' if hidden == 1 else f'{hidden} directions are'} not seen and "
            f"{'was' if hidden == 1 else 'were'} left at nominal:"
        )
    else:
        text += " Nothing is unseen."
    return {"text": text, "unseen": [_sentence(entry["text"]) for entry in seen["unseen"]]}


def _sentence(text: str) -> str:
    return text if text.endswith(".") else f"{text}."


# ------------------------------------------------------------------------------------------------------------ parameters


def _parameters(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Rows in the order of the vector; angles in deg, lengths in mm, all of one unit with as many decimals as its sigmas ask for."""
    decimals = {unit: _decimals(parameters, unit) for unit in {p["unit"] for p in parameters.values()}}
    rows = []
    for name, p in parameters.items():
        factor, unit = (180 / math.pi, "deg") if p["unit"] == "rad" else (1.0, p["unit"])
        places = decimals[p["unit"]]
        sigma = p["sigma"]
        rows.append(
            {
                "symbol": symbol(name),
                "name": name,
                "nominal": fixed(p["nominal"] * factor, places),
                "error": fixed(p["error"] * factor, places),
                "identified": fixed(p["identified"] * factor, places),
                "sigma": _sigma(sigma, factor, places),
                "unit": unit,
                "state": "fixed" if not p.get("free", True) else "open" if sigma is None else "determined",
            }
        )
    states = {row["state"] for row in rows}
    notes = []
    if "open" in states:
        notes.append(
            "Grey rows without a standard deviation (–): the data do not determine this parameter by itself, only combinations of it with others; "
            "the value is the one nearest to nominal and no finding."
        )
    if "fixed" in states:
        notes.append("Rows marked 'fixed' were held at nominal as the experiment asks.")
    return {"rows": rows, "notes": notes}


def _decimals(parameters: Mapping[str, Mapping[str, Any]], unit: str) -> int:
    factor = 180 / math.pi if unit == "rad" else 1.0
    known = [p["sigma"] * factor for p in parameters.values() if p["unit"] == unit and p["sigma"]]
    if not known:
        return 4 if unit == "rad" else 3
    return min(max(1 - math.floor(math.log10(min(known))), 2), 6)


def _sigma(sigma: float | None, factor: float, places: int) -> str:
    if sigma is None:
        return "–"
    value = sigma * factor
    return number(value, 2) if 0 < value < 0.5 * 10**-places else fixed(value, places)


def _frames(frames: Mapping[str, Any], estimated: list[str]) -> list[dict[str, Any]]:
    rows = []
    for key, label in (("base", "base in world"), ("tool", "tool in flange")):
        if key in frames:
            frame = frames[key]
            cells = [fixed(v, 3) for v in frame["xyz_mm"]] + [fixed(v, 4) for v in frame["rpy_deg"]]
            rows.append({"label": label, "cells": cells, "estimated": key in estimated})
    for name, xyz in frames.get("points_mm", {}).items():
        cells = [fixed(v, 3) for v in xyz] + ["", "", ""]
        rows.append({"label": f"point {name} in tool", "cells": cells, "estimated": "points" in estimated})
    return rows


# ----------------------------------------------------------------------------------------------------------- how it was made


def _facts(content: Content) -> list[list[str]]:
    found = content["identification"]
    facts = [
        [
            "solver",
            f"{found['solver'].replace('_', ' ')}, {plural(found['iterations'], 'accepted step')}; {found['message']}",
        ],
        ["noise", _noise(found)],
        [
            "equations",
            f"{found['equations']}, less {content['identifiability']['rank']} directions: {plural(found['dof'], 'degree')} of freedom",
        ],
    ]
    if found.get("chi_squared") is not None:
        facts.append(
            ["weighted squares", f"{number(found['chi_squared'], 4)} (sum of squared residuals over their variances)"]
        )
    facts.append(["random seed", str(content["seed"])])
    facts.append(["versions", ", ".join(f"{name} {version}" for name, version in content["versions"].items())])
    return facts


def _noise(found: Mapping[str, Any]) -> str:
    parts = []
    for key, group, unit in (
        ("noise_sigma_mm", "position", "mm per axis"),
        ("noise_sigma_deg", "orientation", "deg per axis"),
    ):
        if found.get(key) is not None:
            how = "estimated from the training data" if group in found.get("noise_estimated", []) else "as given"
            parts.append(f"{number(found[key])} {unit} ({group}, {how})")
    return "standard deviation " + ", ".join(parts) if parts else "as given with each measurement"
