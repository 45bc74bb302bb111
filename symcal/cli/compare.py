"""The command that lays calibrations of one robot beside each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symcal.cli.app import Quiet

if TYPE_CHECKING:
    from rich.table import Table


def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN RUN...", help="folders of runs, or calibrated.yaml files")],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="numbers, tables and the figure")] = None,
    quiet: Quiet = False,
) -> None:
    """Compare calibrations of one robot with the first: did it change?"""
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.runs.compare import compare_runs

    with terminal.spinner(quiet) as progress:
        content = compare_runs(runs, out, progress)
    reply(lambda: content, *([] if out is None else [out]))
    if not quiet:
        print_comparison(content)
        if out is not None:
            terminal.output().print(f"written to {escape(str(out))}")


def print_comparison(content: Any) -> None:
    """How good every run is; of every pair what differs, and what it comes to."""
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.report.comparison import pair_sentences

    console = terminal.output()
    console.print(_runs_table(content["runs"]))
    for pair in content["comparison"]:
        first, *rest = pair_sentences(pair)
        console.print()
        console.print(escape(first))
        if not pair["identical"]:
            console.print(_parameter_table(pair))
        for line in rest:
            console.print(escape(line))
    console.print()
    for warning in content["warnings"]:
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


def _runs_table(runs: Any) -> Table:
    from rich.markup import escape
    from rich.table import Table

    heads = ("run", "poses", "judged on", "before rms", "after rms", "after p95", "unit", "noise", "seen", "verdict")
    decided = any(run["accepted"] is not None for run in runs.values())
    table = Table(*heads[: None if decided else -1], box=None, pad_edge=False)
    for name, run in runs.items():
        found = run["accuracy"]
        sizes = (
            [f"{found[s][k]:.4g}" for s, k in (("before", "rms"), ("after", "rms"), ("after", "p95"))] if found else []
        )
        parts = {"test": "held-out", "cross_validation": "cross-validation", "train": "training"}
        cells = [parts.get(found["part"], found["part"]), *sizes, found["unit"]] if found else ["-"] * 5
        noise = ", ".join(f"{each['sigma']:.3g} {each['unit']}" for each in run["noise"].values())
        seen = "-" if run["rank"] is None else f"{run['rank']}{f' of {n}' if (n := run['parameters']) else ''}"
        poses = " + ".join(str(run["poses"][part]) for part in ("train", "test") if part in run["poses"])
        verdict = {None: "-", True: "accepted", False: "refused"}[run["accepted"]]
        row = [escape(name), poses or "-", *cells, noise or "-", seen, verdict]
        table.add_row(*row[: len(table.columns)])
    return table


def _parameter_table(pair: Any) -> Table:
    """Those that differ, or else those that come nearest to it."""
    from rich.markup import escape
    from rich.table import Table

    from symcal.units import in_mrad
    from symcal.words import chance

    judged = [name for name, each in pair["parameters"].items() if each["p"] is not None]
    order = sorted(judged, key=lambda name: pair["parameters"][name]["p"])
    shown = [name for name in order if pair["parameters"][name]["differs"]] or order[:3]
    heads = ("parameter", pair["first"], pair["second"], "difference", "std. deviation", "unit", "p", "")
    table = Table(*map(escape, heads), box=None, pad_edge=False)
    for name in shown:
        each = pair["parameters"][name]
        unit, factor = in_mrad(each["unit"])
        numbers = [f"{each[key] * factor:+.4g}" for key in ("first", "second", "difference")]
        mark = "differs" if each["differs"] else ""
        sigma = f"{each['sigma'] * factor:.2g}"
        table.add_row(name, *numbers, sigma, unit, chance(each["p_adjusted"]), mark)
    return table
