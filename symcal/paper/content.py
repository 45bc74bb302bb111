"""The study as one plain dictionary (results.json): numbers, their units in the keys, and against what they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration import results
from symcal.calibration.evaluate import statistics
from symcal.paper import published
from symcal.paper.results import Identified, Recovery, Setting, Study, StudyPlan
from symcal.paper.surroundings import mean_norm
from symcal.planning.fitness import Reading
from symcal.planning.results import order_facts, plan_facts

Array = NDArray[np.float64]


def study_content(study: Study) -> dict[str, Any]:
    """Everything that the report says beside the header, as results.json holds it."""
    certified = study.simulation_2["certified"].calibration
    return {
        "kind": "paper",
        "robot": results.robot_facts(study.setting.model.robot),
        "measurement": results.measurement_facts(
            study.setting.model.task, {"train": study.setting.count, "test": len(study.setting.test_poses)}
        ),
        "warnings": list(certified.notes),
        "plan": plan_facts(study.certified.plan, study.setting.model.measurement),
        "order": order_facts(study.certified),
        **results.calibration_facts(certified),
        "accuracy": _accuracy(study),
        "against": "noisy measurement",
        "nominal_pose": _nominal_pose(study.setting),
        "plans": {name: _plan(plan) for name, plan in study.plans.items()},
        "simulation_1": _simulation_1(study),
        "simulation_2": _simulation_2(study),
        "readings": [_reading(study, i) for i in range(len(study.readings))],
        "gauge": _gauge(study),
        "seconds": dict(study.seconds),
    }


def _accuracy(study: Study) -> dict[str, Any]:
    """The certified plan's, in the form that every run has."""
    found, setting = study.simulation_2["certified"], study.setting
    poses = np.arange(len(study.test))

    def of(values: Array, *, worst: bool = False) -> dict[str, Any]:
        s = statistics(values)
        facts: dict[str, Any] = {"mean": s.mean, "rms": s.rms, "p95": s.p95, "max": s.max, "count": s.count}
        where = {"worst": results.worst_facts(values, poses, study.test.labels, "mm")} if worst else {}
        return {"position_mm": facts | where}

    return {
        "test": {"before_raw": of(found.before_measured), "after": of(found.after_measured, worst=True)},
        "truth": {"before_raw": of(setting.before_raw), "after": of(found.after_true, worst=True)},
    }


def _nominal_pose(setting: Setting) -> dict[str, Any]:
    return {
        "q": dict(zip((j.name for j in setting.model.robot.joints), setting.start.tolist(), strict=True)),
        "position_mm": setting.arm.motion(setting.start[None])[0][0].tolist(),
    }


def _plan(plan: StudyPlan) -> dict[str, Any]:
    lines = plan.motion.kinds.count("line")
    return {
        "title": plan.title,
        "expected_rms_mm": plan.expected_rms_mm,
        "beats_random_expected": plan.beats_random,
        "d_efficiency_lower_bound": plan.certificate.d_efficiency_lower_bound,
        "g_efficiency": plan.certificate.g_efficiency,
        "certificate": plan.certificate.statement,
        "condition_number": plan.condition_number,
        "visible_share": plan.visible,
        "straight_lines": lines,
        "joint_motions": len(plan.motion.kinds) - lines,
        "tour_s": plan.motion.total_time,
        "search_s": plan.seconds,
    }


def _parameters(setting: Setting, errors: Array, true: Array | None = None) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for i, p in enumerate(setting.model.parameters.items):
        out[p.name] = {
            "nominal": p.nominal,
            "error": float(errors[i]),
            "identified": p.nominal + float(errors[i]),
            "unit": p.unit,
        }
        if true is not None:
            out[p.name]["true_error"] = float(true[i])
    return out


def _simulation_1(study: Study) -> dict[str, Any]:
    setting, one = study.setting, study.simulation_1

    def recovery(found: Recovery) -> dict[str, Any]:
        return {
            "plan": found.plan,
            "iterations": found.iterations,
            "position_error_mm": found.position_error_mm.tolist(),
            "damping": found.damping.tolist(),
            "parameters": _parameters(setting, found.found, setting.truth),
            "largest_deviation": float(np.abs(found.found - setting.truth).max()),
            "mirrored": found.mirrored,
            "message": found.message,
        }

    return {
        **recovery(one.main),
        "plans": {name: recovery(found) for name, found in one.plans.items()},
        "draws": None
        if not len(one.draws)
        else {
            "count": len(one.draws),
            "most_iterations": int(one.draws[:, 0].max()),
            "largest_position_error_mm": float(one.draws[:, 1].max()),
            "largest_deviation": float(one.draws[:, 2].max()),
            "mirrored": one.mirrors,
        },
        "paper": {"iterations": published.SIMULATION_1_ITERATIONS},
    }


def _short(values: Array, *, rms: bool = False) -> dict[str, float]:
    s = statistics(values)
    return {"mean_mm": s.mean, **({"rms_mm": s.rms} if rms else {}), "max_mm": s.max}


def _simulation_2(study: Study) -> dict[str, Any]:
    again = study.repetitions
    return {
        "plans": {name: _judged(study, study.simulation_2[name]) for name in study.plans},
        "paper": {name: _published(study, name) for name in published.TABLE_IV},
        "repetitions": again.count,
        "random_plans": len(study.random.poses),
        "random_expected_rms_mm": _quantiles(study.random.expected_rms_mm),
        "new_random": _spread(study, "new_random"),
        "noise": {
            "distribution": study.setting.noise.distribution,
            "half_width_mm": study.setting.noise.sizes["position"],
            "sigma_mm": study.setting.sigma,
            "mean_norm_mm": mean_norm(study.setting.noise),
        },
    }


def _judged(study: Study, found: Identified) -> dict[str, Any]:
    plan, again = study.plans[found.plan], study.repetitions
    return {
        "before_raw": _short(study.setting.before_raw),
        "before_measured": _short(found.before_measured),
        "after_measured": _short(found.after_measured),
        "after_true": _short(found.after_true, rms=True),
        "unregularised_true": _short(found.unregularised_true, rms=True),
        "expected_rms_mm": plan.expected_rms_mm,
        "cramer_rao_rms_mm": found.cramer_rao_mm,
        "d_efficiency_lower_bound": plan.certificate.d_efficiency_lower_bound,
        "true_rms_over_cramer_rao": again.over_cramer_rao(found.plan),
        "beats_random_expected": plan.beats_random,
        "beats_random_realised": again.wins(found.plan),
        "parameters": _parameters(study.setting, found.fit.x, study.setting.truth),
        "unregularised": _parameters(study.setting, found.unregularised, study.setting.truth),
        "repetitions": _spread(study, found.plan),
    }


def _spread(study: Study, name: str) -> dict[str, Any]:
    again = study.repetitions
    return {
        "measured_mean_mm": _quantiles(again.measured_mean[name]),
        "measured_max_mm": _quantiles(again.measured_max[name]),
        "true_mean_mm": _quantiles(again.true_mean[name]),
        "true_rms_mm": _quantiles(again.true_rms[name]),
        "true_max_mm": _quantiles(again.true_max[name]),
    }


def _quantiles(values: Array) -> dict[str, float]:
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return {"p05": float(low), "median": float(middle), "p95": float(high), "mean": float(values.mean())}


def _published(study: Study, name: str) -> dict[str, Any]:
    """The paper's row of Table IV, its identified errors, and what the robot with them does at our test poses."""
    table = published.TABLE_IV[name]
    own = study.published_true.get(name)
    return {
        "before": dict(table["before"]),
        "after": dict(table["after"]),
        "parameters": dict(published.TABLES[name]),
        "parameters_at_our_test_poses": None if own is None else _short(own, rms=True),
    }


def _reading(study: Study, i: int) -> dict[str, Any]:
    way = study.readings[i]
    return {
        "key": way.key,
        "text": way.text,
        "reading": None if way.reading is None else _reading_facts(way.reading),
        "main": way.main,
        "expected_rms_mm": way.expected_rms_mm,
        "d_efficiency_lower_bound": way.d_efficiency_lower_bound,
        "beats_random_expected": way.beats_random,
        "distinct_poses": way.distinct,
        "generations": len(way.history) - 1,
        "scores": dict(way.scores),
    }


def _reading_facts(reading: Reading) -> dict[str, str]:
    return {
        "conditioning": reading.conditioning,
        "rows": reading.rows,
        "point": reading.point,
        "over": reading.over,
    }


def _gauge(study: Study) -> dict[str, Any]:
    found, names = study.gauge, study.setting.model.parameters.names
    bound = study.simulation_2[found.plan].cramer_rao_mm

    def per_parameter(values: Array) -> Mapping[str, float]:
        return dict(zip(names, values.tolist(), strict=True))

    return {
        "plan": found.plan,
        "nominal": results.identifiability_facts(found.seen),
        "truth": results.identifiability_facts(found.at_truth),
        "three_target_points": results.identifiability_facts(found.target),
        "repetitions": len(found.spread["posterior"]),
        "methods": {
            method: {
                "mean": per_parameter(x.mean(axis=0)),
                "sd": per_parameter(x.std(axis=0)),
                "true_rms_mm": _quantiles(found.true_rms[method]),
                "true_rms_over_cramer_rao": float(np.sqrt(np.mean(found.true_rms[method] ** 2)) / bound),
            }
            for method, x in found.spread.items()
        },
    }
