"""What the data can see: rank of the scaled Jacobian, its whole spectrum, and the unseen directions in words.

The Jacobian is whitened by the noise and scaled by the plausible size of each parameter's error, W = Sigma^-1/2 J S.
A direction is seen when the data determine it better than its plausible scale: singular value above 1. Without noise
the numerical rank decides. Nothing is cut off by it: it is what a person is told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.parameters import ParameterSet
from symcal.solvers.sparsest import least_one_norms
from symcal.units import in_mrad

Array = NDArray[np.float64]

NUMERICAL = 1e-10
"""A singular value below this share of the largest counts as zero: rounding of a Jacobian is about 1e-13 of it."""

_NEGLIGIBLE = 0.03  # share of a direction below which a parameter is not named in words
_DISTINCT = 0.2  # share of a direction outside of all others that makes it a different one


@dataclass(frozen=True, slots=True)
class Direction:
    """A direction in parameter space that the data do not determine.

    direction: components in scaled coordinates (error / scale), unit norm, small ones left out.
    text: the same in a sentence.
    """

    direction: dict[str, float]
    text: str


@dataclass(frozen=True, slots=True)
class Identifiability:
    """Spectrum and subspaces of W = Sigma^-1/2 J S, in the scaled coordinates of the free parameters.

    names: the free parameters, n of them. singular_values: shape (n,), descending.
    rank: directions determined at the noise; numerical_rank: directions that the noise-free Jacobian sees.
    seen (n, rank) and hidden (n, n - rank): orthonormal bases; seen_values: singular values of the seen ones, (rank,).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scales: Array
    singular_values: Array
    rank: int
    numerical_rank: int
    seen: Array
    seen_values: Array
    hidden: Array
    hidden_values: Array

    @property
    def condition_number(self) -> float:
        """Largest over smallest singular value of the identifiable subspace."""
        return float(self.seen_values[0] / self.seen_values[-1]) if self.rank else float("inf")

    def unseen(self) -> tuple[Direction, ...]:
        """A sparse basis of the hidden subspace, each vector with its sentence; a tenth of a second or so."""
        exact = self.rank == self.numerical_rank
        return _directions(self.hidden, self.names, self.scales, self.units, "nothing" if exact else "hardly anything")


def decompose(scaled: Array, threshold: float | None = 1.0) -> tuple[Array, Array, int, int]:
    """Singular values (n,), right singular vectors (n, n) as columns, rank at the threshold, numerical rank.

    Args:
        scaled: W, shape (m, n). threshold: smallest singular value that counts; None for the numerical rank.
    """
    n = scaled.shape[1]
    triangular = np.linalg.qr(scaled, mode="r") if scaled.shape[0] > n else scaled
    _, s, vt = np.linalg.svd(triangular, full_matrices=True)
    values = np.zeros(n)
    values[: s.size] = s
    numerical = _count(values)
    rank = numerical if threshold is None else min(numerical, int(np.sum(values > threshold)))
    return values, vt.T, rank, numerical


def numerical_rank(scaled: Array) -> int:
    """Directions that rows of shape (m, n) see at all, whatever the noise."""
    triangular = np.linalg.qr(scaled, mode="r") if scaled.shape[0] > scaled.shape[1] else scaled
    return _count(np.asarray(np.linalg.svd(triangular, compute_uv=False), dtype=np.float64))


def _count(values: Array) -> int:
    return int(np.sum(values > NUMERICAL * values[0])) if values.size else 0


def analyse(
    jacobian: Array, parameters: ParameterSet, free: tuple[str, ...] | None = None, *, noise_known: bool = True
) -> Identifiability:
    """Identifiability of the free parameters from stacked whitened rows.

    Args:
        jacobian: Sigma^-1/2 J by all parameters, shape (m, n); rows of priors included if there are any. free:
            names; all when None.
        noise_known: False when the rows are not whitened: the numerical rank decides.
    """
    names = parameters.names if free is None else free
    index = parameters.indices(names)
    scales, units = parameters.scales[index], parameters.units
    values, v, rank, numerical = decompose(jacobian[:, index] * scales, 1.0 if noise_known else None)
    return Identifiability(
        names=names,
        units=tuple(units[i] for i in index),
        scales=scales,
        singular_values=values,
        rank=rank,
        numerical_rank=numerical,
        seen=v[:, :rank],
        seen_values=values[:rank],
        hidden=v[:, rank:],
        hidden_values=values[rank:],
    )


def _directions(
    hidden: Array, names: tuple[str, ...], scales: Array, units: tuple[str, ...], changed: str
) -> tuple[Direction, ...]:
    """A sparse basis of the hidden subspace, each vector with its sentence."""
    directions = []
    for vector in sparse_basis(hidden):
        keep = np.flatnonzero(np.abs(vector) > _NEGLIGIBLE * np.abs(vector).max())
        vector = vector * np.sign(vector[keep[0]])
        directions.append(
            Direction(
                {names[i]: float(vector[i]) for i in keep},
                _sentence(keep, vector / np.abs(vector).max() * scales, names, units, changed),
            )
        )
    return tuple(directions)


def sparse_basis(subspace: Array) -> list[Array]:
    """A basis of span(subspace) whose vectors have few entries, so that they can be read; unit vectors, shape (n,).

    For each coordinate the vector of least 1-norm with a one there is found by linear programming; the sparsest
    independent ones are kept. Ours; the 1-norm is the usual convex stand-in for the number of entries.
    """
    n, k = subspace.shape
    if k == 0:
        return []
    reached = np.flatnonzero(np.linalg.norm(subspace, axis=1) > 1e-3)
    candidates = [vector / np.linalg.norm(vector) for vector in least_one_norms(subspace, reached)]
    candidates.sort(key=lambda v: (int(np.sum(np.abs(v) > _NEGLIGIBLE * np.abs(v).max())), float(np.abs(v).sum())))
    chosen: list[Array] = []
    span = np.zeros((n, 0))
    for vector, new in [(v, _DISTINCT) for v in candidates] + [(v, 1e-6) for v in subspace.T]:
        rest = vector - span @ (span.T @ vector)
        if np.linalg.norm(rest) > new:
            # what the programming did not reach, a dense vector completes
            chosen.append(vector if new == _DISTINCT else rest / np.linalg.norm(rest))
            span = np.linalg.qr(np.array(chosen).T)[0]
    return chosen


def _sentence(
    kept: NDArray[np.intp], physical: Array, names: tuple[str, ...], units: tuple[str, ...], changed: str
) -> str:
    if len(kept) == 1:
        return f"{names[kept[0]]} cannot be seen"
    amounts = " with ".join(_amount(physical[i], names[i], units[i]) for i in kept)
    verb = "cannot be told apart" if len(kept) == 2 else "can be changed together unseen"
    listed = ", ".join(names[i] for i in kept[:-1]) + f" and {names[kept[-1]]}"
    return f"{listed} {verb}: {amounts} changes {changed} that was measured"


def _amount(value: float, name: str, unit: str) -> str:
    label, factor = in_mrad(unit)
    return f"{value * factor:+.3g} {label if label != '1' else ''} of {name}".replace("  ", " ")
