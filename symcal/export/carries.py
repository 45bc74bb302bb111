"""The one gate of joint terms: which of them a way out of symcal can carry, and what leaving out the others costs.

No file but the robot file carries a smooth remainder.

json         all of them, as definitions and numbers
c, commands  all of them at nominal conditions: neither knows from which side a joint comes, nor what the tool holds
urdf, table  none: a joint of URDF, and a controller's table of offsets and lengths, has a constant zero at most
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.compensation.caps import moved_by_terms
from symcal.compensation.targets import base_frames
from symcal.errors import RefusedError
from symcal.export.joint_zeros import least_zeros, shifted, slopes_of_zeros
from symcal.export.largest import POSTURES, Largest, largest_difference
from symcal.joints import Term
from symcal.joints.payload import PAYLOAD
from symcal.kinematics import chain
from symcal.parameters import ParameterSet
from symcal.robot.robot import Robot
from symcal.words import listed

SX = ca.SX
Array = NDArray[np.float64]
Way = Literal["json", "c", "commands", "urdf", "table"]

CARRIES: dict[Way, Literal["all", "nominal", "none"]] = {
    "json": "all",
    "c": "nominal",
    "commands": "nominal",
    "urdf": "none",
    "table": "none",
}
_NAMES: dict[Way, str] = {
    "json": "JSON",
    "c": "the C code",
    "commands": "a command",
    "urdf": "URDF",
    "table": "a table of zero offsets and lengths",
}

_REFIT = 1024  # postures of a least-squares fit of joint zeros


@dataclass(frozen=True, slots=True)
class LeftOut:
    """What a way out leaves behind of a robot's joint terms, and what that costs; the errors are searched.

    terms: in words. robot: as it is written. mm, rad: the largest error of the tool at the robot file's payload; from
    whatever side joints come. per_kg: mm and rad that a kg of payload beyond it adds at most; None where no term asks.
    zeros: what was added to joint zeros to make up for it as far as it goes, by joint, rad or mm; empty: nothing.
    """

    way: Way
    terms: tuple[str, ...]
    robot: Robot
    mm: float
    rad: float
    per_kg: tuple[float, float] | None
    zeros: Mapping[str, float]

    @property
    def text(self) -> str:
        """All of it in one sentence or a few, in plain ASCII as far as names are."""
        names = listed(self.terms)
        if CARRIES[self.way] == "nominal":
            said = [f"{_NAMES[self.way]} keeps at nominal: {names}"]
        else:
            said = [f"{_NAMES[self.way]} leaves out: {names}"]
        if self.zeros:
            kinds = {joint.name: joint.revolute for joint in self.robot.joints}
            shifts = [
                f"{name} {np.degrees(v):.4g} deg" if kinds[name] else f"{name} {v:.4g} mm"
                for name, v in self.zeros.items()
            ]
            said.append(f"joint zeros were fitted by least squares to make up for it: {', '.join(shifts)}")
        searched = f"(searched over the joints' ranges: {POSTURES} random postures, corners, climbs from the worst)"
        if CARRIES[self.way] == "none" or self.mm > 0 or self.rad > 0:
            sides = ", from whatever side the joints come" if CARRIES[self.way] == "nominal" else ""
            said.append(f"the tool is then up to {_size(self.mm, self.rad)} off{sides} {searched}")
            searched = ""
        if self.per_kg is not None:
            more = f"each kg of payload beyond the file's moves the tool by up to {_size(*self.per_kg)} {searched}"
            said.append(more.strip())
        return ". ".join(part[0].upper() + part[1:] for part in said)


def left_out(robot: Robot, way: Way) -> LeftOut | None:
    """What a way out leaves behind; None where it carries all that acts."""
    carried = CARRIES[way]
    acting = [term for term in robot.terms if term.acts]
    lost = acting if carried == "none" else [] if carried == "all" else [term for term in acting if term.conditions]
    if not lost:
        return None
    q, sides = SX.sym("q", robot.dof), _sides(lost)
    from_sides = {name: SX.sym(name) for name in sides}
    v = ca.vertcat(q, *from_sides.values())
    lower, upper = robot.ranges
    box = (np.append(lower, np.full(len(sides), -1.0)), np.append(upper, np.full(len(sides), 1.0)))
    true, written, zeros = _pose(robot, q, from_sides), robot, dict[str, float]()
    if carried == "none":
        written = replace(robot, terms=())
        worst = largest_difference(true, _pose(written, q, {}), v, *box)
        if way == "urdf":
            written, worst, zeros = _refitted(robot, written, worst, (true, q, v), box)
    else:
        worst = largest_difference(true, _pose(robot, q, {}), v, *box)
    per_kg = None
    if any(PAYLOAD in term.conditions for term in lost):
        loaded = largest_difference(_pose(robot, q, {PAYLOAD: SX(1)}), _pose(robot, q, {}), q, *robot.ranges)
        per_kg = (loaded.mm, loaded.rad)
    names = [joint.name for joint in robot.joints]
    return LeftOut(way, tuple(term.words(names) for term in lost), written, worst.mm, worst.rad, per_kg, zeros)


def refuse_remainder(robot: Robot, format_: str) -> None:
    """Let a robot without a smooth remainder pass to a format that has no room for one.

    Raises:
        RefusedError: it has one.
    """
    if robot.remainder is not None:
        raise RefusedError(
            f"{robot.name} has a smooth remainder of {len(robot.remainder.centres)} centres, which {format_} cannot "
            "carry, and its other numbers hold only together with it: identify with 'remainder: none' to export, or "
            "compensate with symcal"
        )


def check_carries(robot: Robot, way: Way, approximate: bool = False) -> LeftOut | None:
    """Let a robot go into a file this way, or refuse it for a smooth remainder or joint terms that would be lost.

    Terms at nominal conditions are no reason to refuse.

    Args:
        approximate: whether it may go without them.
    Raises:
        RefusedError: it has a remainder, or terms would be lost and ``approximate`` is False.
    """
    refuse_remainder(robot, _NAMES[way])
    found = left_out(robot, way)
    if found is not None and CARRIES[way] == "none" and not approximate:
        raise RefusedError(
            f"{robot.name} has joint terms that {_NAMES[way]} cannot carry: {listed(found.terms)}. Without them the "
            f"tool is up to {_size(found.mm, found.rad)} off (searched). Export to c or json, which carry them, or say "
            "--approximate (in Python approximate=True) to write the robot without them"
        )
    return found


def _refitted(
    robot: Robot, bare: Robot, worst: Largest, symbols: tuple[SX, SX, SX], box: tuple[Array, Array]
) -> tuple[Robot, Largest, dict[str, float]]:
    """The robot without terms, with joint zeros that make up for them if that makes the largest distance smaller."""
    true, q, v = symbols
    shifts = _zeros(robot, bare)
    refitted = shifted(bare, shifts)
    after = largest_difference(true, _pose(refitted, q, {}), v, *box)
    if not after.mm < worst.mm:
        return bare, worst, {}
    return refitted, after, {j.name: float(s) for j, s in zip(robot.joints, shifts, strict=True) if s != 0}


def _zeros(robot: Robot, bare: Robot) -> Array:
    """Constant shifts of the joints that act at the tool as much like the terms as shifts can, shape (dof,), rad or mm.

    Least squares over random postures, 1 rad like 300 mm; the smallest shifts where several do.
    """
    rng = np.random.default_rng(0)
    postures = rng.uniform(*robot.ranges, (_REFIT, robot.dof))
    moved = moved_by_terms(robot, {name: p.value for name, p in robot.term_parameters.items()}, postures)
    _, slopes = slopes_of_zeros(bare, postures)
    return least_zeros(bare, slopes, np.einsum("nij,nj->ni", slopes, moved))


def _sides(terms: list[Term]) -> tuple[str, ...]:
    """The directions of approach that terms ask for."""
    return tuple(dict.fromkeys(name for term in terms for name in term.conditions if name != PAYLOAD))


def _pose(robot: Robot, q: SX, conditions: Mapping[str, SX]) -> SX:
    """T_base_tool under conditions by name, the others nominal; shape (4, 4)."""
    model = chain(robot, ParameterSet(()), conditions=True)
    given = [conditions.get(name, SX(0)) for name in robot.conditions]
    symbols, values = [model.q, model.frames], [q, SX(base_frames(robot))]
    if given:
        symbols, values = [*symbols, model.conditions], [*values, ca.vertcat(*given)]
    return ca.substitute([model.tool], symbols, values)[0]


def _size(mm: float, rad: float) -> str:
    return f"{mm:.3g} mm and {np.degrees(rad):.2g} deg"
