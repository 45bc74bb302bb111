"""What a check of the model says: one sentence with the likely cause and what to do, and all of it as numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from symcal.calibration.candidates import AUTO, CONDITIONED
from symcal.calibration.lack_of_fit import LackOfFit
from symcal.calibration.model_check import LEVEL, Found, ModelCheck
from symcal.calibration.patterns import Kind
from symcal.joints.backlash import direction_name
from symcal.units import in_mrad
from symcal.words import listed, number

_REFERENCE = "measure a reference posture now and then"
_TIMES = {1: "once", 2: "twice"}
_NAMED = 2  # kinds of cause, and waves, that the sentence names
_KINDS: dict[Kind, str] = {
    "gravity": "gravity",
    "harmonic": "waves of joints",
    "angle": "readings of joints",
    "approach": "directions of approach",
    "drift": "the order of the measurements",
    "neighbours": "the measurement before",
    "reach": "the reach",
}


def model_sentence(check: ModelCheck, tried: Sequence[str] = ()) -> str:
    """The verdict: what the residuals follow and what to switch on or measure, or that no test finds a pattern.

    The foremost causes are named; all of them are in the facts.

    Args:
        tried: groups of joint terms that the identification has tried, or `auto`.
    """
    if check.causes:
        by_kind: dict[Kind, list[Found]] = {}
        for cause in check.causes:
            by_kind.setdefault(cause.kind, []).append(cause)
        said = [_SAID[kind](own) for kind, own in list(by_kind.items())[:_NAMED]]
        followed = "; they ".join(each.what for each in said)
        more = list(by_kind)[_NAMED:]
        others = f"; less so {listed([_KINDS[kind] for kind in more])} (see the table)" if more else ""
        advice = [each.means for each in said if each.means] + _extended(
            [g for each in said for g in each.groups], tried
        )
        return f"the residuals {followed}{others}: {'; '.join(advice)}"
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
    unit, factor = in_mrad(cause.of_unit)
    return f"{number((cause.rms or 0.0) * factor, 2)} of the {number((cause.of or 0.0) * factor, 2)} {unit} rms"


def _p(value: float) -> str:
    return "0" if value == 0 else f"{value:.1g}"


def _size(cause: Found) -> str:
    unit, factor = in_mrad(cause.unit)
    own = f"{number((cause.amplitude or 0.0) * factor, 2)} {unit}"
    if cause.unit != "rad" or cause.at_tool is None:
        return own
    return f"{own}, {number(cause.at_tool, 2)} mm at the tool"


def _extended(groups: Sequence[str], tried: Sequence[str]) -> list[str]:
    """What to switch on, beside what was tried."""
    had = AUTO if tuple(tried) == ("auto",) else tuple(tried)
    new = [group for group in dict.fromkeys(groups) if group not in had]
    if not new:
        return []
    again = [group for group in had if group not in CONDITIONED]  # the data may carry nothing for these
    wanted = "auto" if not had and set(new) <= set(AUTO) else f"[{', '.join([*again, *new])}]"
    return [f"set `identification: {{extend: {wanted}}}`"]


@dataclass(frozen=True, slots=True)
class _Said:
    """what: the residuals do. means: what does that, or what to measure. groups: of terms that would take it up."""

    what: str
    means: str
    groups: tuple[str, ...] = ()


def _gravity(causes: Sequence[Found]) -> _Said:
    return _Said(f"follow gravity at {_joints(causes)} {_measure(causes[0])}", "", ("gravity",))


def _waves(causes: Sequence[Found]) -> _Said:
    waves = [f"joint {c.joint}, {_TIMES.get(c.k, f'{c.k} times')} to a turn {_measure(c, _size(c))}" for c in causes]
    more = [f"{len(waves) - _NAMED} more"] if len(waves) > _NAMED else []
    groups = tuple(f"harmonics {k}" for k in sorted({c.k for c in causes}))
    means = "an eccentric encoder or gear would do that"
    return _Said(f"follow a wave of {listed([*waves[:_NAMED], *more])}", means, groups)


def _angles(causes: Sequence[Found]) -> _Said:
    what = f"grow with the reading of {_joints(causes)} {_measure(causes[0], f'{_size(causes[0])} to either side')}"
    return _Said(what, "a wrong gear ratio would do that", ("ratio",))


def _directions(causes: Sequence[Found]) -> _Said:
    what = f"depend on the direction from which {_joints(causes)} came {_measure(causes[0], _size(causes[0]))}"
    columns = [direction_name(joint) for joint in sorted({c.joint for c in causes if not c.stated})]
    give = f"; give the column{'s' if len(columns) > 1 else ''} {listed(columns)}" if columns else ""
    return _Said(what, f"play does that{give}", ("backlash",))


def _drifts(causes: Sequence[Found]) -> _Said:
    unit, factor = in_mrad(causes[0].unit)
    size = f"{number((causes[0].amplitude or 0.0) * factor, 2)} {unit} over the run"
    what = f"follow the order of the measurements {_measure(causes[0], size)}"
    return _Said(what, f"the instrument, the target or the base moved; {_REFERENCE}")


def _neighbours(causes: Sequence[Found]) -> _Said:
    what = f"are alike from one measurement to the next {_measure(causes[0], _correlated(causes[0]))}"
    means = f"something changes slowly, such as a temperature; {_REFERENCE}, and mix the order of the postures"
    return _Said(what, means)


def _reaches(causes: Sequence[Found]) -> _Said:
    grow = "grow" if (causes[0].correlation or 0.0) > 0 else "shrink"
    what = f"{grow} with the distance from the first turning axis {_measure(causes[0], _correlated(causes[0]))}"
    means = (
        "joints that do not repeat, or an instrument that is worse at some distances; measure postures twice to tell, "
        "and give columns sigma_*"
    )
    return _Said(what, means)


def _correlated(cause: Found) -> str:
    return f"correlation {number(cause.correlation or 0.0, 2)}"


_SAID: dict[Kind, Callable[[Sequence[Found]], _Said]] = {
    "gravity": _gravity,
    "harmonic": _waves,
    "angle": _angles,
    "approach": _directions,
    "drift": _drifts,
    "neighbours": _neighbours,
    "reach": _reaches,
}


def model_warnings(check: ModelCheck, tried: Sequence[str] = ()) -> tuple[str, ...]:
    """The sentence, where the model lacks something."""
    return (model_sentence(check, tried),) if check.causes or check.lacking else ()


def model_check_facts(check: ModelCheck, tried: Sequence[str] = ()) -> dict[str, Any]:
    """All numbers for results.json; amplitudes of turning joints in rad, residuals in mm, rad or px."""
    return {
        "sentence": model_sentence(check, tried),
        "level": LEVEL,
        "lacks": bool(check.causes or check.lacking),
        "lack_of_fit": [{**asdict(each), "said": each.said} for each in check.lack],
        "causes": [cause.name for cause in check.causes],
        "tests": [asdict(test) for test in check.tests],
        "untested_joints": list(check.untested),
    }
