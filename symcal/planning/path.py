"""From pose to pose: straight lines of the tool where the arm can follow them, joint motion elsewhere.

A line's waypoint at share s solves p(q) = p_a + s (p_b - p_a) by damped Newton steps of least norm (in shares of joint
travel) from the reference q_a + s (q_b - q_a). At both ends the reference itself is the solution, so the arm arrives in
the very pose that is to be measured; in between, the freedom that a line leaves (orientation, redundancy) follows the
joint motion. Steps respect the joint limits: a joint at its limit takes no part in steps that lead outside. Between
waypoints the joints move linearly; the waypoints are so dense that the tool stays within ``straightness`` of the line
there too, which also shows every jump between branches of the solution.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.planning.constraints import Constraint, complaints, feasible
from symcal.planning.ordering import Tour, joint_time
from symcal.planning.skeleton import Skeleton

Array = NDArray[np.float64]
Kind = Literal["line", "joint"]

STRAIGHTNESS = 0.01
"""Largest distance of the tool from its line, mm."""

_RESIDUAL = 1e-7  # mm, of the tool at a waypoint
_STEPS = 60  # Newton converges in 4 to 8; more only where a joint creeps along its limit
_LONGEST_STEP = 0.2  # of a joint's travel, per Newton step
_FIRST = 16  # pieces of a line that are tried first
_MOST = 4096
_TOGETHER = 8192  # pieces of lines that are solved at once
_SAMPLES = 100  # of a joint motion over a joint's whole travel, for checking it


@dataclass(frozen=True, slots=True)
class Segment:
    """The way to one pose.

    kind: `line`: the tool moves straight; `joint`: all joints move linearly in time. why: why it is no line; empty if
        it is.
    waypoints: joint readings from the pose before to this one, shape (K, dof), rad and mm; linear in between.
    times: since the beginning of the segment, shape (K,), s, at the full speed of the slowest joint.
    """

    kind: Kind
    waypoints: Array
    times: Array
    why: str = ""

    @property
    def time(self) -> float:
        return float(self.times[-1])


@dataclass(frozen=True, slots=True)
class Path:
    """A plan as a motion: the segment i leads to the pose order[i].

    conflicts: sentences about segments that break constraints on the way whichever way they are driven; the plan needs
    another pose in between there.
    """

    order: NDArray[np.intp]
    segments: tuple[Segment, ...]
    conflicts: tuple[str, ...]

    @property
    def total_time(self) -> float:
        """s, of motion alone."""
        return sum(segment.time for segment in self.segments)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        return tuple(segment.kind for segment in self.segments)


def plan_path(
    arm: Skeleton,
    poses: Array,
    tour: Tour,
    start: Array,
    speeds: Array,
    limits: tuple[Array, Array],
    *,
    constraints: Sequence[Constraint] = (),
    straightness: float = STRAIGHTNESS,
) -> Path:
    """Join the poses of a plan in the order of a tour.

    Args:
        poses: shape (N, dof). start: shape (dof,). speeds: see `joint_speeds`. limits: lower and upper, shape (dof,)
            each.
        constraints: what must hold on the way, such as `clearance`; not what only a measurement needs.
    """
    order = tour.order
    nodes = np.vstack([start, poses[order]])
    names = ["the start", *(f"pose {i + 1}" for i in order)]
    segments, conflicts = [], []
    allowed = feasible(constraints)
    lines = follow_lines(arm, nodes[:-1], nodes[1:], limits, straightness)
    for line, (a, b), (source, goal) in zip(lines, itertools.pairwise(nodes), itertools.pairwise(names), strict=True):
        why = line if isinstance(line, str) else ""
        if not isinstance(line, str) and constraints and not allowed(line).all():
            why = "the line breaks " + _broken(constraints, line)
        if not isinstance(line, str) and not why:
            segments.append(_timed("line", line, speeds))
            continue
        motion = joint_motion(a, b, limits)
        if constraints and not allowed(motion).all():
            conflicts.append(f"the way from {source} to {goal} breaks {_broken(constraints, motion)}")
        segments.append(_timed("joint", motion, speeds, why))
    return Path(order, tuple(segments), tuple(conflicts))


def _broken(constraints: Sequence[Constraint], waypoints: Array) -> str:
    named = [c for c in constraints if complaints([c], waypoints)]
    return ", ".join(f"'{c.name}' by {c.amount(float(np.nanmax(c.violation(waypoints))))}" for c in named)


def _timed(kind: Kind, waypoints: Array, speeds: Array, why: str = "") -> Segment:
    steps = joint_time(waypoints[:-1], waypoints[1:], speeds)
    return Segment(kind, waypoints, np.concatenate([[0.0], np.cumsum(steps)]), why)


def joint_motion(a: Array, b: Array, limits: tuple[Array, Array]) -> Array:
    """Waypoints of a linear motion of all joints from a to b, shape (K, dof), dense enough to check constraints on
    it."""
    pieces = max(1, int(np.ceil(_SAMPLES * np.max(np.abs(b - a) / _travel(limits)))))
    return np.asarray(a + np.linspace(0.0, 1.0, pieces + 1)[:, None] * (b - a))


def follow_line(
    arm: Skeleton, a: Array, b: Array, limits: tuple[Array, Array], straightness: float = STRAIGHTNESS
) -> Array | str:
    """Waypoints, shape (K, dof), on which the tool moves straight from pose a to pose b; or why the arm cannot do
    that."""
    return follow_lines(arm, a[None], b[None], limits, straightness)[0]


def follow_lines(
    arm: Skeleton, a: Array, b: Array, limits: tuple[Array, Array], straightness: float = STRAIGHTNESS
) -> list[Array | str]:
    """`follow_line` for many pairs of poses, shape (S, dof) each: all lines of the same number of pieces at once."""
    found: list[Array | str] = ["the line comes too near to a singular configuration"] * len(a)
    ends = np.stack([arm.motion(a)[0], arm.motion(b)[0]], axis=1)
    open_, pieces, before = np.arange(len(a)), _FIRST, np.full(len(a), np.inf)
    while pieces <= _MOST and len(open_):
        rest = []
        for some in np.array_split(open_, -(-len(open_) * pieces // _TOGETHER)):
            share = np.linspace(0.0, 1.0, pieces + 1)[:, None]
            goals = ends[some, :1] + share * (ends[some, 1:] - ends[some, :1])
            q, residual = _solve(arm, a[some, None] + share * (b - a)[some, None], goals, limits)
            middle = _motion(arm, 0.5 * (q[:, :-1] + q[:, 1:]))[0]
            for line, i in enumerate(some):
                deviation = float(_off_line(middle[line], ends[i]).max())
                if residual[line].max() > _RESIDUAL:
                    found[i] = "the line leaves what the arm can reach within its limits"
                elif deviation <= straightness:
                    found[i] = q[line]
                elif deviation > 0.6 * before[i]:
                    # falls by four with every halving of the steps, unless the solution jumps
                    found[i] = "the arm would have to change its configuration on the line"
                else:
                    before[i] = deviation
                    rest.append(i)
        open_, pieces = np.array(rest, dtype=np.intp), 2 * pieces
    return found


def _off_line(points: Array, ends: Array) -> Array:
    """Distance, mm, of points (K, 3) from the straight piece between two ends (2, 3)."""
    along = ends[1] - ends[0]
    length = float(along @ along)
    share = np.clip((points - ends[0]) @ along / length, 0.0, 1.0) if length > 0 else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - ends[0] - share[:, None] * along, axis=1))


def _motion(arm: Skeleton, q: Array) -> tuple[Array, Array]:
    """`Skeleton.motion` of lines, (S, K, dof)."""
    position, jacobian = arm.motion(q.reshape(-1, q.shape[-1]))
    return position.reshape(*q.shape[:2], 3), jacobian.reshape(*q.shape[:2], 3, -1)


def _travel(limits: tuple[Array, Array]) -> Array:
    """Travel of every joint; a turn for one without limits."""
    span = limits[1] - limits[0]
    return np.where(np.isfinite(span) & (span > 0), span, 2 * np.pi)


def _solve(arm: Skeleton, reference: Array, goals: Array, limits: tuple[Array, Array]) -> tuple[Array, Array]:
    """Joint readings of lines, (S, K, dof), near a reference that put the tool at goals (S, K, 3), and how far it still
    is from them, (S, K), mm; a line is left as it is once all of it is there."""
    travel = _travel(limits)
    q = np.clip(reference, *limits)
    position, jacobian = _motion(arm, q)
    for _ in range(_STEPS):
        miss = goals - position
        on = np.flatnonzero(np.linalg.norm(miss, axis=2).max(axis=1) > 1e-2 * _RESIDUAL)
        if not len(on):
            break
        shape = (len(on), *q.shape[1:])
        here, slopes, missed = (part[on].reshape(-1, *part.shape[2:]) for part in (q, jacobian, miss))
        step = _limited_step(here, slopes, missed, travel, limits)
        step /= np.maximum(np.max(np.abs(step) / travel, axis=1, keepdims=True) / _LONGEST_STEP, 1.0)
        q[on] = np.clip(here + step, *limits).reshape(shape)
        position[on], jacobian[on] = _motion(arm, q[on])
    return q, np.linalg.norm(goals - position, axis=2)


def _limited_step(q: Array, jacobian: Array, miss: Array, travel: Array, limits: tuple[Array, Array]) -> Array:
    """The damped least-norm step without the joints that sit at a limit and would leave it, shape (K, dof)."""
    free = np.ones_like(q)
    # vanishes with the miss, so that convergence stays quadratic; the second term keeps a singular arm solvable
    damping = 1e-2 * np.sum(miss**2, axis=1)
    step = np.zeros_like(q)
    for _ in range(q.shape[1]):
        weight = free * travel**2
        gram = (jacobian * weight[:, None, :]) @ jacobian.swapaxes(1, 2)
        shift = damping + 1e-12 * np.trace(gram, axis1=1, axis2=2) + 1e-12
        y = np.linalg.solve(gram + shift[:, None, None] * np.eye(3), miss[:, :, None])
        step = weight * np.squeeze(jacobian.swapaxes(1, 2) @ y, axis=2)
        outward = ((q <= limits[0]) & (step < 0)) | ((q >= limits[1]) & (step > 0))
        if not outward.any():
            break
        free = np.where(outward, 0.0, free)
    return step
