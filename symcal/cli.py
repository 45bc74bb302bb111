"""The `symcal` command: each step works alone on files; results go to files, a short table to the terminal."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from symcal.errors import RefusedError, SymcalError
from symcal.runs import terminal

app = typer.Typer(
    help="Kinematic calibration of serial robots: plan, measure, identify, validate, compensate.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Experiment = Annotated[Path, typer.Argument(metavar="EXPERIMENT.yaml", help="experiment file")]
Calibrated = Annotated[Path, typer.Argument(metavar="CALIBRATED.yaml", help="calibrated robot")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="the run's folder [reports/<name>]")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="instead of the file's seed")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE", help="replace a value of the file")]
Images = Annotated[list[Path], typer.Argument(metavar="IMAGES...", help="image files, or folders of them")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="no progress and no table")]


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"symcal {version('symcal')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="print the version and exit", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    pass


@app.command()
def run(experiment: Experiment, out: Out = None, seed: Seed = None, set_: Set = None, quiet: Quiet = False) -> None:
    """Run an experiment: measure or simulate, identify, evaluate, report."""
    _identify(experiment, None, out, seed, set_, quiet)


@app.command()
def plan(
    experiment: Experiment,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="the plan's folder [reports/<name>-plan]")
    ] = None,
    seed: Seed = None,
    set_: Set = None,
    quiet: Quiet = False,
) -> None:
    """Choose the poses to measure: which, how many, in what order, and how good the plan provably is."""
    from symcal.runs.plan import run_plan

    with terminal.spinner(quiet) as progress:
        folder, content = run_plan(experiment, out, seed=seed, overrides=set_ or (), progress=progress)
    if not quiet:
        terminal.print_plan(content)
        terminal.output().print(f"written to {escape(str(folder))}")


@app.command()
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


@app.command()
def measure(
    images: Images,
    camera_file: Annotated[Path, typer.Option("--camera", metavar="YAML", help="camera file")],
    target: Annotated[Path, typer.Option("--target", metavar="YAML", help="target file")],
    joints: Annotated[
        Path,
        typer.Option(
            "--joints", metavar="CSV", help="columns image, q1_deg.. (or joint names with units); pose, split"
        ),
    ],
    robot: Annotated[Path, typer.Option("--robot", metavar="YAML", help="robot file")],
    scene: Annotated[
        Path | None, typer.Option("--scene", metavar="YAML", help="where the camera roughly is [found from the images]")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="CSV", help="measurements")] = Path("measurements.csv"),
    quiet: Quiet = False,
) -> None:
    """Measure a target on the robot's tool in images."""
    from symcal.runs.folder import require_place
    from symcal.runs.measure import measure_files

    require_place(out)
    with terminal.spinner(quiet) as progress:
        found = measure_files(
            images,
            camera=camera_file,
            target=target,
            joints=joints,
            robot=robot,
            scene=scene,
            out=out,
            progress=progress,
        )
    if not quiet:
        terminal.print_measured(found)
        terminal.output().print(f"written to {escape(str(out))}")


@app.command()
def identify(
    experiment: Experiment,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="CSV", help="measurements instead of the file's")
    ] = None,
    out: Out = None,
    seed: Seed = None,
    set_: Set = None,
    quiet: Quiet = False,
) -> None:
    """Identify a robot from measurements."""
    _identify(experiment, data, out, seed, set_, quiet, study=False)


@app.command()
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE.yaml", help="robot, calibrated robot or experiment")],
) -> None:
    """Validate a file; print the model and what is identifiable."""
    from symcal.documents.document import read_document
    from symcal.robot.robot import load_robot
    from symcal.runs import experiment as runs
    from symcal.runs.check import check_model, check_robot

    if "links" in read_document(file).data:
        robot = load_robot(file)
        found, data = check_robot(robot), tuple[str, ...]()
    else:
        loaded = runs.load(file)
        robot, found, data = loaded.robot, check_model(loaded.model), runs.describe_data(loaded)
    terminal.print_robot(robot)
    terminal.print_check(found, data)


@app.command()
def validate(
    calibrated: Annotated[Path, typer.Argument(metavar="CALIBRATED.yaml", help="calibrated robot")],
    data: Annotated[Path, typer.Option("--data", metavar="CSV", help="new measurements of the same kind")],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="the run's folder")] = None,
    refit: Annotated[
        str | None,
        typer.Option("--refit", help="frames to fit to the new data, such as base,tool (the instrument was moved)"),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Judge a calibrated robot on new measurements."""
    from symcal.runs.validate import validate_robot

    with terminal.spinner(quiet) as progress:
        content = validate_robot(calibrated, data, out, tuple(refit.split(",")) if refit else (), progress)
    if not quiet:
        terminal.print_accuracy(content)


@app.command()
def compensate(
    calibrated: Calibrated,
    targets: Annotated[Path, typer.Option("--targets", metavar="CSV", help="joint commands, or positions or poses")],
    out: Annotated[Path, typer.Option("--out", metavar="CSV", help="corrected joint commands")] = Path("joints.csv"),
    frame: Annotated[str, typer.Option("--frame", help="frame of positions and poses: base or world")] = "base",
    seed: Seed = None,
    quiet: Quiet = False,
) -> None:
    """Correct joint commands so that the calibrated robot gets where it was sent."""
    import numpy as np

    from symcal.compensation.compensate import compensate as solve
    from symcal.compensation.compensate import write_joints
    from symcal.compensation.targets import read_targets
    from symcal.errors import InputError
    from symcal.robot.robot import load_robot
    from symcal.runs.folder import require_place

    require_place(out)

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
    write_joints(result, out)
    if not quiet:
        terminal.print_compensation(result)
        terminal.output().print(f"written to {escape(str(out))}")


@app.command()
def export(
    calibrated: Calibrated,
    to: Annotated[str, typer.Option("--to", metavar="c|urdf|json", help="what to write")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="folder to write into")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="export in spite of doubts, which are still printed")] = False,
    quiet: Quiet = False,
) -> None:
    """Hand a calibrated robot over: C code for the controller, URDF, or JSON with the table of corrections."""
    from symcal.export import FORMATS, export_robot
    from symcal.robot.robot import load_robot

    if to not in FORMATS:
        from symcal.errors import InputError

        raise InputError("no such format", key="--to", found=to, allowed=FORMATS)
    robot = load_robot(calibrated)
    written, doubts = export_robot(robot, to, out, force=force)
    notes = [f"doubt overridden: {doubt.text}" for doubt in doubts]
    if robot.record is None:
        notes.append("this robot has no 'calibration': what is written is nominal")
    for note in notes:
        Console(stderr=True, soft_wrap=True).print(note, markup=False, highlight=False)
    if not quiet:
        for path in written:
            terminal.output().print(f"written to {escape(str(path))}")


@app.command("import")
def import_(
    urdf: Annotated[Path, typer.Argument(metavar="ROBOT.urdf", help="URDF file")],
    base: Annotated[str, typer.Option("--base", metavar="LINK", help="base link")],
    tip: Annotated[str, typer.Option("--tip", metavar="LINK", help="tip link")],
    out: Annotated[Path, typer.Option("--out", metavar="YAML", help="robot file")] = Path("robot.yaml"),
) -> None:
    """Read a URDF chain as a robot file."""
    from symcal.robot.robot import save_robot
    from symcal.robot.urdf import load_urdf
    from symcal.runs.folder import require_place

    require_place(out)

    robot = load_urdf(urdf, base, tip)
    save_robot(robot, out)
    terminal.print_robot(robot)
    terminal.output().print(f"written to {escape(str(out))}")


@app.command()
def schema(
    kind: Annotated[str, typer.Argument(help="experiment or robot")] = "experiment",
) -> None:
    """Print the JSON Schema of a file, for editors that complete it."""
    import json

    from symcal.config.conversion import ExperimentFile
    from symcal.errors import InputError
    from symcal.robot.schema import RobotFile

    models: dict[str, Any] = {"experiment": ExperimentFile, "robot": RobotFile}
    if kind not in models:
        raise InputError("no such schema", found=kind, allowed=models)
    typer.echo(json.dumps(models[kind].model_json_schema(), indent=2))


def _identify(
    experiment: Path,
    data: Path | None,
    out: Path | None,
    seed: int | None,
    overrides: list[str] | None,
    quiet: bool,
    *,
    study: bool = True,
) -> None:
    from symcal.runs import experiment as runs

    with terminal.spinner(quiet) as progress:
        folder, content = runs.run(
            experiment, out, seed=seed, overrides=overrides or (), data=data, study=study, progress=progress
        )
    if not quiet:
        if "simulation_2" in content:
            terminal.print_study(content)
        else:
            terminal.print_accuracy(content)
        terminal.output().print(f"written to {escape(str(folder))}")
    found = content.get("identification", {})
    if not found.get("converged", True):
        raise RefusedError(f"the identification did not converge ({found['message']}): do not use what is in {folder}")


def main() -> None:
    """Entry point: an input error is one message and exit code 1; a traceback is a bug of ours."""
    signal.signal(signal.SIGTERM, _stop)
    try:
        app()
    except SymcalError as error:
        Console(stderr=True, soft_wrap=True).print(f"symcal: {error}", markup=False, highlight=False)
        sys.exit(1)


def _stop(number: int, _: object) -> None:
    """Leave as after an interrupt: half-written folders vanish."""
    sys.exit(128 + number)


if __name__ == "__main__":
    main()
