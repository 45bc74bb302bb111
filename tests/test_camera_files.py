"""camera.yaml and target.yaml: what is written comes back, and what is wrong is named with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from symcal.camera.camera import Camera
from symcal.camera.files import (
    camera_from_dict,
    camera_to_dict,
    read_camera,
    read_target,
    write_camera,
    write_target,
)
from symcal.camera.target import Target
from symcal.errors import InputError


def test_a_camera_comes_back_with_its_covariance(tmp_path: Path, rng: np.random.Generator) -> None:
    factor = rng.standard_normal((9, 9))
    factor[8] = 0
    camera = Camera(640, 480, 532.8, 533.1, 342.5, 233.9, (-0.28, 0.03, 1e-3, -1e-4), factor @ factor.T, 0.1779)
    write_camera(tmp_path / "camera.yaml", camera, {"images": 13})
    back = read_camera(tmp_path / "camera.yaml")
    assert back == camera
    assert np.array_equal(back.covariance, camera.covariance)
    assert camera_from_dict(camera_to_dict(camera)) == camera


def test_a_lens_gives_the_pinhole_of_its_data_sheet(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text("units: {image: px}\nwidth: 2448\nheight: 2048\nlens: {focal_mm: 16, pixel_um: 3.45}\n")
    camera = read_camera(path)
    assert camera.fx == camera.fy == pytest.approx(4637.68, abs=0.01)
    assert (camera.cx, camera.cy) == (1223.5, 1023.5)


@pytest.mark.parametrize(
    ("text", "line", "word"),
    [
        (
            "units: {image: px}\nwidth: 640\nheight: 480\nlens: {focal_mm: 16, pixel_um: 3.45}\nfx: 5\n",
            5,
            "unknown key",
        ),
        ("width: 640\nheight: 480\nlens: {focal_mm: 16, pixel_um: 3.45}\n", None, "missing"),
        ("units: {image: px}\nwidth: 640\nheight: 480\n", None, "give one"),
        ("units: {image: px}\nwidth: 640\nheight: -1\nlens: {focal_mm: 16, pixel_um: 3.45}\n", 3, "greater"),
    ],
)
def test_wrong_cameras_are_named_with_their_line(tmp_path: Path, text: str, line: int | None, word: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=word) as caught:
        read_camera(path)
    assert caught.value.file == path
    if line is not None:
        assert caught.value.line == line


def test_a_matrix_that_is_no_covariance_is_refused() -> None:
    data = camera_to_dict(Camera(640, 480, 500.0, 500.0, 320.0, 240.0))
    for wrong in (-np.eye(9), np.triu(np.ones((9, 9))), np.ones((9, 9)) - 2 * np.eye(9)):
        with pytest.raises(InputError, match="not a covariance"):
            camera_from_dict({**data, "covariance": wrong.tolist()})


def test_a_target_comes_back_with_its_mount(tmp_path: Path) -> None:
    mount = np.eye(4)
    mount[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    mount[:3, 3] = [1, 2, 80]
    corners = np.array([[0, 0, 0], [100, 0, 0], [0, 100, 20], [30, 30, 30]], dtype=float)
    target = Target(("A", "B", "C", "D"), corners, 12.5, (0.0, 0.6, 0.8), "C", mount)
    write_target(tmp_path / "target.yaml", target)
    back = read_target(tmp_path / "target.yaml")
    assert (back.names, back.disc_radius, back.normal, back.marked) == (target.names, 12.5, (0.0, 0.6, 0.8), "C")
    assert np.array_equal(back.points, target.points)
    assert back.mount == pytest.approx(mount, abs=1e-12)


def test_units_of_a_target_are_converted_once(tmp_path: Path) -> None:
    path = tmp_path / "target.yaml"
    path.write_text(
        "units: {length: m, angle: deg}\ntriangle: {side: 0.2}\ndisc_radius: 0.015\n"
        "mount: {xyz: [0, 0, 0.08], rpy: [90, 0, 0]}\n"
    )
    target = read_target(path)
    assert np.linalg.norm(target.points[0] - target.points[1]) == pytest.approx(200)
    assert target.disc_radius == pytest.approx(15)
    assert target.mount is not None
    assert target.mount[:3, 3] == pytest.approx([0, 0, 80])
    assert target.mount[:3, 1] == pytest.approx([0, 0, 1])


def test_a_target_without_enough_points_names_its_line(tmp_path: Path) -> None:
    path = tmp_path / "target.yaml"
    path.write_text("units: {length: mm, angle: deg}\ndisc_radius: 5\npoints:\n  A: [0, 0, 0]\n  B: [1, 0, 0]\n")
    with pytest.raises(InputError, match="at least three points") as caught:
        read_target(path)
    assert caught.value.line == 3


def test_a_skew_comes_back_and_is_absent_where_there_is_none(tmp_path: Path) -> None:
    covariance = np.diag(np.arange(1.0, 11))
    camera = Camera(640, 480, 500.0, 501.0, 320.0, 240.0, (-0.2, 0.1), covariance, skew=0.25)
    write_camera(tmp_path / "camera.yaml", camera)
    back = read_camera(tmp_path / "camera.yaml")
    assert back.skew == 0.25
    assert np.array_equal(back.numbers, camera.numbers)
    assert back.covariance is not None
    assert np.array_equal(back.covariance, camera.covariance)
    plain = camera_to_dict(Camera(640, 480, 500.0, 501.0, 320.0, 240.0))
    assert "skew" not in plain["intrinsics"]
    data = camera_to_dict(camera)
    with pytest.raises(InputError, match="as many columns as rows"):
        camera_from_dict({**data, "covariance": [row[:9] for row in data["covariance"]]})
