"""What a check of the model says: one sentence with the likely cause and what to do, and all of it as numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from symcal.calibration.lack_of_fit import LackOfFit
from symcal.calibration.model_check import LEVEL, Found, ModelCheck
from symcal.calibration.patterns import Kind
from symcal.joints.backlash import direction_name
from symcal.words import listed, number

_AUTO = "add `identification: {extend: auto}`"
_REFERENCE = "measure a reference posture now and then"
_TIMES = {1: "once", 2: "twice"}
_IN_AUTO = 2  # highest wave that `extend: auto` tries
_SHOWN: dict[str, tuple[str, float]] = {"rad": ("mrad", 1e3), "mm": ("mm", 1.0), "px": ("px", 1.0)}


def model_sentence(check: ModelCheck) -> str:
    """The verdict: what the residuals follow and what to switch on or measure, or that no test finds a pattern."""
    if check.causes:
        by_kind: dict[Kind, list[Found]] = {}
        for cause in check.causes:
            by_kind.setdefault(cause.kind, []).append(cause)
        said = [_SAID[kind](own) for kind, own in by_kind.items()]
        followed = "; they ".join(what for what, _ in said)
        return f"the residuals {followed}: {'; '.join(dict.fromkeys(advice for _, advice in said))}"
    if not check.tests:
        nothing = "the measurements leave too little over to look for a pattern in the residuals"
    else:
        nothing = f"no test finds a pattern in the residuals ({len(check.tests)} were tried)"
    if check.lacking:
        return (
            f"{nothing}, but {'; '.join(_larger(each) for each in check.lacking)}: the noise is taken too small, or "
            "the model lacks something else"
        )
    judged = [each for each in check.lack if each.p is not None]
    if not judged:
        return (
            f"{nothing}; whether they are larger than the noise is not judged: it is not stated, and no posture was "
            "measured again"
        )
    return f"{nothing}, and they are no larger than they should be: {'; '.join(_larger(each) for each in judged)}"


def _larger(each: LackOfFit) -> str:
    return f"{each.group} residuals are {each.said}"


def _joints(causes: Sequence[Found]) -> str:
    joints = [str(joint) for joint in sorted({cause.joint for cause in causes})]
    return f"joint{'s' if len(joints) > 1 else ''} {listed(joints)}"


def _measure(cause: Found, *amounts: str) -> str:
    """Amounts, share of the residuals and probability in brackets."""
    shown = [*amounts, *([_share(cause)] if cause.rms is not None and cause.of else []), f"p = {_p(cause.beside)}"]
    return f"({'; '.join(shown)})"


def _share(cause: Found) -> str:
    unit, factor = _SHOWN[cause.of_unit]
    return f"{number((cause.rms or 0.0) * factor, 2)} of the {number((cause.of or 0.0) * factor, 2)} {unit} rms"


def _p(value: float) -> str:
    return "0" if value == 0 else f"{value:.1g}"


def _size(cause: Found) -> str:
    unit, factor = _SHOWN[cause.unit]
    own = f"{number((cause.amplitude or 0.0) * factor, 2)} {unit}"
    if cause.unit != "rad" or cause.at_tool is None:
        return own
    return f"{own}, {number(cause.at_tool, 2)} mm at the tool"


def _gravity(causes: Sequence[Found]) -> tuple[str, str]:
    return f"follow gravity at {_joints(causes)} {_measure(causes[0])}", _AUTO


def _waves(causes: Sequence[Found]) -> tuple[str, str]:
    waves = [
        f"joint {c.joint}, {_TIMES.get(c.k, f'{c.k} times')} to a turn {_measure(c, _size(c))}"
        for c in sorted(causes, key=lambda c: (c.joint, c.k))
    ]
    more = [f"harmonics {k}" for k in sorted({c.k for c in causes})]
    advice = _AUTO
    if any(c.k > _IN_AUTO for c in causes):
        advice = f"add `identification: {{extend: [{', '.join(more)}]}}`"
    return f"follow a wave of {listed(waves)}", f"an eccentric encoder or gear would do that; {advice}"


def _angles(causes: Sequence[Found]) -> tuple[str, str]:
    what = f"grow with the reading of {_joints(causes)} {_measure(causes[0], f'{_size(causes[0])} to either side')}"
    return what, "a wrong gear ratio would do that; add `identification: {extend: [ratio]}`"


def _directions(causes: Sequence[Found]) -> tuple[str, str]:
    what = f"depend on the direction from which {_joints(causes)} came {_measure(causes[0], _size(causes[0]))}"
    if all(cause.stated for cause in causes):
        return what, f"play does that; {_AUTO}"
    columns = [direction_name(joint) for joint in sorted({c.joint for c in causes if not c.stated})]
    return what, f"play does that; give the column{'s' if len(columns) > 1 else ''} {listed(columns)} and {_AUTO}"


def _drifts(causes: Sequence[Found]) -> tuple[str, str]:
    unit, factor = _SHOWN[causes[0].unit]
    size = f"{number((causes[0].amplitude or 0.0) * factor, 2)} {unit} over the run"
    what = f"follow the order of the measurements {_measure(causes[0], size)}"
    return what, f"the instrument, the target or the base moved; {_REFERENCE}"


def _neighbours(causes: Sequence[Found]) -> tuple[str, str]:
    what = f"are alike from one measurement to the next {_measure(causes[0], _correlated(causes[0]))}"
    return what, f"something changes slowly, such as a temperature; {_REFERENCE}, and mix the order of the postures"


def _reaches(causes: Sequence[Found]) -> tuple[str, str]:
    grow = "grow" if (causes[0].correlation or 0.0) > 0 else "shrink"
    what = f"{grow} with the distance from the first turning axis {_measure(causes[0], _correlated(causes[0]))}"
    return what, (
        "joints that do not repeat, or an instrument that is worse at some distances; measure postures twice to tell, "
        "and give columns sigma_*"
    )


def _correlated(cause: Found) -> str:
    return f"correlation {number(cause.correlation or 0.0, 2)}"


_SAID: dict[Kind, Callable[[Sequence[Found]], tuple[str, str]]] = {
    "gravity": _gravity,
    "harmonic": _waves,
    "angle": _angles,
    "direction": _directions,
    "drift": _drifts,
    "neighbours": _neighbours,
    "reach": _reaches,
}


def model_warnings(check: ModelCheck) -> tuple[str, ...]:
    """The sentence, where the model lacks something."""
    return (model_sentence(check),) if check.causes or check.lacking else ()


def model_check_facts(check: ModelCheck) -> dict[str, Any]:
    """All numbers for results.json; amplitudes of turning joints in rad, residuals in mm, rad or px."""
    return {
        "sentence": model_sentence(check),
        "level": LEVEL,
        "lacks": bool(check.causes or check.lacking),
        "lack_of_fit": [{**asdict(each), "said": each.said} for each in check.lack],
        "causes": [cause.name for cause in check.causes],
        "tests": [asdict(test) for test in check.tests],
        "untested_joints": list(check.untested),
    }
