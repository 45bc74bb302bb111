"""`symcal measure --board` as a user calls it, and experiments whose data are images of a board."""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import board_draws
import camera_scenes
import cv2
import numpy as np
import pytest
import yaml
from board_images import ARM, BOARD, LENS, images, views
from typer.testing import CliRunner

from symcal.calibration.simulate import simulate
from symcal.camera.files import write_camera, write_target
from symcal.camera.target import Target
from symcal.cli import app
from symcal.config.conversion import area_of, load_experiment
from symcal.data.measurement_file import load_measurements
from symcal.errors import InputError, RefusedError
from symcal.instruments.noise import Noise
from symcal.model.model import build_model
from symcal.model.task import Scene, pixels_task
from symcal.robot.files import save_robot
from symcal.runs.load import load
from symcal.runs.run import run
from symcal.vision.render import render_discs

SIGMA = np.array([0.5, 0.5, 0.5, 0.5, 1e-3, 4e-3, 1e-4, 1e-4, 0.0])
SWAPPED = {3: 17, 17: 3, 8: 30, 30: 8}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Forty images by a camera in the hand, of which two pairs have swapped names; truth of the image points."""
    place = tmp_path_factory.mktemp("boards")
    rng = np.random.default_rng(11)
    found = views(40, rng)
    pictures = images(found, rng)
    (place / "images").mkdir()
    for i in range(40):
        cv2.imwrite(str(place / "images" / f"{i:02d}.png"), pictures[SWAPPED.get(i, i)])
    rows = ["image,pose,split," + ",".join(f"q{k}_deg" for k in range(1, 7))]
    for i, q in enumerate(np.rad2deg(found.q)):
        part = "test" if i % 4 == 1 else "train"
        rows.append(f"{i:02d}.png,P{i},{part}," + ",".join(repr(float(value)) for value in q))
    (place / "joints.csv").write_text("\n".join(rows) + "\n")
    write_camera(place / "camera.yaml", replace(LENS, covariance=np.diag(SIGMA**2)))
    write_target(place / "target.yaml", Target.triangle(200.0, 25.0))
    save_robot(ARM, place / "robot.yaml")
    return place, found


def command(folder: Path, *words: object):
    files = ["--camera", folder / "camera.yaml", "--joints", folder / "joints.csv", "--robot", folder / "robot.yaml"]
    return CliRunner().invoke(app, [str(word) for word in ("measure", folder / "images", *files, *words)])


def test_forty_images_with_two_pairs_of_swapped_names(folder, tmp_path):
    place, found = folder
    out = tmp_path / "measurements.csv"
    done = command(place, "--board", BOARD, "--out", out)
    assert done.exit_code == 0, done.output
    printed = " ".join(done.output.split())
    for i, j in SWAPPED.items():
        assert f"not measured: {i:02d}.png: its name is swapped with that of {j:02d}.png" in printed
        assert f"# not measured: {i:02d}.png" in out.read_text()
    assert "the camera is in the robot's hand" in printed
    data = load_measurements(out, ARM, "pixels", point_names=tuple(str(i) for i in range(len(BOARD.points))))
    good = [i for i in range(40) if i not in SWAPPED]
    assert data.labels == tuple(f"P{i}" for i in good)
    np.testing.assert_allclose(data.q, found.q[good], atol=1e-12)
    error = data.z.reshape(36, -1, 2) - found.pixels[good]
    assert np.nanmax(np.abs(error)) < 0.3
    assert data.split.count("test") == sum(i % 4 == 1 for i in good)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "say what the images show"),
        (("--board", "charuco:8x6:40mm:30mm", "--target", "target.yaml"), "say what the images show"),
        (("--board", "charuco:8x6"), "board"),
        (("--board", "charuco:9x6:40mm:30mm:DICT_4X4_50"), "the images show a ChArUco board of 8 squares"),
        (("--board", "charuco:8x6:48mm:36mm:DICT_4X4_50"), "times as large as said: its squares measure 40"),
    ],
)
def test_what_cannot_be_measured_is_said_and_nothing_written(folder, tmp_path, words, message):
    place, _ = folder
    words = [place / word if word == "target.yaml" else word for word in words]
    done = command(place, *words, "--out", tmp_path / "z.csv")
    assert isinstance(done.exception, InputError | RefusedError)
    assert message in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_a_joints_file_without_rows_or_images(folder, tmp_path):
    place, _ = folder
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a.png").write_bytes((place / "images" / "00.png").read_bytes())
    for name in ("camera.yaml", "robot.yaml"):
        (tmp_path / name).write_text((place / name).read_text())
    head = "image,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n"
    for text, message in (
        (head, "no rows"),
        (head + "b.png,1,2,3,4,5,6\n", "none of the images"),
        ("image\na.png\n", "q1"),
    ):
        (tmp_path / "joints.csv").write_text(text)
        done = command(tmp_path, "--board", BOARD, "--out", tmp_path / "z.csv")
        assert message in str(done.exception)


def experiment(place: Path, **data: object) -> dict:
    source = {"source": "images", "files": str(place / "images"), "joints": str(place / "joints.csv")}
    return {
        "name": "hand",
        "units": {"length": "mm", "angle": "deg"},
        "robot": str(place / "robot.yaml"),
        "measurements": {
            "camera": {
                "instrument": "pixels",
                "camera": str(place / "camera.yaml"),
                "intrinsics": "unknown",
                "at": {"on": "flange", "place": "unknown"},
                "target": {"on": "base", "place": "unknown", "board": str(BOARD)},
                "data": source | data,
            }
        },
        "validation": {"folds": 0},
        "outputs": {"figures": False, "report": False},
    }


def test_an_experiment_measures_its_images_and_identifies(folder, tmp_path):
    place, _ = folder
    content = experiment(place) | {"outputs": {}}
    (tmp_path / "e.yaml").write_text(yaml.safe_dump(content))
    out, results = run(tmp_path / "e.yaml", tmp_path / "run")
    facts = results["measured_images"]["camera"]
    assert (facts["given"], facts["measured"]) == (40, 36)
    assert {each["image"] for each in facts["failures"]} == {f"{i:02d}.png" for i in SWAPPED}
    assert sum("two names are swapped" in note for note in results["warnings"]) == 2
    errors = results["accuracy"]["test"]
    assert errors["before"]["position_mm"]["rms"] > 0.4
    assert errors["after"]["position_mm"]["rms"] < 0.1
    assert results["identification"]["noise_sigma_px"] < 0.05
    assert "its name is swapped" in (out / "measurements.csv").read_text()
    assert (out / "figures" / "example_images.png").is_file()
    assert (out / "report.pdf").read_bytes().startswith(b"%PDF")
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count('src="data:image/jpeg;base64,') == 36  # of every pose
    assert len(page) < 10_000_000
    resolved, document = load_experiment(out / "experiment.resolved.yaml")
    source = resolved.measurements["camera"].data
    assert document.resolve(source.files, ()).resolve() == (place / "images").resolve()


def test_data_at_the_top_is_measured_alike(folder, tmp_path):
    place, _ = folder
    content = experiment(place)
    content["data"] = content["measurements"]["camera"].pop("data")
    content["data"]["files"] = [str(place / "images" / f"{i:02d}.png") for i in range(16)]
    (tmp_path / "e.yaml").write_text(yaml.safe_dump(content))
    _, results = run(tmp_path / "e.yaml", tmp_path / "run")
    facts = results["measured_images"]["camera"]
    assert facts["measured"] == 14
    left = {each["image"]: each["reason"] for each in facts["failures"]}
    assert left["03.png"].startswith("it fits the joints of pose P17, not those of its name")
    assert "no such image was given" in left["20.png"]


ON_ROBOT = {"on": "flange", "place": "unknown"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"at": {"on": "base", "place": "unknown"}, "target": ON_ROBOT | {"board": str(BOARD)}},
            "by its images the camera 'camera' is in the robot's hand and the board is not",
        ),
        ({"target": {"on": "base", "points": {"P": [0, 0, 0]}}}, "of a target with 'board' or 'file'"),
        ({"at": ON_ROBOT | {"per": "session"}}, "measure the images first"),
    ],
)
def test_experiments_that_do_not_fit_their_images_are_refused(folder, tmp_path, change, message):
    place, _ = folder
    content = experiment(place, files=[str(place / "images" / f"{i:02d}.png") for i in range(10, 17)])
    content["measurements"]["camera"] |= change
    (tmp_path / "e.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises((InputError, RefusedError), match=message):
        run(tmp_path / "e.yaml", tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.long
def test_discs_are_measured_in_an_experiment_too(tmp_path):
    """The short form: a camera beside the robot, which nobody has placed, and three discs on the tool."""
    lens = camera_scenes.small_camera()
    scene = Scene(lens, camera_scenes.target(), camera_scenes.T_WORLD_CAMERA)
    model = build_model(camera_scenes.ROBOT, pixels_task(scene, ("tool", "camera")))
    q = camera_scenes.poses(model, 12, np.random.default_rng(6))
    true = camera_scenes.target_poses(model, q, model.parameters.vector(camera_scenes.TRUTH), model.setup)
    rows = ["image,q1_rad,q2_mm,q3_mm,q4_rad,q5_rad"]
    for i, pose in enumerate(true):
        picture = render_discs(lens, camera_scenes.target(), pose, np.random.default_rng(i))
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture if i != 4 else np.zeros_like(picture))
        rows.append(",".join([f"{i}.png", *(repr(float(value)) for value in q[i])]))
    (tmp_path / "joints.csv").write_text("\n".join(rows) + "\n")
    write_camera(tmp_path / "camera.yaml", lens)
    write_target(tmp_path / "target.yaml", camera_scenes.target())
    save_robot(camera_scenes.ROBOT, tmp_path / "robot.yaml")
    short = {"type": "pixels", "camera": "camera.yaml", "target": "target.yaml", "estimate": ["camera", "tool"]}
    content = experiment(tmp_path) | {
        "measurement": short,
        "data": {"source": "images", "files": ".", "joints": "joints.csv"},
    }
    del content["measurements"]
    (tmp_path / "e.yaml").write_text(yaml.safe_dump(content))
    out, results = run(tmp_path / "e.yaml", tmp_path / "run")
    facts = results["measured_images"]["pixels"]
    assert (facts["given"], facts["measured"]) == (12, 11)
    assert "the camera was found at" in facts["where"]
    assert "not measured: 4.png: black image" in " ".join(results["warnings"])
    assert results["identification"]["noise_sigma_px"] < 0.05
    assert len(load_measurements(out / "measurements.csv", camera_scenes.ROBOT, "pixels")) == 11


def test_two_cameras_do_not_share_their_images(folder, tmp_path):
    place, _ = folder
    content = experiment(place)
    entry = content["measurements"]["camera"]
    content["data"] = entry.pop("data")
    content["data"]["files"] = [str(place / "images" / f"{i:02d}.png") for i in range(9, 16)]
    content["measurements"]["other"] = deepcopy(entry)
    (tmp_path / "e.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match="'other' would be measured in the same images as 'camera'"):
        run(tmp_path / "e.yaml", tmp_path / "run")


@pytest.mark.long
def test_the_shipped_experiment_with_few_poses(configs, tmp_path):
    """The true robot is known: corners, camera and robot come out as the noise of the images lets them."""
    overrides = ["plan.poses=20", "data.views=6", "data.test_poses=50", "data.examples=1"]
    overrides += ["validation.folds=0", "outputs.report=false", "outputs.figures=false"]
    out, results = run(configs / "eye_in_hand_board.yaml", tmp_path / "run", overrides=overrides)
    facts = results["measured_images"]["camera"]
    assert facts["measured"] == 20
    assert facts["points"] < 0.9 * 20 * 88  # boards are seen in part
    assert facts["error_per_axis_px"] < 0.06
    assert results["identification"]["noise_sigma_px"] == pytest.approx(facts["error_per_axis_px"], rel=0.15)
    truth = results["accuracy"]["truth"]
    assert truth["before"]["position_mm"]["rms"] > 1.0
    assert truth["after"]["position_mm"]["rms"] < 0.03
    assert json.loads((out / "results.json").read_text())["camera"]["intrinsics"]["fx"]["true"] == 611.7
    assert (out / "camera.yaml").is_file()
    assert len(list((out / "images").glob("*.png"))) == 1


def test_draws_on_partial_views_are_as_good_as_the_noise_lets_them_be():
    """Short form of `python tests/board_draws.py 100`, with the noise of the corners that the rendered set showed."""
    experiment = load(board_draws.CONFIG)
    model, (lower, upper) = experiment.model, area_of(experiment.file, experiment.document, experiment.robot)
    rng = np.random.default_rng(3)
    q = rng.uniform(lower, upper, (400, model.robot.dof))
    seen = np.isfinite(simulate(model, {}, q, Noise(), rng).z).mean(axis=1)
    found = board_draws.drawn(model, q[seen > 0.4][:25], 0.0366, 4)
    assert found.seen < 0.9
    assert found.inside.mean() > 0.8
    assert found.ratio.mean() == pytest.approx(1.0, abs=5 * np.sqrt(2 / (4 * 35)))
    np.testing.assert_allclose(found.noise, 0.0366, rtol=0.08)
