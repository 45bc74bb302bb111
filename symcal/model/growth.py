"""Growth of all lengths by one share: what contacts and directions cannot see.

g(x) = 1 + L . x / L . L, with L the nominal lengths a and d of the links; uniform growth, x = e L, gives 1 + e.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.parameters import ParameterSet

Array = NDArray[np.float64]


def lengths(parameters: ParameterSet) -> Array:
    """L, shape (n,), mm: nominal a and d of the links, zero for all else."""
    return np.array([0.0 if p.unknown or p.unit != "mm" else p.nominal for p in parameters.items])


def growth_slope(parameters: ParameterSet) -> Array:
    """dg/dx, shape (n,), 1/mm; zero for a robot without lengths."""
    nominal = lengths(parameters)
    return nominal / max(float(nominal @ nominal), 1e-12)


def growth(parameters: ParameterSet, x: Array) -> float:
    """g of errors, shape (n,)."""
    return 1.0 + float(growth_slope(parameters) @ x)
