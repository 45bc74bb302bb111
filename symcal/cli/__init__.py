"""The `symcal` command."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from symcal.cli.app import app
from symcal.cli.bench import bench
from symcal.cli.capture import capture
from symcal.cli.compare import compare
from symcal.cli.deliver import compensate, export, import_, schema
from symcal.cli.doctor import doctor
from symcal.cli.identify import check, identify, run, validate
from symcal.cli.images import board, camera, measure
from symcal.cli.init import init
from symcal.cli.plan import plan, program
from symcal.cli.reply import WithJson, answer, json_asked
from symcal.cli.stdout import named_stdout, silence
from symcal.cli.study import study
from symcal.cli.watch import watch
from symcal.errors import InputError, SymcalError, printable

# Before NumPy is loaded: matrices here are small, and what several threads sum is not the same bits everywhere.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

for command in (
    init,
    run,
    study,
    plan,
    program,
    capture,
    board,
    camera,
    measure,
    identify,
    check,
    validate,
    compare,
    watch,
    compensate,
    export,
    bench,
    import_,
    schema,
    doctor,
):
    app.command(command.__name__.rstrip("_"))(WithJson(command))

# New objects before garbage is looked for: loading makes many that stay, and looking through them is slow.
OBJECTS = 400_000


def main() -> None:
    """Entry point: an input error is one message and exit code 1; a traceback is a bug of ours."""
    gc.set_threshold(OBJECTS, 50, 100)
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "true")  # it would look through all installed packages for them
    signal.signal(signal.SIGTERM, _stop)
    hangup = getattr(signal, "SIGHUP", None)
    if hangup is not None and signal.getsignal(hangup) != signal.SIG_IGN:  # not under nohup
        signal.signal(hangup, _stop)
    try:
        with named_stdout(), _called_alone():
            if json_asked(sys.argv[1:]):
                answer(app, next((each for each in sys.argv[1:2] if not each.startswith("-")), None), _say)
            app()
    except SymcalError as error:
        _say(error)
        sys.exit(1)


def _called() -> list[str]:
    """The command of this call, or of the line that a shell wants completed; empty where there is none."""
    line = os.environ.get("_TYPER_COMPLETE_ARGS") or os.environ.get("COMP_WORDS")
    return line.split()[1:2] if "_SYMCAL_COMPLETE" in os.environ and line else sys.argv[1:2]


def _say(error: SymcalError) -> None:
    """Tell people of an error: one message; on a terminal also the line of the file that it is about."""
    from rich.console import Console

    console = Console(stderr=True, soft_wrap=True)
    try:
        console.print(f"symcal: {printable(str(error))}", markup=False, highlight=False)
        if console.is_terminal and isinstance(error, InputError):
            from symcal.documents.excerpt import excerpt

            found = excerpt(error, console.width)
            for line, style in zip(() if found is None else found.lines(), ("", "bold red"), strict=False):
                console.print(line, style=style, markup=False, highlight=False)
    except OSError:
        silence(sys.stderr)


@contextmanager
def _called_alone() -> Iterator[None]:
    """Typer reads the parameters of every command it knows before it looks which one is called: it knows that one."""
    known = app.registered_commands
    app.registered_commands = [command for command in known if command.name in _called()] or known
    try:
        yield
    finally:
        app.registered_commands = known


def _stop(number: int, _: object) -> None:
    """Leave as after an interrupt: half-written folders vanish."""
    sys.exit(128 + number)
