"""The command that chooses poses: plan."""

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
