"""Where an instrument stands of which one reading gives no point: many starts, and how many of them agree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.fit.residual_rows import Rows, rows_of
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.parameters import FRAME_AXES
from symcal.placing.registration import LEVER
from symcal.solvers import SOLVERS
from symcal.solvers.least_squares import Problem, Tolerances
from symcal.spatial import transform

Array = NDArray[np.float64]

_MOST = 60
STARTS = 16
"""At least: so many that a basin of a third of all starts is missed once in a thousand times."""
_ENOUGH = 4  # starts that agree on the best place before the search ends
_POSES = 80  # that judge a start
_AROUND = 1.5  # robot's lengths: how far from the base instruments stand at most
_ON_ROBOT = 150.0  # mm: spread of things on the robot about the middle of where they are
_AS_GOOD = 1.0001  # ratio of two rms that the data cannot tell apart
_SAME = 1.05  # ratio of two rms that count as the same place
_COARSE = Tolerances(gradient=1e-8, cost=1e-6, step=1e-8, iterations=60)
_WEIGHT: Mapping[str, float] = {"mm": 1.0, "rad": LEVER, "px": 1.0, "1": 1.0}


@dataclass(frozen=True, slots=True)
class Found:
    """The best of many starts. agreed: how many of ``starts`` came to it."""

    setup: Setup
    starts: int
    agreed: int


def search(
    model: Model,
    data: Dataset,
    setup: Setup,
    x: Array,
    free: tuple[str, ...],
    reach: float,
    rng: np.random.Generator,
    fewest: int = STARTS,
) -> Found:
    """The least sum of squares over many starts of the free parameters, all else as it is.

    Args:
        data: what the instruments in question have read. x: errors of all parameters, shape (n,).
        free: names of frames, points and numbers to be placed. reach: of the robot, mm. fewest: starts, at least.
    """
    if len(data) > _POSES:
        data = data.take(np.linspace(0, len(data) - 1, _POSES).astype(int))
    rows = rows_of(model.measurement, data, setup, model.residuals)
    weight = model.measurement.per_unit(_WEIGHT)[None, :] * rows.seen
    tried: list[tuple[float, Setup]] = []
    agreed, starts = 0, 0
    for starts in range(1, _MOST + 1):
        begin = setup if starts == 1 else _somewhere(model, setup, free, reach, rng)
        cost, found = _descend(model, replace(rows, setup=begin), x, weight, free)
        tried.append((cost, found))
        best = min(cost for cost, _ in tried)
        agreed = sum(cost <= _SAME * best + 1e-12 for cost, _ in tried)
        if starts >= fewest and agreed >= min(_ENOUGH, fewest // 2):
            break
    best = min(cost for cost, _ in tried)
    # of places that the data do not tell apart, that which was said or guessed
    return Found(next(found for cost, found in tried if cost <= _AS_GOOD * best + 1e-12), starts, agreed)


def _descend(model: Model, rows: Rows, reference: Array, weight: Array, free: tuple[str, ...]) -> tuple[float, Setup]:
    index, scales = model.parameters.indices(free), model.parameters.scales

    def at(y: Array) -> Array:
        x = reference.copy()
        x[index] = y * scales[index]
        return x

    def evaluate(y: Array) -> tuple[Array, Array]:
        r, jacobian = rows(at(y))
        flat = (jacobian[:, :, index] * weight[:, :, None]).reshape(-1, len(index))
        return (r * weight).ravel(), flat * scales[index]

    problem = Problem(evaluate, np.zeros(len(free)), np.ones(len(free)))
    if not np.isfinite(evaluate(problem.start)[0]).all():
        return np.inf, rows.setup
    x = at(SOLVERS["levenberg_marquardt"](problem, _COARSE).x)
    count = max(int((weight > 0).sum()), 1)
    left = float(np.sqrt(np.sum((rows(x)[0] * weight) ** 2) / count))
    errors = {name: float(x[i]) for name, i in zip(free, index, strict=True)}
    moved = rows.setup.moved(errors, model.measurement.points_called)
    own = {name: value + errors.get(name, 0.0) for name, value in rows.setup.own.items()}
    return (left if np.isfinite(left) else np.inf), replace(moved, own=own)


def _somewhere(model: Model, setup: Setup, free: tuple[str, ...], reach: float, rng: np.random.Generator) -> Setup:
    """Frames and points anywhere around the robot, or near where they are on it; numbers as they are."""
    on_robot = {
        name: place.moves
        for o in model.task.observations
        for name, place in ((o.place, o.at), (o.target.name, o.target.at))
    }

    def frame(name: str, nominal: Array, moves: bool) -> Array:
        axes = [axis for axis in FRAME_AXES if f"{name}_{axis}" in free]
        if not axes:
            return nominal
        turned = any(axis.startswith("r") for axis in axes)
        turn = scipy.spatial.transform.Rotation.random(rng=rng).as_matrix() if turned else nominal[:3, :3]
        size = _ON_ROBOT if moves else _AROUND * reach
        shift = rng.uniform(-size, size, 3) * [axis in axes for axis in "xyz"]
        return transform(turn, nominal[:3, 3] + shift)

    called = model.measurement.points_called
    points = setup.points.copy()
    for k, name in enumerate(called):
        if f"{name}_x" in free:
            points[k] = rng.uniform(-_ON_ROBOT, _ON_ROBOT, 3)
    return replace(
        setup,
        base=frame("base", setup.base, False),
        tool=frame("tool", setup.tool, True),
        points=points,
        places={name: frame(name, place, on_robot[name]) for name, place in setup.places.items()},
    )
