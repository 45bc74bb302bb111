"""Commands from measurements to a calibrated robot, and what a file would allow: run, identify, validate, check."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symcal.cli.app import Experiment, NoReport, Out, Quiet, Seed, Set, with_outputs
from symcal.errors import RefusedError

if TYPE_CHECKING:
    from symcal.robot.robot import Robot


def run(
    experiment: Experiment,
    out: Out = None,
    seed: Seed = None,
    set_: Set = None,
    no_report: NoReport = False,
    quiet: Quiet = False,
) -> None:
    """Run an experiment: measure or simulate, identify, evaluate, report."""
    _identify(experiment, None, out, seed, with_outputs(set_, no_report), quiet)


def identify(
    experiment: Experiment,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="CSV", help="measurements instead of the file's")
    ] = None,
    out: Out = None,
    seed: Seed = None,
    set_: Set = None,
    no_report: NoReport = False,
    quiet: Quiet = False,
) -> None:
    """Identify a robot from measurements."""
    _identify(experiment, data, out, seed, with_outputs(set_, no_report), quiet, study=False)


def validate(
    calibrated: Annotated[Path, typer.Argument(metavar="CALIBRATED.yaml", help="calibrated robot")],
    data: Annotated[Path, typer.Option("--data", metavar="CSV", help="new measurements of the same kind")],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="the run's folder")] = None,
    refit: Annotated[
        str | None,
        typer.Option("--refit", help="frames to fit to the new data, such as base,tool (the instrument was moved)"),
    ] = None,
    instrument: Annotated[
        str | None, typer.Option("--instrument", help="whose measurements these are, where several measured")
    ] = None,
    tolerance: Annotated[
        str | None, typer.Option("--tolerance", metavar="0.5mm,0.1deg", help="accept or refuse the robot against this")
    ] = None,
    of: Annotated[
        str, typer.Option("--of", metavar="p95|rms|max", help="of the errors, what must be within the tolerance")
    ] = "p95",
    quiet: Quiet = False,
) -> None:
    """Judge a calibrated robot on new measurements: accept or refuse it."""
    from rich.markup import escape

    from symcal.calibration.tolerance import parse_tolerance
    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.runs.validate import validate_robot

    against = None if tolerance is None else parse_tolerance(tolerance, of)
    parts = tuple(refit.split(",")) if refit else ()
    with terminal.spinner(quiet) as progress:
        content = validate_robot(calibrated, data, out, parts, instrument, progress, against)
    reply(lambda: content, *([] if out is None else [out]))
    if not quiet:
        terminal.print_accuracy(content)
        terminal.print_second(content)
        terminal.print_decision(content)
        if out is not None:
            terminal.output().print(f"written to {escape(str(out))}")
    if not content["decision"]["accepted"]:
        raise RefusedError(f"the calibration is {content['decision']['sentence']}")


def check(
    file: Annotated[Path, typer.Argument(metavar="FILE.yaml", help="robot, calibrated robot, experiment or study")],
) -> None:
    """Validate a file; print the model and what is identifiable."""
    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.documents.document import read_document

    document = read_document(file)  # what is no YAML is refused before anything else is loaded
    from symcal.robot.files import load_robot
    from symcal.runs.check import check_model, check_robot
    from symcal.runs.data import describe_data
    from symcal.runs.load import load

    if document.data.get("kind") == "study":
        from rich.markup import escape

        from symcal.trials.check import check_study

        lines = check_study(file)
        reply(lambda: {"study": lines})
        for line in lines:
            terminal.output().print(escape(line))
        return
    if "links" in document.data:
        robot = load_robot(file)
        found, data = check_robot(robot), tuple[str, ...]()
    else:
        loaded = load(file)
        robot, found, data = loaded.robot, check_model(loaded.model), describe_data(loaded)
    reply(lambda: {"robot": _plain(robot), **found.facts(), "measurements": list(data)})
    terminal.print_robot(robot)
    terminal.print_check(found, data)


def _plain(robot: Robot) -> dict[str, Any]:
    from symcal.export.json import robot_json

    return robot_json(robot)


def _identify(
    experiment: Path,
    data: Path | None,
    out: Path | None,
    seed: int | None,
    overrides: list[str],
    quiet: bool,
    *,
    study: bool = True,
) -> None:
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.runs.run import run as run_experiment

    with terminal.spinner(quiet) as progress:
        folder, content = run_experiment(
            experiment, out, seed=seed, overrides=overrides, data=data, study=study, progress=progress
        )
    reply(lambda: content, folder)
    if not quiet:
        if "simulation_2" in content:
            terminal.print_study(content)
        else:
            terminal.print_accuracy(content)
            terminal.print_frames(content)
        terminal.print_decision(content)
        terminal.output().print(f"written to {escape(str(folder))}")
    if not content["decision"]["accepted"]:
        raise RefusedError(f"the calibration is {content['decision']['sentence']}. Do not use what is in {folder}")
