"""`symcal camera` and `symcal measure` as a user calls them, on rendered images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from camera_scenes import ROBOT, T_WORLD_CAMERA, TRUTH, poses, small_camera, target, target_poses
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import symcal as sc
from symcal import spatial
from symcal.camera.board import Board
from symcal.camera.camera import Camera
from symcal.camera.files import read_camera, write_camera, write_target
from symcal.cli import app
from symcal.config.scene import read_scene
from symcal.data.measurement_file import load_measurements
from symcal.errors import InputError
from symcal.model.model import build_model
from symcal.model.task import Scene, pixels_task
from symcal.robot.files import save_robot
from symcal.vision.render import Look, render_board, render_discs


def command(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Ten views of a chessboard by a small camera, and one image of nothing."""
    folder = tmp_path_factory.mktemp("boards")
    rng = np.random.default_rng(2)
    camera = Camera(640, 480, 620.0, 621.0, 322.0, 238.0, (-0.2, 0.05))
    board = Board("chessboard", 9, 6, 25.0)
    for i in range(10):
        turn = Rotation.from_euler(
            "xyz", [rng.uniform(-40, 40), rng.uniform(-40, 40), rng.uniform(-20, 20)], degrees=True
        )
        middle = np.array([rng.uniform(-60, 60), rng.uniform(-45, 45), rng.uniform(350, 430)])
        pose = spatial.transform(turn.as_matrix(), middle - turn.as_matrix() @ np.array([100.0, 62.5, 0.0]))
        cv2.imwrite(str(folder / f"view{i}.png"), render_board(camera, board, pose, rng, Look(noise=0.005)))
    cv2.imwrite(str(folder / "nothing.png"), np.full((480, 640), 128, np.uint8))
    return folder, camera


def test_camera_command(boards, tmp_path):
    folder, truth = boards
    out = tmp_path / "camera.yaml"
    done = command("camera", folder, "--board", "chessboard:9x6:25mm", "--out", out)
    assert done.exit_code == 0, done.output
    found = read_camera(out)
    assert found.fx == pytest.approx(truth.fx, rel=2e-3)
    assert found.covariance is not None
    assert "nothing.png" in done.output
    assert out.with_suffix(".pdf").read_bytes().startswith(b"%PDF")
    assert {file.name for file in tmp_path.iterdir()} == {"camera.yaml", "camera.pdf"}


def test_camera_command_refuses_what_is_no_board(boards, tmp_path):
    folder, _ = boards
    done = command("camera", folder / "nothing.png", "--board", "chessboard:9x6:25mm", "--out", tmp_path / "c.yaml")
    assert done.exit_code != 0
    assert "nothing.png" in str(done.exception)
    assert not (tmp_path / "c.yaml").exists()


def test_measure_command(tmp_path):
    lens = small_camera()
    model = build_model(ROBOT, pixels_task(Scene(lens, target(), T_WORLD_CAMERA), ("tool", "camera")))
    q = poses(model, 4, np.random.default_rng(6))
    true = target_poses(model, q, model.parameters.vector(TRUTH), model.setup)
    folder = tmp_path / "images"
    folder.mkdir()
    rows = ["image,pose,q1_rad,q2_mm,q3_mm,q4_rad,q5_rad"]
    for i, pose in enumerate(true):
        cv2.imwrite(str(folder / f"{i}.png"), render_discs(lens, target(), pose, np.random.default_rng(i)))
        rows.append(",".join([f"{i}.png", f"pose {i}", *(repr(float(v)) for v in q[i])]))
    cv2.imwrite(str(folder / "4.png"), np.zeros((lens.height, lens.width), np.uint8))
    rows.append(",".join(["4.png", "dark", *(repr(float(v)) for v in q[0])]))
    (tmp_path / "joints.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "scene.yaml").write_text(
        "units: {length: m, angle: deg}\ncamera: {position: [0.1, 2.7, 1.15], look_at: [0.1, 0, 1.15]}\n"
    )
    write_camera(tmp_path / "camera.yaml", lens)
    write_target(tmp_path / "target.yaml", target())
    save_robot(ROBOT, tmp_path / "robot.yaml")
    files = {name: tmp_path / f"{name}.yaml" for name in ("camera", "target", "robot", "scene")}
    options = [word for name, file in files.items() for word in (f"--{name}", file)]
    done = command("measure", folder, *options, "--joints", tmp_path / "joints.csv", "--out", tmp_path / "z.csv")
    assert done.exit_code == 0, done.output
    assert "not measured: 4.png: black image" in done.output
    data = load_measurements(tmp_path / "z.csv", ROBOT, "pixels", point_names=("P1", "P2", "P3"))
    assert data.labels == ("pose 0", "pose 1", "pose 2", "pose 3")
    np.testing.assert_allclose(data.q, q, atol=1e-12)
    assert "# not measured: 4.png: black image" in (tmp_path / "z.csv").read_text()


def test_scene_files(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text("units: {length: mm, angle: deg}\ncamera: {position: [100, 2700, 1150], look_at: [100, 0, 1150]}\n")
    np.testing.assert_allclose(read_scene(file), T_WORLD_CAMERA, atol=1e-9)
    file.write_text("units: {length: mm, angle: deg}\ncamera: {position: [100, 2700, 1150]}\n")
    with pytest.raises(InputError, match="look_at"):
        read_scene(file)


@pytest.fixture(scope="module")
def corner_file(boards, tmp_path_factory):
    """The corners of the rendered views as a list, one view with three points only."""
    from symcal.vision.board import detect_boards

    folder, _ = boards
    board = Board("chessboard", 9, 6, 25.0)
    detections, _ = detect_boards(sorted(folder.glob("view*.png")), board)
    rows = ["view,id,X_mm,Y_mm,u_px,v_px"]
    for found in detections:
        for i, (u, v) in zip(found.indices, found.pixels.tolist(), strict=True):
            rows.append(f"{found.name},{i},{board.points[i, 0]},{board.points[i, 1]},{u!r},{v!r}")
    rows += [f"few.png,{i},{board.points[i, 0]},0,{100 + 20 * i},50" for i in range(3)]
    file = tmp_path_factory.mktemp("lists") / "corners.csv"
    file.write_text("\n".join(rows) + "\n")
    return file


def test_camera_command_takes_a_list_of_corners(corner_file, tmp_path):
    out = tmp_path / "camera.yaml"
    done = command("camera", "--points", corner_file, "--size", "640x480", "--fix", "p1,p2,k3", "--skew", "--out", out)
    assert done.exit_code == 0, done.output
    corners = sc.load_corners(corner_file, (640, 480))
    expected = sc.calibrate_camera(corners, fix=("p1", "p2", "k3"), skew=True).camera
    assert read_camera(out).numbers == pytest.approx(expected.numbers, rel=1e-6)
    assert expected.dist[2:] == (0.0, 0.0, 0.0)
    assert "10 of 11 views used" in done.output
    assert "p1, p2 and k3 were held at zero, as asked" in done.output
    assert "look at: few.png: it has 3 points: at least 4 are needed" in done.output
    assert {file.name for file in tmp_path.iterdir()} == {"camera.yaml", "camera.pdf"}
    assert "few.png: 'it has 3 points" in out.read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--points", "CORNERS"], "does not tell the image's size"),
        (["--points", "CORNERS", "--size", "640"], "WIDTHxHEIGHT"),
        (["--points", "CORNERS", "--size", "640x480", "--fix", "p4"], "can be held at zero"),
        (["--points", "CORNERS", "--size", "640x480", "--board", "chessboard:9x6:25mm"], "brings its own points"),
        (["--points", "CORNERS", "--size", "640x480", "--bowed"], "brings its own points"),
        (["--points", "CORNERS", "--size", "480x640"], "outside the image of 480 x 640 px"),
        (["IMAGES", "--points", "CORNERS", "--size", "640x480"], "not both"),
        ([], "give images of a board"),
        (["IMAGES"], "say which board"),
        (["IMAGES", "--board", "chessboard:9x6:25mm", "--size", "640x480"], "images tell their size"),
        (["IMAGES", "--board", "chessboard:9x6:25mm", "--fix", "k7"], "can be held at zero"),
    ],
)
def test_camera_command_says_what_is_missing_or_too_much(words, said, boards, corner_file, tmp_path):
    files = {"CORNERS": corner_file, "IMAGES": boards[0]}
    done = command("camera", *(files.get(word, word) for word in words), "--out", tmp_path / "c.yaml")
    assert isinstance(done.exception, InputError)
    assert said in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_camera_command_holds_the_terms_of_images(boards, tmp_path):
    folder, _ = boards
    words = ("camera", folder, "--board", "chessboard:9x6:25mm", "--out", tmp_path / "c.yaml")
    assert command(*words, "--fix", "none").exit_code == 0
    assert all(number != 0 for number in read_camera(tmp_path / "c.yaml").dist)
    assert command(*words, "--fix", "p1,p2").exit_code == 0
    assert [number == 0 for number in read_camera(tmp_path / "c.yaml").dist] == [False, False, True, True, False]
