"""Accept or refuse a calibration, with the reasons: decided once from what was found, and the same wherever it is said.

Every rule is a sentence about one thing. Where a tolerance is given, errors and what could make errors are held against
it; where none is, the calibration must be better than the nominal robot with fitted frames by more than chance. A
calibration is accepted where no rule has a reason against it. The rules and their limits are ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from symcal.calibration.claims import Gain, where_judged
from symcal.calibration.evaluate import Errors
from symcal.calibration.evidence import Evidence
from symcal.calibration.reasons import KINDS, Reason
from symcal.calibration.tolerance import Tolerance
from symcal.calibration.tolerance_rules import against, basis, cautions
from symcal.errors import InputError
from symcal.words import number

WORTHLESS = 3.0
"""Times the error of a robot that was never calibrated, by its plausible sizes: what is left beyond is no calibration's
error."""

HARDLY = 0.9
"""Of the error of the nominal robot: what leaves more of it, and more than robots are off, has found nothing."""

_CONFIRMED = 3.0
"""Times that a calibration must err less than the nominal robot at unseen poses for these to confirm large errors of
the robot file."""


@dataclass(frozen=True, slots=True)
class Decision:
    """Accepted or refused.

    tolerance: against what; None: against the nominal robot with fitted frames. reasons: against it. basis: what was
    found and against what it was held, in a sentence without a full stop. cautions: what an acceptance leaves open.
    """

    tolerance: Tolerance | None
    reasons: tuple[Reason, ...]
    basis: str = ""
    cautions: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        return not self.reasons

    @property
    def sentence(self) -> str:
        """`accepted: ...` or `refused: ...; ...`."""
        if self.accepted:
            return f"accepted: {self.basis}"
        return f"refused: {'; '.join(reason.text for reason in self.reasons)}"

    @property
    def facts(self) -> dict[str, Any]:
        """As results.json and calibrated.yaml have it."""
        return {
            "accepted": self.accepted,
            "tolerance": None if self.tolerance is None else self.tolerance.facts,
            "reasons": [
                {"kind": r.kind, "text": r.text} | ({"parameter": r.parameter} if r.parameter else {})
                for r in self.reasons
            ],
            "basis": self.basis,
            "cautions": list(self.cautions),
            "sentence": self.sentence,
        }

    @staticmethod
    def recalled(facts: Any) -> Decision | None:
        """The decision of such `facts`; None where they are none, or say that they accept what has reasons."""
        try:
            tolerance = facts["tolerance"]
            found = Decision(
                None if tolerance is None else Tolerance.recalled(tolerance),
                tuple(Reason(r["kind"], str(r["text"]), str(r.get("parameter", ""))) for r in facts["reasons"]),
                str(facts["basis"]),
                tuple(str(caution) for caution in facts["cautions"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError, InputError):
            return None
        whole = all(reason.kind in KINDS and reason.text for reason in found.reasons)
        return found if whole and facts.get("accepted") is found.accepted else None


def decide(found: Evidence, tolerance: Tolerance | None = None) -> Decision:
    """Accept or refuse what was found.

    Args:
        tolerance: None: the calibration must be better than the nominal robot by more than chance.
    """
    gain = Gain.of(found.errors, found.aside)
    reasons = list(_always(found, gain))
    if tolerance is None:
        reasons += _without_tolerance(gain, found.frames_only)
        text = gain and (_frames_text(gain) if found.frames_only else gain.text)
        said = f"{text}; no tolerance was given" if text else ""
        return Decision(None, tuple(reasons), said, tuple(_cautions(found, gain, reasons)))
    reasons += against(found, tolerance)
    open_ = [*_cautions(found, gain, reasons), *cautions(found, tolerance)]
    if gain is not None and not gain.beyond_chance and not found.frames_only:
        open_.append(gain.text)
    return Decision(tolerance, tuple(reasons), basis(found, tolerance), tuple(open_))


def _always(found: Evidence, gain: Gain | None) -> Iterator[Reason]:
    """What speaks against a calibration whatever is asked of it."""
    if found.trouble:
        yield Reason("unsettled", f"the identification did not converge: {found.trouble}")
    for mistake in found.mistakes:
        yield Reason("mistake", str(mistake["text"]))
    confirmed = _confirmed(found, gain)
    yield from (reason for reason in found.implausible if reason not in confirmed)
    yield from _worthless(found)


def _confirmed(found: Evidence, gain: Gain | None) -> tuple[Reason, ...]:
    """Implausible errors that poses which the calibration was not made from confirm."""
    if gain is None or not gain.beyond_chance or _CONFIRMED * gain.after > gain.before:
        return ()
    return tuple(reason for reason in found.implausible if reason.parameter in found.conceivable)


def _worthless(found: Evidence) -> Iterator[Reason]:
    if found.part is None:
        return
    after, before = (found.errors[found.part].get(state) for state in ("after", "before"))
    assert after is not None
    was = None if before is None else before.statistics.rms
    sizes = [
        (after.statistics.rms, was, after.unit, after.vectors.shape[1] / 3 if after.unit == "mm" else 1.0, "error")
    ]
    if after.orientation is not None and after.orientation.size:
        turned = None if before is None or before.orientation is None else _degrees_rms(before)
        sizes.append((_degrees_rms(after), turned, "deg", 1.0, "orientation error"))
    for rms, nominal, unit, share, what in sizes:
        usual = found.uncalibrated.of(unit)
        if usual is None:
            continue
        usual *= float(np.sqrt(share))  # of a length alone, an error has a third of its squares
        said = f"{where_judged(found.part)} the {what} is {number(rms)} {unit} rms, where even a robot that was never "
        off = f"calibrated is off by about {number(usual)} {unit}"
        if rms > WORTHLESS * usual:
            yield Reason("worthless", f"{said}{off}: the measurements are not of this robot as it is described")
        elif nominal is not None and rms > usual and HARDLY * nominal < rms < nominal:
            yield Reason(
                "worthless",
                f"{said}{off}, and the nominal one by hardly more, {number(nominal)} {unit}: what was identified is "
                "not what is wrong",
            )


def _without_tolerance(gain: Gain | None, frames_only: bool) -> Iterator[Reason]:
    if gain is None:
        yield Reason("unjudged", "nothing was held out of the identification, so nothing says what it is worth")
    elif not gain.beyond_chance and not frames_only:
        yield Reason("no_gain", gain.text)


def _frames_text(gain: Gain) -> str:
    """What frames of a robot whose poses are data leave, in a sentence without a full stop."""
    return f"{where_judged(gain.part)} the frames, which alone were estimated, leave {gain.after:.3g} {gain.unit} rms"


def _cautions(found: Evidence, gain: Gain | None, reasons: Sequence[Reason]) -> Iterator[str]:
    """What to be careful with that no reason says."""
    if found.part == "left_out":
        yield "no pose was held out: poses were left out in turn of the linearised fit"
    if found.aside:
        names = ", ".join(found.aside.values())
        slips = f"poses {names} set aside as slips" if len(found.aside) > 1 else f"pose {names} set aside as a slip"
        yield f"held-out {slips}: measure again there"
    yield from found.large
    for reason in _confirmed(found, gain):
        yield f"{reason.text}; unseen poses confirm it: is the robot file of this robot?"
    halves = found.halves or {}
    told = any(reason.kind == "halves" for reason in reasons)
    if halves.get("agree") is False and halves.get("text") and not told:
        yield str(halves["text"])


def _degrees_rms(errors: Errors) -> float:
    assert errors.orientation is not None
    return float(np.degrees(np.sqrt(np.mean(errors.orientation**2))))
