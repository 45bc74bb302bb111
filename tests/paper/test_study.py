"""The study as a whole: the paper's own numbers, known truth, and statistical laws as witnesses."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from study_case import CONFIG, experiment, outcome

from symcal.errors import InputError, RefusedError
from symcal.paper import published
from symcal.paper.simulation_1 import recover
from symcal.robot.files import load_robot
from symcal.runs.load import load
from symcal.runs.run import run
from symcal.runs.study import study_experiment, write

HALF = np.pi / 2


def rotation_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def slide_z(d: float) -> np.ndarray:
    out = np.eye(4)
    out[2, 3] = d
    return out


def test_nominal_pose_is_where_table_1_puts_it():
    fold = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])  # Rx(-90 deg)
    by_hand = rotation_z(np.pi / 4) @ slide_z(1100) @ fold @ slide_z(0) @ rotation_z(HALF) @ slide_z(300) @ fold
    by_hand = by_hand @ rotation_z(0) @ slide_z(25)
    found = outcome().content["nominal_pose"]["position_mm"]
    np.testing.assert_allclose(found, by_hand[:3, 3], atol=1e-9)
    np.testing.assert_allclose(found, [-229.810, 194.454, 1100.0], atol=1e-3)


def test_the_nominal_robot_is_as_wrong_as_the_paper_says():
    before = outcome().study.before_raw
    assert before.mean == pytest.approx(4.1723, abs=0.35)
    assert before.max == pytest.approx(5.46, abs=0.6)


def test_the_true_errors_are_table_3():
    setting = outcome().study.setting
    assert setting.model.parameters.mapping(setting.truth) == pytest.approx(dict(published.TABLE_III))


def test_the_papers_identified_robots_have_about_the_errors_that_it_prints():
    """Tables V and VI, put into this model, give Table IV: the model is the paper's, and so is the meaning of its
    errors (against truth; the printed digits alone make some hundredths of a millimetre)."""
    for name, errors in outcome().study.published_true.items():
        after = published.TABLE_IV[name]["after"]
        assert errors.mean() == pytest.approx(after["mean_mm"], rel=0.25)
        assert errors.max() == pytest.approx(after["max_mm"], rel=0.45)


def test_simulation_1_finds_the_truth_on_every_plan():
    one = outcome().study.simulation_1
    for found in one.plans.values():
        assert found.iterations <= published.SIMULATION_1_ITERATIONS
        assert found.position_error_mm[-1] < 1e-10 <= found.position_error_mm[-2]
        np.testing.assert_allclose(found.found, outcome().study.setting.truth, atol=5e-5)
    iterations, error, deviation = one.draws.T
    assert iterations.max() <= published.SIMULATION_1_ITERATIONS
    assert error.max() < 1e-10
    assert deviation.max() < 5e-5


def test_simulation_1_ends_in_canonical_form_from_the_mirrors_side():
    setting, config = outcome().study.setting, experiment().file.study.simulation_1
    plan = outcome().study.plans["random"]
    starts = config.model_copy(update={"start": -0.01})
    found = recover(setting, "mirror", plan.poses, starts)
    assert found.position_error_mm[-1] < 1e-10
    np.testing.assert_allclose(found.found, setting.truth, atol=5e-5)


def test_informed_plans_beat_random_ones():
    study = outcome().study
    for name in ("ga", "certified"):
        assert study.plans[name].beats_random >= 0.99
    assert study.plans["certified"].certificate.d_efficiency_lower_bound > 0.99
    # a random plan's rank among random plans is anything, but its prediction lies among theirs
    low, high = study.random.expected_rms_mm.min(), study.random.expected_rms_mm.max()
    assert low < study.plans["random"].expected_rms_mm < high


def test_repetitions_keep_the_law_of_cramer_and_rao():
    again = outcome().study.repetitions
    for name in ("ga", "certified", "random"):
        assert again.over_cramer_rao(name) == pytest.approx(1.0, abs=0.03)
    assert again.over_cramer_rao("new_random") == pytest.approx(1.0, abs=0.03)


def test_errors_against_noise_are_below_the_papers_and_above_the_floor():
    again = outcome().study.repetitions
    rng = np.random.default_rng(1)
    floor = np.linalg.norm(rng.uniform(-0.1, 0.1, (200_000, 3)), axis=1).mean()
    for name in ("ga", "certified"):
        assert floor < np.median(again.measured_mean[name]) <= 0.1175
        assert np.median(again.measured_max[name]) <= 0.2359


def test_better_predictions_win_more_often():
    again, plans = outcome().study.repetitions, outcome().study.plans
    best, middling = again.wins("certified"), again.wins("random")
    assert plans["certified"].expected_rms_mm < plans["random"].expected_rms_mm
    assert best > middling
    assert 0.7 < best < 0.9


def test_eleven_of_fifteen_are_seen_and_the_unseen_directions_are_the_known_ones():
    gauge = outcome().study.gauge
    assert (gauge.seen.rank, gauge.seen.numerical_rank) == (11, 11)
    assert (gauge.at_truth.rank, gauge.at_truth.numerical_rank) == (11, 15)
    assert gauge.target.numerical_rank == 14
    involved = [set(d.direction) for d in gauge.seen.unseen()]
    assert {"theta_5"} in involved
    assert {"theta_4", "a_4"} in involved
    assert {"d_3", "d_4"} in involved
    assert any("alpha_4" in direction for direction in involved)


def test_without_a_gauge_the_papers_four_parameters_run_away():
    """Table V's alpha_4, theta_5, d_3, d_4 are off by as much as the paper's algorithm leaves them here."""
    gauge, setting = outcome().study.gauge, outcome().study.setting
    names = setting.model.parameters.names

    def rms(method: str, name: str) -> float:
        i = names.index(name)
        return float(np.sqrt(np.mean((gauge.spread[method][:, i] - setting.truth[i]) ** 2)))

    for name, scale in (("alpha_4", 0.010), ("theta_5", 0.010), ("d_3", 1.0), ("d_4", 1.0)):
        assert abs(published.TABLE_V[name] - published.TABLE_III[name]) > 2 * scale
        assert rms("unregularised", name) > 2 * scale
        assert rms("posterior", name) < 0.2 * scale
    # parameters that no unseen direction touches are found whatever is done with the others
    for name in ("theta_1", "alpha_1", "alpha_2"):
        assert max(rms(method, name) for method in gauge.spread) < 2e-4


def test_readings_score_the_plans_side_by_side():
    study = outcome().study
    assert [way.main for way in study.readings].count(True) == 1
    assert len({way.text for way in study.readings}) == len(study.readings) >= 5
    main = next(way for way in study.readings if way.main)
    assert main.expected_rms_mm == pytest.approx(study.plans["paper_ga"].expected_rms_mm)
    # each search did lower its own fitness
    for way in study.readings:
        assert way.history[-1] < way.history[0]


def test_tours_start_at_the_initial_pose_and_end_every_segment_at_a_pose():
    setting = outcome().study.setting
    np.testing.assert_allclose(setting.start, [np.pi / 4, 1100, 0, HALF, 0])
    for plan in outcome().study.plans.values():
        assert len(plan.poses) == 40
        np.testing.assert_allclose(plan.motion.segments[0].waypoints[0], setting.start)
        ends = [segment.waypoints[-1] for segment in plan.motion.segments]
        np.testing.assert_allclose(ends, plan.poses, atol=1e-6)


def test_the_folder_holds_what_the_study_found(tmp_path):
    write(outcome(), tmp_path)
    content = json.loads((tmp_path / "results.json").read_text())
    assert content["kind"] == "paper"
    assert content["plan"]["method"] == "certified"
    one, two = content["simulation_1"], content["simulation_2"]
    assert len(one["position_error_mm"]) == one["iterations"] + 1
    assert set(one["parameters"]["alpha_4"]) == {"nominal", "error", "identified", "unit", "true_error"}
    assert set(two["plans"]) == {"paper_ga", "ga", "certified", "random"}
    assert two["repetitions"] == outcome().study.repetitions.count
    for plan in two["plans"].values():
        assert {"before_raw", "after_measured", "after_true", "expected_rms_mm", "d_efficiency_lower_bound"} <= set(
            plan
        )
        assert {"true_rms_over_cramer_rao", "beats_random_expected", "beats_random_realised"} <= set(plan)
    table = pd.read_csv(tmp_path / "tables" / "table_4_position_errors.csv")
    ours = table[(table["path"] == "ours, certified") & (table["state"] == "after")]
    assert ours[ours["against"] == "truth"]["mean_mm"].item() == two["plans"]["certified"]["after_true"]["mean_mm"]
    robot = load_robot(tmp_path / "calibrated.yaml")
    assert robot.record is not None
    identified = two["plans"]["certified"]["parameters"]["alpha_2"]["error"]
    assert robot.record.errors["alpha_2"] == pytest.approx(identified)


def test_what_is_no_such_study_is_refused():
    with pytest.raises(RefusedError, match="known truth"):
        study_experiment(load(CONFIG, overrides=["data.noise.position=0"]))
    with pytest.raises(RefusedError, match="base and tool are known"):
        study_experiment(load(CONFIG, overrides=["measurement.estimate=[base]"]))
    with pytest.raises(RefusedError, match=r"plan\.start"):
        study_experiment(load(CONFIG, overrides=["plan.start=null"]))
    with pytest.raises(InputError, match="quik"):
        load(CONFIG, overrides=["study.quik=true"])


def test_a_single_identification_of_the_same_file(tmp_path):
    _, content = run(
        CONFIG, tmp_path / "single", study=False, overrides=["outputs.report=false", "outputs.figures=false"]
    )
    assert "simulation_2" not in content
    assert content["identifiability"]["rank"] == 11
