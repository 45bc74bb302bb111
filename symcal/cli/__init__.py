"""The `symcal` command."""

from __future__ import annotations

import signal
import sys

from rich.console import Console

from symcal.cli.app import app
from symcal.cli.compare import compare
from symcal.cli.deliver import compensate, export, import_, schema
from symcal.cli.identify import check, identify, run, validate
from symcal.cli.images import board, camera, measure
from symcal.cli.plan import plan
from symcal.errors import SymcalError

for command in (run, plan, board, camera, measure, identify, check, validate, compare, compensate, export):
    app.command()(command)
app.command("import")(import_)
app.command()(schema)


def main() -> None:
    """Entry point: an input error is one message and exit code 1; a traceback is a bug of ours."""
    signal.signal(signal.SIGTERM, _stop)
    try:
        app()
    except SymcalError as error:
        Console(stderr=True, soft_wrap=True).print(f"symcal: {error}", markup=False, highlight=False)
        sys.exit(1)


def _stop(number: int, _: object) -> None:
    """Leave as after an interrupt: half-written folders vanish."""
    sys.exit(128 + number)
