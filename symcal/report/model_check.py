"""Is the model right: the verdict on the residuals and the tests behind it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.units import in_mrad
from symcal.words import fixed, number, plural

_SHOWN = 8  # tests that are printed


def model_check_text(found: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Sentence, lines on the lack of fit and the tests of least probability; None where nothing was checked.

    Args:
        found: of results.json.
    """
    if not found:
        return None
    tests = sorted(found["tests"], key=lambda test: (test["name"] not in found["causes"], test["corrected"], test["p"]))
    count = len(tests)
    note = (
        f"The {min(_SHOWN, count)} most significant of {plural(count, 'test')}, all of which are in "
        "tables/model_check.csv. p is the probability of such a pattern by chance, corrected for the number of tests; "
        "the last column is it beside the causes that are named, taken into the model. The effect of what was "
        "identified is taken out."
    )
    sentence = found["sentence"]
    return {
        "sentence": f"{sentence[:1].upper()}{sentence[1:]}.",
        "lack": [f"{each['group']}: {each['said']}" for each in found["lack_of_fit"]],
        "untested": _untested(found["untested_joints"]),
        "rows": [_row(test) for test in tests[:_SHOWN]],
        "note": note,
    }


def _untested(joints: list[int]) -> str:
    if not joints:
        return ""
    named = ", ".join(map(str, joints))
    return f"Not tested: joint {named}, of which the robot file has no zero, or whose motion no reading sees."


def _row(test: Mapping[str, Any]) -> list[str]:
    return [test["name"], _size(test), _rms(test), _p(test["corrected"]), _p(test["beside"])]


def _size(test: Mapping[str, Any]) -> str:
    if test["correlation"] is not None:
        return f"correlation {fixed(test['correlation'], 2)}"
    unit, factor = in_mrad(test["unit"])
    own = f"{number(test['amplitude'] * factor, 2)} {unit}"
    return own if test["at_tool"] is None or unit != "mrad" else f"{own}, {number(test['at_tool'], 2)} mm at the tool"


def _rms(test: Mapping[str, Any]) -> str:
    if test["rms"] is None:
        return "–"
    unit, factor = in_mrad(test["of_unit"])
    return f"{number(test['rms'] * factor, 2)} of {number(test['of'] * factor, 2)} {unit}"


def _p(value: float) -> str:
    return number(value, 1) if value < 0.001 else fixed(value, 3)
