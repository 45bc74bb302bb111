"""Symmetric matrices as their upper triangles: tr(W I_k) of many I_k, and of many W, is one product."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CHUNK = 4096  # matrices at once: bounds the memory


def packed_squares(rows: Array) -> Array:
    """The upper triangle of F^T F for each F, shape (K, n (n + 1) / 2).

    Args:
        rows: F, shape (K, m, n).
    """
    upper = np.triu_indices(rows.shape[-1])
    out = np.empty((len(rows), len(upper[0])))
    for i in range(0, len(rows), _CHUNK):
        block = rows[i : i + _CHUNK]
        out[i : i + _CHUNK] = (block.swapaxes(-1, -2) @ block)[:, upper[0], upper[1]]
    return out


def packed_weight(weight: Array) -> Array:
    """What an upper triangle is multiplied with to give tr(W I), shape (..., n (n + 1) / 2).

    Args:
        weight: W, symmetric, shape (..., n, n).
    """
    upper = np.triu_indices(weight.shape[-1])
    return np.asarray(weight[..., upper[0], upper[1]] * np.where(upper[0] == upper[1], 1.0, 2.0))
