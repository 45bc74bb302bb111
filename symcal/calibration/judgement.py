"""What a decision about an identification is made of, gathered from a run, a calibration or a validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.claims import outside
from symcal.calibration.compare import compare
from symcal.calibration.decision import Decision, decide
from symcal.calibration.evaluate import Errors
from symcal.calibration.evidence import Evidence, Lack
from symcal.calibration.foretold_errors import foremost, open_errors, uncalibrated
from symcal.calibration.implausible import conceivable, implausible, large_terms
from symcal.calibration.left_out import left_out
from symcal.calibration.mistakes.mistake import mistake_facts
from symcal.calibration.outliers import outlier_facts
from symcal.calibration.tolerance import Tolerance
from symcal.calibration.tolerance_rules import GROSS
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.model.model import State
from symcal.robot.given import is_given
from symcal.robot.robot import Robot
from symcal.units import DEGREES

Array = NDArray[np.float64]
Area = tuple[Array, Array]

_POSTURES = 256  # of the working area, or measured ones
_SLIPS = 0.1  # of the held-out poses: more are no slips


def decide_run(
    calibration: Calibration,
    data: Dataset,
    errors: Mapping[str, Mapping[str, Errors]],
    content: Mapping[str, Any],
    options: Options,
    tolerance: Tolerance | None = None,
    area: Area | None = None,
    test: Array | None = None,
) -> Decision:
    """The decision about an identification and all that a run found of it.

    Args:
        errors: by part and state. content: of results.json; its `outliers`, `mistakes`, `halves`, `model_check`,
            `identification` and `identifiability` are looked at. area: lower and upper readings of the working area,
            shape (dof,) each, where one is stated. test: poses that judge, shape (N, dof), where they are not in the
            data.
    """
    errors = {part: states for part, states in errors.items() if part != "truth"}
    after = calibration.after
    train = data.part("train").q
    held_out = data.part("test").q if test is None else test
    if not {"test", "cross_validation"} & set(errors):
        own = left_out(calibration, data, options)
        errors |= {} if own is None else {"left_out": own}
    measured, postures = np.vstack([train, held_out]), None
    if area is not None:
        postures = area[0] + (area[1] - area[0]) * np.random.default_rng(0).random((_POSTURES, len(area[0])))
    found = Evidence(
        errors,
        trouble=after.trouble,
        implausible=implausible(calibration.robot),
        uncalibrated=uncalibrated(calibration.before, train, *_stated_noise(calibration)),
        outliers=content.get("outliers", ()),
        mistakes=content.get("mistakes", ()),
        halves=content.get("halves"),
        large=large_terms(calibration.robot),
        conceivable=conceivable(calibration.robot),
        aside=_slips(data, content.get("outliers", ())),
        frames_only=is_given(calibration.robot),
    )
    if tolerance is not None and np.isfinite(after.x).all():
        asked = _some(measured) if postures is None else postures
        found = replace(
            found,
            open=open_errors(calibration.model, after, asked, tolerance.of),
            over="the measured poses" if postures is None else "the working area",
            foremost=foremost(calibration.model, after, asked) if after.free else "",
            outside=None if postures is None else outside(measured, postures, "the working area"),
            lacks=_lacks(content),
        )
    return decide(found, tolerance)


def decide_alone(calibration: Calibration, data: Dataset, options: Options) -> Decision:
    """The decision about a calibration beside which nothing else was found: by the test poses of its data, or without
    any by the training poses, left out in turn."""
    errors: dict[str, Mapping[str, Errors]] = {}
    if "test" in data.split:
        with suppress(RefusedError):  # what judges has read nothing there
            errors["test"] = compare(calibration, data.part("test"))
    facts = {"outliers": outlier_facts(calibration.outliers), "mistakes": mistake_facts(calibration.mistakes)}
    return decide_run(calibration, data, errors, facts, options)


def decide_validation(
    robot: Robot,
    before: State,
    errors: Mapping[str, Errors],
    q: Array,
    content: Mapping[str, Any],
    tolerance: Tolerance | None = None,
) -> Decision:
    """The decision about a calibrated robot by new measurements alone.

    Args:
        before: of the nominal robot. errors: `before` and `after`, of the new measurements at poses q, shape (N, dof).
        content: of results.json; its `mistakes` and `halves` are looked at.
    """
    trouble = "" if robot.record is None else str(robot.record.provenance.get("trouble") or "")
    found = Evidence(
        {"test": errors},
        trouble,
        implausible(robot),
        uncalibrated(before, q),
        mistakes=content.get("mistakes", ()),
        halves=content.get("halves"),
        conceivable=conceivable(robot),
        frames_only=is_given(robot),
    )
    return decide(found, tolerance)


def with_decision(calibration: Calibration, decision: Decision) -> Calibration:
    """The calibration whose robot carries the decision."""
    return replace(calibration, robot=decided_robot(calibration.robot, decision))


def decided_robot(robot: Robot, decision: Decision) -> Robot:
    """A calibrated robot with the decision about it, which goes with its file; a nominal one stays."""
    if robot.record is None:
        return robot
    provenance = {**robot.record.provenance, "decision": decision.facts}
    return replace(robot, record=replace(robot.record, provenance=provenance))


def _some(poses: Array) -> Array:
    """Poses, or as many random ones of them as stand for all."""
    if len(poses) <= _POSTURES:
        return poses
    return np.asarray(poses[np.sort(np.random.default_rng(0).choice(len(poses), _POSTURES, replace=False))])


def _slips(data: Dataset, outliers: Sequence[Mapping[str, Any]]) -> dict[int, str]:
    """Held-out poses with a reading that is no accident of any noise, by number; none where they are many."""
    gross = {str(each["pose"]) for each in outliers if each.get("split") == "test" and each["noises"] > GROSS}
    labels = data.part("test").labels
    found = {i: label for i, label in enumerate(labels) if label in gross}
    return found if len(found) <= _SLIPS * len(labels) else {}


def _stated_noise(calibration: Calibration) -> tuple[float, float]:
    """Rms of the largest noise that is stated, mm and deg, over whole readings; 0 where it is estimated."""
    after, sizes = calibration.after, {"mm": 0.0, "rad": 0.0, "px": 0.0}
    for group in calibration.model.measurement.groups:
        if group.name in after.sigmas and group.name not in after.estimated:
            sizes[group.unit] = max(sizes[group.unit], float(after.sigmas[group.name]) * float(np.sqrt(group.block)))
    return sizes["mm"], sizes["rad"] * DEGREES


def _lacks(content: Mapping[str, Any]) -> tuple[Lack, ...]:
    """What the check of the model says is missing, with its size in mm or deg where it has one."""
    check = content.get("model_check") or {}
    units = {"mm": ("mm", 1.0), "rad": ("deg", DEGREES)}
    found = []
    for test in check.get("tests", ()):
        if test["name"] in check["causes"] and test["rms"] is not None and test["of_unit"] in units:
            unit, factor = units[test["of_unit"]]
            found.append(Lack(test["name"], test["rms"] * factor, unit))
    noise = content.get("identification", {}).get("noise", {})
    judged = sum(each["p"] is not None for each in check.get("lack_of_fit", ()))
    for each in check.get("lack_of_fit", ()):
        own = noise.get(each["group"])
        if own is None or own["unit"] == "px" or each["p"] is None or each["p"] * judged >= check["level"]:
            continue
        # stated noise leaves sigma as it is, beside which the residuals are; repeated postures find it inside of sigma
        squared = each["ratio"] ** 2 - 1 if each["against"] == "stated noise" else 1 - 1 / each["ratio"] ** 2
        size = own["sigma"] * float(np.sqrt(max(squared, 0.0)))
        found.append(Lack(f"something beyond the {each['against']} of {each['group']}", size, own["unit"]))
    return tuple(found)
