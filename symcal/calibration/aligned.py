"""Errors against the truth where the measurement cannot tell where the world is: after one rigid alignment.

With an unknown camera pose the place of the robot in world is a matter of convention. What counts is whether positions
agree with the truth once the two sets are laid on each other, which is done once for a whole set of poses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.evaluate import Errors, without_rigid_motion
from symcal.fit.estimation import Fit
from symcal.model.model import Model, State
from symcal.placing.registration import rigid_fit

Array = NDArray[np.float64]


def target_points(state: State, q: Array) -> Array:
    """The target's (or tool's) points in world as a state has them, shape (N, k, 3), mm, at joint readings (N, dof)."""
    return state.model.points(q, state.x, state.setup.vector)[0].reshape(len(q), -1, 3)


def centres(points: Array) -> Array:
    """The centre of each pose's points, (N, k, 3) -> (N, 1, 3)."""
    return np.asarray(points.mean(axis=1, keepdims=True))


def aligned_errors(predicted: Array, truth: Array) -> Errors:
    """Errors of predicted points, shape (N, k, 3), once one rigid motion has laid them on the true ones.

    Source: the motion is that of [Umeyama1991], over all points alike.
    """
    moved = rigid_fit(predicted.reshape(-1, 3), truth.reshape(-1, 3))
    vectors = predicted.reshape(-1, 3) @ moved[:3, :3].T + moved[:3, 3] - truth.reshape(-1, 3)
    pose, point = (index.ravel() for index in np.indices(predicted.shape[:2]))
    return Errors(vectors, pose, point, None)


def expected_centre_rms(model: Model, result: Fit, q: Array) -> Array:
    """Predicted rms error of the target's centre at each pose after one rigid alignment of all, shape (N,), mm."""
    points, slopes = model.points(q, result.x, result.setup.vector)
    index = model.parameters.indices(result.free)
    centre = points.reshape(len(q), -1, 3).mean(axis=1)
    jacobian = slopes.reshape(len(q), -1, 3, slopes.shape[-1]).mean(axis=1)[:, :, index]
    return result.posterior.predicted_rms(without_rigid_motion(centre, jacobian))
