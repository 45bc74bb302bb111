"""How far apart two estimates predict the tool to be, over some postures, and how far their law lets expect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.calibration.evaluate import without_rigid_motion
from symcal.fit.difference import Difference, Tested, at_least_one
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.placing.registration import rigid_fit
from symcal.spatial import matrix_vectors, mean_rotation

Array = NDArray[np.float64]

LEVEL = 0.01
"""Probability below which two estimates differ by more than is stated: of good data one set in a hundred does."""
POSTURES = 1000
"""At which predictions are compared."""
WITHIN = 0.95
"""Of differences at one posture, those that are within the bounds by which postures are counted."""
_MOST = 8  # points of a target that stand for all of it
_FLAT = 1e-8  # of the largest variance at a posture: none


@dataclass(frozen=True, slots=True)
class Compared:
    """What two estimates say.

    tested: T and its law. difference, predicted: rms over postures and points of the difference of what they predict of
    the tool's position, and what the law lets expect, mm. turn, turn_predicted: the same of its orientation, rad; None
    where no instrument reads it.
    """

    tested: Tested
    difference: float
    predicted: float
    turn: float | None = None
    turn_predicted: float | None = None

    @property
    def ratio(self) -> float:
        """Difference over what is to be expected, of position or orientation, whichever is more."""
        turned = 0.0 if self.turn is None or self.turn_predicted is None else self.turn / self.turn_predicted
        return max(self.difference / self.predicted, turned)


@dataclass(frozen=True, slots=True)
class Apart:
    """Two estimates compared posture by posture; made by `Region.apart`.

    at: where the tool (the middle of its points) is in base, shape (K, 3), mm. apart, sigma: rms over its points of the
    difference, and what is to be expected of that, shape (K,), mm. within: share of postures at which the difference is
    within bounds that `WITHIN` of all are in.
    """

    compared: Compared
    at: Array
    apart: Array
    sigma: Array
    within: float


@dataclass(frozen=True, slots=True)
class Region:
    """Predictions of the tool at K postures, linearised at an estimate by n free parameters y = x / S.

    q: (K, dof). index, scales: of the free parameters, shape (n,). at: the tool's points, shape (K, k, 3), mm. slopes:
    of them, shape (K, 3 k, n), mm; turns: of its orientation, shape (K, 3, n), rad, None where no instrument reads it.
    aligned: predictions are meant after one rigid alignment of all postures.
    """

    model: Model
    setup: Setup
    q: Array
    index: NDArray[np.intp]
    scales: Array
    at: Array
    slopes: Array
    turns: Array | None
    aligned: bool

    def squares(self) -> tuple[Array, Array | None]:
        """Mean squares over postures (and points) of what a step y changes, as forms (n, n), mm^2 and rad^2."""
        flat = self.slopes.reshape(-1, self.slopes.shape[2])
        position = flat.T @ flat / (len(flat) / 3)
        if self.turns is None:
            return position, None
        turned = self.turns.reshape(-1, self.turns.shape[2])
        return position, turned.T @ turned / len(self.turns)

    def to_first_order(self, law: Difference, step: Array) -> Compared | None:
        """What a difference y_1 - y_2, shape (n,), says.

        Position and orientation count alike in T, each over what is to be expected of it.

        Returns:
            None where nothing can be told from it.
        """
        position, turned = self.squares()
        expected = float(np.sum(position * law.covariance))
        if expected <= 0:
            return None
        metric, rms = position / expected, _root(step, position)
        turn = turn_expected = None
        if turned is not None:
            turn_expected = float(np.sum(turned * law.covariance))
            if turn_expected <= 0:
                return None
            metric, turn = metric + turned / turn_expected, _root(step, turned)
        tested = law.tested(step, metric)
        if tested is None:
            return None
        root = None if turn_expected is None else float(np.sqrt(turn_expected))
        return Compared(tested, rms, float(np.sqrt(expected)), turn, root)

    def apart(self, law: Difference, first: Array, second: Array) -> Apart | None:
        """Two estimates x of all parameters, shape (p,) each, in rad and mm; the figures are those of the whole model,
        T is of their difference to first order.

        Returns:
            None where nothing can be told from their difference.
        """
        compared = self.to_first_order(law, (first - second)[self.index] / self.scales)
        if compared is None:
            return None
        points, turns = self._predicted(first, second)
        here = np.einsum("kin,nm,kjm->kij", self.slopes, law.covariance, self.slopes, optimize=True)
        sizes, axes = np.linalg.eigh(here)
        told = sizes > _FLAT * sizes[:, -1:]
        along = np.einsum("kij,ki->kj", axes, points.reshape(len(points), -1))
        squares = np.sum(np.where(told, along**2 / np.where(told, sizes, 1.0), 0.0), axis=1)
        count = points.shape[1]
        return Apart(
            Compared(
                compared.tested,
                float(np.sqrt(np.mean(np.sum(points**2, axis=2)))),
                compared.predicted,
                None if turns is None else float(np.sqrt(np.mean(np.sum(turns**2, axis=1)))),
                compared.turn_predicted,
            ),
            self._in_base(first, second),
            np.sqrt(np.sum(points**2, axis=(1, 2)) / count),
            np.sqrt(np.maximum(np.trace(here, axis1=1, axis2=2), 0.0) / count),
            float(np.mean(squares <= scipy.special.chdtri(np.maximum(told.sum(axis=1), 1), 1 - WITHIN))),
        )

    def _in_base(self, first: Array, second: Array) -> Array:
        base = self.model.moved(self.setup, (first + second) / 2).base
        return np.asarray((self.at.mean(axis=1) - base[:3, 3]) @ base[:3, :3])

    def _predicted(self, first: Array, second: Array) -> tuple[Array, Array | None]:
        """What two estimates predict differently: points, shape (K, k, 3), mm, and rotation vectors, (K, 3), rad."""
        where = [_some(self.model.points(self.q, x, self.setup.vector)[0]) for x in (first, second)]
        if self.aligned:
            moved = rigid_fit(where[1].reshape(-1, 3), where[0].reshape(-1, 3))
            where[1] = where[1] @ moved[:3, :3].T + moved[:3, 3]
        points = np.asarray(where[0] - where[1])
        if self.turns is None:
            return points, None
        frames = [self.model.flange(self.q, x, self.setup.vector[:24])[0][:, :3, :3] for x in (first, second)]
        turns = frames[0] @ frames[1].swapaxes(-1, -2)
        if self.aligned:
            turns = turns @ mean_rotation(turns).T
        return points, matrix_vectors(turns)


def disagree(compared: Compared, count: int) -> bool:
    """Whether two estimates differ by more than is stated, and not by chance, as the least probable of so many."""
    return compared.ratio > 1 and at_least_one(compared.tested.p, count) < LEVEL


def _root(step: Array, form: Array) -> float:
    return float(np.sqrt(max(float(step @ form @ step), 0.0)))


def _some(flat: Array) -> Array:
    """Of rows by point, shape (K, 3 k, ...), those of a few points that stand for all, shape (K, k', 3, ...)."""
    points = flat.reshape(len(flat), -1, 3, *flat.shape[2:])
    count = points.shape[1]
    return points[:, np.unique(np.linspace(0, count - 1, min(count, _MOST)).astype(int))]


def region_of(model: Model, setup: Setup, x: Array, free: tuple[str, ...], q: Array, *, moved: bool = False) -> Region:
    """Predictions at postures q, shape (K, dof), around an estimate x, shape (p,).

    Where only the instruments say where the world is, they are meant after one rigid alignment of all postures.

    Args:
        moved: the robot may stand elsewhere in world for one of the estimates: the same.
    """
    index = model.parameters.indices(free)
    scales = model.parameters.scales[index]
    flat, jacobian = model.points(q, x, setup.vector)
    at = _some(flat)
    slopes = _some(jacobian[:, :, index]).reshape(len(q), -1, len(index)) * scales
    turns = None
    if any(part.attitudes.stop > part.attitudes.start for part in model.measurement.parts):
        turns = model.flange(q, x, setup.vector[:24])[2][:, 3:, index] * scales
    aligned = moved or model.measurement.adrift
    if aligned:
        slopes = without_rigid_motion(at.reshape(-1, 3), slopes)
        turns = None if turns is None else turns - turns.mean(axis=0)
    return Region(model, setup, q, index, scales, at, slopes, turns, aligned)
