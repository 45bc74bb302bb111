"""Ways to an instrument: the keyboard; lines on standard input, TCP or a serial port; one that is only simulated."""

from __future__ import annotations

import contextlib
import io
import socket
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Protocol

from symcal.capture.aim import Aim
from symcal.capture.lines import Answer, Missed, Read, Request, Stop, answer, columns, greeting, request_line
from symcal.capture.simulated import Mishaps, simulated
from symcal.errors import InputError, printable
from symcal.units import DEGREES

WAYS = ("keyboard", "-", "tcp://HOST:PORT", "serial:DEVICE:BAUD", "images:FOLDER", "simulated:SEED")
_PATIENCE = 60.0  # seconds in which a server that went away may come back
_PAUSE = 0.1  # seconds between two tries
_UNCLEAR = 5  # answers in a row that mean nothing


class Way(Protocol):
    """What reads."""

    def ask(self, request: Request) -> Answer:
        """What is read at a posture."""

    def say(self, text: str) -> None:
        """Tell who measures."""

    def end(self, text: str) -> None:
        """Tell that nothing is wanted any more."""


@contextmanager
def way_to(address: str, aim: Aim, used: Iterable[str] = ()) -> Iterator[Way]:
    """The way to an instrument.

    Args:
        address: one of `WAYS`. used: names of images that were read before.
    Raises:
        InputError: no such way, or nobody there.
    """
    kind, _, rest = address.partition(":")
    if address == "keyboard":
        yield Keyboard(aim)
    elif address == "-":
        yield Lines(aim, lambda: (sys.stdin, sys.stdout))
    elif kind == "tcp" and rest.startswith("//"):
        with contextlib.closing(_Tcp(_host(address, rest[2:]))) as there:
            yield Lines(aim, there.open, patience=_PATIENCE)
    elif kind == "serial":
        with contextlib.closing(_Serial(address, rest)) as port:
            yield Lines(aim, port.open)
    elif kind == "images" and rest:
        from symcal.capture.watched_folder import WatchedFolder

        yield WatchedFolder(aim, Path(rest), used, lambda request: _show(aim, request))
    elif kind == "simulated":
        if rest and not rest.isdecimal():
            raise InputError("a seed is a number", key="--instrument", found=address, allowed=WAYS)
        yield Practice(aim, int(rest or 1))
    else:
        raise InputError("no such way to an instrument", key="--instrument", found=address, allowed=WAYS)


class Lines:
    """An instrument that speaks the lines of `symcal.capture.lines`.

    A connection that breaks is made anew and the request said again: its number is the same, and an answer that came
    too late went with the old connection.
    """

    def __init__(self, aim: Aim, open_: Callable[[], tuple[IO[str], IO[str]]], patience: float = 0.0) -> None:
        self._aim, self._open, self._patience = aim, open_, patience
        self._streams: tuple[IO[str], IO[str]] | None = None

    def ask(self, request: Request) -> Answer:
        until = time.monotonic() + self._patience
        while True:
            try:
                return self._asked(request)
            except (OSError, EOFError, ValueError) as error:
                self._streams = None
                if time.monotonic() >= until:
                    if isinstance(error, EOFError):
                        return Stop()
                    raise InputError(f"the instrument does not answer: {error}", key="--instrument") from None
                time.sleep(_PAUSE)

    def _asked(self, request: Request) -> Answer:
        unclear = 0
        while True:
            self._write(request_line(self._aim, request))
            try:
                return answer(self._aim, request, self._read())
            except InputError as error:
                unclear += 1
                if unclear >= _UNCLEAR:
                    raise
                self._write(f"SAY not understood: {error}")

    def _read(self) -> Iterator[str]:
        assert self._streams is not None
        while True:
            line = self._streams[0].readline()
            if not line.endswith("\n"):
                raise EOFError("the connection was closed")
            yield line

    def _write(self, line: str) -> None:
        if self._streams is None:
            self._streams = self._open()
            line = f"{greeting(self._aim)}\n{line}"
        stream = self._streams[1]
        stream.write(f"{line}\n")
        stream.flush()

    def say(self, text: str) -> None:
        self._tell("SAY", text)

    def end(self, text: str) -> None:
        self._tell("END", text)

    def _tell(self, word: str, text: str) -> None:
        with contextlib.suppress(OSError, ValueError):  # who does not listen is told by the next request
            if self._streams is not None:
                self._write(f"{word} {' '.join(text.split())}")


class Keyboard:
    """Somebody who drives the robot and types what the instrument shows."""

    def __init__(self, aim: Aim) -> None:
        self._aim = aim
        print("type what is read, or: miss WHY, at Q1 Q2 ..., strike NUMBER, stop", file=sys.stderr)  # noqa: T201

    def ask(self, request: Request) -> Answer:
        _show(self._aim, request)
        while True:
            try:
                return answer(self._aim, request, self._typed())
            except InputError as error:
                self.say(str(error))

    def _typed(self) -> Iterator[str]:
        while True:
            try:
                yield input(f"   {' '.join(columns(self._aim))}: ")
            except EOFError:
                return

    def say(self, text: str) -> None:
        print(f"   {printable(text)}", file=sys.stderr)  # noqa: T201

    def end(self, text: str) -> None:
        self.say(text)


def _show(aim: Aim, request: Request) -> None:
    """Tell people where to drive."""
    joints = aim.model.robot.joints
    shown = [
        f"{joint.name} {value * DEGREES:.4f} deg" if joint.revolute else f"{joint.name} {value:.4f} mm"
        for joint, value in zip(joints, request.q, strict=True)
    ]
    print(f"\n{request.number}: pose {request.of.pose}: {', '.join(shown)}", file=sys.stderr)  # noqa: T201
    if request.directions.any():
        sides = ["above" if each < 0 else "below" for each in request.directions]
        said = ", ".join(f"{joint.name} from {side}" for joint, side in zip(joints, sides, strict=True))
        print(f"   come there with {said}", file=sys.stderr)  # noqa: T201


class Practice:
    """A robot that is only simulated."""

    def __init__(self, aim: Aim, seed: int) -> None:
        self._there = simulated(aim, seed, Mishaps())

    def ask(self, request: Request) -> Answer:
        z = self._there.read(request.number, request.q, request.directions)
        return Missed("nothing is seen") if z is None else Read(z, request.q, request.directions)

    def say(self, text: str) -> None:
        pass

    def end(self, text: str) -> None:
        pass


class _Tcp:
    """A server that may go away and come back."""

    def __init__(self, place: tuple[str, int]) -> None:
        self._place = place
        self._socket: socket.socket | None = None

    def open(self) -> tuple[IO[str], IO[str]]:
        self.close()
        there = socket.create_connection(self._place, timeout=_PATIENCE)
        there.settimeout(None)  # an instrument takes its time
        there.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._socket = there
        return there.makefile("r", encoding="utf-8", newline="\n"), there.makefile("w", encoding="utf-8", newline="\n")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _host(address: str, text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise InputError("expected tcp://HOST:PORT", key="--instrument", found=address)
    return host.strip("[]"), int(port)


class _Arrived(io.RawIOBase):
    """What has come through a port, at least a byte: its own reads wait until all that a buffer could hold is there."""

    def __init__(self, port: Any) -> None:
        self._port = port

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        came = self._port.read(max(1, min(len(buffer), self._port.in_waiting)))
        buffer[: len(came)] = came
        return len(came)


class _Serial:
    """A serial port; needs pyserial."""

    def __init__(self, address: str, text: str) -> None:
        device, _, baud = text.rpartition(":")
        if not device or not baud.isdecimal():
            raise InputError("expected serial:DEVICE:BAUD", key="--instrument", found=address)
        try:
            import serial
        except ImportError:
            message = "a serial port needs pyserial: pip install 'symcal[serial]'"
            raise InputError(message, key="--instrument", found=address) from None
        try:
            self._port = serial.Serial(device, int(baud))
        except (OSError, ValueError) as error:
            raise InputError(f"the port cannot be opened: {error}", key="--instrument", found=address) from None

    def open(self) -> tuple[IO[str], IO[str]]:
        reads = io.TextIOWrapper(io.BufferedReader(_Arrived(self._port)), encoding="utf-8", newline="\n")
        writes = io.TextIOWrapper(io.BufferedWriter(self._port), encoding="utf-8", newline="\n")
        return reads, writes

    def close(self) -> None:
        self._port.close()
