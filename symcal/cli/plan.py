"""The commands that choose poses and drive to them: plan, program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symcal.cli.app import Experiment, NoReport, Quiet, Seed, Set, with_outputs


def plan(
    experiment: Experiment,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="the plan's folder [reports/<name>-plan]")
    ] = None,
    seed: Seed = None,
    set_: Set = None,
    no_report: NoReport = False,
    quiet: Quiet = False,
) -> None:
    """Choose the poses to measure: which, how many, in what order, and how good the plan provably is."""
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.runs.plan import run_plan

    with terminal.spinner(quiet) as progress:
        overrides = with_outputs(set_, no_report)
        folder, content = run_plan(experiment, out, seed=seed, overrides=overrides, progress=progress)
    reply(lambda: content, folder)
    if not quiet:
        terminal.print_plan(content)
        terminal.output().print(f"written to {escape(str(folder))}")


def program(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="folder that 'symcal plan' wrote, or a plan.csv")],
    to: Annotated[str, typer.Option("--to", metavar="urscript|rapid|krl|csv", help="language of the controller")],
    robot: Annotated[
        Path | None, typer.Option("--robot", metavar="YAML", help="of a plan.csv that stands alone")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="folder to write into [the plan's]")] = None,
    name: Annotated[str, typer.Option("--name", help="of the program")] = "symcal_poses",
    speed: Annotated[float, typer.Option("--speed", metavar="PERCENT", help="of the joints' largest speeds")] = 20.0,
    settle: Annotated[float, typer.Option("--settle", metavar="S", help="how long the arm stands first")] = 1.0,
    approach: Annotated[
        float, typer.Option("--approach", metavar="DEG", help="last motion of every joint, upwards (mm of prismatic)")
    ] = 0.0,
    wait: Annotated[bool, typer.Option("--wait", help="stop at every pose until somebody starts it again")] = False,
    quiet: Quiet = False,
) -> None:
    """Write the program that drives a robot to the poses of a plan: with speed, settling time, direction of approach,
    and a mark where to measure."""
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.errors import InputError
    from symcal.programs.languages import LANGUAGES
    from symcal.programs.write import write_program
    from symcal.runs.load import robot_of_plan

    if to not in LANGUAGES:
        raise InputError("no such language", key="--to", found=to, allowed=LANGUAGES)
    file, known = robot_of_plan(plan, robot)
    written = write_program(
        file,
        known,
        to,
        file.parent if out is None else out,
        name=name,
        percent=speed,
        settle=settle,
        approach=approach,
        wait=wait,
    )
    reply(dict, *written)
    if not quiet:
        for path in written:
            terminal.output().print(f"written to {escape(str(path))}")
        terminal.output().print("try it at low speed first: only the joints' limits were checked")
