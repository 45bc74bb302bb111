"""Postures that touch: joint readings moved onto constraints by Newton's method with the joint Jacobian.

    q <- q - W G^T (G W G^T)^-1 (c(q) - n),      G = dc/dq,   W diagonal, of the joints that may move

the least change of the joints (a length counts as a turn about `_LEVER`) that meets the constraint to first order. A
joint at its limit is left there. n is where the ball really is: noise moves the place.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.kernels import BatchFunction, batch_function
from symcal.model.assembled import margins_kernel
from symcal.model.measurement import Measurement, Part, Setup
from symcal.model.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOUCHING = 1e-6
"""mm: postures nearer than this to a constraint touch it. Newton's method ends a thousand times nearer."""

_MET = 1e-9
_STEPS = 60
_LONGEST = 0.3  # rad: longest step of a joint
_LEVER = 300.0  # mm
_DRAWS = 400  # random postures tried per wanted one
_HOPELESS = 4000  # random postures of which none can touch


def constraints(measurement: Measurement) -> tuple[Part, ...]:
    """The observations that a posture must lie on."""
    return tuple(part for part in measurement.parts if part.contact is not None)


def touched(measurement: Measurement, setup: Setup, q: Array) -> Mask:
    """Which constraints each posture nominally touches, shape (N, number of constraints)."""
    out = np.zeros((len(q), len(constraints(measurement))), dtype=np.bool_)
    x = np.zeros(len(measurement.parameters))
    for i, part in enumerate(constraints(measurement)):
        assert part.contact is not None
        (c, *_) = batch_function(part.contact, evaluations=0)(q, x, setup.vector)
        out[:, i] = np.linalg.norm(c.reshape(len(q), -1), axis=1) < TOUCHING
    return out


def touched_names(measurement: Measurement, setup: Setup, q: Array) -> tuple[str, ...]:
    """What each posture nominally touches, by name; empty for a free one."""
    names = [part.observation.name for part in constraints(measurement)]
    return tuple(
        " ".join(n for n, own in zip(names, row, strict=True) if own) for row in touched(measurement, setup, q)
    )


def projected(
    model: Model,
    part: Part,
    q: Array,
    x: Array,
    lower: Array,
    upper: Array,
    shift: Array | None = None,
    kernel: BatchFunction | None = None,
) -> tuple[Array, Mask]:
    """Postures moved onto a constraint, shape (N, dof), and which of them came to lie on it within the limits, (N,).

    Args:
        q: where to begin, shape (N, dof). x: errors of all parameters. shift: where the ball is from its place, in the
            constraint's own components, shape (N, m), mm; there when None. kernel: made before, see `_kernel`.
    """
    kernel = kernel or _kernel(part, len(q))
    revolute = np.array([joint.revolute for joint in model.robot.joints])
    weight = np.where(revolute, 1.0, _LEVER**2)
    longest = np.where(revolute, _LONGEST, _LONGEST * _LEVER)
    q = np.clip(q, lower, upper)
    met = np.zeros(len(q), dtype=np.bool_)
    for _ in range(_STEPS):
        open_ = np.flatnonzero(~met)
        if not len(open_):
            break
        c, slope, _ = kernel(q[open_], x, model.setup.vector)
        c = c.reshape(len(open_), -1) - (0.0 if shift is None else shift[open_])
        slope = slope.reshape(len(open_), c.shape[1], -1)
        near = np.linalg.norm(c, axis=1) < _MET
        met[open_[near]] = True
        moving = open_[~near]
        if len(moving):
            q[moving] = _moved(q[moving], c[~near], slope[~near], weight, longest, lower, upper)
    return q, met


def _kernel(part: Part, postures: int) -> BatchFunction:
    """A constraint and its slopes, for so many postures at a time; whoever moves several lots makes it once."""
    assert part.contact is not None
    return batch_function(part.contact, evaluations=_STEPS * postures)


def _moved(q: Array, c: Array, slope: Array, weight: Array, longest: Array, lower: Array, upper: Array) -> Array:
    """One step; of joints that it would take beyond their limits without them."""
    free = np.ones_like(q)
    step = np.zeros_like(q)
    for _ in range(q.shape[1]):
        w = weight * free
        normal = np.einsum("nij,nj,nkj->nik", slope, w, slope)
        normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(c.shape[1]) + 1e-300
        step = -w * np.einsum("nij,ni->nj", slope, np.linalg.solve(normal, c[:, :, None])[:, :, 0])
        step /= np.maximum((np.abs(step) / longest).max(axis=1), 1.0)[:, None]
        stuck = ((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0))
        if not stuck.any():
            break
        free = np.where(stuck, 0.0, free)
    return np.clip(q + step * free, lower, upper)


def contact_postures(
    model: Model,
    count: int,
    draw: Callable[[int], Array],
    limits: tuple[Array, Array],
    feasible: Callable[[Array], Mask] | None = None,
) -> Array:
    """Postures that touch the nominal constraints in turn, and free ones where something else reads too; (count, dof).

    Args:
        draw: random postures to begin from, by their number. limits: lower and upper joint readings. feasible: which
            postures can be measured.
    Raises:
        RefusedError: hardly any posture can touch one of them.
    """
    parts = constraints(model.measurement)
    turns: list[Part | None] = [*parts, *([None] if len(parts) < len(model.measurement.parts) else [])]
    out = np.empty((count, model.robot.dof))
    for turn, part in enumerate(turns):
        wanted = len(range(turn, count, len(turns)))
        out[turn :: len(turns)] = _postures(model, part, wanted, draw, limits, feasible)
    return out


def _postures(
    model: Model,
    part: Part | None,
    wanted: int,
    draw: Callable[[int], Array],
    limits: tuple[Array, Array],
    feasible: Callable[[Array], Mask] | None,
) -> Array:
    nominal = np.zeros(len(model.parameters))
    kept: list[Array] = []
    have = tried = 0
    at_once = 2 * wanted + 50
    kernel = None if part is None else _kernel(part, at_once)
    while have < wanted:
        if tried >= _DRAWS * max(wanted, 20) or (not have and tried >= _HOPELESS):
            name = "the free postures" if part is None else f"'{part.observation.name}'"
            raise RefusedError(
                f"only {have} of {tried} random postures can touch {name} within the joint limits and what the plan "
                f"asks for, and {wanted} are needed: is its place ('near') right and within reach, and does the tool "
                "point the right way?"
            )
        q = draw(at_once)
        tried += len(q)
        if part is not None:
            q, met = projected(model, part, q, nominal, *limits, kernel=kernel)
            q = q[met]
            q = q[upright(model, part, q)]
        if feasible is not None and len(q):
            q = q[feasible(q)]
        kept.append(q)
        have += len(q)
    return np.concatenate([*kept, np.zeros((0, model.robot.dof))])[:wanted]


def upright(model: Model, part: Part, q: Array) -> Mask:
    """Which postures keep a constraint's own limits, such as its tilt, shape (N,)."""
    margins = margins_kernel(part, 0)
    if margins is None or not len(q):
        return np.ones(len(q), dtype=np.bool_)
    return np.asarray((margins(q, np.zeros(len(model.parameters)), model.setup.vector) > 0).all(axis=(1, 2)))
