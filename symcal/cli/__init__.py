"""The `symcal` command."""

from __future__ import annotations

import errno
import os
import signal
import sys
from typing import NoReturn

from rich.console import Console

from symcal.cli.app import app
from symcal.cli.compare import compare
from symcal.cli.deliver import compensate, export, import_, schema
from symcal.cli.identify import check, identify, run, validate
from symcal.cli.images import board, camera, measure
from symcal.cli.plan import plan
from symcal.errors import SymcalError, printable

for command in (run, plan, board, camera, measure, identify, check, validate, compare, compensate, export):
    app.command()(command)
app.command("import")(import_)
app.command()(schema)


def main() -> None:
    """Entry point: an input error is one message and exit code 1; a traceback is a bug of ours."""
    signal.signal(signal.SIGTERM, _stop)
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # here, where it can still be said that it failed
    except SymcalError as error:
        _say(printable(str(error)))
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left cannot be written at exit either
        _say(f"the output cannot be written: {error.strerror}")


# The disk is full, the quota used up, or a pipe has nobody who reads it.
_NO_ROOM = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EPIPE)


def _say(message: str) -> NoReturn:
    Console(stderr=True, soft_wrap=True).print(f"symcal: {message}", markup=False, highlight=False)
    sys.exit(1)


def _stop(number: int, _: object) -> None:
    """Leave as after an interrupt: half-written folders vanish."""
    sys.exit(128 + number)
