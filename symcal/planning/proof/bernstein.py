r"""Polynomials of degree two in (cos q, sin q), or in q, as convex combinations of their coefficients over an interval.

Over an angle q in [a, b] with b - a = w < pi, midpoint m and

    u = sin((b - q) / 2) / sin(w / 2),      v = sin((q - a) / 2) / sin(w / 2)

the functions 1, cos q, sin q, cos 2q, sin 2q are forms of degree four in u and v: cos((q - m) / 2) = cos(w/4) (u + v),
sin((q - m) / 2) = sin(w/4) (v - u). In particular 1 = sum_i w_i C(4, i) u^(4-i) v^i with positive weights w_i, so

    f(q) = sum_i b_i N_i(q),     N_i = w_i C(4, i) u^(4-i) v^i >= 0,     sum_i N_i = 1

([Pena1997]). Over a length the same holds with u and v linear, degree two and weights of one (Bernstein).
So f lies between the least and the largest b_i, takes b_0 and b_n at the ends, and rises strictly where the b_i do: its
derivative is sum_{i<j} (b_j - b_i) (N_i N_j' - N_i' N_j), and N_j / N_i, a multiple of (v / u)^(j-i), rises. Halving
the interval replaces b by convex combinations of b (de Casteljau), so rounding does not grow.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WIDEST = 2.0 * np.pi / 3.0 + 1e-9
"""Angles wider than this are cut into equal pieces: at pi a weight would vanish."""

ANGLE, LENGTH = 5, 3
"""Coefficients of a revolute and of a prismatic joint."""


def _forms(width: float) -> Array:
    """Coefficients c_i (of C(4, i) u^(4-i) v^i) of 1, cos t, sin t, cos 2t, sin 2t; t = q - m; shape (5 forms, 5)."""
    cosine = np.cos(width / 4) * np.array([1.0, 1.0])  # of (u, v): powers of v rise
    sine = np.sin(width / 4) * np.array([-1.0, 1.0])
    cc, ss, sc = np.convolve(cosine, cosine), np.convolve(sine, sine), np.convolve(sine, cosine)
    one, cos1, sin1 = cc + ss, cc - ss, 2 * sc
    forms = [
        np.convolve(one, one),
        np.convolve(cos1, one),
        np.convolve(sin1, one),
        np.convolve(cos1, cos1) - np.convolve(sin1, sin1),
        2 * np.convolve(sin1, cos1),
    ]
    return np.array(forms) / [comb(4, i) for i in range(5)]


def weights(width: float) -> Array:
    """w_i of an angle's interval, shape (5,)."""
    c = np.cos(width / 2)
    return np.array([1.0, c, (1 + 2 * c * c) / 3, c, 1.0])


def angle_nodes() -> Array:
    """Five angles that determine such a polynomial, shape (5,)."""
    return 2 * np.pi * np.arange(ANGLE) / ANGLE


def from_angles(lower: float, upper: float) -> Array:
    """Values at `angle_nodes` -> b over [lower, upper], narrower than pi; shape (5, 5)."""
    turned = angle_nodes() - 0.5 * (lower + upper)
    # the interpolant of values y: mean(y) + (2/5) sum_k sum_j y_j cos(k (q - q_j))
    fourier = np.array(
        [np.full(ANGLE, 0.5), np.cos(turned), np.sin(turned), np.cos(2 * turned), np.sin(2 * turned)]
    ) * (2 / ANGLE)
    return np.asarray((_forms(upper - lower).T @ fourier) / weights(upper - lower)[:, None])


def from_lengths() -> Array:
    """Values at the lower end, the middle and the upper end -> b over the interval, shape (3, 3)."""
    return np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])


def halving(size: int, width: float) -> Array:
    """b over an interval -> b over its lower half; over its upper half the same, mirrored; shape (size, size).

    Args:
        size: `ANGLE` or `LENGTH`. width: of the interval that is halved; no matter for a length.
    """
    part, before, after = 0.5, np.ones(size), np.ones(size)
    if size == ANGLE:
        part, before, after = 0.5 / float(np.cos(width / 4)), weights(width), weights(width / 2)
    rows = [[comb(i, j) * part**i * before[j] / after[i] if j <= i else 0.0 for j in range(size)] for i in range(size)]
    return np.array(rows)
