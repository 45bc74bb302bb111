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
Calibrated = Annotated[Path, typer.Argument(metavar="CALIBRATED.yaml", help="calibrated robot")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="the run's folder [reports/<name>]")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="instead of the file's seed")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE", help="replace a value of the file")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="no progress and no table")]


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
    from symcal.plan_experiment import run_plan

    with _progress(quiet) as progress:
        folder, content = run_plan(experiment, out, seed=seed, overrides=set_ or (), progress=progress)
    if not quiet:
        _print_plan(content)
        _console().print(f"written to {escape(str(folder))}")


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

    from symcal.compensate import compensate as solve
    from symcal.compensate import write_joints
    from symcal.errors import InputError
    from symcal.robot import load_robot
    from symcal.targets import read_targets

    if frame not in ("base", "world"):
        raise InputError("no such frame", key="--frame", found=frame, allowed=("base", "world"))
    robot = load_robot(calibrated)
    with _progress(quiet) as progress:
        progress("compensating")
        result = solve(
            robot,
            read_targets(targets, robot, "base" if frame == "base" else "world"),
            np.random.default_rng(seed or 0),
        )
    write_joints(result, out)
    if not quiet:
        _print_compensation(result)
        _console().print(f"written to {escape(str(out))}")


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
    from symcal.robot import load_robot

    if to not in FORMATS:
        from symcal.errors import InputError

        raise InputError("no such format", key="--to", found=to, allowed=FORMATS)
    written, doubts = export_robot(load_robot(calibrated), to, out, force=force)
    for doubt in doubts:
        Console(stderr=True, soft_wrap=True).print(f"doubt overridden: {doubt}", markup=False, highlight=False)
    if not quiet:
        for path in written:
            _console().print(f"written to {escape(str(path))}")


@app.command("import")
def import_(
    urdf: Annotated[Path, typer.Argument(metavar="ROBOT.urdf", help="URDF file")],
    base: Annotated[str, typer.Option("--base", metavar="LINK", help="base link")],
    tip: Annotated[str, typer.Option("--tip", metavar="LINK", help="tip link")],
    out: Annotated[Path, typer.Option("--out", metavar="YAML", help="robot file")] = Path("robot.yaml"),
) -> None:
    """Read a URDF chain as a robot file."""
    from symcal.robot import save_robot
    from symcal.urdf import load_urdf

    robot = load_urdf(urdf, base, tip)
    save_robot(robot, out)
    _print_robot(robot)
    _console().print(f"written to {escape(str(out))}")


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
    experiment: Path,
    data: Path | None,
    out: Path | None,
    seed: int | None,
    overrides: list[str] | None,
    quiet: bool,
    *,
    study: bool = True,
) -> None:
    from symcal import experiment as runs

    with _progress(quiet) as progress:
        folder, content = runs.run(
            experiment, out, seed=seed, overrides=overrides or (), data=data, study=study, progress=progress
        )
    if not quiet:
        if "simulation_2" in content:
            _print_study(content)
        else:
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
    console = Console(soft_wrap=True)
    return console if console.is_terminal else Console(soft_wrap=True, width=160)


def _print_study(content: Any) -> None:
    console = _console()
    one, two = content["simulation_1"], content["simulation_2"]
    console.print(f"Simulation I: {one['position_error_mm'][-1]:.1e} mm after {one['iterations']} iterations")
    columns = ("mean mm", "max mm", "true rms mm", "expected mm", "/ Cramer-Rao", "beats random")
    table = Table("Simulation II, plan", *columns, box=None, pad_edge=False)
    for name, plan in two["plans"].items():
        again = plan["repetitions"]
        numbers = [again[key]["median"] for key in ("measured_mean_mm", "measured_max_mm", "true_rms_mm")]
        cells = [f"{value:.4f}" for value in (*numbers, plan["expected_rms_mm"], plan["true_rms_over_cramer_rao"])]
        table.add_row(name, *cells, f"{plan['beats_random_expected']:.1%}")
    for name, paper in two["paper"].items():
        table.add_row(f"paper, {name}", f"{paper['after']['mean_mm']:.4f}", f"{paper['after']['max_mm']:.4f}")
    console.print(table)
    console.print(f"medians of {two['repetitions']} repetitions; mean and max against noisy measurement")
    for warning in content["warnings"]:
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


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


def _print_plan(content: Any) -> None:
    from symcal.report.plan_verdict import plan_verdict

    console = _console()
    console.print(escape(plan_verdict(content)[0]))
    found, random = content["plan"], content["plan"]["random"]
    table = Table("", "this plan", *(["random (median)"] if random else []), box=None, pad_edge=False)
    for key, label in (
        ("d_efficiency_lower_bound", "D-efficiency, at least"),
        ("g_efficiency", "G-efficiency"),
        ("mean_pose_rms_mm", "foretold error, mean, mm"),
        ("worst_pose_rms_mm", "foretold error, worst pose, mm"),
    ):
        cells = [found[key], *([random[key]] if random else [])]
        table.add_row(label, *("-" if value is None else f"{value:.4g}" for value in cells))
    console.print(table)
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


def _print_compensation(result: Any) -> None:
    table = result.table()
    counts = table["status"].value_counts()
    console = _console()
    console.print(
        f"{len(table)} targets: " + ", ".join(f"{count} {escape(str(status))}" for status, count in counts.items())
    )


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
