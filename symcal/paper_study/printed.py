"""What the paper's printed identification values are worth in our model.

Tables V and VI give fifteen errors each. Identifying the positions that they predict once more with minimum norm takes
away what positions cannot see and leaves what the paper's data really said. Ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.kernels import batch_function
from symcal.paper_study import published
from symcal.paper_study.batch_fit import fit_many
from symcal.paper_study.results import Setting
from symcal.paper_study.setting import positions

Array = NDArray[np.float64]

_HALF_DIGIT = 5e-5
"""Half a unit of the last digit of Tables V and VI, rad and mm."""


@dataclass(frozen=True, slots=True)
class Printed:
    """One of the paper's tables of identified errors.

    rounding_mm: rms error over the test poses that its rounding to four decimals alone makes.
    reduced: its errors without what positions cannot see, shape (n,), rad and mm.
    """

    rounding_mm: float
    reduced: Array


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
        exact = positions(setting, poses, model.parameters.vector(table))[None]
        found[name] = Printed(rounding, fit_many(model, poses, exact, setting.sigma).x[0])
    return found
