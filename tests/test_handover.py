"""What a calibration is worth on the controller: against kinematics written out in NumPy, known gauges, and files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import TABLE_III, front_half, handling, handling_model
from decisions import ACCEPTED
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.calibration.compensation_check import Handover, hand_over, true_robot
from symcal.compensation.compensate import REACHED
from symcal.compensation.targets import tool_pose
from symcal.export.corrections import corrections
from symcal.export.results import correction_facts, handover_facts
from symcal.kernels.batch import batch_function
from symcal.plots.handover import handover_figures
from symcal.plots.save import save_figures
from symcal.report.handover import handover_text
from symcal.robot.robot import Record, Robot
from symcal.runs.run import run


def calibrated(errors: Mapping[str, float]) -> Robot:
    robot = handling()
    record = Record(
        dict(errors), dict.fromkeys(errors, 1e-4), 1e-8 * np.eye(len(errors)), robot.base, robot.tool, ACCEPTED
    )
    return replace(robot.corrected(errors), record=record)


def tool(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Positions of the last origin by the paper's Table I, Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); shape (N, 3)."""
    found = []
    for reading in q:
        pose = np.eye(4)
        for link, value in zip(robot.links, reading, strict=True):
            p = {**dict.fromkeys(("theta", "d", "a", "alpha", "beta"), 0.0), **link.parameters}
            p["theta" if link.joint.revolute else "d"] += value
            turn = Rotation.from_euler("ZXY", [p["theta"], p["alpha"], p["beta"]]).as_matrix()
            step = np.array([p["a"] * np.cos(p["theta"]), p["a"] * np.sin(p["theta"]), p["d"]])
            pose = pose @ spatial.transform(turn, step)
        found.append(pose[:3, 3])
    return np.array(found)


@pytest.fixture(scope="module")
def perfect() -> Handover:
    """The identification found every error."""
    rng = np.random.default_rng(2)
    return hand_over(calibrated(TABLE_III), handling().corrected(TABLE_III), front_half(3000, rng), rng)


def test_before_is_what_the_paper_says(perfect: Handover) -> None:
    """4.3 mm in the mean and 5.4 to 5.9 mm at most over the working area."""
    errors = perfect.before.size
    assert 4.2 < errors.mean() < 4.4
    assert 5.4 < errors.max() < 5.95
    robot, q = handling(), perfect.compensation.nominal[:50]
    wanted = tool(robot, q)
    np.testing.assert_allclose(perfect.wanted[:50], wanted, atol=1e-9)
    np.testing.assert_allclose(perfect.before.vectors[:50], tool(robot.corrected(TABLE_III), q) - wanted, atol=1e-9)


def test_a_perfect_model_leaves_only_what_limits_keep_away(perfect: Handover) -> None:
    assert perfect.reached.mean() > 0.98
    assert perfect.after.size[perfect.reached].max() < 2 * REACHED
    assert not perfect.worse.any()
    assert set(perfect.statuses) <= {"reached", "joint limit"}
    assert sum(perfect.statuses.values()) == 3000
    q = perfect.compensation.joints[:50]
    truth = tool(handling().corrected(TABLE_III), q)
    np.testing.assert_allclose(perfect.after.vectors[:50], truth - perfect.wanted[:50], atol=1e-9)


def test_errors_of_the_model_stay(rng: np.random.Generator) -> None:
    """A model that is 0.05 mm off in d_5 leaves about these 0.05 mm."""
    joints = front_half(300, rng)
    wrong = {**TABLE_III, "d_5": TABLE_III["d_5"] + 0.05}
    found = hand_over(calibrated(wrong), handling().corrected(TABLE_III), joints, rng)
    left = found.after.size[found.reached]
    assert left == pytest.approx(0.05, rel=0.05)


def test_orientation_is_told_though_it_is_not_compensated(perfect: Handover) -> None:
    assert not perfect.compensation.pose
    assert perfect.before.orientation is not None
    assert perfect.after.orientation is not None
    assert 0.3 < np.degrees(perfect.before.orientation).mean() < 0.5
    assert np.degrees(perfect.after.orientation[perfect.reached]).mean() > 0.1


def test_a_base_that_was_estimated_is_laid_on_the_true_one(rng: np.random.Generator) -> None:
    """Turning the waist's zero and turning the base the other way is the same robot in world."""
    joints = front_half(500, rng)
    shifted = {**TABLE_III, "theta_1": TABLE_III["theta_1"] + 0.01}
    truth = handling().corrected(TABLE_III)
    raw = hand_over(calibrated(shifted), truth, joints, rng)
    laid = hand_over(calibrated(shifted), truth, joints, rng, aligned=True)
    assert raw.after.size[raw.reached].max() > 2
    assert laid.after.size[laid.reached].max() < 2 * REACHED
    assert laid.before.size.mean() < raw.before.size.mean()


def test_the_true_robot_predicts_the_measurements(rng: np.random.Generator) -> None:
    model = handling_model("A", "B", "C", estimate=frozenset({"base", "tool"}))
    names = model.parameters.names
    truth = {name: float(rng.normal()) * (1e-3 if name[0] in "tab" and "_r" in name else 0.01) for name in names}
    robot = true_robot(model, truth)
    q = front_half(5, rng)
    (z,) = batch_function(model.measurement.predict, evaluations=0)(
        q, model.parameters.vector(truth), model.setup.vector
    )
    (poses,) = batch_function(tool_pose(robot), evaluations=0)(q)
    points = np.einsum("ij,njk,lk->nli", robot.base[:3], poses, np.c_[model.setup.points, np.ones(3)])
    np.testing.assert_allclose(points.reshape(5, 9), z, atol=1e-9)
    with pytest.raises(KeyError):
        true_robot(model, {"theta_9": 0.1})


# ------------------------------------------------------------------------------------------------- results and report


def content(handover: Handover, robot: Robot) -> dict[str, Any]:
    facts = {"controller": correction_facts(robot), "compensation": handover_facts(handover)}
    return dict(json.loads(json.dumps(facts, allow_nan=False)))


def test_facts(perfect: Handover) -> None:
    found = content(perfect, calibrated(TABLE_III))["compensation"]
    assert found["without"] == found["before"]
    assert found["before"]["position_mm"]["mean"] == pytest.approx(perfect.before.size.mean())
    assert found["after_reached"]["position_mm"]["count"] == found["status"]["reached"]
    assert found["after_reached"]["position_mm"]["max"] < 2 * REACHED
    assert (found["frame"], found["against"], found["aligned"]) == ("base", "truth", False)
    assert found["orientation_compensated"] is False


def test_unknown_numbers_are_null() -> None:
    robot = calibrated(TABLE_III)
    assert robot.record is not None
    unseen = replace(robot, record=replace(robot.record, sigmas={**robot.record.sigmas, "d_3": None}))
    rows = correction_facts(unseen)["corrections"]
    assert [row["parameter"] for row in rows if row["sigma"] is None] == ["d_3"]
    assert len(rows) == len(corrections(unseen))


def test_text_says_that_a_file_changes_nothing(perfect: Handover) -> None:
    text = handover_text(content(perfect, calibrated(TABLE_III)))
    assert text is not None
    labels = [row["label"] for row in text["compensation"]["rows"]]
    assert text["compensation"]["rows"][0]["cells"] == text["compensation"]["rows"][1]["cells"]
    assert len(labels) == 4
    assert "changes nothing" in text["compensation"]["text"]
    assert "the orientation is not" in text["compensation"]["note"]
    assert "subtracts its offset wants the opposite sign" in text["corrections"]["note"]
    row = next(row for row in text["corrections"]["rows"] if row["symbol"] == "θ₁")
    assert float(row["cells"][1]) == pytest.approx(np.degrees(TABLE_III["theta_1"]), abs=1e-4)
    assert row["cells"][-1] == "deg"
    assert handover_text({}) is None
    assert text["code"] is None


def test_doubts_are_told_in_words(perfect: Handover) -> None:
    facts = content(perfect, calibrated({**TABLE_III, "theta_5": -0.37}))
    text = handover_text(facts)
    assert text is not None
    assert "should not go to a controller" in text["gate"]
    assert "theta_5 is off by -21.2 deg" in text["gate"]


def test_figures_say_what_they_show(perfect: Handover, tmp_path: Path) -> None:
    shown = handover_figures(perfect)
    assert [one.name for one in shown] == ["compensation", "compensation_map"]
    away = int((~perfect.reached).sum())
    assert f"{away} poses" in shown[0].caption
    assert f"{away} poses" in shown[1].caption
    assert f"{perfect.before.size.mean():.2f} mm" in shown[0].caption
    for picture in save_figures(shown, tmp_path):
        assert picture.file.stat().st_size > 2000


def test_figures_when_nothing_is_reached(rng: np.random.Generator, tmp_path: Path) -> None:
    """A single pose far off, and a calibration that found no error at all."""
    truth = handling().corrected(TABLE_III)
    nothing = hand_over(calibrated(dict.fromkeys(TABLE_III, 0.0)), truth, front_half(20, rng), rng)
    assert nothing.after.size == pytest.approx(nothing.before.size)
    beyond = hand_over(calibrated({**TABLE_III, "d_2": 400.0}), truth, front_half(20, rng), rng)
    assert not beyond.reached.any()
    assert handover_facts(beyond)["after_reached"] is None
    for k, found in enumerate((nothing, beyond)):
        save_figures(handover_figures(found), tmp_path / str(k))


# ------------------------------------------------------------------------------------------------------- whole runs


def test_a_run_leaves_code_and_says_so(configs: Path, tmp_path: Path) -> None:
    quick = ("data.test_poses=50", "outputs.figures=false", "outputs.report=false")
    folder, found = run(configs / "simulated_arm.yaml", tmp_path / "out", overrides=(*quick, "outputs.c=true"))
    assert found == json.loads((folder / "results.json").read_text())
    code = found["controller"]["code"]
    assert code["written"]
    assert {path.relative_to(folder / "c").as_posix() for path in (folder / "c").rglob("*") if path.is_file()} == set(
        code["files_bytes"]
    )
    assert found["compensation"]["aligned"]  # the base was estimated
    assert (
        found["compensation"]["after"]["position_mm"]["p95"]
        < 0.1 * found["compensation"]["before"]["position_mm"]["p95"]
    )
    assert (folder / "tables" / "corrections.csv").is_file()
    run(configs / "simulated_arm.yaml", tmp_path / "out", overrides=quick)
    assert not (folder / "c").exists()


def test_doubtful_numbers_are_not_exported(configs: Path, tmp_path: Path) -> None:
    """An error of theta_4 that no robot has: the run goes on, warns, and writes no code."""
    overrides = (
        "data.test_poses=50",
        "outputs.figures=false",
        "outputs.report=false",
        "outputs.c=true",
        "data.truth.errors.theta_4=0.7",
    )
    folder, found = run(configs / "simulated_arm.yaml", tmp_path / "out", overrides=overrides)
    assert not (folder / "c").exists()
    assert found["controller"]["code"]["written"] is False
    assert any("theta_4" in doubt for doubt in found["controller"]["code"]["doubts"])
    assert any("no C code was written" in warning for warning in found["warnings"])
    text = handover_text(found)
    assert text is not None
    assert text["code"]["text"] == "No C code was written, because of the doubts above."
