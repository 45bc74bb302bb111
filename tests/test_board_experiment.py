"""Boards from file to report: simulated by two cameras, identified, validated; a sentence for each mistake."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from boards import CAMERA, LYING, MOUNT, ROBOT, SMALL, postures
from numpy.typing import NDArray

import symcal as sc
from symcal import spatial
from symcal.camera.files import write_camera
from symcal.errors import InputError
from symcal.runs.check import check_model
from symcal.runs.data import measurements
from symcal.runs.load import load
from symcal.runs.run import run
from symcal.runs.validate import validate_robot

Array = NDArray[np.float64]
Write = Callable[..., Path]
TEXT = "charuco:6x5:40mm:30mm:DICT_4X4_100"


def frame(pose: Array) -> str:
    xyz, rpy = pose[:3, 3], np.rad2deg(spatial.matrix_rpy(pose[:3, :3]))
    return f"{{xyz: [{', '.join(f'{v:.3f}' for v in xyz)}], rpy: [{', '.join(f'{v:.4f}' for v in rpy)}]}}"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Two cameras in one hand look at one board; postures near one that shows it."""
    sc.save_robot(ROBOT, tmp_path / "robot.yaml")
    write_camera(tmp_path / "camera.yaml", CAMERA)
    (middle,) = np.rad2deg(postures(SMALL, 1, np.random.default_rng(1), spread=0.1))
    middle = np.clip(middle, -115.0, 115.0)
    area = ", ".join(f"j{i}: [{q - 25:.1f}, {q + 25:.1f}]" for i, q in enumerate(middle, start=1))
    second = MOUNT @ spatial.transform(np.eye(3), np.array([60.0, 0.0, 0.0]))

    def made(*, more: str = "", board: str = TEXT, target: str = "", intrinsics: str = "unknown") -> Path:
        path = tmp_path / "experiment.yaml"
        path.write_text(
            "name: boards\nseed: 2\nunits: {length: mm, angle: deg}\nrobot: robot.yaml\n"
            f"targets:\n  sheet: {{on: world, place: unknown, near: {frame(LYING)}, board: '{board}'{target}}}\n"
            "measurements:\n"
            f"  cam1: {{instrument: pixels, camera: camera.yaml, intrinsics: {intrinsics}, noise: {{image: 0.1}}, "
            f"at: {{on: flange, place: unknown, near: {frame(MOUNT)}}}, target: sheet}}\n"
            f"  cam2: {{instrument: pixels, camera: camera.yaml, intrinsics: {intrinsics}, noise: {{image: 0.1}}, "
            f"at: {{on: flange, place: unknown, near: {frame(second)}}}, target: sheet}}\n"
            f"plan: {{poses: 24, area: {{{area}}}}}\n"
            "data: {source: simulated, truth: {sigma_length: 0.2, sigma_angle: 0.05}, noise: {image: 0.1}, "
            "test_poses: 8}\nvalidation: {folds: 0}\noutputs: {c: false}\n" + more
        )
        return path

    return made


def test_two_cameras_and_one_board_from_file_to_report(write: Write, tmp_path: Path) -> None:
    _, content = run(write(), tmp_path / "out")
    assert content["identification"]["converged"]
    parameters = content["identification"]["parameters"]
    for name in ("cam1_fx", "cam2_k1", "cam1_rx", "sheet_x"):
        assert parameters[name]["free"]
    assert content["identification"]["chi_squared"] == pytest.approx(content["identification"]["dof"], rel=0.15)
    for name in ("cam1", "cam2"):
        accuracy = content["instruments"][name]["accuracy"]["test"]
        assert accuracy["after"]["rms"] < 0.15 < accuracy["before"]["rms"]
    figures = {p.name for p in (tmp_path / "out" / "figures").glob("*.png")}
    assert {"image_residuals_cam1.png", "image_residuals_cam2.png"} <= figures
    assert (tmp_path / "out" / "report.pdf").stat().st_size > 10_000
    assert (tmp_path / "out" / "results.json").stat().st_size < 120_000
    rows = list(csv.DictReader((tmp_path / "out" / "tables" / "errors.csv").read_text().splitlines()))
    assert len(rows) < 3 * 32 + 1  # by pose, not by corner
    assert all(float(row["points"]) <= 2 * 20 for row in rows)
    assert json.loads((tmp_path / "out" / "results.json").read_text())["frames"]["points_mm"] == {}
    own = tmp_path / "out" / "measurements" / "cam1.csv"
    checked = validate_robot(tmp_path / "out" / "calibrated.yaml", own, instrument="cam1")["accuracy"]["test"]
    assert checked["after"]["position_mm"]["rms"] < 0.15 < checked["before"]["position_mm"]["rms"]


def test_check_says_what_boards_can_tell(write: Write) -> None:
    first, second = check_model(load(write()).model).instruments
    assert first.of == "sheet 20 points (0 to 19) on world"
    assert (first.rows, second.rows) == (40, 40)
    assert second.added == 6 + 9  # its place and its numbers; of the robot nothing new
    assert "cam2_fx" in second.unknown
    known, _ = check_model(load(write(intrinsics="known")).model).instruments
    assert known.alone == first.alone - 9


def test_simulated_data_are_taken_where_the_board_is_seen(write: Write) -> None:
    experiment = load(write(target=", seen: 12"))
    found = measurements(experiment.file, experiment.document, experiment.model, np.random.default_rng(3)).data
    seen = np.isfinite(found.z).reshape(len(found), 2, 40)[:, :, ::2].sum(axis=2)
    assert len(found) == 32
    assert seen[seen > 0].min() >= 12
    assert (seen > 0).mean() > 0.95  # nominal postures show it to both; the true robot is a little off


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (", seen: 21", "the target has 20 points"),
        (", seen: all", "whole"),
        (", seen: 2", "greater than or equal to 4|at least 4"),
        (", incidence: -5", "greater than 0"),
    ],
)
def test_what_is_said_of_a_board_makes_sense(write: Write, target: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        load(write(target=target))
    assert error.value.line is not None


def test_incidence_and_share_reach_the_model(write: Write) -> None:
    (first, _) = load(write(target=", seen: whole, incidence: 50")).model.task.observations
    assert first.target.needed == 20
    assert first.target.largest_incidence == pytest.approx(np.deg2rad(50.0))
    (first, _) = load(write(board="chessboard:6x5:40mm")).model.task.observations
    assert first.target.needed == 30
