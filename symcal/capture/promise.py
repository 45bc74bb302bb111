r"""How accurate the robot is by now, how sure that is, and which pose makes it most accurate.

The rms error over the region is a quadratic form of the parameters' errors, e^2 = x^T W x with x ~ N(0, C): a weighted
sum of squares of independent normal numbers, the weights being the eigenvalues of C^1/2 W C^1/2. Its 95 % quantile, not
its mean, is what is promised: the mean is exceeded in some two of five cases.

A pose with whitened rows F leaves C - C F^T (1 + F C F^T)^-1 F C, whatever is read there: the best pose is the one that
takes most off tr(W C), and poses to come can be counted before they are measured. W and F are taken at the estimate:
what nothing tells has its plausible size as uncertainty, and only there it is of no consequence.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.evaluate import without_rigid_motion
from symcal.capture.aim import Aim
from symcal.capture.estimate import Estimate

Array = NDArray[np.float64]

SURE = 0.95
"""Probability with which the accuracy that is said is kept."""
MOST = 40
"""Poses to come that are counted one by one; beyond, errors fall as one over the root of the number of poses."""
LARGEST = 1000
"""Poses beyond which nobody goes on."""
_DRAWS = 20_000
_ENDLESS = 1e8  # times that every pose is measured, where it is asked what no measurement tells


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Rms error over the region, mm: below ``sure`` with 95 % probability; its root mean square ``expected``."""

    sure: float
    expected: float


@dataclass(frozen=True, slots=True)
class Ground:
    """What a promise stands on: C, shape (p, p), W, (p, p), mm^2, and F of every pose of the aim, (P, m, p)."""

    covariance: Array
    weight: Array
    rows: Array

    def within(self, tolerance: float) -> bool:
        """Whether the error is below a tolerance for sure; looked at closely only where it is on the average."""
        expected = float(np.sum(self.weight * self.covariance))
        return expected <= tolerance**2 and self.accuracy.sure <= tolerance

    @property
    def accuracy(self) -> Accuracy:
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        shares = np.maximum(np.linalg.eigvalsh(root.T @ self.weight @ root), 0.0)
        squares = _squares(len(shares)) @ shares
        return Accuracy(float(np.sqrt(np.quantile(squares, SURE))), float(np.sqrt(shares.sum())))

    def with_pose(self, number: int, times: float = 1.0) -> Ground:
        """After one more pose, or so many times that one."""
        rows = np.sqrt(times) * self.rows[number]
        reach = rows @ self.covariance
        left = self.covariance - reach.T @ np.linalg.solve(np.eye(len(rows)) + reach @ rows.T, reach)
        return replace(self, covariance=np.asarray((left + left.T) / 2))

    def gains(self, numbers: Sequence[int]) -> Array:
        """By how much each of some poses lessens the mean square error over the region, shape (K,)."""
        rows = self.rows[np.asarray(numbers, dtype=np.intp)]
        reach = rows @ self.covariance
        inner = np.eye(rows.shape[1]) + reach @ rows.swapaxes(1, 2)
        felt = reach @ self.weight @ reach.swapaxes(1, 2)
        return np.asarray(np.einsum("kii->k", np.linalg.solve(inner, felt)))

    def best(self, numbers: Sequence[int]) -> int:
        """Which of some poses lessens the error most."""
        return int(numbers[int(np.argmax(self.gains(numbers)))])


@lru_cache(maxsize=4)
def _squares(count: int) -> Array:
    """Squares of normal numbers, always the same, shape (draws, count)."""
    return np.asarray(np.random.default_rng(0).standard_normal((_DRAWS, count)) ** 2)


def ground(aim: Aim, known: Estimate) -> Ground:
    """At an estimate, with the noise that is counted with."""
    model, x, setup = aim.model, known.fit.x, known.setup.vector
    index = model.parameters.indices(aim.parameters)
    slopes = np.asarray(model.jacobian(aim.poses, x, setup)[0])[:, :, index] * aim.scales
    rows = slopes / model.measurement.per_component(known.noise)[:, None]
    return Ground(known.covariance, _weight(aim, x, setup), rows)


def first_ground(aim: Aim, poses: Sequence[int]) -> Ground:
    """At nominal, with what is plausible and what these poses tell, whatever was read there: before anything can be
    placed."""
    info = aim.problem.info
    x, setup = np.zeros(len(aim.model.parameters)), aim.model.setup.vector
    covariance = np.asarray(np.linalg.inv(info.sizes.T @ info.sizes), dtype=np.float64)
    found = Ground(covariance, _weight(aim, x, setup), aim.rows)
    for number in poses:
        found = found.with_pose(number)
    return found


def _weight(aim: Aim, x: Array, setup: Array) -> Array:
    """Mean over the region of A^T A, A by the scaled parameters."""
    at, slopes = aim.model.points(aim.region, x, setup)
    slopes = np.asarray(slopes)
    if aim.problem.aligned:
        slopes = without_rigid_motion(np.asarray(at).reshape(-1, 3), slopes)
    points = slopes.shape[1] // 3
    index = aim.model.parameters.indices(aim.parameters)
    own = slopes[:, :, index].reshape(-1, len(index)) * aim.scales
    return np.asarray(own.T @ own / (len(aim.region) * points))


@dataclass(frozen=True, slots=True)
class Forecast:
    """poses: how many more keep the tolerance for sure; None where no number does. floor: what stays for sure however
    many are measured, mm: of directions that no pose tells."""

    poses: int | None
    floor: float


def forecast(start: Ground, tolerance: float, order: Sequence[int], open_: Sequence[int]) -> Forecast:
    """How many poses it takes.

    Args:
        tolerance: mm. order: poses that come next, as far as that is fixed. open_: those to choose from after that.
    """
    if start.within(tolerance):
        return Forecast(0, 0.0)
    path, now = _coming(start, iter(order), open_), start
    for count in range(1, MOST + 1):
        now = next(path)
        if now.within(tolerance):
            return Forecast(count, 0.0)
    floor = _endless(now, open_).accuracy.sure
    if floor >= tolerance:
        return Forecast(None, floor)
    seen = np.sqrt(max(now.accuracy.sure**2 - floor**2, 0.0))
    count = int(np.ceil(MOST * (seen / np.sqrt(tolerance**2 - floor**2)) ** 2))
    return Forecast(count if count <= LARGEST else None, floor)


def _coming(now: Ground, order: Iterator[int], open_: Sequence[int]) -> Iterator[Ground]:
    """After each pose to come: in an order while it lasts, else the best of those that are open, each as often as it
    helps."""
    while True:
        number = next(order, None)
        now = now.with_pose(now.best(open_) if number is None else number)
        yield now


def _endless(now: Ground, numbers: Sequence[int]) -> Ground:
    """After all of these poses without end."""
    rows = np.sqrt(_ENDLESS) * now.rows[np.asarray(numbers, dtype=np.intp)].reshape(-1, now.rows.shape[2])
    values, vectors = np.linalg.eigh(now.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    triangle = np.linalg.qr(np.vstack([rows @ root, np.eye(len(root))]), mode="r")
    left = root @ np.linalg.inv(triangle)
    return replace(now, covariance=np.asarray(left @ left.T))
