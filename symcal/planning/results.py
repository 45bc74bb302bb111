"""The numbers of a plan as plain data for results.json and tables; units in the keys."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.results import noise_facts
from symcal.compensation.targets import joint_columns
from symcal.config.plan import AreaRegion, BoxRegion, FileRegion
from symcal.model.measurement import Measurement
from symcal.outputs.csv_text import Rows, rows_of
from symcal.parameters import coordinate_names
from symcal.planning.accuracy_forecast.forecast import Forecast, PosesNeeded
from symcal.planning.accuracy_forecast.random_band import RandomBand
from symcal.planning.constraints import complaints
from symcal.planning.drive_plan import Planned
from symcal.planning.plan_problem import PlanProblem
from symcal.planning.proof.proof import Proof
from symcal.planning.sampling import feasible_shares
from symcal.planning.search import Plan
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_SMALLER_IS_BETTER = ("A", "cond", "I", "G", "J")


def plan_facts(plan: Plan, measurement: Measurement) -> dict[str, Any]:
    """The plan, its certificate and prediction, with random plans beside it."""
    proof, foretold, random = plan.certificate, plan.prediction, plan.random
    out: dict[str, Any] = {
        "poses": len(plan),
        "rank": plan.rank,
        **noise_facts(plan.sigmas, measurement),
        "method": plan.method,
        "criterion": plan.criterion,
        "criterion_value": plan.value,
        "criterion_efficiency_lower_bound": proof.criterion_efficiency_lower_bound,
        "d_efficiency_lower_bound": proof.d_efficiency_lower_bound,
        "g_efficiency": proof.g_efficiency,
        "worst_pose_rms_mm": foretold.worst_pose_rms_mm,
        "mean_pose_rms_mm": foretold.mean_pose_rms_mm,
        "hidden_mm": foretold.hidden_mm,
        "search_seconds": plan.search_seconds,
        "certificate": {
            "statement": proof.statement,
            "gap": proof.gap,
            "searched": proof.searched,
            "exhaustive": proof.exhaustive,
            "proof": proof_facts(proof.proof),
            "unproven": proof.unproven,
        },
        "random": None,
    }
    if random is not None:
        out["random"] = {
            "plans": random.plans,
            "d_efficiency_lower_bound": random.d_efficiency_lower_bound,
            "g_efficiency": random.g_efficiency,
            "worst_pose_rms_mm": _finite(random.worst_pose_rms_mm),
            "mean_pose_rms_mm": _finite(random.mean_pose_rms_mm),
        }
    return out


def proof_facts(proof: Proof | None) -> dict[str, Any] | None:
    """What is proven; None where nothing is."""
    if proof is None:
        return None
    return {
        "d_efficiency_lower_bound": proof.d_efficiency,
        "g_efficiency_lower_bound": proof.g_efficiency,
        "criterion_efficiency_lower_bound": proof.criterion_efficiency,
        "open_share": proof.open_share,
        "boxes": proof.boxes,
        "joints": proof.joints,
        "rounding": proof.rounding,
        "missed": proof.missed,
    }


def _finite(value: float) -> float | None:
    """JSON has no infinity; random plans that determine nothing have an infinite error."""
    return value if math.isfinite(value) else None


def efficiency_over_time(plan: Plan, best: float | None = None) -> list[tuple[float, float]]:
    """(seconds, efficiency by the plan's own criterion) of the best plan so far.

    For D it is the searched lower bound, as for all criteria that have one; for the others the ratio to ``best``, the
    best value that any method found, is all there is.
    """
    proof = plan.certificate
    final = proof.criterion_efficiency_lower_bound
    if plan.criterion == "D":
        end = proof.d_efficiency_lower_bound
        return [(t, end * math.exp((value - plan.value) / plan.rank)) for t, value in plan.history]
    larger = plan.criterion not in _SMALLER_IS_BETTER
    reference, end = (plan.value, final) if final is not None else (plan.value if best is None else best, 1.0)
    return [
        (t, end * (value / reference if larger else reference / value))
        for t, value in plan.history
        if value > 0 and math.isfinite(value)
    ]


def has_bound(plan: Plan) -> bool:
    """Whether there is a bound for the plan by its own criterion."""
    return plan.certificate.criterion_efficiency_lower_bound is not None


def best_value(plans: Mapping[str, Plan]) -> float:
    """The best value of the common criterion that any method reached."""
    values = [plan.value for plan in plans.values()]
    smaller = next(iter(plans.values())).criterion in _SMALLER_IS_BETTER
    return min(values) if smaller else max(values)


def method_facts(plans: Mapping[str, Plan]) -> dict[str, Any]:
    """Methods side by side, each with its history."""
    best = best_value(plans)
    return {
        name: {
            "criterion_value": plan.value,
            "d_efficiency_lower_bound": plan.certificate.d_efficiency_lower_bound,
            "g_efficiency": plan.certificate.g_efficiency,
            "worst_pose_rms_mm": plan.prediction.worst_pose_rms_mm,
            "mean_pose_rms_mm": plan.prediction.mean_pose_rms_mm,
            "search_seconds": plan.search_seconds,
            "history": {
                "quantity": "lower bound" if has_bound(plan) else "relative to the best found",
                "seconds": [seconds for seconds, _ in efficiency_over_time(plan, best)],
                "efficiency": [efficiency for _, efficiency in efficiency_over_time(plan, best)],
            },
        }
        for name, plan in plans.items()
    }


def promise_facts(
    promise: Forecast | None, band: RandomBand | None, needed: Sequence[PosesNeeded]
) -> dict[str, Any] | None:
    """Predicted errors against the number of poses, and the poses that wanted accuracies need."""
    if promise is None or band is None:
        return None
    table = [
        {
            "poses": count,
            "best_mean_mm": promise.best_mean_mm[i],
            "best_worst_mm": promise.best_worst_mm[i],
            "random_mean_mm": _finite(promise.random_mean_mm[i]),
            "random_worst_mm": _finite(promise.random_worst_mm[i]),
            "random_mean_low_mm": _finite(band.low_mm[i]),
            "random_mean_high_mm": _finite(band.high_mm[i]),
            "bound_mean_mm": promise.bound_mean_mm[i],
            "bound_worst_mm": promise.bound_worst_mm[i],
        }
        for i, count in enumerate(promise.counts)
    ]
    return {
        "hidden_mm": promise.hidden_mm,
        "table": table,
        "needed": [
            {
                "accuracy_mm": n.target_mm,
                "figure": n.figure,
                "poses": n.count,
                "at_least": n.at_least,
                "random": n.random,
                "mean_pose_rms_mm": n.prediction.mean_pose_rms_mm,
                "worst_pose_rms_mm": n.prediction.worst_pose_rms_mm,
            }
            for n in needed
        ],
    }


def order_facts(planned: Planned) -> dict[str, Any]:
    """The way: time, kinds of its segments and why some are no lines."""
    motion = planned.motion
    reasons: dict[str, int] = {}
    for segment in motion.segments:
        if segment.why:
            reasons[segment.why] = reasons.get(segment.why, 0) + 1
    return {
        "time_s": motion.total_time if planned.timed else None,
        "segments": {kind: motion.kinds.count(kind) for kind in ("line", "joint")},
        "no_line_because": reasons,
        "conflicts": list(motion.conflicts),
        "poses": list(planned.names),
        "required": [name for name, must in zip(planned.names, planned.required, strict=True) if must],
    }


def constraint_facts(problem: PlanProblem, distance: float) -> dict[str, Any]:
    """Which part of the working area each constraint leaves, and candidates that break them, by name."""
    together, alone = feasible_shares(problem.area, problem.measuring) if problem.measuring else (1.0, {})
    broken: tuple[str, ...] = ()
    if problem.candidates is not None and problem.measuring:
        broken = complaints(problem.measuring, problem.candidates, [f"candidate {n}" for n in problem.candidate_names])
    return {
        "feasible_share": together,
        "feasible_share_of_each_alone": alone,
        "distance": distance,
        "infeasible_candidates": list(broken),
    }


def region_words(wanted: AreaRegion | BoxRegion | FileRegion | None, constrained: bool) -> str:
    """The task region in words."""
    if isinstance(wanted, AreaRegion):
        ranges = [f"{name} {low:g} to {high:g}" for name, (low, high) in wanted.area.items()]
        return f"the working area{' with ' + ', '.join(ranges) if ranges else ''}, whether or not it can be measured"
    if isinstance(wanted, BoxRegion):
        return f"poses of the working area with the tool between {wanted.lower} and {wanted.upper} in world"
    if isinstance(wanted, FileRegion):
        return f"the poses of {wanted.file}"
    return "the part of the working area that can be measured" if constrained else "the working area"


def plan_notes(problem: PlanProblem, planned: Planned) -> list[str]:
    """What the user should know before driving."""
    notes = list(planned.motion.conflicts)
    measurement, points = problem.info.measurement, problem.info.setup.points
    unknown = [
        name.removeprefix("tool_")
        for name, point in zip(measurement.points_called, points, strict=True)
        if coordinate_names(name)[0] in measurement.parameters.names and not point.any()
    ]
    if unknown:
        notes.append(
            f"where {', '.join(unknown)} sit on the tool is not stated: the plan takes the origin of the tool, where "
            "some directions cannot be seen; rough coordinates (under 'measurement.points', or as 'near') make it truer"
        )
    if not planned.timed:
        slow = [joint.name for joint in problem.robot.joints if joint.speed is None]
        notes.append(
            f"no speed is known for {', '.join(slow)}: poses are ordered by shares of joint travel and no times are "
            "given; state 'plan.speeds', or 'speed' in the robot file"
        )
    if problem.start is None:
        notes.append(
            "no start is given: the way begins at the pose nearest to the middle of the working area; state "
            "'plan.start'"
        )
    return notes


def plan_tables(
    robot: Robot,
    planned: Planned,
    content: Mapping[str, Any],
    tool_mm: Array,
    errors_mm: Array,
    touches: Sequence[str] | None = None,
) -> dict[str, Rows]:
    """poses: what is measured and what is foretold there; promise; methods.

    Args:
        tool_mm: tool position of every pose, shape (N, 3). errors_mm: predicted rms error at every pose, shape (N,).
        touches: what each of them touches, where something is touched.
    """
    poses: dict[str, Iterable[object]] = {"pose": planned.names, **joint_columns(robot, planned.plan.poses)}
    poses["required"] = planned.required
    if touches is not None:
        poses["touches"] = touches
    for i, axis in enumerate("xyz"):
        poses[f"tool_{axis}_mm"] = tool_mm[:, i]
    poses["predicted_rms_mm"] = errors_mm
    out: dict[str, Rows] = {"poses": rows_of(poses)}
    if content["promise"] is not None:
        out["promise"] = content["promise"]["table"]
        if content["promise"]["needed"]:
            out["poses_needed"] = content["promise"]["needed"]
    out["methods"] = [
        {"method": name, **{k: v for k, v in facts.items() if k != "history"}}
        for name, facts in content["methods"].items()
    ]
    return out
