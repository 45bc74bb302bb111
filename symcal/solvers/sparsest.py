"""Vectors of a subspace with few entries, by linear programming."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def least_one_norms(subspace: Array, places: NDArray[np.intp]) -> Iterator[Array]:
    """For each of some coordinates the vector of span(subspace) of least 1-norm with a one there, shape (n,).

    min sum_i t_i over c and t, with -t <= V c <= t and (V c)_j = 1: by HiGHS through CasADi, which is loaded anyway
    (SciPy's takes a sixth of a second to load, and comes to the same vertex).

    Args:
        subspace: V, shape (n, k), independent columns. places: the coordinates j. One without a solution is left out.
    """
    n, k = subspace.shape
    program = np.vstack([np.block([[subspace, -np.eye(n)], [-subspace, -np.eye(n)]]), np.zeros(k + n)])
    shapes = {"h": ca.Sparsity(k + n, k + n), "a": ca.Sparsity.dense(*program.shape)}
    quiet: dict[str, Any] = {"error_on_fail": False, "highs": {"output_flag": False}}
    solve = ca.conic("one_norm", "highs", shapes, quiet)
    fixed = {
        "g": np.concatenate([np.zeros(k), np.ones(n)]),
        "lba": np.append(np.full(2 * n, -np.inf), 1.0),
        "uba": np.append(np.zeros(2 * n), 1.0),
        "lbx": np.append(np.full(k, -np.inf), np.zeros(n)),
    }
    for j in places:
        program[-1, :k] = subspace[j]
        found = solve(a=program, **fixed)
        if solve.stats()["success"]:
            yield subspace @ np.asarray(found["x"]).ravel()[:k]
