"""The command that leads a measurement: capture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symcal.cli.app import Quiet


def capture(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="folder that 'symcal plan' wrote, or its plan.csv")],
    instrument: Annotated[
        str,
        typer.Option(
            "--instrument",
            metavar="ADDRESS",
            help="keyboard, - (standard input), tcp://HOST:PORT, serial:DEVICE:BAUD, images:FOLDER, simulated:SEED",
        ),
    ] = "keyboard",
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="the session's folder [reports/<name>-capture]")
    ] = None,
    tolerance: Annotated[
        str | None, typer.Option("--tolerance", metavar="0.1mm", help="rms error over the plan's region [the file's]")
    ] = None,
    order: Annotated[
        str, typer.Option("--order", metavar="best|plan", help="the pose that helps most next, or as in the plan")
    ] = "best",
    most: Annotated[int | None, typer.Option("--most", min=1, help="poses at most")] = None,
    afresh: Annotated[bool, typer.Option("--afresh", help="set aside what the session has so far")] = False,
    simulate: Annotated[
        int | None,
        typer.Option("--simulate", metavar="PORT", min=0, max=65535, help="be a simulated instrument on this port"),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="of the simulated robot and its noise")] = 1,
    bump: Annotated[
        int | None, typer.Option("--bump", min=1, help="simulated: reading before which the target is knocked by 1 mm")
    ] = None,
    outliers: Annotated[float, typer.Option("--outliers", min=0, max=1, help="simulated: share of slips")] = 0.0,
    misses: Annotated[float, typer.Option("--misses", min=0, max=1, help="simulated: share of drop-outs")] = 0.0,
    quiet: Quiet = False,
) -> None:
    """Lead a measurement pose by pose: check each reading, and stop when the tolerance is sure to be kept."""
    from symcal.errors import InputError, RefusedError

    if order not in ("best", "plan"):
        raise InputError("no such order", key="--order", found=order, allowed=("best", "plan"))
    wanted = None if tolerance is None else _length(tolerance)
    if simulate is not None:
        from symcal.capture.aim import aim_of
        from symcal.capture.server import serve
        from symcal.capture.simulated import Mishaps, simulated

        aim = aim_of(plan, wanted)
        there = simulated(aim, seed, Mishaps(outliers=outliers, misses=misses, bump=bump))
        serve(aim, there, simulate, lambda port: typer.echo(f"listening on tcp://127.0.0.1:{port}", err=True))
    from symcal.capture.run import capture as lead
    from symcal.cli.reply import reply
    from symcal.errors import printable

    def say(text: str) -> None:
        if not quiet:
            typer.echo(printable(text), err=True)

    done = lead(
        plan,
        out,
        instrument=instrument,
        tolerance=wanted,
        order="plan" if order == "plan" else "best",
        most=most,
        afresh=afresh,
        say=say if instrument != "keyboard" else lambda _: None,
    )
    reply(lambda: done.facts, done.folder)
    if not done.ended_well:
        raise RefusedError(done.outlook.why)
    if not quiet:
        why = "stopped: the same command goes on" if done.stopped else done.outlook.why
        typer.echo(f"{why}\nsymcal identify {printable(str(done.folder / 'session.yaml'))}", err=instrument == "-")


def _length(text: str) -> float:
    """A tolerance of the position, mm."""
    from symcal.calibration.tolerance import parse_tolerance
    from symcal.errors import InputError

    found = parse_tolerance(text).position
    if found is None:
        raise InputError("expected a length with its unit, such as 0.1mm", key="--tolerance", found=text)
    return found
