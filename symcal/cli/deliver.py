"""Commands between symcal and other programs: compensate, export, import, schema."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symcal.cli.app import Calibrated, Quiet, Seed

if TYPE_CHECKING:
    from symcal.robot.robot import Robot


def compensate(
    calibrated: Calibrated,
    targets: Annotated[Path, typer.Option("--targets", metavar="CSV", help="joint commands, or positions or poses")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="CSV", help="corrected joint commands [joints.csv]")
    ] = None,
    frame: Annotated[str, typer.Option("--frame", help="frame of positions and poses: base or world")] = "base",
    seed: Seed = None,
    quiet: Quiet = False,
) -> None:
    """Correct joint commands so that the calibrated robot gets where it was sent."""
    import numpy as np
    from rich.console import Console
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.compensation.compensate import compensate as solve
    from symcal.compensation.compensate import write_joints
    from symcal.compensation.targets import read_targets
    from symcal.errors import InputError
    from symcal.export.carries import left_out
    from symcal.outputs.whole_file import place_of
    from symcal.robot.files import load_robot

    place = place_of(out, "joints.csv", (calibrated, targets))

    if frame not in ("base", "world"):
        raise InputError("no such frame", key="--frame", found=frame, allowed=("base", "world"))
    robot = load_robot(calibrated)
    if robot.record is None:
        message = "this robot has no 'calibration', so there is nothing to correct: give the calibrated.yaml of a run"
        raise InputError(message, file=calibrated)
    with terminal.spinner(quiet) as progress:
        progress("compensating")
        result = solve(
            robot,
            read_targets(targets, robot, "base" if frame == "base" else "world"),
            np.random.default_rng(seed or 0),
        )
    write_joints(result, place)
    left = left_out(robot, "commands")
    notes = [] if left is None else [left.text]
    reply(lambda: {"targets": result.facts(), "notes": notes}, place)
    if left is not None:
        Console(stderr=True, soft_wrap=True).print(left.text, markup=False, highlight=False)
    if not quiet:
        terminal.print_compensation(result)
        terminal.output().print(f"written to {escape(str(place))}")


def export(
    calibrated: Calibrated,
    to: Annotated[str, typer.Option("--to", metavar="c|urdf|json", help="what to write")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="folder to write into")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="export what was refused; reasons are still printed")] = False,
    approximate: Annotated[
        bool,
        typer.Option("--approximate", help="leave out joint terms that the format cannot carry, and say what it costs"),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Hand a calibrated robot over: C code for the controller, URDF, or JSON with the table of corrections."""
    from rich.console import Console
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.export import FORMATS, export_robot
    from symcal.robot.files import load_robot

    if to not in FORMATS:
        from symcal.errors import InputError

        raise InputError("no such format", key="--to", found=to, allowed=FORMATS)
    robot = load_robot(calibrated)
    found = export_robot(robot, to, out, force=force, approximate=approximate)
    notes = [f"doubt overridden: {doubt.text}" for doubt in found.doubts]
    if found.left_out is not None:
        notes.append(found.left_out.text)
    if robot.record is None:
        notes.append("this robot has no 'calibration': what is written is nominal")
    reply(lambda: {"notes": notes}, *found.written)
    for note in notes:
        Console(stderr=True, soft_wrap=True).print(note, markup=False, highlight=False)
    if not quiet:
        for path in found.written:
            terminal.output().print(f"written to {escape(str(path))}")


def import_(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="URDF, or of a UR calibration.conf or ur_calibration's YAML"),
    ],
    base: Annotated[str | None, typer.Option("--base", metavar="LINK", help="base link of a URDF")] = None,
    tip: Annotated[str | None, typer.Option("--tip", metavar="LINK", help="tip link of a URDF")] = None,
    arm: Annotated[
        str | None, typer.Option("--arm", metavar="NAME", help="arm of the list that a UR calibration is of, as ur5e")
    ] = None,
    angles: Annotated[
        str, typer.Option("--angles", help="how six frames mean roll, pitch, yaw: ur_calibration or urdf")
    ] = "ur_calibration",
    out: Annotated[Path | None, typer.Option("--out", metavar="YAML", help="robot file [robot.yaml]")] = None,
) -> None:
    """Read a URDF chain, or a factory calibration of Universal Robots, as a robot file."""
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.export.json import robot_json
    from symcal.outputs.whole_file import place_of
    from symcal.robot.files import save_robot

    place = place_of(out, "robot.yaml", (file,))
    note = ""
    if file.suffix.lower() in (".conf", ".yaml", ".yml"):
        robot, note = _calibrated_ur(file, arm, angles)
    elif base is None or tip is None:
        raise typer.BadParameter("a URDF file needs the links that the chain is between", param_hint="--base, --tip")
    else:
        from symcal.robot.urdf import load_urdf

        robot = load_urdf(file, base, tip)
    save_robot(robot, place)
    reply(lambda: robot_json(robot), place)
    terminal.print_robot(robot)
    if note:
        terminal.output().print(note, markup=False, highlight=False)
    terminal.output().print(f"written to {escape(str(place))}")


def _calibrated_ur(file: Path, arm: str | None, angles: str) -> tuple[Robot, str]:
    """The robot of a factory calibration of Universal Robots, and what is to be said of it."""
    from symcal.errors import InputError
    from symcal.robot.arms import arm_file
    from symcal.robot.files import load_robot
    from symcal.robot.universal_robots import ANGLES, load_calibration_conf, load_six_frames, order_matters

    nominal = None if arm is None else load_robot(arm_file(arm))
    if file.suffix.lower() == ".conf":
        if nominal is None:
            message = "a calibration.conf says what is added to the nominal arm: say which that is, as --arm ur5e"
            raise InputError(message, key="--arm")
        return load_calibration_conf(file, nominal), ""
    if angles not in ANGLES:
        raise InputError("no such order of angles", key="--angles", found=angles, allowed=ANGLES)
    return load_six_frames(file, "urdf" if angles == "urdf" else "ur_calibration", nominal), order_matters(file)


def schema(
    kind: Annotated[str, typer.Argument(help="experiment, robot or study")] = "experiment",
) -> None:
    """Print the JSON Schema of a file, for editors that complete it."""
    import json

    from symcal.cli.reply import reply
    from symcal.config.experiment import experiment_type
    from symcal.config.trials import StudyFile
    from symcal.documents.document import json_schema
    from symcal.errors import InputError
    from symcal.robot.schema import RobotFile

    models: dict[str, Any] = {"experiment": experiment_type(), "robot": RobotFile, "study": StudyFile}
    if kind not in models:
        raise InputError("no such schema", found=kind, allowed=models)
    content = json_schema(models[kind])
    reply(lambda: content)
    typer.echo(json.dumps(content, indent=2))
