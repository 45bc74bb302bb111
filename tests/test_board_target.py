"""Boards as targets: their key, their points, and one sentence for each mistake."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import ARM

import symcal as sc
from symcal.camera.board import parse_board
from symcal.camera.camera import Camera
from symcal.camera.files import write_camera
from symcal.errors import InputError
from symcal.runs.load import load

ROBOT = replace(
    ARM, links=tuple(replace(x, joint=replace(x.joint, name=f"j{i}")) for i, x in enumerate(ARM.links, start=1))
)
TEXT = "charuco:6x5:30mm:22mm:DICT_4X4_100"
BOARD = f"{{on: world, place: unknown, board: '{TEXT}'}}"
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    sc.save_robot(ROBOT, tmp_path / "robot.yaml")
    write_camera(tmp_path / "camera.yaml", Camera(1280, 1024, 1400.0, 1400.0, 639.5, 511.5))

    def made(target: str) -> Path:
        path = tmp_path / "experiment.yaml"
        path.write_text(
            "name: boards\nunits: {length: mm, angle: deg}\nrobot: robot.yaml\nmeasurements:\n"
            "  eye: {instrument: pixels, camera: camera.yaml, at: {on: flange, place: unknown}, "
            f"target: {target}}}\n"
        )
        return path

    return made


def test_a_board_has_its_points_by_their_numbers(write: Write) -> None:
    (observation,) = load(write(BOARD)).model.task.observations
    board = parse_board(TEXT)
    assert observation.target.board == board
    assert observation.features == tuple(str(i) for i in range(20))
    np.testing.assert_array_equal(observation.target.nominal, board.points)
    assert not observation.target.unknown_points


def test_python_knows_boards_too() -> None:
    target = sc.Target("board", sc.Place("world", unknown=True), board=sc.parse_board(TEXT))
    assert list(target.points)[:2] == ["0", "1"]
    with pytest.raises(InputError, match="its own points"):
        sc.Target("board", sc.Place("world"), {"P": (0.0, 0.0, 0.0)}, board=sc.parse_board(TEXT))


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("{on: world, place: unknown, board: 'charuco:6x5'}", "a board is charuco"),
        ("{on: world, place: unknown, board: 'cube:6x5:30mm'}", "unknown kind of board"),
        (f"{{on: world, place: unknown, board: '{TEXT}', points: {{P: [0, 0, 0]}}}}", "its own points"),
    ],
)
def test_a_wrong_board_is_one_sentence(write: Write, target: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        load(write(target))
    assert error.value.line is not None
