"""What must not reach a controller without being asked for twice.

A fit always returns numbers. Whether they are worth a controller was decided where the calibration was judged
(`symcal.calibration.decision`), and the robot carries that decision: here it is asked for, in the same words. What the
data did not tell stays near nominal and does no harm.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.calibration.decision import Decision
from symcal.calibration.implausible import implausible
from symcal.calibration.reasons import Reason
from symcal.errors import RefusedError
from symcal.robot.robot import Robot

_NO_BETTER = 0.02  # relative gain that is none, of files whose errors are known by their rms alone


def doubts(robot: Robot) -> tuple[Reason, ...]:
    """What speaks against using a calibration on a controller; empty for a nominal robot, and for an accepted one."""
    if robot.record is None:
        return ()
    provenance = robot.record.provenance
    decision = Decision.recalled(provenance.get("decision"))
    found = decision.reasons if decision is not None else _of_earlier_file(provenance)
    said = [reason.text for reason in found] + ([] if decision is None else list(decision.cautions))
    new = (reason for reason in implausible(robot) if not any(text.startswith(reason.text) for text in said))
    return (*found, *new)


def check_exportable(robot: Robot, force: bool = False) -> tuple[Reason, ...]:
    """Let a calibration pass to a controller, or refuse it by name and reason.

    Returns:
        the doubts that ``force`` overrode.
    Raises:
        RefusedError: there are doubts and ``force`` is False.
    """
    found = doubts(robot)
    if found and not force:
        reasons = "; ".join(doubt.text for doubt in found)
        raise RefusedError(
            f"this calibration of {robot.name} should not go to a controller: {reasons}. Look for the mistake in the "
            "measurements or the robot file, hold parameters at nominal, state their true scales, or force the export"
        )
    return found


def _of_earlier_file(provenance: Mapping[str, Any]) -> tuple[Reason, ...]:
    """The same of a file that carries no decision, by what else it carries: how the fit ended, and its errors."""
    if provenance.get("trouble"):
        return (Reason("unsettled", f"the identification did not converge: {provenance['trouble']}"),)
    accuracy = provenance.get("accuracy") or {}
    try:
        part = next(name for name in ("test", "cross_validation") if "after" in accuracy.get(name, {}))
        before, after = (_rms(accuracy[part][state]) for state in ("before", "after"))
    except (KeyError, TypeError, ValueError, AttributeError, StopIteration):
        text = (
            "it was never judged by poses that it was not made from: judge it on new measurements with 'symcal "
            "validate', or identify it again"
        )
        return (Reason("unjudged", text),)
    if after > (1 - _NO_BETTER) * before:
        text = f"it is no better ({after:.3g} rms) than the nominal robot with fitted frames ({before:.3g})"
        return (Reason("no_gain", text),)
    return ()


def _rms(quantities: Mapping[str, Any]) -> float:
    """Of the quantity that judges."""
    return float(next(facts["rms"] for name, facts in quantities.items() if name != "orientation_deg"))
