"""Commands between symcal and other programs: compensate, export, import, schema."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symcal.cli.app import Calibrated, Quiet, Seed

if TYPE_CHECKING:
    from symcal.robot.robot import Robot


def compensate(
    calibrated: Calibrated,
    targets: Annotated[
        Path | None, typer.Option("--targets", metavar="CSV", help="joint commands, or positions or poses")
    ] = None,
    program: Annotated[
        Path | None, typer.Option("--program", metavar="FILE", help="URScript, RAPID or KRL, instead of targets")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="corrected joint commands [joints.csv], or the corrected program"),
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option("--frame", help="frame of positions and poses: base or world [base; of a program: none]"),
    ] = None,
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

    if frame not in (None, "base", "world"):
        raise InputError("no such frame", key="--frame", found=frame, allowed=("base", "world"))
    if (targets is None) == (program is None):
        raise typer.BadParameter("give either a table of targets or a program", param_hint="--targets, --program")
    if targets is None:
        assert program is not None
        _compensate_program(calibrated, program, out, frame, seed, quiet)
        return
    place = place_of(out, "joints.csv", (calibrated, targets))
    robot = _to_correct_by(calibrated)
    with terminal.spinner(quiet) as progress:
        progress("compensating")
        result = solve(
            robot,
            read_targets(targets, robot, "world" if frame == "world" else "base"),
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


def _to_correct_by(calibrated: Path) -> Robot:
    from symcal.errors import InputError
    from symcal.robot.files import load_robot

    robot = load_robot(calibrated)
    if robot.record is None:
        message = "this robot has no 'calibration', so there is nothing to correct: give the calibrated.yaml of a run"
        raise InputError(message, file=calibrated)
    return robot


def _compensate_program(
    calibrated: Path, program: Path, out: Path | None, frame: str | None, seed: int | None, quiet: bool
) -> None:
    import numpy as np
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.errors import InputError
    from symcal.outputs.whole_file import place_of, write_whole
    from symcal.programs.correct import correct_program

    if frame == "world":
        raise InputError(
            "frames of a program are in the robot's base frame", key="--frame", found=frame, allowed=["base"]
        )
    place = place_of(out, f"{program.stem}_corrected{program.suffix}", (calibrated, program))
    robot = _to_correct_by(calibrated)
    with terminal.spinner(quiet) as progress:
        progress("compensating")
        found = correct_program(program, robot, np.random.default_rng(seed or 0), frames=frame == "base")
    write_whole(place, found.text)
    facts = {"corrected": found.count, "largest_mm": found.largest_mm, "left": [asdict(each) for each in found.left]}
    reply(lambda: facts, place)
    console = terminal.output()
    for each in found.left:
        console.print(f"left, line {each.line}: {escape(each.text)}: {escape(each.why)}")
    if not quiet:
        count = "1 target" if found.count == 1 else f"{found.count} targets"
        console.print(f"{count} corrected, by up to {found.largest_mm:.3g} mm; {len(found.left)} left as they were")
        console.print(f"written to {escape(str(place))}")


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
        str | None, typer.Option("--angles", help="how six frames mean roll, pitch, yaw: ur_calibration or urdf")
    ] = None,
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


def _calibrated_ur(file: Path, arm: str | None, angles: str | None) -> tuple[Robot, str]:
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
    order = next((each for each in ANGLES if each == angles), None)
    if angles is not None and order is None:
        raise InputError("no such order of angles", key="--angles", found=angles, allowed=ANGLES)
    return load_six_frames(file, order, nominal), order_matters(file)


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
