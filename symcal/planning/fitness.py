r"""Fitness of whole plans for a search: the paper's, in every reading, and a sound one in the same frame.

    c1 (cond_1 + cond_2 + cond_3) + c2 (theta_1 + theta_2 + theta_3) + c3 S            ([Ding2017] eq. 12)

cond_k is the condition number of (M_11 / z_k) J for target point k at depth z_k (eq. 10 with its factors in the order
that their shapes allow), theta_k the angle of the point's ray to the optical axis, S the area of the triangle's image
(eq. 11). The paper leaves open whether a condition number is of one pose or of the whole plan, over which columns it
runs, and the weights; and it minimises c3 S although it wants a large triangle: c3 < 0 does what it says. The sound
fitness keeps the frame and puts the information of the whole plan in place of the condition numbers. All are functions
(P, N, dof) -> (P,), smaller is better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import kinematics, spatial
from symcal.camera.camera import project_points
from symcal.errors import InputError
from symcal.kernels import BatchFunction, batch_function
from symcal.planning.camera_view import CameraView, axis_angles, triangle_area
from symcal.planning.criteria import Criterion
from symcal.planning.information import PoseInformation

Array = NDArray[np.float64]
PlanFunction = Callable[[Array], Array]

_EVEN = 2000  # poses of the working area from which its mean information is taken


@dataclass(frozen=True, slots=True)
class Weights:
    """c1, c2 and c3 of eq. 12: per unit of observability, per rad, per px^2.

    The paper gives none; c3 < 0 wants a large triangle.
    """

    observability: float = 1.0
    angle: float = 0.0
    area: float = 0.0


@dataclass(frozen=True, slots=True)
class Reading:
    """What eq. 10 and 12 may mean.

    conditioning: `per_pose`: a condition number for every pose; `stacked`: one for all rows of the plan.
    rows: `image`: M_11 J / z, two rows, as printed (the change of depth neglected); `projection`: the true derivative
        of the pixel; `position`: J / z, three rows, without the camera.
    point: `target`: J of each target point; `tool`: J of the tool's origin for all three, as eq. 4 defines it.
    over: `sum` or `mean` of what is per pose.
    """

    conditioning: Literal["per_pose", "stacked"] = "per_pose"
    rows: Literal["image", "projection", "position"] = "image"
    point: Literal["target", "tool"] = "target"
    over: Literal["sum", "mean"] = "mean"


def paper_fitness(view: CameraView, basis: Array, weights: Weights, reading: Reading = Reading()) -> PlanFunction:
    """The paper's fitness, eq. 12, in one reading.

    Args:
        basis: columns that the condition number is over: S V_1, shape (parameters, n), the scaled identifiable
            subspace. Over all fifteen columns at nominal the condition number of a plan is infinite.
        weights: see `Weights`.
    Returns:
        (P, N, dof) -> (P,); inf for plans whose stacked rows are singular.
    Source: [Ding2017] eqs. 9 to 12.
    """
    batch = _jacobian_rows(view, reading)
    targets = len(view.target.names)
    camera, T_camera_world = view.camera, spatial.inverse(view.T_world_camera)
    m_11 = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy]])
    reduce = np.sum if reading.over == "sum" else np.mean

    def fitness(plans: Array) -> Array:
        count, n, _ = plans.shape
        poses = plans.reshape(-1, plans.shape[-1])
        raw = batch(poses, view.setup.vector[:24], T_camera_world, m_11, view.tool_points)[0]
        rows = (raw.reshape(-1, raw.shape[-1]) @ basis).reshape(count, n, targets, -1, basis.shape[1])
        if reading.conditioning == "per_pose":
            gram = rows @ rows.swapaxes(-1, -2)
            observability = reduce(condition_numbers(gram).sum(axis=-1), axis=1)
        else:
            stacked = rows.transpose(0, 2, 1, 3, 4).reshape(count, targets, -1, basis.shape[1])
            observability = condition_numbers(stacked.swapaxes(-1, -2) @ stacked).sum(axis=-1)
        return np.asarray(weights.observability * observability + _camera_terms(view, plans, weights, reading.over))

    return fitness


def sound_fitness(
    information: PoseInformation,
    merit: Criterion,
    *,
    whitened: bool = False,
    view: CameraView | None = None,
    weights: Weights = Weights(),
    fixed: Array | None = None,
) -> PlanFunction:
    """Ours, in the frame of eq. 12: the information M of the whole plan takes the place of the condition numbers.

    Minus the score of M takes their place: -log det(M) / n for D, the logarithm of the condition number for cond, of
    the mean square predicted error for I. Logarithms, so that a weight of the camera terms means the same for each.

    Args:
        merit: of M; see `symcal.planning.criteria`.
        whitened: put M in the coordinates in which the mean information of the working area is the identity, so that a
            condition number of 1 is a plan that sees every direction as well as an average one does. Without it a
            condition number depends on the scales of the parameters.
        view: needed for the camera terms, which are means over the poses; without it their weights must be 0.
        fixed: information that every plan has beside its poses, shape (n, n); that of the priors when None.
    Returns:
        (P, N, dof) -> (P,); inf for plans that leave a direction unseen.
    Raises:
        InputError: camera terms without a view.
    """
    if view is None and (weights.angle or weights.area):
        raise InputError("the camera terms of the fitness need a camera and a target", key="weights")
    n = information.rank
    ground = information.prior if fixed is None else fixed
    whitener: Array = np.eye(n)
    if whitened:
        mean = np.mean(information.matrices(information.area.even(_EVEN)), axis=0)
        whitener = np.asarray(np.linalg.inv(np.linalg.cholesky(mean)), dtype=np.float64)

    def fitness(plans: Array) -> Array:
        rows = information.rows(plans.reshape(-1, plans.shape[-1])).reshape(len(plans), -1, n)
        m = ground + rows.swapaxes(-1, -2) @ rows
        value = -merit.score(whitener @ m @ whitener.T if whitened else m)
        terms = 0.0 if view is None else _camera_terms(view, plans, weights, "mean")
        return np.asarray(weights.observability * value + terms)

    return fitness


def condition_numbers(gram: Array) -> Array:
    """Ratio of largest to smallest singular value of A, shape (...), from A^T A or A A^T, shape (..., k, k); inf if
    singular."""
    if gram.shape[-1] == 2:  # half the cost of the general case, and most calls
        half = 0.5 * (gram[..., 0, 0] + gram[..., 1, 1])
        offset = np.hypot(0.5 * (gram[..., 0, 0] - gram[..., 1, 1]), gram[..., 0, 1])
        largest = half + offset
        determinant = gram[..., 0, 0] * gram[..., 1, 1] - gram[..., 0, 1] ** 2
        smallest = determinant / np.where(largest > 0, largest, 1.0)  # no cancellation, as half - offset has
    else:
        usable = np.isfinite(gram).all(axis=(-1, -2), keepdims=True)
        values = np.linalg.eigvalsh(np.where(usable, gram, 0.0))
        smallest, largest = values[..., 0], values[..., -1]
    regular = smallest > 1e-15 * largest
    return np.where(regular, np.sqrt(largest / np.where(regular, smallest, 1.0)), np.inf)


def _camera_terms(view: CameraView, plans: Array, weights: Weights, over: Literal["sum", "mean"]) -> Array | float:
    """c2 times the sum of angles plus c3 times the image's area, over the poses; shape (P,).

    A target with a point that cannot be projected has no image: its area counts as zero.
    """
    if not (weights.angle or weights.area):
        return 0.0
    points = view.points(plans.reshape(-1, plans.shape[-1]))
    value = np.zeros(len(points))
    if weights.angle:
        value += weights.angle * axis_angles(points).sum(axis=-1)
    if weights.area:
        area = triangle_area(project_points(view.camera, points[:, :3]))
        value += weights.area * np.nan_to_num(area, nan=0.0)
    per_plan = value.reshape(plans.shape[:2])
    return np.asarray(per_plan.sum(axis=1) if over == "sum" else per_plan.mean(axis=1))


def _jacobian_rows(view: CameraView, reading: Reading) -> BatchFunction:
    """q -> the rows of eq. 10 for all target points under each other, by all parameters at nominal: (k m,
    parameters)."""
    chain, targets = view.chain, len(view.target.names)
    rotation, origin = chain.tool[:3, :3], chain.tool[:3, 3]
    # camera and target are arguments, so that moving them does not make another kernel
    T_camera_world, m_11 = ca.SX.sym("camera", 4, 4), ca.SX.sym("M_11", 2, 3)
    offsets = ca.SX.sym("points", targets, 3)
    turn, shift = T_camera_world[:3, :3], T_camera_world[:3, 3]
    rows = []
    for k in range(targets):
        world = origin + rotation @ offsets[k, :].T
        jacobian = turn @ kinematics.stack(chain.parameter_screws, world if reading.point == "target" else origin)
        seen = turn @ world + shift
        if reading.rows == "position":
            rows.append(jacobian / seen[2])
            continue
        block = m_11 @ jacobian / seen[2]
        if reading.rows == "projection":  # of the pinhole; eqs. 7 and 9 leave this term out
            block = block - (m_11 @ seen / seen[2]) @ jacobian[2, :] / seen[2]
        rows.append(block)
    given = [T_camera_world, m_11, offsets]
    whole = ca.Function("rows", [chain.q, chain.x, chain.frames, *given], [ca.vertcat(*rows)])
    at_nominal = whole(chain.q, np.zeros(len(chain.parameters)), chain.frames, *given)
    outputs = [ca.cse(ca.densify(ca.simplify(at_nominal)))]
    return batch_function(ca.Function("paper_rows", [chain.q, chain.frames, *given], outputs))
