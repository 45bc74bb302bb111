"""The command that writes the first files: init."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from symcal.cli.app import Quiet
from symcal.cli.reply import reply

if TYPE_CHECKING:
    from symcal.drafts.files import Written
    from symcal.drafts.instrument import Draft
    from symcal.drafts.robot_file import RobotDraft

T = TypeVar("T")


def init(
    arm: Annotated[str | None, typer.Option("--arm", metavar="NAME", help="a common arm; --list shows them")] = None,
    from_: Annotated[Path | None, typer.Option("--from", metavar="ROBOT.urdf", help="any other arm")] = None,
    base: Annotated[
        str | None, typer.Option("--base", metavar="LINK", help="of the URDF, the base link [its root]")
    ] = None,
    tip: Annotated[
        str | None,
        typer.Option("--tip", metavar="LINK", help="of the URDF, the link with the tool [its only end]"),
    ] = None,
    instrument: Annotated[
        str | None, typer.Option("--instrument", metavar="KIND", help="what measures it; --list shows them")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="folder to write into [<arm>_<instrument>]")
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="list arms and instruments, and write nothing")] = False,
    quiet: Quiet = False,
) -> None:
    """Write the first files: robot, experiment and an empty table for measurements, to plan with, simulate and fill in.

    In a terminal it asks for what is not said.
    """
    from symcal.drafts.files import first_name, write_first_files
    from symcal.drafts.instrument import draft_named
    from symcal.drafts.robot_file import of_arm, of_urdf

    if list_:
        from symcal.drafts.instrument import DRAFTS
        from symcal.robot.arms import arm_names

        reply(lambda: {"arms": list(arm_names()), "instruments": list(DRAFTS)})
        _print_arms()
        _print_instruments()
        return
    _insist_on_sense(arm, from_, base, tip)
    asking = sys.stdin.isatty()
    if arm is None and from_ is None:
        robot = _asked_robot() if asking else _missing_arm()
    elif from_ is None:
        robot = of_arm(arm or "")
    elif asking and tip is None:
        robot = _asked_end(from_, base)
    else:
        robot = of_urdf(from_, base, tip)
    if instrument is None:
        draft = _asked_instrument() if asking else _missing_instrument()
    else:
        draft = draft_named(instrument)
    folder = out or Path(first_name(robot, draft))
    written = write_first_files(robot, draft, folder)
    reply(lambda: {"guesses": written.guesses, "notes": list(robot.notes)}, *written.files)
    if not quiet:
        _print_written(written, robot.notes)


def _insist_on_sense(arm: str | None, urdf: Path | None, base: str | None, tip: str | None) -> None:
    from symcal.errors import InputError

    if arm is not None and urdf is not None:
        raise InputError("give an arm of the list or a URDF file, not both", key="--from", found=urdf)
    for option, value in (("--base", base), ("--tip", tip)):
        if value is not None and urdf is None:
            raise InputError("this is about a URDF file, which --from names", key=option, found=value)


def _missing_arm() -> RobotDraft:
    from symcal.errors import InputError
    from symcal.robot.arms import arm_names

    raise InputError("say which arm: --arm NAME, or --from ROBOT.urdf", key="--arm", allowed=arm_names())


def _missing_instrument() -> Draft:
    from symcal.drafts.instrument import DRAFTS
    from symcal.errors import InputError

    raise InputError("say what measures the arm", key="--instrument", allowed=DRAFTS)


# ------------------------------------------------------------------------------------------------------------ questions


def _asked(question: str, answered: Callable[[str], T]) -> T:
    """Ask until the answer can be used."""
    from symcal.errors import InputError

    while True:
        try:
            return answered(typer.prompt(question).strip())
        except InputError as error:
            typer.echo(str(error), err=True)


def _asked_robot() -> RobotDraft:
    from symcal.drafts.robot_file import of_arm

    def answered(text: str) -> RobotDraft:
        return _asked_end(Path(text).expanduser(), None) if text.lower().endswith(".urdf") else of_arm(text)

    _print_arms()
    return _asked("arm, or a URDF file", answered)


def _asked_end(urdf: Path, base: str | None) -> RobotDraft:
    from symcal.drafts.robot_file import of_urdf, urdf_ends

    ends = urdf_ends(urdf)[1]
    if len(ends) == 1:
        return of_urdf(urdf, base)
    typer.echo(f"the links that a tool can be on: {', '.join(ends)}")
    return _asked("tip link", lambda tip: of_urdf(urdf, base, tip))


def _asked_instrument() -> Draft:
    from symcal.drafts.instrument import draft_named

    _print_instruments()
    return _asked("instrument", draft_named)


# ------------------------------------------------------------------------------------------------------------- answers


def _print_arms() -> None:
    """The arms of the list, each with where its numbers are from."""
    from rich.markup import escape
    from rich.table import Table

    from symcal.cli import terminal
    from symcal.robot.arms import arm, arm_names

    table = Table("arm", "maker", "model", "axes", "sources", "from", box=None, pad_edge=False)
    for facts in map(arm, arm_names()):
        agree = "two agree" if facts.checked else "one only"
        cells = (facts.name, facts.maker, facts.model, str(facts.axes), agree, _cut(facts.sources[0]))
        table.add_row(*map(escape, cells))
    terminal.output().print(table)


def _cut(text: str, most: int = 60) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."


def _print_instruments() -> None:
    from rich.markup import escape
    from rich.table import Table

    from symcal.cli import terminal
    from symcal.drafts.instrument import DRAFTS

    table = Table("instrument", "what it is", box=None, pad_edge=False)
    for draft in DRAFTS.values():
        table.add_row(escape(draft.name), escape(draft.what))
    console = terminal.output()
    console.print()
    console.print(table)


def _print_written(written: Written, notes: Sequence[str]) -> None:
    """The files, and the commands that go on from here."""
    from rich.markup import escape

    from symcal.cli import terminal

    console, experiment = terminal.output(), shlex.quote(str(written.files[0]))
    for path in written.files:
        console.print(f"written to {escape(str(path))}")
    for note in notes:
        console.print(f"[bold]warning:[/bold] {escape(note)}")
    console.print(f"\nguesses in them: {written.guesses} lines, each marked 'FILL IN'. They work as they are:\n")
    for command, what in (
        ("check", "what such measurements can tell"),
        ("plan", "the postures to measure"),
        ("run", "a simulation, until there are measurements"),
    ):
        line = f"symcal {command} {experiment}"
        console.print(f"    {escape(line):<{len(experiment) + 16}}# {what}")
