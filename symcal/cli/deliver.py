"""Commands between symcal and other programs: compensate, export, import, schema."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from symcal.cli.app import Calibrated, Quiet, Seed


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
    to: Annotated[str, typer.Option("--to", metavar="c|urdf|xacro|ur|offsets|json", help="what to write")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="folder to write into")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="export what was refused; reasons are still printed")] = False,
    approximate: Annotated[
        bool,
        typer.Option("--approximate", help="leave out joint terms that the format cannot carry, and say what it costs"),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Hand a calibrated robot over: C code for the controller, URDF, xacro, the six frames of a Universal Robots arm,
    zero offsets of the joints alone, or JSON with the table of corrections."""
    from dataclasses import asdict

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
    notes += found.notes
    proof = found.proof
    reply(lambda: {"notes": notes, "proof": None if proof is None else asdict(proof)}, *found.written)
    for note in notes:
        Console(stderr=True, soft_wrap=True).print(note, markup=False, highlight=False)
    if not quiet:
        if proof is not None:
            terminal.output().print(escape(proof.text))
        for path in found.written:
            terminal.output().print(f"written to {escape(str(path))}")


def import_(
    urdf: Annotated[Path, typer.Argument(metavar="ROBOT.urdf", help="URDF file")],
    base: Annotated[str, typer.Option("--base", metavar="LINK", help="base link")],
    tip: Annotated[str, typer.Option("--tip", metavar="LINK", help="tip link")],
    out: Annotated[Path | None, typer.Option("--out", metavar="YAML", help="robot file [robot.yaml]")] = None,
) -> None:
    """Read a URDF chain as a robot file."""
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.export.json import robot_json
    from symcal.outputs.whole_file import place_of
    from symcal.robot.files import save_robot
    from symcal.robot.urdf import load_urdf

    place = place_of(out, "robot.yaml", (urdf,))

    robot = load_urdf(urdf, base, tip)
    save_robot(robot, place)
    reply(lambda: robot_json(robot), place)
    terminal.print_robot(robot)
    terminal.output().print(f"written to {escape(str(place))}")


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
