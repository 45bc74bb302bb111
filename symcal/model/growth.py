r"""Growth of all lengths by one share: what contacts and directions cannot see.

    g(x) = 1 + w . y / |w|^2,      y = S^-1 x,    w = v - P v,    v = S^-1 L

L are the nominal lengths a and d of the links, S the plausible sizes of their errors, and P projects onto what moves
neither tool nor base but as rigid bodies: where a link's frame lies on its axis, parallel axes, what base and tool take
up. So uniform growth, x = e L, gives 1 + e, and none of those changes g. Ours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal import kinematics
from symcal.kernels import batch_function
from symcal.kinematics import Chain
from symcal.parameters import ParameterSet

Array = NDArray[np.float64]

_POSTURES = 60
_LEVER = 200.0  # mm: a turn weighs like the shift of a point at this distance
_NULL = 1e-9


def lengths(parameters: ParameterSet) -> Array:
    """L, shape (n,), mm: nominal a and d of the links, zero for all else."""
    return np.array([0.0 if p.unknown or p.group or p.unit != "mm" else p.nominal for p in parameters.items])


def growth_slope(chain: Chain) -> Array:
    """dg/dx, shape (n,), 1/mm and 1/rad; zero for a robot whose lengths nothing could tell anyway."""
    parameters = chain.parameters
    links = parameters.indices([name for name in chain.robot.parameters if name in parameters.names])
    scales, slope = parameters.scales[links], np.zeros(len(parameters))
    v = lengths(parameters)[links] / scales
    w = v - _unseen_anyway(chain, links, scales, v)
    square = float(w @ w)
    if square > _NULL * float(v @ v):
        slope[links] = w / square / scales
    return slope


def _unseen_anyway(chain: Chain, links: NDArray[np.intp], scales: Array, v: Array) -> Array:
    """P v: errors of links that poses of the flange do not show while base and tool are unknown."""
    motion = _motion(chain, links)
    _, s, vt = np.linalg.svd(motion * np.concatenate([scales, np.ones(12)]))
    free = vt[np.count_nonzero(s > _NULL * s[0]) :, : len(links)]
    u, size, _ = np.linalg.svd(free.T, full_matrices=False)
    basis = u[:, size > 1e-6]
    return np.asarray(basis @ (basis.T @ v))


def _motion(chain: Chain, links: NDArray[np.intp]) -> Array:
    """How the flange moves with errors of links, of the base and of what is on it, at postures all over: rows by k + 12
    columns."""
    q = np.random.default_rng(0).uniform(*chain.robot.ranges, (_POSTURES, chain.robot.dof))
    kernel = batch_function(kinematics.forward(chain), evaluations=0)
    bare = kinematics.frame_vector(np.eye(4), np.eye(4))  # the tool is the flange
    pose, _, jacobian = kernel(q, np.zeros(len(chain.parameters)), bare)
    v, w = jacobian[:, :3, links], jacobian[:, 3:, links]
    rotation, still = pose[:, :3, :3], np.zeros((_POSTURES, 3, 3))
    base = np.concatenate(
        [np.broadcast_to(np.eye(3), still.shape), np.cross(np.eye(3), pose[:, None, :3, 3]).swapaxes(1, 2)], axis=2
    )
    turns = np.concatenate([still, np.broadcast_to(np.eye(3), still.shape), still, rotation], axis=2)
    shifts = np.concatenate([v, base, rotation, still], axis=2)
    return np.concatenate([shifts, _LEVER * np.concatenate([w, turns], axis=2)], axis=1).reshape(6 * _POSTURES, -1)


def growth(slope: Array, x: Array) -> float:
    """g of errors, shape (n,)."""
    return 1.0 + float(slope @ x)
