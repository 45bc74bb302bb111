"""The `symcal` command: each step works alone on files; results go to files, a short table to the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from symcal.errors import SymcalError

app = typer.Typer(
    help="Kinematic calibration of serial robots: plan, measure, identify, validate, compensate.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Experiment = Annotated[Path, typer.Argument(metavar="EXPERIMENT.yaml", help="experiment file")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="the run's folder [reports/<name>]")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="instead of the file's seed")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE", help="replace a value of the file")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="no progress and no table")]


@app.command()
def run(experiment: Experiment, out: Out = None, seed: Seed = None, set_: Set = None, quiet: Quiet = False) -> None:
    """Run an experiment: measure or simulate, identify, evaluate, report."""
    _identify(experiment, None, out, seed, set_, quiet)


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
    _identify(experiment, data, out, seed, set_, quiet)


@app.command()
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE.yaml", help="robot, calibrated robot or experiment")],
) -> None:
    """Validate a file; print the model and what is identifiable."""
    from symcal import experiment as runs
    from symcal.check import check_model, check_robot
    from symcal.documents import read_document
    from symcal.robot import load_robot

    if "links" in read_document(file).data:
        robot = load_robot(file)
        found = check_robot(robot)
    else:
        loaded = runs.load(file)
        robot, found = loaded.robot, check_model(loaded.model)
    _print_robot(robot)
    _print_check(found)


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
    from symcal.validate import validate_robot

    with _progress(quiet) as progress:
        content = validate_robot(calibrated, data, out, tuple(refit.split(",")) if refit else (), progress)
    if not quiet:
        _print_accuracy(content)


@app.command()
def schema(
    kind: Annotated[str, typer.Argument(help="experiment or robot")] = "experiment",
) -> None:
    """Print the JSON Schema of a file, for editors that complete it."""
    import json

    from symcal.config import ExperimentFile
    from symcal.errors import InputError
    from symcal.robot_schema import RobotFile

    models: dict[str, Any] = {"experiment": ExperimentFile, "robot": RobotFile}
    if kind not in models:
        raise InputError("no such schema", found=kind, allowed=models)
    typer.echo(json.dumps(models[kind].model_json_schema(), indent=2))


def _identify(
    experiment: Path, data: Path | None, out: Path | None, seed: int | None, overrides: list[str] | None, quiet: bool
) -> None:
    from symcal import experiment as runs

    with _progress(quiet) as progress:
        folder, content = runs.run(experiment, out, seed=seed, overrides=overrides or (), data=data, progress=progress)
    if not quiet:
        _print_accuracy(content)
        _console().print(f"written to {escape(str(folder))}")


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[str], None]]:
    """A spinner that names the current step; nothing when not a terminal or quiet."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda _: None
        return
    with console.status("starting") as status:
        yield lambda step: status.update(escape(step))


def _console() -> Console:
    return Console(soft_wrap=True)


def _print_accuracy(content: Any) -> None:
    console = _console()
    seen, found = content.get("identifiability"), content.get("identification")
    if seen:
        console.print(f"{seen['rank']} of {seen['parameters']} directions identified; {escape(found['message'])}")
    table = Table("data", "state", "mean mm", "rms mm", "p95 mm", "max mm", "rms deg", box=None, pad_edge=False)
    for data, states in content["accuracy"].items():
        for state, quantities in states.items():
            if isinstance(quantities, dict):
                p = quantities["position_mm"]
                turn = quantities.get("orientation_deg")
                numbers = [f"{p[k]:.4g}" for k in ("mean", "rms", "p95", "max")]
                table.add_row(data, state, *numbers, f"{turn['rms']:.4g}" if turn else "")
    console.print(table)
    console.print(
        f"against {content['against']}; 'before' is nominal kinematics with base and tool fitted on the training data"
    )
    for warning in content["warnings"]:
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


def _print_robot(robot: Any) -> None:
    import numpy as np

    console = _console()
    kinds = [k for k in ("theta", "d", "a", "alpha", "beta") if any(k in link.parameters for link in robot.links)]
    console.print(f"{escape(robot.name)}: {robot.dof} joints, {robot.convention} convention (rad shown in deg)")
    table = Table("link", "joint", "kind", "limits", *(f"{k} {'mm' if k in 'ad' else 'deg'}" for k in kinds), box=None)
    for i, link in enumerate(robot.links, start=1):
        joint = link.joint
        shown = [joint.lower, joint.upper]
        if joint.revolute:
            shown = np.rad2deg(shown).tolist()
        cells = [
            ""
            if k not in link.parameters
            else f"{link.parameters[k] if k in 'ad' else np.rad2deg(link.parameters[k]):.7g}"
            for k in kinds
        ]
        table.add_row(str(i), escape(joint.name), joint.kind, f"{shown[0]:.6g} .. {shown[1]:.6g}", *cells)
    console.print(table)


def _print_check(found: Any) -> None:
    import numpy as np

    from symcal.spatial import matrix_rpy

    console = _console()
    pose = found.pose_at_zero
    xyz = ", ".join(f"{v:.6f}" for v in pose[:3, 3])
    rpy = ", ".join(f"{v:.6f}" for v in np.rad2deg(matrix_rpy(pose[:3, :3])))
    console.print(f"\ntool in world with all readings at zero: xyz ({xyz}) mm, rpy ({rpy}) deg")
    for name, seen in found.seen.items():
        console.print(f"\n{name}: {seen.numerical_rank} of {len(seen.names)} parameter directions can be seen")
        for direction in seen.unseen():
            console.print(f"  - {direction.text}")
    for note in found.notes:
        console.print(f"[bold]warning:[/bold] {escape(note)}")


def main() -> None:
    """Entry point: an input error is one message and exit code 1; a traceback is a bug of ours."""
    try:
        app()
    except SymcalError as error:
        Console(stderr=True, soft_wrap=True).print(f"symcal: {error}", markup=False, highlight=False)
        sys.exit(1)


if __name__ == "__main__":
    main()
