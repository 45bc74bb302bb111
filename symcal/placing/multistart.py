"""Where an instrument stands of which one reading gives no point: many starts, and how many of them agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from symcal.solvers.many import minimise_many
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
_SMALL, _NOTHING, _EVALUATIONS = 1e-6, 1e-12, 60
"""A fall of the sum of squares that ends a descent, as a share of it and in itself, mm^2; evaluations at most."""
_TIE = 1e-7
"""Weight that holds things to where they started, mm per scale of a parameter: nothing beside readings, and all there
is where these tell nothing. The heights of a wire's two ends, on an arm of upright axes, ran off to 6e14 mm without."""
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
    descents = _Descents(model, rows_of(model.measurement, data, setup, model.residuals), x, free)
    begin: list[Setup] = []
    tried: list[Array] = []  # rms and errors that each came to
    wanted, more = min(_ENOUGH, fewest // 2), min(fewest, _MOST)
    while more > 0:
        begin += [_somewhere(model, setup, free, reach, rng) if begin or i else setup for i in range(more)]
        tried.extend(descents.ends(begin[-more:]))
        best = min(left for left, *_ in tried)
        agreed = sum(left <= _SAME * best + 1e-12 for left, *_ in tried)
        more = min(wanted - agreed, _MOST - len(begin))  # fewer could not do
    # of places that the data do not tell apart, that which was said or guessed
    first = next(i for i, (left, *_) in enumerate(tried) if left <= _AS_GOOD * best + 1e-12)
    return Found(_moved(model, begin[first], free, tried[first][1:]), len(begin), int(agreed))


@dataclass(frozen=True, slots=True)
class _Descents:
    """From many starts at once to the least squares of what was read, lengths, angles and pixels by their weights.

    reference: errors of all parameters, shape (n,), but for the free ones, which start at zero.
    """

    model: Model
    rows: Rows
    reference: Array
    free: tuple[str, ...]

    def ends(self, begin: Sequence[Setup]) -> Array:
        """From each start the rms of what is left, infinite without finite numbers, and the free errors, (A, 1 + k).

        Rows are asked for one start after the other: that takes no code but what is compiled for every fit.
        """
        index, scales = self.model.parameters.indices(self.free), self.model.parameters.scales
        weight = self.model.measurement.per_unit(_WEIGHT)[None, :] * self.rows.seen
        counted = np.concatenate(
            [weight[poses, columns].ravel() for poses, columns, *_ in self.rows.read(self.reference)]
        )
        starts = [replace(self.rows, setup=each) for each in begin]

        def weighed(which: NDArray[np.intp], y: Array) -> Array:
            out = np.empty((len(y), len(counted) + len(index), len(index) + 1))
            of_readings, ties = out[:, : len(counted)], out[:, len(counted) :]
            ties[:, :, :-1], ties[:, :, -1] = _TIE * np.eye(len(index)), _TIE * y
            x = self.reference.copy()
            for own, i, at in zip(of_readings, which, y, strict=True):
                x[index] = at * scales[index]
                read = [(r, jacobian) for *_, r, jacobian in starts[i].read(x)]
                own[:, -1] = np.concatenate([r.ravel() for r, _ in read])
                np.concatenate([j.reshape(-1, j.shape[2])[:, index] for _, j in read], out=own[:, :-1])
            of_readings[:, :, :-1] *= scales[index]
            of_readings[:] = np.where(counted[:, None] > 0, of_readings * counted[:, None], 0.0)
            return out

        found = minimise_many(
            weighed,
            np.zeros((len(begin), len(index))),
            np.ones(len(index)),
            small=_SMALL,
            nothing=_NOTHING,
            evaluations=_EVALUATIONS,
        )
        r = weighed(np.arange(len(begin)), found.x)[:, : len(counted), -1]
        left = np.sqrt(np.sum(r**2, axis=1) / max(np.count_nonzero(counted), 1))
        left[~found.finite | ~np.isfinite(left)] = np.inf
        return np.column_stack([left, found.x * scales[index]])


def _moved(model: Model, begin: Setup, free: tuple[str, ...], x: Array) -> Setup:
    errors = dict(zip(free, x.tolist(), strict=True))
    moved = begin.moved(errors, model.measurement.points_called)
    return replace(moved, own={name: value + errors.get(name, 0.0) for name, value in begin.own.items()})


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
