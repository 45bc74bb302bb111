"""Two calibrations from disjoint measurements: their law against simulation and textbook tests, and what is said.

`halves_draws.py` is the long form of the draws here.
"""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import halves_draws as drawn
import numpy as np
import pandas as pd
import pytest
from cases import ARM, measure, random_errors
from measured_arms import arm
from model_check_draws import NOISE, model_of
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.transform import Rotation

from symcal import cli
from symcal.calibration.again import as_before, calibrated_again
from symcal.calibration.apart import region_of
from symcal.calibration.calibrate import calibrate
from symcal.calibration.divisions import divisions
from symcal.calibration.halves import Halves, half_estimate, two_halves
from symcal.calibration.halves_words import again_facts, halves_facts, halves_sentence, halves_warnings
from symcal.calibration.record import recorded_task
from symcal.calibration.simulate import concatenate
from symcal.data.dataset import Dataset
from symcal.data.saved_measurements import save_measurements
from symcal.errors import RefusedError
from symcal.fit.difference import HalfRows, at_least_one, difference
from symcal.fit.estimation import Options
from symcal.model.model import build_model
from symcal.model.task import Task
from symcal.plots.halves import halves_map
from symcal.report.halves import halves_text
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Robot
from symcal.runs.validate import validate_robot
from symcal.words import number

Array = NDArray[np.float64]

# ----------------------------------------------------------------------------------------------------- the law itself


def linear(rng: np.random.Generator, poses: int = 24, n: int = 5) -> tuple[Array, Array, NDArray[np.intp]]:
    """Slopes of three rows of every pose, a prior that hardly lets one direction go, and the poses of the rows."""
    slopes = rng.normal(size=(3 * poses, n)) * np.array([3.0, 1.0, 0.3, 0.05, 0.0])
    return slopes, np.diag([0.01, 0.5, 1.0, 2.0, 1.0]), np.repeat(np.arange(poses), 3)


def rows_with(slopes: Array, known: Array, pose: NDArray[np.intp], r: Array, p: Array, dof: float) -> HalfRows:
    group = np.zeros_like(pose)
    return HalfRows(slopes, r, pose, group, np.column_stack([known, p]), [dof], [1.0], [1.0])


def test_the_covariance_is_that_of_simulated_estimates() -> None:
    rng = np.random.default_rng(1)
    slopes, known, pose = linear(rng)
    first = rng.permutation(24) < 10
    apart = []
    for _ in range(4000):
        y = np.linalg.solve(known, rng.normal(size=5))  # the truth as the prior has it
        z = slopes @ y + rng.normal(size=72)
        half = [
            np.linalg.lstsq(np.vstack([slopes[own], known]), np.concatenate([z[own], np.zeros(5)]), rcond=None)[0]
            for own in (first[pose], ~first[pose])
        ]
        apart.append(half[0] - half[1])
    law = difference(rows_with(slopes, known, pose, -z, np.zeros(5), np.inf), first)
    assert np.allclose(law.step, apart[-1], atol=1e-10)
    sampled, sigma = np.cov(np.array(apart).T), np.sqrt(np.diag(law.covariance))
    told = sigma > 0
    assert told.tolist() == [True] * 4 + [False]  # what neither half sees does not differ
    scale = np.outer(sigma[told], sigma[told])
    assert np.allclose(law.covariance[:4, :4] / scale, sampled[:4, :4] / scale, atol=4 * np.sqrt(2 / 4000))
    alone = [np.linalg.inv(slopes[own].T @ slopes[own] + known.T @ known) for own in (first[pose], ~first[pose])]
    assert (np.diag(law.covariance) < 0.9 * np.diag(alone[0] + alone[1]))[3]  # the prior is in both
    shared = alone[0] @ known.T @ known @ alone[1]
    assert np.allclose(law.covariance, alone[0] + alone[1] - shared - shared.T)


def test_without_a_prior_it_is_the_test_of_chow() -> None:
    rng = np.random.default_rng(2)
    slopes, pose = rng.normal(size=(60, 4)), np.repeat(np.arange(20), 3)
    r = rng.normal(size=60)
    first = rng.permutation(20) < 9
    whole, one, other = (
        float(np.linalg.lstsq(slopes[own], r[own], rcond=None)[1][0])
        for own in (np.ones(60, dtype=bool), first[pose], ~first[pose])
    )
    textbook = stats.f.sf((whole - one - other) / 4 / ((one + other) / 52), 4, 52)
    sigma = np.sqrt(whole / 56)  # as the fit of all estimates it
    law = difference(rows_with(slopes / sigma, 1e-9 * np.eye(4), pose, r / sigma, np.zeros(4), 56.0), first)
    tested = law.tested(law.step, np.eye(4))
    assert tested is not None
    assert (tested.directions, tested.dof) == (4, pytest.approx(56.0))
    assert tested.p == pytest.approx(textbook, rel=1e-6)
    known = difference(rows_with(slopes, 1e-9 * np.eye(4), pose, r, np.zeros(4), np.inf), first)
    exact = known.tested(known.step, np.eye(4))
    assert exact is not None
    assert exact.p == pytest.approx(stats.chi2.sf(whole - one - other, 4), rel=1e-6)


def test_directions_that_make_nothing_at_the_tool_do_not_count() -> None:
    rng = np.random.default_rng(3)
    slopes, known, pose = linear(rng)
    law = difference(rows_with(slopes, known, pose, rng.normal(size=72), np.zeros(5), np.inf), np.arange(24) % 2 == 0)
    metric = np.diag([1.0, 1.0, 0.0, 0.0, 1.0])
    tested = law.tested(law.step, metric)
    assert tested is not None
    own = law.step[:2]
    assert tested.directions == 2
    assert tested.squares == pytest.approx(own @ np.linalg.solve(law.covariance[:2, :2], own))
    assert law.tested(law.step, np.diag([0.0, 0.0, 0.0, 0.0, 1.0])) is None
    assert (
        difference(rows_with(slopes, known, pose, slopes[:, 0], np.zeros(5), 4.0), pose[::3] % 2 == 0).tested(
            law.step, np.eye(5)
        )
        is None
    )  # as many directions as degrees of freedom


def test_the_least_of_several_probabilities() -> None:
    rng = np.random.default_rng(4)
    least = [at_least_one(float(rng.uniform(size=9).min()), 9) for _ in range(400)]
    assert stats.kstest(least, "uniform").pvalue > 0.01
    assert at_least_one(1e-30, 14) == pytest.approx(1.4e-29)


# ------------------------------------------------------------------------------------------------------------ divisions


def test_divisions_know_nothing_of_what_was_measured_and_share_every_place() -> None:
    rng = np.random.default_rng(5)
    data = measure(model_of(ARM, "position"), {}, 41, rng, NOISE)
    read = np.zeros((41, 2), dtype=bool)
    read[:15, 0] = read[15:, 1] = True
    found, again = (
        list(divisions(own, read, np.random.default_rng(6))) for own in (data, replace(data, z=np.flipud(data.z)))
    )
    assert [each.name for each in found][:4] == ["chance", "order", "joint 1", "joint 1, middle"]
    assert len(found) == 14
    for one, other in zip(found, again, strict=True):
        assert (one.first == other.first).all()
        assert abs(2 * int(one.first.sum()) - 41) == 1
        for place in read.T:
            assert abs(2 * int(one.first[place].sum()) - int(place.sum())) <= 1
    by_reading = found[2].first
    for place in read.T:
        assert data.q[by_reading & place, 0].max() <= data.q[~by_reading & place, 0].min()
    still = replace(data, q=np.where(np.arange(6) == 2, 0.3, data.q))
    assert not any(each.joint == 3 for each in divisions(still, read, rng))


# --------------------------------------------------------------------------------------------------------- calibrations


@cache
def good() -> tuple[Halves, Dataset]:
    model, rng = model_of(ARM, "position"), np.random.default_rng(11)
    data = measure(model, random_errors(model, rng), 60, rng, NOISE)
    return two_halves(calibrate(model, None, data, Options()), data, Options(), rng), data


def test_halves_are_really_identified() -> None:
    """What is told of is a fit of each half's own poses: SciPy finds the same from these alone."""
    from scipy.optimize import least_squares

    from symcal.fit.residual_rows import rows_of

    model, rng = model_of(ARM, "position"), np.random.default_rng(11)
    data = measure(model, random_errors(model, rng), 60, rng, NOISE)
    calibration = calibrate(model, None, data, Options())
    first = np.arange(60) % 2 == 0
    x = half_estimate(calibration, data, Options(), first)
    rows = rows_of(model.measurement, data.take(first), calibration.setup, model.residuals)
    scales = model.parameters.scales * np.where(
        [name in ARM.parameters for name in model.parameters.names], calibration.after.factor, 1e3
    )

    def residual(y: Array) -> Array:
        r = rows.residual(scales * y) / calibration.after.sigmas["position"]
        return np.concatenate([r.ravel(), y])

    found = least_squares(residual, x / scales + 0.01, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    q = data.q[:10]
    ours, theirs = (model.points(q, each, calibration.setup.vector)[0] for each in (x, scales * found.x))
    assert np.abs(ours - theirs).max() < 1e-4


def test_good_halves_agree_and_say_so() -> None:
    halves, data = good()
    facts = halves_facts(halves)
    assert halves.agree
    assert facts["agree"] is True
    assert facts["division"] == "chance"
    assert facts["poses"] == [30, 30]
    assert facts["difference_rms_mm"] == pytest.approx(np.sqrt(np.mean(halves.apart.apart**2)))
    assert 0.6 < facts["ratio"] < 1.5
    assert facts["ratio"] == pytest.approx(facts["difference_rms_mm"] / facts["predicted_rms_mm"])
    assert facts["within_95"] > 0.6
    assert facts["orientation"] is None
    assert len(facts["divisions"]) == 14
    assert "they agree, as do those of 13 other divisions" in facts["text"]
    assert halves_warnings(halves) == []
    division, compared = halves.every[0]
    assert compared.difference == pytest.approx(halves.apart.compared.difference, rel=0.02)  # to first order
    assert len(data) == len(division.first)


@pytest.mark.long
def test_p_values_are_uniform_and_good_sets_are_let_alone() -> None:
    found = drawn.draws("position", 20) + drawn.draws("pose", 8, seed=1)
    p = drawn.by_chance(found)
    assert stats.kstest(p, "uniform").pvalue > 0.01
    pooled = [compared.tested.p for each in found for _, compared in each.every]
    assert 0.02 < np.mean(np.array(pooled) < 0.05) < 0.09
    assert sum(not each.agree for each in found) <= 2
    squares = [each.every[0][1].ratio ** 2 for each in found]
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)
    assert np.mean([each.apart.within for each in found]) > 0.9


def test_a_wave_that_the_model_lacks_is_found_by_halves_of_its_joint_and_not_by_chance() -> None:
    found = drawn.draws("wave", 4)
    assert not any(each.agree for each in found)
    assert {each.division.joint for each in found} == {3}
    assert min(drawn.by_chance(found)) > 0.002  # for these it is noise
    sentence = halves_sentence(found[0])
    assert "they do not agree" in sentence
    assert "as if the model lacked something that depends on joint 3" in sentence
    assert any(halves_warnings(each) for each in found)


def test_readings_of_a_pose_that_err_together_are_found_by_chance() -> None:
    found = drawn.draws("three points, joints shake", 3)
    assert not any(each.agree for each in found)
    assert all(each.every[0][1].ratio > 1.15 for each in found)
    assert any("erred together" in halves_sentence(each) for each in found)


@pytest.mark.parametrize("name", ["directions_only", "two_sessions", "two_sockets"])
def test_other_instruments(name: str) -> None:
    halves = drawn.scene(name, np.random.default_rng(3))
    assert halves.every[0][1].tested.p > 1e-3
    assert 0.3 < halves.apart.compared.ratio < 2


def test_two_fits_of_the_same_world_that_drifted_do_not_differ() -> None:
    """Where only the instruments say where the world is, moving both the robot and what is in it changes nothing."""
    from known_truth import SCENARIOS, told

    scenario = SCENARIOS["three_wires"](np.random.default_rng(1))
    model = told("three_wires", scenario)
    assert model.measurement.adrift
    names = model.parameters.names
    x = np.zeros(len(names))
    region = region_of(model, scenario.setup, x, names, np.random.default_rng(2).uniform(-1, 1, (20, 6)))
    lengths = np.linalg.norm(region.slopes.reshape(20, -1, 3, len(names)), axis=2)
    still = [names.index(name) for name in ("theta_1", "d_1") if name in names]
    assert still
    assert lengths[:, :, still].max() < 1e-9 * lengths.max()  # the first axis turns and lifts all of it


def test_too_few_poses_are_not_divided() -> None:
    model, rng = model_of(ARM, "position"), np.random.default_rng(12)
    data = measure(model, random_errors(model, rng), 16, rng, NOISE)
    with pytest.raises(RefusedError, match=r"16 training poses are too few: a half of them would be 8"):
        two_halves(calibrate(model, None, data, Options()), data, Options(), rng)
    facts = halves_facts("16 training poses are too few")
    assert facts["agree"] is None
    assert facts["why"] == "16 training poses are too few"
    text = halves_text(facts)
    assert text is not None
    assert (text["rows"], text["sentence"][:13]) == ([], "No two halves")


def test_the_map_and_the_report_say_the_numbers() -> None:
    halves, _ = good()
    drawing = halves_map(halves.apart, "two halves", "Two halves")
    compared = halves.apart.compared
    assert f"{number(compared.difference)} mm rms where {number(compared.predicted)} mm is" in drawing.caption
    assert drawing.figure.axes[0].get_title(loc="left") == "from above"
    still = replace(halves.apart, at=np.zeros_like(halves.apart.at))  # a tool that no joint moves
    assert halves_map(still, "two halves", "Two halves").figure.axes
    text = halves_text(halves_facts(halves))
    assert text is not None
    assert [row["cells"][0] for row in text["rows"] if row["strong"]] == ["drawn by chance"]


# ------------------------------------------------------------------------------------------------- a second calibration


def ur10e() -> Robot:
    return arm("ur", "craig")


def calibrated(folder: Path) -> tuple[Path, Dataset, dict[str, float]]:
    """A robot calibrated and written, measurements that came later, and its true errors."""
    model, rng = build_model(ur10e(), Task.of("position", ("base", "tool"))), np.random.default_rng(13)
    truth = random_errors(model, rng)
    data = measure(model, truth, 60, rng, NOISE)
    save_robot(calibrate(model, None, data, Options()).robot, folder / "calibrated.yaml")
    return folder / "calibrated.yaml", measure(model, truth, 40, rng, NOISE), truth


def test_new_measurements_are_calibrated_again_and_agree(tmp_path: Path) -> None:
    file, new, _ = calibrated(tmp_path)
    robot = load_robot(file)
    assert robot.record is not None
    task = recorded_task(robot.record.provenance, "before", file)
    model = as_before(robot, task, robot.record.provenance)  # with the recorded errors it is the calibrated robot
    errors = model.parameters.vector({name: robot.record.errors[name] for name in model.parameters.names})
    now = build_model(robot, recorded_task(robot.record.provenance, "after", file))
    nothing = np.zeros(len(now.parameters))
    before, after = (m.points(new.q, x, m.setup.vector)[0] for m, x in ((model, errors), (now, nothing)))
    assert np.abs(before - after).max() < 1e-6
    again = calibrated_again(robot, task, new, np.random.default_rng(0))
    assert again.agree
    assert 0.5 < again.apart.compared.ratio < 1.6
    save_measurements(new, robot, tmp_path / "new.csv")
    content = validate_robot(file, tmp_path / "new.csv", tmp_path / "out")
    for key in ("difference_rms_mm", "predicted_rms_mm", "p"):
        assert content["halves"][key] == pytest.approx(again_facts(again)[key], rel=1e-3)
    assert content["halves"]["poses"] == 40
    assert "a calibration from the 40 new poses alone and the recorded one" in content["halves"]["text"]
    assert content["warnings"] == []
    for kind in ("pdf", "png"):
        assert (tmp_path / "out" / "figures" / f"halves.{kind}").stat().st_size > 10_000
    few = validate_robot(file, _first(tmp_path / "new.csv", 9))
    assert few["halves"]["agree"] is None
    assert few["halves"]["why"].startswith("9 poses are too few for a calibration of their own")
    assert few["warnings"] == []


def test_the_command_tells_what_the_second_calibration_says_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def told(*arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", ["symcal", *map(str, arguments)])
        with suppress(SystemExit):
            cli.main()
        return " ".join("".join(capsys.readouterr()).split())

    monkeypatch.setenv("COLUMNS", "10000")
    file, new, truth = calibrated(tmp_path)
    robot = load_robot(file)
    save_measurements(new, robot, tmp_path / "new.csv")
    said = told("validate", file, "--data", tmp_path / "new.csv", "--out", tmp_path / "good")
    text = json.loads((tmp_path / "good" / "results.json").read_text())["halves"]["text"]
    assert "differ over the ranges of the new poses by" in text
    assert said.count(text) == 1
    assert "accepted: on the test poses it is better than" in said
    said = told("validate", file, "--data", _first(tmp_path / "new.csv", 9), "--out", tmp_path / "few")
    assert "no second calibration from the new poses alone was compared" in said
    assert not (tmp_path / "few" / "figures").exists()
    said = told("validate", file, "--data", _bent(tmp_path, robot, truth))
    assert said.count("they do not agree") == 1


def _bent(folder: Path, robot: Robot, truth: dict[str, float]) -> Path:
    """Measurements of the robot after a crash."""
    model, rng = build_model(ur10e(), Task.of("position", ("base", "tool"))), np.random.default_rng(14)
    bent = measure(model, truth | {"theta_3": truth["theta_3"] + 1e-3}, 40, rng, NOISE)
    save_measurements(bent, robot, folder / "bent.csv")
    return folder / "bent.csv"


def _first(file: Path, count: int) -> Path:
    table = pd.read_csv(file, comment="#")
    out = file.with_name("few.csv")
    table.head(count).to_csv(out, index=False)
    return out


def test_a_robot_that_changed_is_told(tmp_path: Path) -> None:
    file, _, truth = calibrated(tmp_path)
    content = validate_robot(file, _bent(tmp_path, load_robot(file), truth))
    assert content["halves"]["agree"] is False
    assert content["halves"]["ratio"] > 1.5
    assert "as if the robot or the instrument had changed" in content["warnings"][-1]


def test_an_instrument_that_was_moved_makes_no_difference(tmp_path: Path) -> None:
    file, new, _ = calibrated(tmp_path)
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    moved = replace(new, z=new.z @ turn.T + np.array([700.0, -300.0, 200.0]))
    robot = load_robot(file)
    for name, data in (("still", new), ("moved", moved)):
        save_measurements(data, robot, tmp_path / f"{name}.csv")
    still, there = (validate_robot(file, tmp_path / f"{name}.csv", refit=("base",)) for name in ("still", "moved"))
    assert there["halves"]["agree"]
    assert there["halves"]["p"] == pytest.approx(still["halves"]["p"], rel=0.02)
    assert there["halves"]["difference_rms_mm"] == pytest.approx(still["halves"]["difference_rms_mm"], rel=0.02)
    remounted = validate_robot(file, tmp_path / "still.csv", refit=("tool",))
    assert remounted["halves"]["why"] == "tool may have moved on the robot in between"


def test_second_calibrations_are_as_far_off_as_stated() -> None:
    found = drawn.again("again, position", 8) + drawn.again("again, positioner", 8)
    assert stats.kstest([each.p for each in found], "uniform").pvalue > 0.01
    assert sum(not each.agree for each in found) <= 1
    assert not any(each.agree for each in drawn.again("again, bent", 2))


def test_gross_slips_are_in_no_half_where_the_loss_lets_them_pull() -> None:
    """Of 4 slips by 20 noises; nothing is left out of good data, nor by a loss that forgets slips by itself."""
    slipped, forgotten = (drawn.draws(f"position, {loss}, slips", 3) for loss in ("huber", "tukey"))
    assert all(3 <= each.aside <= 4 for each in slipped)
    assert not any(each.aside for each in [*forgotten, *drawn.draws("position, huber", 3)])
    (one, *_) = slipped
    facts = halves_facts(one)
    assert sum(facts["poses"]) == 60 - one.aside
    text = halves_text(facts)
    assert text is not None
    assert f"{one.aside} poses with gross slips are in no half" in text["note"]


def test_concatenated_parts_only_train() -> None:
    """Held-out poses have no part in the halves."""
    model, rng = model_of(ARM, "position"), np.random.default_rng(15)
    truth = random_errors(model, rng)
    train = measure(model, truth, 40, rng, NOISE)
    held_out = replace(measure(model, truth, 20, rng, NOISE), split=("test",) * 20)
    data = concatenate(train, held_out)
    halves = two_halves(calibrate(model, None, data, Options()), data, Options(), rng)
    assert len(halves.division.first) == 40
