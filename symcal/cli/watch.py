"""The command that checks a robot in service, and plans such checks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symcal.cli.app import Calibrated, Quiet, Seed
from symcal.watch import ALPHA, OFFSET, POSES

if TYPE_CHECKING:
    from rich.table import Table

CHANGED = 3
"""Exit code where the calibration no longer holds; 1 is an error or a refusal as everywhere, 2 usage."""


def watch(
    calibrated: Calibrated,
    data: Annotated[Path | None, typer.Option("--data", metavar="CSV", help="today's readings: check by these")] = None,
    plan: Annotated[bool, typer.Option("--plan", help="choose the poses of a check instead")] = False,
    poses: Annotated[int, typer.Option("--poses", min=1, help="of a plan")] = POSES,
    moved: Annotated[bool, typer.Option("--moved", help="the instrument was set up anew")] = False,
    alpha: Annotated[float, typer.Option("--alpha", help="share of good checks that raise a false alarm")] = ALPHA,
    offset: Annotated[
        str, typer.Option("--offset", metavar="0.5mrad,0.1mm", help="of a joint, that is to be found")
    ] = OFFSET,
    experiment: Annotated[
        Path | None, typer.Option("--experiment", metavar="YAML", help="whose area and constraints a plan keeps")
    ] = None,
    history: Annotated[
        Path | None, typer.Option("--history", metavar="CSV", help="file that gets a row for this check")
    ] = None,
    date: Annotated[str | None, typer.Option("--date", help="of the readings [when their file was written]")] = None,
    instrument: Annotated[
        str | None, typer.Option("--instrument", help="whose readings these are, where several measured")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="numbers, figures and the plan")] = None,
    seed: Seed = None,
    quiet: Quiet = False,
) -> None:
    """Does the calibration still hold? Exit code 0: it does; 3: it changed, and what; 1: it cannot be judged."""
    from rich.markup import escape

    from symcal.cli import terminal
    from symcal.cli.reply import reply
    from symcal.watch.run import watch as check
    from symcal.watch.run import watch_plan

    if plan == (data is not None):
        raise typer.BadParameter("say either --data CSV or --plan")
    if plan and (history is not None or date is not None):
        raise typer.BadParameter("--history and --date are of a check, not of a plan")
    if experiment is not None and not plan:
        raise typer.BadParameter("--experiment is of a plan")
    with terminal.spinner(quiet) as progress:
        if plan:
            out, content = watch_plan(
                calibrated,
                out,
                poses=poses,
                experiment=experiment,
                offset=offset,
                alpha=alpha,
                moved=moved,
                instrument=instrument,
                seed=1 if seed is None else seed,
                progress=progress,
            )
        else:
            assert data is not None
            content = check(
                calibrated,
                data,
                out,
                alpha=alpha,
                offset=offset,
                moved=moved,
                instrument=instrument,
                history=history,
                date=date,
                progress=progress,
            )
    written = [path for path in (out, None if plan else history) if path is not None]
    reply(lambda: content, *written)
    if not quiet:
        console = terminal.output()
        console.print(_plan_table(content) if plan else _check_table(content))
        for line in ([] if plan else [content["sentence"]]) + content["remarks"]:
            console.print(escape(line))
        for path in written:
            console.print(f"written to {escape(str(path))}")
    if not plan and content["verdict"] != "holds":
        raise typer.Exit(CHANGED)


def _plan_table(content: Any) -> Table:
    from rich.markup import escape
    from rich.table import Table

    from symcal.watch.words import size

    power = f"found with a power of {content['power']:.0%}"
    table = Table("joint", "", power, "instrument set up anew", "wanted", "poses for that", box=None, pad_edge=False)
    for name, each in content["offsets"].items():
        cells = ["not seen" if each[k] is None else size(each[k], each["unit"]) for k in ("still", "moved", "wanted")]
        needed = "no number does" if each["needed"] is None else str(each["needed"])
        table.add_row(str(each["joint"]), escape(name), *cells, needed)
    for name, sizes in content["frames"]["still"].items():
        again = content["frames"]["moved"].get(name, {})
        cells = [", ".join(size(value, unit) for unit, value in found.items()) or "-" for found in (sizes, again)]
        table.add_row("", name, *cells, "", "")
    return table


def _check_table(content: Any) -> Table:
    from rich.markup import escape
    from rich.table import Table

    from symcal.units import in_mrad
    from symcal.words import chance

    table = Table("test", "offset", "95 %", "alarm at", "finds", "unit", "p", "", box=None, pad_edge=False)
    named = {each["name"] for each in content["group"]}
    for name, joint in content["joints"].items():
        if joint is None:
            table.add_row(escape(name), *["-"] * 5, "", "not seen")
            continue
        unit, factor = in_mrad(joint["unit"])
        numbers = [joint[key] and joint[key] * factor for key in ("offset", "half_width_95", "limit", "smallest")]
        shown = [f"{numbers[0]:+.3g}", f"± {numbers[1]:.2g}", f"{numbers[2]:.2g}", f"{numbers[3]:.2g}"]
        table.add_row(escape(name), *shown, unit, chance(content["tests"][name]["p"]), _mark(name, named, content))
    for name in ("base", "tool", "rest"):
        if name in content["tests"]:
            label = "anything else" if name == "rest" else name
            p = chance(content["tests"][name]["p"])
            table.add_row(label, *[""] * 5, p, _mark(name, named, content))
    return table


def _mark(name: str, named: set[str], content: Any) -> str:
    test = content["tests"][name]
    return "changed" if name in named else "alarm" if test["limit"] and test["squares"] > test["limit"] else ""
