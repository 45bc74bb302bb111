"""A simulated instrument as a server: practice for programs that speak the lines of `symcal.capture.lines`."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import IO

from symcal.capture.aim import Aim
from symcal.capture.lines import asked
from symcal.capture.simulated import Simulated
from symcal.errors import InputError


def serve(aim: Aim, there: Simulated, port: int, ready: Callable[[int], None], address: str = "127.0.0.1") -> None:
    """Answer one capture after the other, until the process ends.

    Args:
        port: 0 for any that is free. ready: told the port when it can be connected to.
    Raises:
        InputError: the port cannot be used.
    """
    try:
        listening = socket.create_server((address, port))
    except (OSError, OverflowError) as error:
        raise InputError(f"the port cannot be used: {error}", key="--simulate", found=port) from None
    with listening:
        ready(listening.getsockname()[1])
        while True:
            connection, _ = listening.accept()
            with connection, connection.makefile("rw", encoding="utf-8", newline="\n") as lines:
                try:
                    _answered(aim, there, lines)
                except (OSError, ValueError):  # the other side went away in the middle of a line
                    continue


def _answered(aim: Aim, there: Simulated, lines: IO[str]) -> None:
    for line in lines:
        request = asked(aim, line)
        if request is None:
            continue
        z = there.read(request.number, request.q, request.directions)
        said = "MISS no line of sight" if z is None else " ".join(repr(float(value)) for value in z)
        lines.write(f"{said}\n")
        lines.flush()
