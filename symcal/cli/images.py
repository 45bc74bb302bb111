"""Commands that measure with a camera: board, camera, measure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symcal.cli.app import Images, Quiet


def board(
    board: Annotated[
        str,
        typer.Argument(metavar="BOARD", help="chessboard:9x6:25mm, charuco:12x9:30mm:22mm, aprilgrid:6x6:30mm:9mm, .."),
    ],
    out: Annotated[Path | None, typer.Option("--out", metavar="PDF", help="what to print [board.pdf]")] = None,
    page: Annotated[
        str | None, typer.Option("--page", metavar="A4..A0|exact", help="[the smallest of A4 to A0 that holds it]")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Draw a calibration board at true size, to be printed at 100 %."""
    from rich.markup import escape

    from symcal.camera.board import parse_board
    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.outputs.whole_file import place_of
    from symcal.runs.board import print_board

    place = place_of(out, "board.pdf")
    parsed = parse_board(board)
    sheet = print_board(parsed, place, page)
    paper = {"page": sheet.page, "width_mm": sheet.width, "height_mm": sheet.height}
    reply(lambda: {"board": str(parsed)} | paper, place)
    if not quiet:
        console = terminal.output()
        console.print(f"{escape(str(parsed))} on {sheet.page} ({sheet.width:.0f} x {sheet.height:.0f} mm)")
        console.print("print at 100 %, measure the bar of 100 mm, and use this text as --board")
        console.print(f"written to {escape(str(place))}")


def camera(
    images: Annotated[
        list[Path] | None, typer.Argument(metavar="[IMAGES...]", help="image files, or folders of them")
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            "--board",
            metavar="BOARD",
            help="chessboard:9x6:25mm (inner corners), circles:.., charuco:12x9:30mm:22mm, aprilgrid:6x6:30mm:9mm",
        ),
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option("--points", metavar="CSV", help="instead of images: columns view, id, X_mm, Y_mm (Z_mm), u, v"),
    ] = None,
    size: Annotated[
        str | None, typer.Option("--size", metavar="WxH", help="of the image in px, for --points: 640x480")
    ] = None,
    fix: Annotated[
        str | None,
        typer.Option(
            "--fix",
            metavar="TERMS",
            help="held at zero: p1,p2,k3 or none [images: k3 where it is not determined; --points: none]",
        ),
    ] = None,
    skew: Annotated[bool, typer.Option("--skew", help="estimate the skew of the image's axes too")] = False,
    keep_all: Annotated[
        bool, typer.Option("--keep-all", help="use views with large errors too, as --points always does")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="YAML", help="camera file; its page is a PDF beside it [camera.yaml]"),
    ] = None,
    bowed: Annotated[bool, typer.Option("--bowed", help="estimate the board's shape too (slow)")] = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate a camera from images of a board or a list of corners, and judge the calibration."""
    from rich.markup import escape

    from symcal.camera.board import parse_board
    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.errors import InputError
    from symcal.outputs.whole_file import place_of
    from symcal.runs.camera import calibrate_from_corners, calibrate_from_images, camera_content

    place = place_of(out, "camera.yaml", (*(images or ()), *(() if points is None else (points,))))
    if (points is None) != bool(images):
        both = ", not both" if images else ""
        raise InputError(f"give images of a board, or a list of corners as --points{both}")
    if points is None:
        if board is None or size is not None:
            message = "images tell their size themselves" if board else "say which board the images show"
            raise InputError(message, key="--size" if board else "--board", found=size if board else None)
    elif size is None:
        raise InputError("a list of corners does not tell the image's size: give it, as in 640x480", key="--size")
    elif board is not None or bowed:
        message = "a list of corners brings its own points, which are taken as they are"
        raise InputError(message, key="--bowed" if bowed else "--board")
    with terminal.spinner(quiet) as progress:
        if points is None:
            done = calibrate_from_images(
                images or [],
                parse_board(board or ""),
                place,
                fix=fix or "auto",
                skew=skew,
                keep_all=keep_all,
                bowed=bowed,
                progress=progress,
            )
        else:
            done = calibrate_from_corners(
                points, _size(size or ""), place, fix=fix or "none", skew=skew, progress=progress
            )
    content = camera_content(done.calibration, done.verdict)
    reply(lambda: content, *done.written)
    if not quiet:
        terminal.print_camera(content)
        for path in done.written:
            terminal.output().print(f"written to {escape(str(path))}")


def _size(text: str) -> tuple[int, int]:
    """Width and height of a text such as 640x480."""
    import re

    from symcal.errors import InputError

    match = re.fullmatch(r"\s*([1-9][0-9]{0,5})\s*[xX]\s*([1-9][0-9]{0,5})\s*", text)
    if match is None:
        raise InputError("an image's size is WIDTHxHEIGHT in px, such as 640x480", key="--size", found=text)
    return int(match[1]), int(match[2])


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
    out: Annotated[Path | None, typer.Option("--out", metavar="CSV", help="measurements [measurements.csv]")] = None,
    quiet: Quiet = False,
) -> None:
    """Measure a target or a printed board in images, on the robot's tool or seen by a camera there."""
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.outputs.whole_file import place_of
    from symcal.runs.measure import measure_files

    others = tuple(path for path in (target, scene) if path is not None)
    place = place_of(out, "measurements.csv", (*images, camera_file, joints, robot, *others))
    with terminal.spinner(quiet) as progress:
        found = measure_files(
            images,
            camera=camera_file,
            target=target,
            board=board,
            joints=joints,
            robot=robot,
            scene=scene,
            out=place,
            progress=progress,
        )
    failures = [{"image": name, "reason": reason} for name, reason in found.failures]
    reply(lambda: {"images": list(found.images), "failures": failures, "notes": list(found.notes)}, place)
    if not quiet:
        terminal.print_measured(found)
        terminal.output().print(f"written to {escape(str(place))}")
