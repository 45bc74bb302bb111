"""The command that measures how fast the package is on this machine: bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symcal.cli.app import Quiet


def bench(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="numbers, tables, figure [reports/bench]")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="seconds instead of minutes, and less of everything")] = False,
    only: Annotated[
        str | None, typer.Option("--only", metavar="SUBJECT", help="positions, identifications, commands or growth")
    ] = None,
    against: Annotated[
        Path | None, typer.Option("--against", metavar="BENCH.json", help="an earlier run to compare with")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Measure how fast this machine is: symcal beside SciPy, NumPy, CasADi, and JAX and pinocchio where installed."""
    from rich.markup import escape
    from rich.table import Table

    from symcal.bench.tables import machine_lines, tables
    from symcal.bench.write import bench as run_bench
    from symcal.cli import terminal
    from symcal.cli.reply import reply

    with terminal.spinner(quiet) as progress:
        folder, content, more = run_bench(out, quick=quick, only=only, earlier=against, progress=progress)
    reply(lambda: content, folder)
    if quiet:
        return
    console = terminal.output()
    for line in machine_lines(content):
        console.print(escape(line))
    for each in [*tables(content), *more]:
        console.print()
        table = Table(box=None, pad_edge=False, title=escape(each.title), title_justify="left", title_style="bold")
        for i, head in enumerate(each.heads):
            table.add_column(escape(head), justify="right" if i else "left", no_wrap=not i)
        for row in each.rows:
            table.add_row(*map(escape, row))
        console.print(table)
        for note in each.notes:
            console.print(escape(note), style="dim")
    console.print(f"written to {escape(str(folder))}")
