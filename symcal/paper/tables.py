"""The paper's tables with ours beside them, one row per entry; units in the columns' names."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from symcal.outputs.csv_text import Rows, rows_of
from symcal.paper import published
from symcal.paper.results import Setting, Study

_KINDS = ("theta", "alpha", "a", "d", "beta")


def study_tables(study: Study) -> dict[str, Rows]:
    """Tables I to VI, the repetitions, the readings, and the errors at the test poses, by file name."""
    return {
        "table_1_nominal": _table_1(study.setting),
        "table_2_ranges": _table_2(study.setting),
        "table_3_true_errors": _table_3(study),
        "table_4_position_errors": _table_4(study),
        "table_5_identified_planned": _identified(study, ("ga", "certified", "paper_ga"), "optimal"),
        "table_6_identified_random": _identified(study, ("random",), "random"),
        "plans": _plans(study),
        "repetitions": _repetitions(study),
        "readings": _readings(study),
        "errors": _errors(study),
        "convergence": _convergence(study),
    }


def _table_1(setting: Setting) -> Rows:
    rows = []
    for i, link in enumerate(setting.model.robot.links, start=1):
        row: dict[str, object] = {"link": i, "joint": link.joint.name, "kind": link.joint.kind}
        for kind in _KINDS:
            value = link.parameters.get(kind)
            lengthy = kind in ("a", "d")
            row[f"{kind}_{'mm' if lengthy else 'deg'}"] = (
                None if value is None else value if lengthy else float(np.rad2deg(value))
            )
        rows.append(row)
    return rows


def _table_2(setting: Setting) -> Rows:
    area, robot = setting.info.area, setting.model.robot
    rows = []
    for i, joint in enumerate(robot.joints):
        shown = np.rad2deg if joint.revolute else np.asarray
        rows.append(
            {
                "joint": joint.name,
                "unit": "deg" if joint.revolute else "mm",
                "lower_limit": float(shown(joint.lower)),
                "upper_limit": float(shown(joint.upper)),
                "working_area_lower": float(shown(area.lower[i])),
                "working_area_upper": float(shown(area.upper[i])),
            }
        )
    return rows


def _table_3(study: Study) -> Rows:
    setting, main = study.setting, study.simulation_1.main
    rows = []
    for i, p in enumerate(setting.model.parameters.items):
        rows.append(
            {
                "parameter": p.name,
                "unit": p.unit,
                "paper": published.TABLE_III.get(p.name),
                "true_error": setting.truth[i],
                "simulation_1": main.found[i],
            }
        )
    return rows


def _table_4(study: Study) -> Rows:
    rows = []
    for name, found in study.simulation_2.items():
        for state, against, values in (
            ("before", "truth", study.setting.before_raw),
            ("before", "noisy measurement", found.before_measured),
            ("after", "noisy measurement", found.after_measured),
            ("after", "truth", found.after_true),
            ("after, unregularised", "truth", found.unregularised_true),
        ):
            rows.append(_row(f"ours, {name}", state, against, values.mean(), values.max()))
    for name, table in published.TABLE_IV.items():
        for state, entry in table.items():
            rows.append(_row(f"paper, {name}", state, "not said", entry["mean_mm"], entry["max_mm"]))
    for name, values in study.published_true.items():
        number = "V" if name == "optimal" else "VI"
        rows.append(_row(f"paper's Table {number} at our test poses", "after", "truth", values.mean(), values.max()))
    return rows


def _row(path: str, state: str, against: str, mean: float, largest: float) -> dict[str, object]:
    return {"path": path, "state": state, "against": against, "mean_mm": float(mean), "max_mm": float(largest)}


def _identified(study: Study, plans: tuple[str, ...], paper: str) -> Rows:
    table = published.TABLES[paper]
    rows = []
    for i, p in enumerate(study.setting.model.parameters.items):
        row: dict[str, object] = {
            "parameter": p.name,
            "unit": p.unit,
            "true_error": study.setting.truth[i],
            "paper": table.get(p.name),
        }
        for name in plans:
            found = study.simulation_2[name]
            row |= {
                f"{name}_posterior": found.fit.x[i],
                f"{name}_unregularised": found.unregularised[i],
            }
        rows.append(row)
    return rows


def _plans(study: Study) -> Rows:
    again = study.repetitions
    return [
        {
            "plan": name,
            "title": plan.title,
            "expected_rms_mm": plan.expected_rms_mm,
            "d_efficiency_lower_bound": plan.certificate.d_efficiency_lower_bound,
            "g_efficiency": plan.certificate.g_efficiency,
            "condition_number": plan.condition_number,
            "beats_random_expected": plan.beats_random,
            "beats_random_realised": again.wins(name),
            "true_rms_over_cramer_rao": again.over_cramer_rao(name),
            "visible_share": plan.visible,
            "tour_s": plan.motion.total_time,
        }
        for name, plan in study.plans.items()
    ]


def _repetitions(study: Study) -> Rows:
    again = study.repetitions
    rows: list[dict[str, object]] = []
    for name in again.names:
        rows += rows_of(
            {
                "plan": [name] * again.count,
                "repetition": np.arange(1, again.count + 1),
                "measured_mean_mm": again.measured_mean[name],
                "measured_max_mm": again.measured_max[name],
                "true_mean_mm": again.true_mean[name],
                "true_rms_mm": again.true_rms[name],
                "true_max_mm": again.true_max[name],
                "cramer_rao_rms_mm": again.cramer_rao_mm[name],
            }
        )
    return rows


def _readings(study: Study) -> Rows:
    return [
        {
            "reading": way.key,
            "text": way.text,
            "main": way.main,
            "expected_rms_mm": way.expected_rms_mm,
            "d_efficiency_lower_bound": way.d_efficiency_lower_bound,
            "beats_random_expected": way.beats_random,
            "distinct_poses": way.distinct,
            **{f"score_{name}": value for name, value in way.scores.items()},
        }
        for way in study.readings
    ]


def _errors(study: Study) -> Rows:
    """Fig. 9: every test pose, before and after, against noisy measurement and truth."""
    setting = study.setting
    columns: dict[str, Iterable[object]] = {
        "pose": np.arange(1, len(setting.test_poses) + 1),
        "x_mm": setting.test_positions[:, 0],
        "y_mm": setting.test_positions[:, 1],
        "z_mm": setting.test_positions[:, 2],
        "before_true_mm": setting.before_raw,
    }
    for name, found in study.simulation_2.items():
        columns |= {f"{name}_measured_mm": found.after_measured, f"{name}_true_mm": found.after_true}
    return rows_of(columns)


def _convergence(study: Study) -> Rows:
    """Fig. 7: mean position error after every iteration of Simulation I."""
    return [
        {"plan": name, "iteration": i, "position_error_mm": error, "damping": damping}
        for name, found in study.simulation_1.plans.items()
        for i, (error, damping) in enumerate(zip(found.position_error_mm, found.damping, strict=True))
    ]
