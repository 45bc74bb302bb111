"""What the paper's printed identification values are worth in our model.

Tables V and VI give fifteen errors each. Identifying the positions that they predict once more, at the noise of the
measurement and with plausible sizes as prior, takes away what positions cannot see and leaves what the paper's data
really said. Ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.fit.many import fit_many
from symcal.kernels import batch_function
from symcal.paper import published
from symcal.paper.results import Setting
from symcal.paper.setting import positions

Array = NDArray[np.float64]

_HALF_DIGIT = 5e-5
"""Half a unit of the last digit of Tables V and VI, rad and mm."""


@dataclass(frozen=True, slots=True)
class Printed:
    """One of the paper's tables of identified errors.

    rounding_mm: rms error over the test poses that its rounding to four decimals alone makes.
    reduced: its errors without what positions cannot see, shape (n,), rad and mm; moved_mm: rms distance between the
    positions that both predict for the test poses. turned: mean angle by which the tool's orientation is off, rad.
    """

    rounding_mm: float
    reduced: Array
    moved_mm: float
    turned: float


def printed_tables(setting: Setting, poses: Array) -> Mapping[str, Printed]:
    """Tables V (`optimal`) and VI (`random`).

    Args:
        poses: that the reduction is made with, shape (N, dof); any plan that sees all that can be seen.
    """
    model = setting.model
    (jacobian,) = batch_function(model.measurement.jacobian)(setting.test_poses, setting.truth, model.setup.vector)
    rounding = float(np.sqrt(np.sum(jacobian**2) / len(setting.test_poses)) * _HALF_DIGIT / np.sqrt(3))
    found = {}
    for name, table in published.TABLES.items():
        x = model.parameters.vector(table)
        reduced = fit_many(model, poses, positions(setting, poses, x)[None], setting.sigma).x[0]
        apart = positions(setting, setting.test_poses, reduced) - positions(setting, setting.test_poses, x)
        moved = float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
        found[name] = Printed(rounding, reduced, moved, _turned(setting, x))
    return found


def _turned(setting: Setting, x: Array) -> float:
    """Mean angle between the tool's orientations with errors x and with the true ones, over the test poses, rad."""
    model = setting.model
    chain = model.measurement.chain
    orientation = ca.Function("orientation", [chain.q, chain.x, chain.frames], [ca.vec(chain.tool[:3, :3])])
    q, frames = setting.test_poses.T, model.setup.vector[:24]
    found, true = (np.asarray(orientation(q, errors, frames)) for errors in (x, setting.truth))
    cosine = 0.5 * (np.sum(found * true, axis=0) - 1.0)
    return float(np.mean(np.arccos(np.clip(cosine, -1.0, 1.0))))
