"""The first thing that a page says: how accurate at poses that the identification has not seen, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.report.decision import decision_text
from symcal.report.measured import judged
from symcal.report.verdict import judging_part, usable
from symcal.words import number, plural

Content = Mapping[str, Any]

_HELD_OUT = {"test": "held-out poses", "cross_validation": "cross-validated poses"}
_NOMINAL = {"before": "nominal kinematics, frames fitted", "before_raw": "nominal kinematics"}
_STATES = {
    "before_raw": "nominal, frames as given",
    "before": "nominal, frames fitted",
    "offsets_only": "joint offsets only",
    "after": "all parameters",
}


def headline(content: Content) -> dict[str, Any]:
    """Number, unit and what they are of; no number where no pose was held out, since a residual of the training poses
    does not say how accurate a robot is."""
    part, what = judging_part(content), judged(content)
    decision = decision_text(content) or {
        "accepted": usable(content),
        "title": "Converged" if usable(content) else "Did not converge: do not use these numbers",
        "lines": [],
    }
    if part == "train":
        words = "No pose was held out: nothing here says how accurate the robot is at other poses."
        return {"value": None, "unit": what.unit, "words": words, "beside": [], "decision": decision}
    states = content["accuracy"][part]
    after = states["after"][what.key]
    words = f"rms {what.title} at {_HELD_OUT[part]}"
    beside = [
        ["before", f"{number(states[_start(states)][what.key]['rms'])} {what.unit}", nominal(content)],
        ["95 % below", f"{number(after['p95'])} {what.unit}", f"of {plural(after['count'], what.counted)}"],
        ["largest", f"{number(after['max'])} {what.unit}", f"at pose {after['worst']['pose']}"],
    ]
    if states["after"].get("orientation_deg"):
        angle = states["after"]["orientation_deg"]
        beside.append(["orientation", f"{number(angle['rms'])} deg", f"rms, largest {number(angle['max'])} deg"])
    return {"value": number(after["rms"]), "unit": what.unit, "words": words, "beside": beside, "decision": decision}


def nominal(content: Content) -> str:
    """What is nominal before the identification."""
    return _NOMINAL[_start(content["accuracy"][judging_part(content)])]


def _start(states: Mapping[str, Any]) -> str:
    return "before" if "before" in states else "before_raw"


def ladder(content: Content) -> dict[str, Any] | None:
    """Models from poor to rich with the rms of each at poses held out of the training; None where none were."""
    part, what = judging_part(content), judged(content)
    if part == "train":
        return None
    states = content["accuracy"][part]
    rungs = [(words, states[state][what.key]["rms"]) for state, words in _STATES.items() if state in states]
    top = max(rms for _, rms in rungs) or 1.0
    rows = [
        {"words": words, "rms": number(rms), "share": 100 * rms / top, "strong": i == len(rungs) - 1}
        for i, (words, rms) in enumerate(rungs)
    ]
    return {"rows": rows, "unit": what.unit, "at": _HELD_OUT[part], "error": what.title}
