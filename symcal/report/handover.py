"""The page 'To the controller' as text: corrections, what compensation achieves, and the C code."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from symcal.report.learnt import was_learnt
from symcal.words import fixed, listed, number, plural, symbol

Content = Mapping[str, Any]

_MOST = 6  # decimals
_MOST_OF_RATIOS = 12  # of joint terms: a compliance is some 1e-6 deg/Nmm
_TOOL = "tool frame"
_NO_NEWS = 1e-4  # standard deviations: a smaller correction is none
_NOTHING = 1e-9  # mm or deg: rounding of a number that was not identified
_KEPT = {
    "limit": "with a joint at its limit ({})",
    "cap": "with a correction at its cap ({})",
    "closest": "where too few joints or a singularity leave no way ({})",
    "outside": "outside the limits ({})",
}
_MANY = 0.1
"""Share of poses at a cap above which the corrections themselves are in doubt."""
_STATES = {
    "before": "before the calibration",
    "without": "calibrated, commands not compensated",
    "after": "calibrated and compensated",
    "after_reached": "of these, correction not limited",
}
_COLUMNS = ("rms", "mean", "p95", "max")
_ENDS = {
    "reached": ("was reached", "were reached"),
    "joint limit": ("ended at a joint limit", "ended at a joint limit"),
    "cap": ("ended at the cap on corrections", "ended at the cap on corrections"),
    "closest": ("was approached as near as the arm allows", "were approached as near as the arm allows"),
    "out of reach": ("is out of the nominal robot's reach", "are out of the nominal robot's reach"),
}
_CODE = {
    "forward": "tool pose, calibrated",
    "forward_nominal": "tool pose, nominal",
    "jacobian": "joint Jacobian, calibrated",
    "compensate": "compensation of the position",
    "compensate_pose": "compensation of the pose",
    "forward_with": "tool pose, parameters at run time",
    "jacobian_with": "Jacobian, parameters at run time",
    "compensate_with": "compensation, parameters at run time",
    "compensate_pose_with": "pose compensation, parameters at run time",
}


def handover_text(content: Content) -> dict[str, Any] | None:
    """Everything that the template `handover` prints; None where the results say nothing about a controller.

    Args:
        content: the results dictionary (results.json).
    """
    if "controller" not in content:
        return None
    controller = content["controller"]
    return {
        "corrections": _corrections(
            controller["corrections"],
            content.get("identification", {}).get("parameters", {}),
            controller.get("left_out", ""),
        ),
        "gate": _gate(controller["doubts"], content),
        "compensation": _compensation(content["compensation"], _apart(content))
        if content.get("compensation")
        else None,
        "code": _code(controller["code"]) if controller.get("code") else None,
    }


# --------------------------------------------------------------------------------------------------------- corrections


def _corrections(entries: Sequence[Content], parameters: Mapping[str, Content], left_out: str) -> dict[str, Any]:
    """Rows of what goes to a controller; grey where it is mostly assumed.

    Args:
        parameters: of the identification, by name; empty where only a robot is known. left_out: what offsets and
            lengths lose of joint terms; empty where there are none.
    """
    everything = len(entries)
    entries = [e for e in entries if abs(e["correction"]) > max(_NOTHING, _NO_NEWS * (e["sigma"] or 0.0))]
    units = dict.fromkeys(entry["unit"] for entry in entries)
    places = {unit: _decimals([e for e in entries if e["unit"] == unit], unit) for unit in units}
    rows = []
    for entry in entries:
        digits = places[entry["unit"]]
        cells = [fixed(entry[key], digits) for key in ("nominal", "correction", "corrected")]
        known = entry["sigma"] is not None
        found = parameters.get(entry["parameter"])
        rows.append(
            {
                "joint": entry["joint"],
                "quantity": entry["quantity"],
                "symbol": symbol(entry["parameter"]),
                "cells": [*cells, _sigma(entry["sigma"], digits) if known else "–", entry["unit"]],
                "known": was_learnt(found) if found else known or entry["parameter"] == _TOOL,
            }
        )
    note = (
        "A zero offset is to be added to the joint's reading, in units and direction of that reading (a controller "
        "that subtracts its offset wants the opposite sign); the other rows are numbers of the model, for controllers "
        "that let them be changed. Where the instrument saw the base is no correction of the robot and is left out."
    )
    if any(not row["known"] for row in rows):
        note += (
            " Grey rows are mostly assumed: the data say little about them alone. All rows belong together and go to "
            "the controller together."
        )
    if any(e["sigma"] is None and e["parameter"] == _TOOL for e in entries):
        note += " No standard deviation is given for the tool's angles."
    if left_out:
        note += f" {left_out}. Rows of joint terms are for controllers that have such terms."
    if len(rows) < everything:
        note += " Parameters that keep their nominal value are left out."
    return {"rows": rows, "note": note}


def _decimals(entries: Sequence[Content], unit: str) -> int:
    """So many that the smallest standard deviation has two digits, within reason."""
    known = [entry["sigma"] for entry in entries if entry["sigma"]]
    most = _MOST if unit in ("mm", "deg") else _MOST_OF_RATIOS
    return 4 if not known else min(max(1 - math.floor(math.log10(min(known))), 2), most)


def _sigma(value: float, places: int) -> str:
    return number(value, 2) if 0 < value < 0.5 * 10**-places else fixed(value, places)


def _gate(doubts: Sequence[str], content: Content) -> str:
    if "decision" in content and not doubts:
        return "The calibration is accepted: it may go to a controller."
    if "decision" in content and "identification" in content:  # whose report begins with the reasons
        return (
            "The calibration is refused, for the reasons at the beginning: these numbers should not go to a controller."
        )
    if not doubts:
        return "The identification converged and no correction is implausibly large: it may go to a controller."
    return f"These numbers should not go to a controller as they are: {'; '.join(doubts)}."


# -------------------------------------------------------------------------------------------------------- compensation


def _apart(content: Content) -> float:
    """Distance of the nearest measured point from the origin of the tool frame, mm."""
    points = content.get("frames", {}).get("points_mm", {})
    return min((math.hypot(*xyz) for xyz in points.values()), default=0.0)


def _compensation(found: Content, apart: float) -> dict[str, Any]:
    states = [state for state in _STATES if found.get(state)]
    quantities = ["position_mm"] + ["orientation_deg"] * all("orientation_deg" in found[s] for s in states)
    rows = []
    for state in states:
        cells = [number(found[state][q][c]) for q in quantities for c in _COLUMNS]
        label = _STATES[state]
        if state == "after_reached":
            label += f" ({plural(found[state]['position_mm']['count'], 'pose')})"
        rows.append({"label": label, "cells": cells, "strong": state == "after"})
    return {"rows": rows, "angles": len(quantities) > 1, "text": _achieved(found), "note": _note(found, apart)}


def _achieved(found: Content) -> str:
    before, after = (found[state]["position_mm"] for state in ("before", "after"))
    text = (
        "A calibration that stays in a file changes nothing: with the commands as planned the tool is still "
        f"{number(before['mean'])} mm off on average. Commands that are compensated with the calibrated model bring "
        f"the true robot to {number(after['mean'])} mm on average and {number(after['p95'])} mm for 95 % of "
        f"{plural(found['poses'], 'random pose')}."
    )
    ends = [f"{plural(count, 'pose')} {_ENDS[s][count != 1]}" for s, count in found["status"].items()]
    text += f" By the calibrated model, {listed(ends)}."
    worse = found["worse"]
    if worse:
        text += f" At {plural(worse, 'pose')} the compensated command is farther off than the plain one."
    return text


def _note(found: Content, apart: float) -> str:
    text = (
        "Distance of the true robot's tool (the origin of the tool frame) from where the nominal robot would be, "
        "against the simulated truth, in the base frame."
    )
    if found["aligned"]:
        text += (
            " The base was estimated, so the base frame is where the measurement puts it: errors are taken after one "
            "rigid motion that lays the model's positions on the true ones."
        )
    if apart > 0:
        text += (
            f" What was measured stands {number(apart)} mm from that origin, and what it does not tell of the origin "
            "is in these errors."
        )
    if not found["orientation_compensated"]:
        text += " The position is compensated, the orientation is not: it follows."
    return text


# ---------------------------------------------------------------------------------------------------------------- code


def _code(found: Content) -> dict[str, Any]:
    if not found["written"]:
        return {"written": False, "text": "No C code was written, because of the doubts above."}
    check, files = found["check"], found["files_bytes"]
    names = ("forward", "forward_nominal", "jacobian", "compensate", "compensate_pose", "compensate_with")
    shown = [name for name in names if name in found["operations"]]
    return {
        "written": True,
        "text": (
            f"The folder {found['folder']} holds {plural(len(files), 'file')}, {_size(sum(files.values()))}: header "
            "and source in C99 without allocation, input or output, or variables outside functions; a README; build "
            "files for make and CMake; and a self-test. The same source is compiled in double or, with SYMCAL_FLOAT, "
            "in single precision. The model hash begins with "
            f"{found['model_hash'][:12]}."
        ),
        "check": _check(check),
        "functions": [
            [f"{found['prefix']}_{name}", _CODE[name], *(str(found["operations"][name][k]) for k in ("total", "libm"))]
            for name in shown
        ],
        "example": "\n".join(found["example"]),
    }


def _check(check: Content | None) -> str:
    if check is None:
        return "It was not compiled here, where there is no working C compiler: its self-test does that elsewhere."
    exact = "to the last bit" if check["double_mm"] == 0 else f"to {number(check['double_mm'])} mm"
    text = (
        f"Compiled here ({check['compiler']}) and compared with Python at {plural(check['poses'], 'random pose')}: "
        f"tool positions agree {exact} in double and to {number(check['float_mm'])} mm in single precision. In double "
        f"the compensation reaches {number(100 * check['reached_share'])} % of the poses and leaves "
        f"{number(check['compensated_mean_mm'])} mm on average by the calibrated model"
    )
    kept = [_KEPT[name].format(count) for name, count in check["status"].items() if name in _KEPT]
    text += f"; the others end {listed(kept)}." if kept else "."
    if check["status"].get("cap", 0) > _MANY * check["poses"]:
        text += (
            f" At {plural(check['status']['cap'], 'pose')} a correction is as large as its cap: look at the "
            "corrections, and at the base frame that they refer to, before the code is used."
        )
    if check["code_bytes"]:
        double, single = (_size(check["code_bytes"][kind]) for kind in ("double", "float"))
        text += (
            f" All functions together are {double} of machine code in double, {single} in float on this machine; a "
            "linker keeps only those that are called."
        )
    return text


def _size(count: int) -> str:
    return f"{count} bytes" if count < 1000 else f"{number(count / 1000)} kB"
