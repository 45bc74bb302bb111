r"""A smooth remainder: where the tool is displaced beyond what geometry and physics say, a Gaussian process's mean.

    f(q) = sum_m k(q, c_m) w_m,    k(q, q') = exp(-sum_revolute (1 - cos(q_i - q'_i)) / l_i^2
                                                  - sum_prismatic (q_i - q'_i)^2 / (2 l_i^2))

q are joint readings, c_m centres (readings too), w_m weights in mm, f in the base frame. Of revolute joints k is the
squared exponential of the points (cos q, sin q): a turn more changes nothing. Far from all centres f is nothing.
Source: [Rasmussen2006] sec. 4.2 (periodic kernel), sec. 8.3.1 (a mean on some of the points).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy
from numpy.typing import NDArray

SX = ca.SX
Array = NDArray[np.float64]

SHIFTS = ("remainder_x", "remainder_y", "remainder_z")
"""Parameters of a displacement of the flange along the axes of the base, mm; only models of `with_shift` have them."""
TOLD = 0.05
"""Share of the prior variance that the centres must tell for a posture to count as within the data. Ours."""


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """k(q, q'). revolute: by joint. lengths: l, shape (dof,), rad of revolute joints and mm of prismatic ones."""

    revolute: tuple[bool, ...]
    lengths: Array

    def __call__(self, a: Array, b: Array) -> Array:
        """Between readings (N, dof) and (M, dof): shape (N, M)."""
        exponent = np.zeros((len(a), len(b)))
        for i, (turns, length) in enumerate(zip(self.revolute, self.lengths, strict=True)):
            off = a[:, i, None] - b[None, :, i]
            exponent += ((1 - np.cos(off)) if turns else off**2 / 2) / length**2
        return np.asarray(np.exp(-exponent))

    def expression(self, q: SX, centres: Array) -> tuple[SX, SX]:
        """k(q, c_m), shape (M,), and its slopes by q, shape (M, dof)."""
        exponent, slopes = SX(len(centres), 1), []
        for i, (turns, length) in enumerate(zip(self.revolute, self.lengths, strict=True)):
            c = centres[:, i]
            if turns:  # cos(q - c) from one sine and one cosine for all centres
                exponent += (ca.cos(q[i]) * SX(np.cos(c)) + ca.sin(q[i]) * SX(np.sin(c)) - 1) / length**2
                slopes.append((ca.cos(q[i]) * SX(np.sin(c)) - ca.sin(q[i]) * SX(np.cos(c))) / length**2)
            else:
                exponent -= (q[i] - SX(c)) ** 2 / (2 * length**2)
                slopes.append(-(q[i] - SX(c)) / length**2)
        value = ca.exp(exponent)
        return value, ca.horzcat(*(value * slope for slope in slopes))

    def root(self, centres: Array) -> Array:
        """L of k(c, c) = L L^T, shape (M, M)."""
        return np.asarray(np.linalg.cholesky(self(centres, centres)))

    def basis(self, q: Array, centres: Array) -> Array:
        """b = L^-1 k(c, q), shape (N, M): functions whose coefficients are of unit variance."""
        return np.asarray(scipy.linalg.solve_triangular(self.root(centres), self(centres, q), lower=True).T)

    def spanning(self, q: Array, most: int, left: float) -> NDArray[np.intp]:
        """Which of N readings span the others: a pivoted Cholesky factorisation.

        Args:
            most: of them. left: share of the variance that may be left anywhere.
        Source: [Harbrecht2012].
        """
        rest, rows, chosen = np.ones(len(q)), np.zeros((0, len(q))), list[int]()
        while len(chosen) < most:
            pivot = int(np.argmax(rest))
            if rest[pivot] <= left:
                break
            row = (self(q[[pivot]], q)[0] - rows[:, pivot] @ rows) / np.sqrt(rest[pivot])
            rows = np.vstack([rows, row])
            rest = np.maximum(rest - row**2, 0.0)
            rest[pivot] = 0.0
            chosen.append(pivot)
        return np.array(chosen, dtype=np.intp)


@dataclass(frozen=True, slots=True, eq=False)
class Remainder:
    """A displacement field over joint readings.

    centres: c, shape (M, dof), rad and mm. weights: w, shape (M, 3), mm along the axes of the base. amplitude: standard
    deviation of a component of f before the data, mm.
    """

    kernel: Kernel
    centres: Array
    weights: Array
    amplitude: float

    def displacement(self, q: Array) -> Array:
        """f at readings (N, dof), shape (N, 3), mm, in the base frame."""
        return np.asarray(self.kernel(q, self.centres) @ self.weights)

    def expression(self, q: SX) -> tuple[SX, SX]:
        """f, shape (3,), and its slopes by q, shape (3, dof)."""
        value, slopes = self.kernel.expression(q, self.centres)
        weights = SX(ca.DM(self.weights)).T
        return weights @ value, weights @ slopes

    def basis(self, q: Array) -> Array:
        """b of the kernel and the centres at readings (N, dof), shape (N, M)."""
        return self.kernel.basis(q, self.centres)

    def told(self, q: Array) -> Array:
        """Share of the prior variance that the centres tell, |b(q)|^2, shape (N,): one at a centre, nothing far off."""
        return np.asarray(np.clip((self.basis(q) ** 2).sum(axis=1), 0.0, 1.0))


def remainder_of(kernel: Kernel, centres: Array, coefficients: Array, amplitude: float) -> Remainder:
    """f = sum_m b_m(q) t_m, t of shape (M, 3), mm."""
    return Remainder(
        kernel,
        centres,
        scipy.linalg.solve_triangular(kernel.root(centres), coefficients, lower=True, trans="T"),
        amplitude,
    )
