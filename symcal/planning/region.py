r"""Task regions, and the tool error that a plan lets one expect there.

    e(q)^2 = |A(q) R^-1|^2 / k,        A(q) = d(tool points)/dx S        (mm)

the expected square of the position error of the k tool points (the tool's origin if there are none), in world, by the
posterior of an identification at nominal: from the noise of the measurement, and from what it does not tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.documents.csv_file import read_table
from symcal.documents.table import joint_readings
from symcal.errors import InputError
from symcal.kernels import BatchFunction, batch_function
from symcal.planning.area import Feasible, Mask, WorkingArea, draw
from symcal.planning.information import PoseInformation
from symcal.planning.subspace_rows import SubspaceRows, subspace_rows
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

SAMPLE = 2000
"""Poses from which means over a region are taken unless told otherwise; the standard error is some 1 % of the mean."""


@dataclass(frozen=True, slots=True)
class TaskRegion:
    """Poses in which accuracy matters.

    poses: a sample, shape (K, dof); means are taken over it. area, feasible: the set that was sampled, in which a
    maximum may be looked for; area is None if the listed poses are all there is.
    """

    poses: Array
    area: WorkingArea | None = None
    feasible: Feasible | None = None


def area_region(
    area: WorkingArea, rng: np.random.Generator, *, feasible: Feasible | None = None, count: int = SAMPLE
) -> TaskRegion:
    """The feasible poses of a working area, uniform in joint space."""
    return TaskRegion(draw(area, rng, count, feasible), area, feasible)


def box_region(
    info: PoseInformation,
    lower: Array,
    upper: Array,
    rng: np.random.Generator,
    *,
    feasible: Feasible | None = None,
    count: int = SAMPLE,
) -> TaskRegion:
    """Poses of the working area whose tool points all lie in a box, uniform in joint space.

    Args:
        lower, upper: corners of the box in world, shape (3,), mm.
    Raises:
        RefusedError: the box is (almost) out of reach.
    """
    points = tool_points(info)

    def inside(poses: Array) -> Mask:
        at = points(poses)[0].reshape(len(poses), -1, 3)
        mask = np.asarray(((at >= lower) & (at <= upper)).all(axis=(1, 2)))
        return mask if feasible is None else mask & feasible(poses)

    return TaskRegion(draw(info.area, rng, count, inside), info.area, inside)


def csv_region(path: Path | str, robot: Robot) -> TaskRegion:
    """The poses of a CSV file with a column per joint (`q1_deg`, ..., or the joints' names).

    Raises:
        InputError: the file cannot be read, or has no rows.
    """
    table = read_table(path)
    poses = joint_readings(table, [(joint.name, joint.revolute) for joint in robot.joints])
    if len(poses) == 0:
        raise InputError("the file lists no poses", file=path)
    return TaskRegion(poses)


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Predicted position error over a task region, as a function of a plan's information; made by `region_accuracy`.

    function: q -> A V_1 / sqrt(k), shape (3 k, n), mm. mean: average of its square over the region, shape (n, n): what
        plans are chosen by.
    everything, everywhere: the same of all p parameters, (3 k, p) and (p, p): what plans let expect.
    hidden_mm: rms position error over the region that directions unseen by the measurement make at their plausible
        size; it is part of every prediction, and zero when what is unseen does not matter there.
    aligned: the error is what is left after one rigid alignment of the region.
    """

    region: TaskRegion
    function: SubspaceRows
    mean: Array
    everything: SubspaceRows
    everywhere: Array
    hidden_mm: float
    aligned: bool

    def at(self, poses: Array, posterior: Array) -> Array:
        """Predicted rms error at each pose for a plan with posterior R^-1, shape (N,), mm."""
        return np.sqrt(np.maximum(self.everything.weighted(poses, posterior @ posterior.T), 0.0))

    def mean_rms(self, posterior: Array) -> float:
        """Root of the mean square error over the region for a plan with posterior R^-1, mm."""
        return float(np.sqrt(max(np.sum(posterior * (self.everywhere @ posterior)), 0.0)))


def region_accuracy(info: PoseInformation, region: TaskRegion, *, aligned: bool = False) -> Accuracy:
    """Predicted error over a region.

    Args:
        aligned: take out the rigid motion of the whole region that fits the error best, as one must where the
            measurement cannot tell where the world is (an unknown camera pose).
    """
    chain, index = info.measurement.chain, info.measurement.parameters.indices(info.names)
    where, motion = _points(info)
    points = ca.vertsplit(where, 3)
    k = len(points)
    jacobian = motion[:, index.tolist()] @ ca.diag(info.scales) / np.sqrt(k)
    if aligned:
        # a rigid motion moves the points by [1, -[p]x]; turns are counted per reach of the arm to balance the columns
        length = max(chain.robot.reach, 1.0)
        motion = ca.vertcat(*(ca.horzcat(ca.SX.eye(3), -spatial.skew(p) / length) for p in points)) / np.sqrt(k)
        j, m = batch_function(_of_readings(info, "motion", [jacobian, motion]))(region.poses)
        fit = np.linalg.lstsq(m.reshape(-1, 6), j.reshape(-1, len(index)), rcond=None)[0]
        jacobian = jacobian - motion @ fit
    whole = subspace_rows("accuracy", chain.q, jacobian, np.eye(len(index)))
    function = whole.on(info.basis)
    rows = whole.full(region.poses).reshape(-1, len(index)) / np.sqrt(len(region.poses))
    everywhere = rows.T @ rows
    mean = info.basis.T @ everywhere @ info.basis
    unseen = float(np.sum(info.seen.hidden * (everywhere @ info.seen.hidden)))
    return Accuracy(
        region, function, mean, whole, everywhere, hidden_mm=float(np.sqrt(max(unseen, 0.0))), aligned=aligned
    )


def tool_points(info: PoseInformation) -> BatchFunction:
    """q -> tool points in world at nominal, shape (3 k,), mm."""
    points, _ = _points(info)
    return batch_function(_of_readings(info, "points", [points]))


def _of_readings(info: PoseInformation, name: str, expressions: list[ca.SX]) -> ca.Function:
    return ca.Function(name, [info.measurement.chain.q], ca.cse([ca.densify(ca.simplify(e)) for e in expressions]))


def _points(info: PoseInformation) -> tuple[ca.SX, ca.SX]:
    """Tool points (or the tool) in world at nominal, shape (3 k,), and their Jacobian by all parameters, (3 k, n)."""
    chain = info.measurement.chain
    where, motion = info.measurement.points(chain.q, ca.SX.zeros(chain.x.numel()), ca.SX(info.setup.vector))
    return where, motion
