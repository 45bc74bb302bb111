"""`symcal measure`: images and joint readings in, measurements.csv out, with what could not be measured in its head."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from symcal.camera.board import parse_board
from symcal.camera.files import read_camera, read_target
from symcal.config.scene import read_scene
from symcal.data.saved_measurements import save_measurements
from symcal.errors import InputError
from symcal.images.boards import MeasuredBoards, measure_boards
from symcal.images.entries import measured_head
from symcal.images.measure import MeasuredImages, measure_images
from symcal.images.shots import read_shots
from symcal.robot.files import load_robot
from symcal.runs.camera import image_files


def measure_files(
    images: Sequence[Path],
    *,
    camera: Path,
    joints: Path,
    robot: Path,
    out: Path,
    target: Path | None = None,
    board: str | None = None,
    scene: Path | None = None,
    search_px: float = 100.0,
    progress: Callable[[str], None] = lambda _: None,
) -> MeasuredImages | MeasuredBoards:
    """Measure images and write the measurements; images that failed stand in the file's first lines.

    Args:
        images: files and folders. joints: CSV with `image`, joint readings, and `pose`, `split` if any.
        target: file of a target with discs; board: a printed board in words. One of the two.
        scene: where the camera roughly is; found from the images without it; for discs only.
    Raises:
        InputError: files that cannot be read. RefusedError: nothing could be measured, with the reasons.
    """
    if (target is None) == (board is None):
        raise InputError("say what the images show: --target FILE for discs, or --board BOARD", key="--board")
    if board is not None and scene is not None:
        raise InputError("a board needs no scene: its images tell where the camera is", key="--scene")
    arm, lens = load_robot(robot), read_camera(camera)
    shots = read_shots(joints, arm, image_files(images))
    found: MeasuredImages | MeasuredBoards
    if board is not None:
        found = measure_boards(shots, arm, lens, parse_board(board), progress=progress)
    else:
        assert target is not None
        found = measure_images(
            shots.shots,
            arm,
            lens,
            read_target(target),
            T_world_camera=None if scene is None else read_scene(scene),
            search_px=search_px,
            progress=progress,
        )
    found = replace(found, failures=(*found.failures, *shots.left))
    save_measurements(found.data, arm, out, measured_head(found))
    return found
