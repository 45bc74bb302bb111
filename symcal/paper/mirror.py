"""The paper's two roots.

Positions of the last origin do not change when a_n becomes -a_n and theta_n turns by an odd multiple of pi: the last
link folded over. The canonical form of a solution is the representative nearest to nominal. Ours; the paper does not
mention it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.parameters import ParameterSet

Array = NDArray[np.float64]


def canonical(x: Array, parameters: ParameterSet, link: int) -> tuple[Array, bool]:
    """The canonical form of errors x, shape (n,), and whether the mirror was taken.

    Args:
        link: number of the last link; its a and theta are among the parameters, with a nominal at zero.
    """
    a, theta = parameters.index(f"a_{link}"), parameters.index(f"theta_{link}")
    scale = parameters.scales[[a, theta]]

    def turned(mirrored: bool) -> Array:
        out = x.copy()
        half = np.pi if mirrored else 0.0
        out[a] = -x[a] if mirrored else x[a]
        out[theta] = np.remainder(x[theta] + half + np.pi, 2 * np.pi) - np.pi
        return out

    direct, folded = turned(False), turned(True)
    nearer = np.linalg.norm(folded[[a, theta]] / scale) < np.linalg.norm(direct[[a, theta]] / scale)
    return (folded, True) if nearer else (direct, False)
