"""What is said between a capture and an instrument, a line each way, in words that ten lines of any language speak.

To the instrument:

    CAPTURE 1 q1_deg ... qn_deg -> x_mm y_mm z_mm   once: what joint readings and readings are
    MEASURE 7 12 30.5 -80 ... [FROM + - ...]        number of the request, pose, joint readings to drive to; and from
                                                    which side each joint is to come there
    SAY ...                                         for people
    END ...                                         nothing is wanted any more, and why

and from it, for every MEASURE one of the first two:

    1203.512 -88.204 511.93                         what was read, in the order and units of the first line; nan for
                                                    what was not seen. `OK` may stand before
    MISS no line of sight                           nothing could be read
    AT 30.4998 -80.0003 ...                         before the reading: where the joints really are
    FROM + - 0 ...                                  before the reading: from where they really came; 0: not known
    STRIKE 5 the lamp was in the way                the reading of that number shall not count
    STOP                                            enough for now

Words may be small letters; lines that begin with `#`, and empty ones, are passed over.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.capture.aim import Aim
from symcal.capture.course import Wanted
from symcal.data.saved_measurements import joint_columns, reading_columns
from symcal.errors import InputError
from symcal.units import DEGREES

Array = NDArray[np.float64]

_SIDES = {"+": 1.0, "-": -1.0, "0": 0.0, "1": 1.0, "-1": -1.0, "+1": 1.0}


@dataclass(frozen=True, slots=True)
class Request:
    """What the instrument is asked. q: shape (dof,), rad and mm; directions: shape (dof,), zero where it is all one."""

    number: int
    of: Wanted
    q: Array
    directions: Array


@dataclass(frozen=True, slots=True)
class Read:
    """An answer: what was read, shape (w,), where and from where the joints came. source: the file it is from."""

    z: Array
    q: Array
    directions: Array
    source: str = ""


@dataclass(frozen=True, slots=True)
class Missed:
    """An answer: nothing could be read."""

    why: str


@dataclass(frozen=True, slots=True)
class Strike:
    """A reading shall not count."""

    number: int
    why: str


@dataclass(frozen=True, slots=True)
class Stop:
    """Enough for now."""


Answer = Read | Missed | Strike | Stop


def columns(aim: Aim) -> tuple[str, ...]:
    """Names of the numbers of an answer, with their units; of several points each with its name before it."""
    own, points = reading_columns(aim.instrument), aim.observation.features
    if len(points) < 2:
        return tuple(own)
    return tuple(f"{point}_{name}" for point in points for name in own)


def greeting(aim: Aim) -> str:
    """The first line."""
    return f"CAPTURE 1 {' '.join(joint_columns(aim.experiment.robot))} -> {' '.join(columns(aim))}"


def request_line(aim: Aim, request: Request) -> str:
    """The line of a request."""
    q = " ".join(repr(float(value)) for value in _shown(aim, request.q))
    name = "_".join(request.of.pose.split()) or "_"
    line = f"MEASURE {request.number} {name} {q}"
    if not request.directions.any():
        return line
    return f"{line} FROM {' '.join('+' if each > 0 else '-' for each in request.directions)}"


def asked(aim: Aim, line: str) -> Request | None:
    """The request of a line, as an instrument reads it; None of a line that asks for nothing."""
    words = line.split()
    if not words or words[0] != "MEASURE":
        return None
    dof = aim.model.robot.dof
    q, rest = np.array([float(word) for word in words[3 : 3 + dof]]), words[3 + dof :]
    directions = np.array([_SIDES[word] for word in rest[1:]]) if rest else np.zeros(dof)
    return Request(int(words[1]), Wanted(words[2]), _inside(aim, q), directions)


def answer(aim: Aim, request: Request, lines: Iterable[str]) -> Answer:
    """What an instrument answers to a request, from its lines; `Stop` where they end.

    Raises:
        InputError: a line that means nothing, or not as many numbers as are wanted.
    """
    q, came, dof = request.q, request.directions, aim.model.robot.dof
    for line in lines:
        first, *rest = line.split() or ["#"]
        word = first.upper()
        if word.startswith("#"):
            continue
        if word == "AT":
            q = _inside(aim, _numbers(rest, dof, joint_columns(aim.experiment.robot), line))
        elif word == "FROM":
            if len(rest) != dof or not set(rest) <= set(_SIDES):
                raise InputError("a side for each joint is wanted: +, - or 0", key="FROM", found=line.strip())
            came = np.array([_SIDES[each] for each in rest])
        elif word == "MISS":
            return Missed(" ".join(rest))
        elif word == "STOP":
            return Stop()
        elif word == "STRIKE":
            if not rest or not rest[0].isdecimal():
                raise InputError("the number of a reading is wanted", key="STRIKE", found=line.strip())
            return Strike(int(rest[0]), " ".join(rest[1:]))
        else:
            return Read(_reading(aim, rest if word == "OK" else [first, *rest], line), q, came)
    return Stop()


def _reading(aim: Aim, words: list[str], line: str) -> Array:
    """The numbers of a reading in mm, rad and px."""
    wanted = columns(aim)
    z = _numbers(words, len(wanted), wanted, line)
    if not np.isfinite(z).any():
        raise InputError("nothing was read: say MISS and why", key="answer", found=line.strip())
    if aim.instrument.reads == "frame" and len(wanted) == 7:
        norm = float(np.linalg.norm(z[3:]))
        if not abs(norm - 1) <= 1e-3:
            raise InputError("the quaternion is not of unit length", key="answer", found=line.strip())
        z[3:] /= norm
    return z


def _numbers(words: list[str], count: int, names: Iterable[str], line: str) -> Array:
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or np.isinf(values).any():
        raise InputError(f"{count} numbers are wanted: {' '.join(names)}", key="answer", found=line.strip())
    return values


def _shown(aim: Aim, q: Array) -> Array:
    return np.where([joint.revolute for joint in aim.model.robot.joints], q * DEGREES, q)


def _inside(aim: Aim, q: Array) -> Array:
    return np.where([joint.revolute for joint in aim.model.robot.joints], q / DEGREES, q)
