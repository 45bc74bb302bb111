"""A serial robot as frozen data.

Conventions ([Ding2017] Table I is the first, [Craig2005] sec. 3.4 the second; beta after [Hayati1985]):
    standard (distal):   T_i = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)
    craig (proximal):    T_i = Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)
The joint variable adds to theta (revolute) or d (prismatic). A link lists only the parameters that its transform
contains.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.joints import Term, TermParameter
from symcal.joints.arm import Mass, Payload
from symcal.joints.remainder import Remainder
from symcal.notebook import html_table
from symcal.parameters import SCALE, Parameter, Unit, link_name
from symcal.robot.schema import LINK_PARAMETERS
from symcal.robot.schema import Convention as Convention
from symcal.robot.schema import Frame as Frame
from symcal.robot.schema import JointKind as JointKind
from symcal.robot.schema import is_angle as is_angle
from symcal.robot.terms import DOWN

Array = NDArray[np.float64]

_HALF_STROKE = 500.0  # mm: of a prismatic joint without limits


# The elementary motions of a link transform, in the order in which they multiply: (parameter, axis).
ELEMENTS: dict[Convention, tuple[tuple[str, int], ...]] = {
    "standard": (("theta", 2), ("d", 2), ("a", 0), ("alpha", 0), ("beta", 1)),
    "craig": (("alpha", 0), ("a", 0), ("beta", 1), ("theta", 2), ("d", 2)),
}


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint: q_model = sign * ratio * reading + offset.

    lower, upper: limits of the reading, rad or mm; infinite when the file gives none.
    speed: largest speed of the reading, rad/s or mm/s; None when not given.

    Example:
        >>> import symcal as sc
        >>> sc.Joint("revolute", "elbow", lower=-2.0, upper=2.0).revolute
        True
    """

    kind: JointKind
    name: str
    lower: float = -math.inf
    upper: float = math.inf
    sign: int = 1
    ratio: float = 1.0
    offset: float = 0.0
    speed: float | None = None

    def __post_init__(self) -> None:
        if not self.lower < self.upper or math.isfinite(self.lower) != math.isfinite(self.upper):
            message = "limits are two finite numbers, lower < upper, or both infinite"
            raise InputError(message, key=self.name, found=[self.lower, self.upper])

    @property
    def revolute(self) -> bool:
        return self.kind == "revolute"


@dataclass(frozen=True, slots=True)
class Link:
    """One joint and the link parameters that its transform contains (rad, mm).

    Example:
        >>> import symcal as sc
        >>> link = sc.Link(sc.Joint("revolute", "elbow"), {"theta": 0.0, "a": 250.0})
        >>> link.parameters["a"]
        250.0
    """

    joint: Joint
    parameters: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What an identification left in a calibrated robot, whose numbers are those after it.

    errors: identified minus nominal by parameter name, mm or rad; base and tool increments included.
    sigmas: standard deviation by name after the data, or None where the parameter was held.
    covariance: of all parameters in the order of ``errors``, shape (n, n); zero where a parameter was held.
    nominal_base, nominal_tool: the frames that the increments refer to.
    provenance: free facts (inputs, seed, versions, accuracy).
    """

    errors: Mapping[str, float]
    sigmas: Mapping[str, float | None]
    covariance: Array
    nominal_base: Array
    nominal_tool: Array
    provenance: Mapping[str, Any] = field(default_factory=dict)


def _identity() -> Array:
    return np.eye(4)


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial chain: T_world_tool(q) = base * T_1(q_1) ... T_n(q_n) * tool.

    base: T_world_base, tool: T_flange_tool; nominal, shape (4, 4), mm.
    scales: plausible size of an error by parameter name (mm, rad) where it is not the default.
    terms: what joints add to their readings. down: direction of gravity in base. masses, payload: what gravity pulls
        at, as far as it is known. remainder: how the flange is displaced beyond all that.

    Example:
        >>> import symcal as sc
        >>> links = [sc.Link(sc.Joint("revolute", name), {"theta": 0.0, "a": 250.0}) for name in ("upper", "lower")]
        >>> robot = sc.Robot("planar", "standard", tuple(links))
        >>> robot.dof, robot.reach
        (2, 500.0)
    """

    name: str
    convention: Convention
    links: tuple[Link, ...]
    base: Array = field(default_factory=_identity)
    tool: Array = field(default_factory=_identity)
    scales: Mapping[str, float] = field(default_factory=dict)
    record: Record | None = None
    terms: tuple[Term, ...] = ()
    down: tuple[float, float, float] = DOWN
    masses: tuple[Mass, ...] = ()
    payload: Payload = field(default_factory=Payload)
    remainder: Remainder | None = None

    @property
    def dof(self) -> int:
        return len(self.links)

    def _repr_html_(self) -> str:
        """Joints and link parameters, in deg and mm, and what the arm looks like."""
        from symcal.kinematics.picture import robot_sketch

        kinds = [kind for kind in LINK_PARAMETERS if any(kind in link.parameters for link in self.links)]
        head = ["link", "joint", "kind", "limits", *(f"{kind} {'deg' if is_angle(kind) else 'mm'}" for kind in kinds)]
        rows = []
        for i, link in enumerate(self.links, start=1):
            unit = math.degrees(1.0) if link.joint.revolute else 1.0
            limits = f"{link.joint.lower * unit:g} to {link.joint.upper * unit:g} {'deg' if unit != 1 else 'mm'}"
            given = [
                f"{math.degrees(value) if is_angle(kind) else value:.6g}" if value is not None else ""
                for kind, value in ((kind, link.parameters.get(kind)) for kind in kinds)
            ]
            rows.append([str(i), link.joint.name, link.joint.kind, limits, *given])
        state = "nominal" if self.record is None else "calibrated"
        terms = [f"joint terms: {', '.join(sorted({term.kind for term in self.terms}))}"] if self.terms else []
        return html_table(f"{self.name}: {self.convention} convention, {state}", head, rows, terms, robot_sketch(self))

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(link.joint for link in self.links)

    @property
    def lower(self) -> Array:
        """Lower limits of the readings, shape (n,), rad or mm."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> Array:
        """Upper limits of the readings, shape (n,), rad or mm."""
        return np.array([joint.upper for joint in self.joints])

    @property
    def ranges(self) -> tuple[Array, Array]:
        """Lower and upper readings between which postures stand for all, shape (n,) each: the limits, and for joints
        without them a turn, or a metre, about zero."""
        half = np.array([np.pi if joint.revolute else _HALF_STROKE for joint in self.joints])
        limited = np.isfinite(self.upper - self.lower)
        return np.where(limited, self.lower, -half), np.where(limited, self.upper, half)

    @property
    def conditions(self) -> tuple[str, ...]:
        """What of a pose the terms depend on beside joint readings; zero is nominal."""
        return tuple(dict.fromkeys(name for term in self.terms for name in term.conditions))

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Parameters of links and joint terms by name, in the order of the parameter vector."""
        return self.link_parameters | {name: p.value for name, p in self.term_parameters.items()}

    @cached_property
    def term_parameters(self) -> dict[str, TermParameter]:
        """Numbers of joint terms by name (`q2_sin_1`, ...)."""
        return {p.name: p for term in self.terms for p in term.parameters}

    @cached_property
    def described(self) -> tuple[Parameter, ...]:
        """`parameters` with unit and plausible size."""
        links = [(name, _unit(name), value) for name, value in self.link_parameters.items()]
        items = [Parameter(name, unit, value, self.scales.get(name, SCALE[unit])) for name, unit, value in links]
        return *items, *(
            Parameter(p.name, p.unit, p.value, self.scales.get(p.name, p.scale), group=p.group)
            for p in self.term_parameters.values()
        )

    @cached_property
    def link_parameters(self) -> dict[str, float]:
        """Link parameters by name (`theta_1`, ...), by kind and then by link."""
        return {
            link_name(kind, i): link.parameters[kind]
            for kind in LINK_PARAMETERS
            for i, link in enumerate(self.links, start=1)
            if kind in link.parameters
        }

    @property
    def reach(self) -> float:
        """An upper bound of the arm's extent in mm without joint terms: links, finite prismatic travel and the tool."""
        lengths = sum(
            abs(v) for name, v in self.link_parameters.items() if name[0] in "ad" and not name.startswith("alpha")
        )
        travel = sum(
            max((abs(j.sign * j.ratio * q + j.offset) for q in (j.lower, j.upper) if math.isfinite(q)), default=0.0)
            for j in self.joints
            if not j.revolute
        )
        return float(lengths + travel + np.linalg.norm(self.tool[:3, 3]))

    def length(self, q: Array) -> float:
        """Links, and strokes over joint readings (N, dof), mm."""
        lengths = [abs(v) for link in self.links for kind, v in link.parameters.items() if kind in ("a", "d")]
        strokes = [float(np.ptp(q[:, i])) for i, joint in enumerate(self.joints) if not joint.revolute]
        return float(sum(lengths) + sum(strokes))

    def length_with_tool(self, q: Array) -> float:
        """`length` and how far the tool is from the flange, mm."""
        return float(self.length(q) + np.linalg.norm(self.tool[:3, 3]))

    def corrected(self, errors: Mapping[str, float]) -> Robot:
        """The robot with errors (mm, rad) added to its parameters; names that it lacks are a KeyError."""
        known = self.parameters
        for name in errors:
            if name not in known:
                raise KeyError(name)
        links = tuple(
            replace(link, parameters={k: v + errors.get(link_name(k, i), 0.0) for k, v in link.parameters.items()})
            for i, link in enumerate(self.links, start=1)
        )
        return replace(self, links=links, terms=tuple(term.corrected(errors) for term in self.terms))

    def nominal(self) -> Robot:
        """The robot before its calibration, without a remainder: no controller has one; itself if it was never
        calibrated."""
        if self.record is None:
            return self
        errors = {name: -value for name, value in self.record.errors.items() if name in self.parameters}
        return replace(
            self.corrected(errors),
            base=self.record.nominal_base,
            tool=self.record.nominal_tool,
            record=None,
            remainder=None,
        )


def _unit(link_parameter: str) -> Unit:
    return "rad" if is_angle(link_parameter.rpartition("_")[0]) else "mm"
