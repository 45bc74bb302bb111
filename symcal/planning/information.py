r"""What one pose tells about the parameters: whitened, scaled rows on the identifiable subspace.

    F(q) = Sigma^-1/2 J(q) S V_1,        I(q) = F^T F,        M = P + sum_i I(q_i)

J is taken at nominal; Sigma is the stated noise, S the plausible size of each parameter's error, V_1 (p x n) an
orthonormal basis of what the data can see, and P the (constant) information of priors. In these coordinates the
covariance of the parameters is S V_1 M^-1 V_1^T S, whatever is measured: nuisance parameters such as base, tool or
camera are simply parameters. Plans are chosen by M. What they let one expect is the posterior of an identification,

    C = S R^-1 R^-T S,        Q R = [Sigma^-1/2 J S of every pose; rows of plausible sizes]

over all p free parameters: what the data do not tell is in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.fit.identifiability import Identifiability, analyse
from symcal.fit.whitened import beforehand
from symcal.model.measurement import Measurement, Setup
from symcal.planning.area import Feasible, WorkingArea, working_area
from symcal.planning.staged_rows import StagedRows, measured_rows
from symcal.planning.subspace_rows import SubspaceRows

Array = NDArray[np.float64]

RANK_POSES = 2000
"""Poses, spread evenly over the working area, from which rank and identifiable subspace are taken."""


@dataclass(frozen=True, slots=True)
class PoseInformation:
    """The information of a pose as a function of its joint readings; made by `pose_information`.

    names: the p free parameters. scales: their plausible errors, shape (p,). sigmas: the noise by group.
    seen: the rank analysis behind the subspace. prior: P, shape (n, n): information that is there before any pose is
    measured; zero without priors. sizes: whitened rows of plausible sizes and stated priors, shape (k, p).
    function: q -> Sigma^-1/2 J S, shape (m, p), and its rows on the subspace.
    """

    measurement: Measurement
    setup: Setup
    area: WorkingArea
    sigmas: dict[str, float]
    names: tuple[str, ...]
    scales: Array
    seen: Identifiability
    prior: Array
    sizes: Array
    function: SubspaceRows | StagedRows

    @property
    def basis(self) -> Array:
        """V_1, shape (p, n), orthonormal in scaled coordinates."""
        return self.function.basis

    @property
    def rank(self) -> int:
        """n, the number of directions that the data determine."""
        return int(self.basis.shape[1])

    @property
    def components(self) -> int:
        """The most rows that one pose gives: its residual components, or fewer with the same information; it touches
        one thing at a time."""
        touches = [part.size for part in self.measurement.parts if part.contact is not None]
        return self.function.components - sum(touches) + max(touches, default=0)

    def rows(self, poses: Array) -> Array:
        """F at each pose, shape (N, m, n); poses (N, dof) in rad or mm."""
        return self.function.rows(poses)

    def matrices(self, poses: Array) -> Array:
        """I = F^T F at each pose, shape (N, n, n)."""
        rows = self.rows(poses)
        return np.asarray(rows.swapaxes(-1, -2) @ rows)

    def total(self, poses: Array) -> Array:
        """M of a plan, shape (n, n): priors and the sum over its poses."""
        stacked = self.rows(poses).reshape(-1, self.rank)
        return np.asarray(self.prior + stacked.T @ stacked)

    def posterior(self, poses: Array) -> Array:
        """R^-1 of a plan, shape (p, p); of several plans, (R, N, dof), shape (R, p, p)."""
        rows = self.function.full(poses.reshape(-1, self.area.dof))
        return self.posterior_of(rows.reshape(*poses.shape[:-2], -1, len(self.names)))

    def posterior_of(self, rows: Array) -> Array:
        """R^-1 from rows Sigma^-1/2 J S, shape (..., k, p)."""
        known = np.broadcast_to(self.sizes, (*rows.shape[:-2], *self.sizes.shape))
        return np.asarray(np.linalg.inv(np.linalg.qr(np.concatenate([rows, known], axis=-2), mode="r")))

    def lift(self, matrix: Array) -> Array:
        """A covariance in the coordinates of the subspace as one of the free parameters (mm, rad), shape (p, p)."""
        root = self.scales[:, None] * self.basis
        return np.asarray(root @ matrix @ root.T)


def pose_information(
    measurement: Measurement,
    setup: Setup,
    sigmas: dict[str, float],
    free: tuple[str, ...] | None = None,
    *,
    area: WorkingArea | None = None,
    feasible: Feasible | None = None,
    poses: int = 40,
    prior_rows: Array | None = None,
    typical: Array | None = None,
) -> PoseInformation:
    """Information per pose at the nominal parameters.

    The identifiable subspace is decided for a plan of ``poses`` poses spread evenly over the working area, by the
    definition of `identifiability`: singular values of Sigma^-1/2 J S above 1. Priors of the parameter set count as
    data.

    Args:
        sigmas: noise by group of the measurement: mm, rad or px. free: names of the free parameters; all when None.
        area: where poses may lie; the robot's joint limits when None. feasible: which of them can be measured; only
            these count for the rank.
        prior_rows: further rows of constant information by the free parameters (whitened, per mm and rad), (k, p).
        typical: poses that stand for those that can be measured, shape (K, dof), where not all of the area can: they
            touch what they must. Only what a posture touches counts.
    Raises:
        RefusedError: the measurement determines nothing at this noise, or no pose is feasible.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> model = sc.build_model(robot, sc.Task.of("position"))
        >>> info = sc.pose_information(model.measurement, model.setup, {"position": 0.05})
        >>> info.rank
        11
    """
    robot, parameters = measurement.chain.robot, measurement.parameters
    area = working_area(robot) if area is None else area
    names = parameters.names if free is None else free
    index = parameters.indices(names)
    scales = parameters.scales[index]
    prior_rows = _known(measurement, setup, tuple(names), prior_rows)
    whole = measured_rows(measurement, setup, measurement.per_component(sigmas), index, scales)

    sampled = whole.full(_typical(area, feasible) if typical is None else typical)
    sampled = sampled[np.isfinite(sampled).all(axis=(1, 2))].reshape(-1, len(names))
    prior = _priors(measurement, names, prior_rows) * scales
    # as much information as ``poses`` average ones have
    stacked = np.vstack([sampled * np.sqrt(poses * whole.components / max(len(sampled), 1)), prior])
    full = np.zeros((len(stacked), len(parameters)))
    full[:, index] = stacked / scales
    seen = analyse(full, parameters, names)
    if seen.rank == 0:
        raise RefusedError(
            "at this noise the measurement determines none of the parameters better than their plausible size"
        )
    reduced = prior @ seen.seen
    return PoseInformation(
        measurement=measurement,
        setup=setup,
        area=area,
        sigmas=dict(sigmas),
        names=tuple(names),
        scales=scales,
        seen=seen,
        prior=reduced.T @ reduced,
        sizes=_sizes(measurement, names, scales, prior_rows),
        function=whole.on(seen.seen),
    )


def _sizes(measurement: Measurement, names: tuple[str, ...], scales: Array, extra: Array | None) -> Array:
    known = beforehand(measurement.parameters, names).rows(scales)
    return known if extra is None else np.vstack([known, extra * scales])


def _typical(area: WorkingArea, feasible: Feasible | None) -> Array:
    """Evenly spread feasible poses, about `RANK_POSES` of them where so many are to be had."""
    poses = area.even(RANK_POSES)
    if feasible is None:
        return poses
    visible = poses[feasible(poses)]
    if len(visible) < RANK_POSES // 2:
        poses = area.even(50 * RANK_POSES)
        visible = poses[feasible(poses)][:RANK_POSES]
    if len(visible) == 0:
        raise RefusedError(f"none of {len(poses)} poses spread over the working area is feasible")
    return visible


def _priors(measurement: Measurement, names: tuple[str, ...], extra: Array | None) -> Array:
    """Whitened rows of all priors by the free parameters, shape (k, p)."""
    own = measurement.parameters.prior_rows(names)
    return own if extra is None else np.vstack([own, extra])


def _known(measurement: Measurement, setup: Setup, names: tuple[str, ...], extra: Array | None) -> Array | None:
    """Whitened rows of what is known between things, beside further ones, shape (k, p)."""
    index = measurement.parameters.indices(names)
    known = measurement.known_rows(np.zeros(len(measurement.parameters)), setup)
    rows = [slopes[:, index] for _, _, slopes in known]
    rows += [] if extra is None else [extra]
    return np.vstack(rows) if rows else None
