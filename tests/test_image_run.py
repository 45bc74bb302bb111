"""Experiments with a camera, end to end: image points that are simulated, and images that are rendered (small ones)."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from symcal.camera.board import Board
from symcal.camera.camera import Camera, project_points
from symcal.data.measurement_file import load_measurements
from symcal.errors import InputError
from symcal.robot.files import load_robot
from symcal.runs.run import run
from symcal.runs.validate import validate_robot
from symcal.vision.board_views import board_views

SMALL = {"width": 816, "height": 684, "units": {"image": "px"}}


def folder_of(configs: Path, tmp_path: Path, poses: int = 40) -> Path:
    """The shipped experiment with a ninth of the pixels, at random poses."""
    shutil.copytree(configs / "robots", tmp_path / "robots")
    shutil.copytree(configs / "vision", tmp_path / "vision")
    sheet = SMALL | {"lens": {"focal_mm": 16, "pixel_um": 10.35}}
    numbers = {"fx": 1550.7, "fy": 1550.3, "cx": 410.6, "cy": 339.9}
    lens = SMALL | {"intrinsics": numbers, "distortion": {"k1": -0.09, "k2": 0.12}}
    (tmp_path / "vision" / "camera_data_sheet.yaml").write_text(yaml.safe_dump(sheet))
    (tmp_path / "vision" / "camera_true.yaml").write_text(yaml.safe_dump(lens))
    content = yaml.safe_load((configs / "vision.yaml").read_text())
    del content["plan"]["method"]
    content["plan"] |= {"poses": poses}
    content["plan"]["constraints"]["view"]["margin_px"] = 40
    content["data"] |= {"views": 10, "examples": 2, "test_poses": 60}
    (tmp_path / "vision.yaml").write_text(yaml.safe_dump(content))
    return tmp_path / "vision.yaml"


@pytest.fixture(scope="module")
def rendered(configs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rendered")
    file = folder_of(configs, folder, poses=14)
    out, results = run(file, folder / "run")
    return out, results


def test_rendered_images_calibrate_the_robot(rendered):
    _, results = rendered
    accuracy = results["accuracy"]["test"]
    assert accuracy["before"]["position_mm"]["rms"] > 1.0
    assert accuracy["after"]["position_mm"]["rms"] < 0.02
    assert accuracy["after"]["position_mm"]["count"] == 60
    assert results["against"] == "truth, after one rigid alignment"
    assert results["images"]["measured"] == 14
    assert results["images"]["camera_found_from_images"]
    assert results["images"]["error_per_axis_px"] < 0.015
    camera = results["camera"]["intrinsics"]
    assert camera["fx"]["calibrated"] == pytest.approx(camera["fx"]["true"], rel=1e-3)
    ways = results["comparison"]
    assert set(ways) == {"pixels", "p3p", "p3p_points", "p3p_covariance"}
    assert ways["p3p"]["times_pixels"] > 2


def test_the_folder_of_a_run_with_images(rendered, configs):
    out, results = rendered
    assert json.loads((out / "results.json").read_text())["comparison"] == results["comparison"]
    assert (out / "report.pdf").read_bytes().startswith(b"%PDF")
    assert (out / "report.html").read_text(encoding="utf-8").count('src="data:image/jpeg;base64,') == 14
    worst = results["accuracy"]["test"]["after"]["position_mm"]["worst"]
    assert worst["pose"].startswith("unseen ")
    assert len(list((out / "images").glob("*.png"))) == 2
    for name in ("camera.yaml", "calibrated.yaml", "measurements.csv", "figures/ways_compared.pdf"):
        assert (out / name).is_file()
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    data = load_measurements(out / "measurements.csv", robot, "pixels", point_names=("P1", "P2", "P3"))
    assert len(data) == 14


def test_measured_image_points_are_identified_again_from_their_file(rendered, configs, tmp_path):
    """`data: file` with the measurements and the camera of the run: errors are then across the lines of sight."""
    out, _ = rendered
    content = yaml.safe_load((configs / "vision.yaml").read_text())
    content["robot"] = str(configs / "robots" / "handling_robot.yaml")
    content["measurement"] = {
        "type": "pixels",
        "camera": str(out / "camera.yaml"),
        "target": str(configs / "vision" / "target.yaml"),
    }
    content["data"] = {"source": "file", "file": str(out / "measurements.csv")}
    content["validation"] = {"folds": 0}
    content["outputs"] = {"figures": False, "report": False}
    del content["plan"]
    (tmp_path / "again.yaml").write_text(yaml.safe_dump(content))
    _, results = run(tmp_path / "again.yaml", tmp_path / "run")
    assert results["accuracy"]["train"]["after"]["position_mm"]["rms"] < 0.02
    assert results["identification"]["noise_sigma_px"] < 0.02
    assert results["measurement"]["estimate"] == ["camera", "intrinsics", "tool"]


def test_new_images_validate_a_calibrated_robot(rendered):
    out, _ = rendered
    found = validate_robot(out / "calibrated.yaml", out / "measurements.csv")["accuracy"]["test"]
    assert found["before"]["position_mm"]["rms"] > 0.5
    assert found["after"]["position_mm"]["rms"] < 0.02
    moved = validate_robot(out / "calibrated.yaml", out / "measurements.csv", refit=("camera",))["accuracy"]["test"]
    assert moved["after"]["position_mm"]["rms"] < 0.02


def test_simulated_image_points(configs, tmp_path):
    file = folder_of(configs, tmp_path)
    content = yaml.safe_load(file.read_text())
    truth = content["data"]["truth"]
    content["data"] = {"source": "simulated", "truth": truth, "noise": {"image": 0.02}, "test_poses": 100}
    content["measurement"] |= {"camera": "vision/camera_true.yaml", "estimate": ["tool", "camera"]}
    content["outputs"] = {"figures": False, "report": False}
    file.write_text(yaml.safe_dump(content))
    _, results = run(file, tmp_path / "run")
    found = results["accuracy"]["test"]["after"]["position_mm"]["rms"]
    expected = results["expected_position_rms_mm"]["test"]
    assert 0.4 * expected < found < 2 * expected
    assert results["identifiability"]["rank"] == 21
    assert results["identification"]["noise_sigma_px"] == pytest.approx(0.02, rel=0.25)
    assert "images" not in results


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (("measurement", "camera"), "nowhere.yaml", "camera file is not there"),
        (("measurement", "camera_pose"), None, "where the camera is"),
        (("data", "board"), "chessboard:9x6", "board"),
        (("measurement", "target"), None, "needs 'camera' and 'target'"),
    ],
)
def test_what_is_missing_is_named(configs, tmp_path, key, value, message):
    file = folder_of(configs, tmp_path)
    content = yaml.safe_load(file.read_text())
    if value is None:
        del content[key[0]][key[1]]
    else:
        content[key[0]][key[1]] = value
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=message):
        run(file, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_views_of_a_board_are_whole_tilted_and_reach_the_corners():
    camera = Camera(1224, 1024, 2326.0, 2325.0, 611.5, 511.5, (-0.09, 0.12))
    board = Board("chessboard", 11, 8, 30.0)
    views = board_views(camera, board, 18, np.random.default_rng(0))
    pixels = project_points(camera, np.einsum("nij,kj->nki", views[:, :3, :3], board.points) + views[:, None, :3, 3])
    assert pixels.min() > 0
    assert np.all(pixels.reshape(-1, 2).max(axis=0) < [1223, 1023])
    tilt = np.rad2deg(np.arccos(views[:, 2, 2]))
    assert tilt.min() > 14
    assert tilt.max() < 46
    for corner in np.array([[0, 0], [1223, 0], [0, 1023], [1223, 1023]]):
        assert np.linalg.norm(pixels.reshape(-1, 2) - corner, axis=1).min() < 260
