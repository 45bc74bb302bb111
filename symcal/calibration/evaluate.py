"""How accurate: errors of a robot's tool against measurements, and what was to be expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.fit.estimation import Fit
from symcal.model.model import Model, State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Statistics:
    """Of Euclidean norms over points, or of rotation angles; rms = sqrt(mean of squares)."""

    mean: float
    rms: float
    p95: float
    max: float
    count: int


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of predictions against measurements, in world.

    vectors: per observation, shape (k, 3), mm. position: their norms, shape (k,). pose: the pose of each, shape (k,).
    point: its tool point, shape (k,). orientation: rotation angles per pose, shape (N,), rad; None where only
        positions are measured.
    rotations: rotation vectors in the tool frame, shape (N, 3), rad.
    """

    vectors: Array
    pose: NDArray[np.intp]
    point: NDArray[np.intp]
    rotations: Array | None

    @property
    def position(self) -> Array:
        return np.asarray(np.linalg.norm(self.vectors, axis=1))

    @property
    def orientation(self) -> Array | None:
        return None if self.rotations is None else np.asarray(np.linalg.norm(self.rotations, axis=1))


def statistics(values: Array) -> Statistics:
    """Statistics of error norms, shape (k,), k >= 1."""
    return Statistics(
        float(values.mean()),
        float(np.sqrt(np.mean(values**2))),
        float(np.percentile(values, 95)),
        float(values.max()),
        int(values.size),
    )


def evaluate(state: State, data: Dataset) -> Errors:
    """Errors of a state on measurements of its kind."""
    model = state.model
    (error,) = model.accuracy(data.q, state.x, state.setup.vector, np.nan_to_num(data.z))
    if not model.measurement.kind.reads_points:
        index = np.arange(len(data))
        return Errors(error[:, :3], index, np.zeros_like(index), error[:, 3:])
    seen = np.isfinite(data.z).reshape(len(data), -1, model.measurement.groups[0].block).all(axis=2)
    pose, point = np.nonzero(seen)
    return Errors(error.reshape(len(data), -1, 3)[seen], pose, point, None)


def expected_position_rms(model: Model, result: Fit, q: Array) -> Array:
    """Predicted rms position error of the tool (or of its points) at each pose, shape (N,), mm; from the covariance.

    The noise of the measurement that it would be compared with is not in it. Where only a camera says where the world
    is, it is the error after one rigid alignment of all poses.
    """
    index = model.parameters.indices(result.free)
    at, jacobian = model.points(q, result.x, result.setup.vector)
    if model.measurement.kind.place:  # only the instrument says where the world is
        jacobian = without_rigid_motion(at.reshape(-1, 3), jacobian)
    rms = result.posterior.predicted_rms(jacobian[:, :, index])
    return np.asarray(rms / np.sqrt(jacobian.shape[1] // 3))


def without_rigid_motion(points: Array, jacobian: Array) -> Array:
    """Jacobian (N, 3 k, n) of points (N k, 3) without what one rigid motion of all of them can do."""
    arm = points - points.mean(axis=0)
    turn = np.cross(np.eye(3), arm[:, None, :])
    motion = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=2).reshape(-1, 6)
    basis, _ = np.linalg.qr(motion / np.linalg.norm(motion, axis=0))
    flat = jacobian.reshape(-1, jacobian.shape[2])
    return np.asarray((flat - basis @ (basis.T @ flat)).reshape(jacobian.shape))
