"""Commands that measure with a camera: camera, measure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from symcal.cli import terminal
from symcal.cli.app import Images, Quiet


def camera(
    images: Images,
    board: Annotated[
        str,
        typer.Option(
            "--board",
            metavar="BOARD",
            help="chessboard:9x6:25mm (inner corners), circles:.., charuco:5x7:30mm:22mm:DICT_4X4_50",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="YAML", help="camera file; its page is a PDF beside it")] = Path(
        "camera.yaml"
    ),
    bowed: Annotated[bool, typer.Option("--bowed", help="estimate the board's shape too (slow)")] = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate a camera from images of a board, and judge the calibration."""
    from symcal.camera.board import parse_board
    from symcal.runs.camera import calibrate_from_images, camera_content
    from symcal.runs.folder import require_place

    require_place(out)
    with terminal.spinner(quiet) as progress:
        done = calibrate_from_images(images, parse_board(board), out, bowed=bowed, progress=progress)
    if not quiet:
        terminal.print_camera(camera_content(done.calibration, done.verdict))
        for path in done.written:
            terminal.output().print(f"written to {escape(str(path))}")


def measure(
    images: Images,
    camera_file: Annotated[Path, typer.Option("--camera", metavar="YAML", help="camera file")],
    joints: Annotated[
        Path,
        typer.Option(
            "--joints", metavar="CSV", help="columns image, q1_deg.. (or joint names with units); pose, split"
        ),
    ],
    robot: Annotated[Path, typer.Option("--robot", metavar="YAML", help="robot file")],
    target: Annotated[
        Path | None, typer.Option("--target", metavar="YAML", help="target file: discs on the robot's tool")
    ] = None,
    board: Annotated[
        str | None,
        typer.Option("--board", metavar="BOARD", help="a printed board instead: charuco:12x9:30mm:22mm:DICT_4X4_100"),
    ] = None,
    scene: Annotated[
        Path | None, typer.Option("--scene", metavar="YAML", help="where the camera roughly is [found from the images]")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="CSV", help="measurements")] = Path("measurements.csv"),
    quiet: Quiet = False,
) -> None:
    """Measure a target or a printed board in images, on the robot's tool or seen by a camera there."""
    from symcal.runs.folder import require_place
    from symcal.runs.measure import measure_files

    require_place(out)
    with terminal.spinner(quiet) as progress:
        found = measure_files(
            images,
            camera=camera_file,
            target=target,
            board=board,
            joints=joints,
            robot=robot,
            scene=scene,
            out=out,
            progress=progress,
        )
    if not quiet:
        terminal.print_measured(found)
        terminal.output().print(f"written to {escape(str(out))}")
