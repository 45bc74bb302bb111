"""The command that runs an experiment thousands of times: study."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symcal.cli.app import Out, Quiet, Seed, Set

_INTERRUPTED = 130


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY.yaml", help="study file")],
    out: Out = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="processes [one per core]")] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="of a Dask cluster, instead of processes here")
    ] = None,
    portable: Annotated[
        bool, typer.Option("--portable", help="only the kernels that every machine has, for clusters that are mixed")
    ] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="the table of trials as Parquet too")] = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="numbers only: no figures and no PDF")] = False,
    seed: Seed = None,
    set_: Set = None,
    quiet: Quiet = False,
) -> None:
    """Run an experiment thousands of times over a grid; again after an interrupt, it goes on."""
    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.outputs.side_by_side import cores
    from symcal.trials.study import Execution, Interrupted, run_study

    if scheduler is not None and workers is not None:
        from symcal.errors import InputError

        raise InputError("a cluster has its own workers: leave one of the two out", key="--workers", found=workers)
    execution = Execution(workers or cores(), scheduler, portable, parquet=parquet)
    try:
        with terminal.trial_progress(quiet) as (progress, advance):
            folder, content = run_study(
                file,
                out,
                seed=seed,
                overrides=set_ or (),
                execution=execution,
                report=not no_report,
                progress=progress,
                advance=advance,
            )
    except Interrupted as interrupted:
        from rich.console import Console

        Console(stderr=True, soft_wrap=True).print(f"symcal: {interrupted}", markup=False, highlight=False)
        raise typer.Exit(_INTERRUPTED) from None
    reply(lambda: content, folder)
    if not quiet:
        from rich.markup import escape

        terminal.print_trials(content)
        terminal.output().print(f"written to {escape(str(folder))}")
