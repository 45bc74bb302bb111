r"""What each pose of a plan tells: how much less would be known without it.

With R^-1 of the whole plan and the rows F_i of pose i, G = F_i R^-1 (m x p), the posterior without the pose is

    C_-i = C + R^-1 G^T (1 - G G^T)^-1 G R^-T                                   (Woodbury)

so that no plan is solved again. tr(G G^T) is the pose's leverage: its share of the directions that the plan tells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.planning.information import PoseInformation
from symcal.planning.region import Accuracy

Array = NDArray[np.float64]

_LEAST = 1e-12  # of a direction, told by other poses and plausible sizes: less is rounding


@dataclass(frozen=True, slots=True, eq=False)
class PoseWorth:
    """What is lost where one of N poses is left out.

    mean_mm: foretold rms error over the region without it, shape (N,). directions: how many of the plan's directions it
    tells alone, shape (N,); with those of all others they are the plan's. growth: by which factor the standard
    deviation of every free parameter is larger without it, shape (N, p).
    """

    mean_mm: Array
    directions: Array
    growth: Array


def pose_worth(info: PoseInformation, accuracy: Accuracy, poses: Array) -> PoseWorth:
    """Leave out each pose of a plan, shape (N, dof), in turn."""
    root = info.posterior(poses)
    spread = np.sum(root**2, axis=1)
    told = float(np.sum(root * (accuracy.everywhere @ root)))
    g = info.function.full(poses) @ root
    # of rank m, the numbers that a pose reads: what it adds to the posterior is kept as a factor, (p, m)
    told_alone, axes = np.linalg.eigh(g @ g.swapaxes(1, 2))
    left = np.maximum(1.0 - told_alone, _LEAST)
    lost = root @ g.swapaxes(1, 2) @ (axes / np.sqrt(left)[:, None, :])
    region = np.sum(lost * (accuracy.everywhere @ lost), axis=(1, 2))
    return PoseWorth(
        mean_mm=np.sqrt(told + region),
        directions=np.sum(g**2, axis=(1, 2)),
        growth=np.sqrt(1 + np.sum(lost**2, axis=2) / spread),
    )
