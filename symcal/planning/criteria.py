r"""How good a plan is: numbers of its information matrix M, shape (n, n), on the identifiable subspace.

lambda_1 >= ... >= lambda_n are the eigenvalues of M and sigma_i their roots, the singular values of the plan's stacked,
whitened and scaled Jacobian. Criteria that are not functions of det M depend on the scales of the parameters.

Every criterion also has a *score*, which searches maximise: a number that is larger the better the plan is, minus
infinity for a singular M, and has a gradient by M. For `concave` ones score = log psi(M) with psi concave and
homogeneous of degree one, so that the gradient bounds what any plan can reach (see `symcal.planning.certificate`).

    D       log det M                               [Pukelsheim2006] ch. 6
    A       tr M^-1                                 same
    E       lambda_n                                same
    cond    sigma_1 / sigma_n                       [Driels1990]
    O1      (sigma_1 ... sigma_n)^(1/n) / sqrt(N)   [Borm1991]
    O2      sigma_n / sigma_1                       [Driels1990]
    O3      sigma_n                                 [Nahvi1994]
    O4      sigma_n^2 / sigma_1                     [Nahvi1996]
    O5      1 / (1/sigma_1 + ... + 1/sigma_n)       [Sun2008], which compares O1 to O5
    I       root mean square predicted error over a task region, mm     [Atkinson2007] ch. 10 (as V- or I-optimality)
    G       largest predicted rms error over a task region, mm          same
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.planning.region import Accuracy

Array = NDArray[np.float64]

NAMES = ("D", "A", "E", "cond", "O1", "O2", "O3", "O4", "O5", "I", "G")

_G_POSES = 400  # of the region's sample, over which searches take the largest error
_G_POWER = 12.0  # they maximise a power mean: the maximum itself has no gradient where two poses tie


@dataclass(frozen=True, slots=True)
class Criterion:
    """One figure of merit of a plan; made by `criterion`.

    value: M (..., n, n) -> (...), in the unit given. larger_is_better: how to compare values.
    score: M (..., n, n) -> (...), what searches maximise. slope: M (n, n) -> d score / dM, symmetric.
    concave: score is the logarithm of a concave function that is homogeneous of degree one.
    smooth: it has a derivative everywhere.
    root: psi^root is proportional to the value or to its reciprocal, so efficiencies are ratios of psi^root.
    """

    name: str
    unit: str
    larger_is_better: bool
    value: Callable[[Array], Array]
    score: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    concave: bool
    smooth: bool
    root: float = 1.0
    added: Callable[[Array, Array], Array] | None = None

    def with_each(self, m: Array, rows: Array) -> Array:
        """Score of M + F^T F for each F, shape (k,); M (n, n), F (k, m, n)."""
        if self.added is None:
            return self.score(m + rows.swapaxes(-1, -2) @ rows)
        return self.added(m, rows)


def criterion(name: str, *, poses: int = 1, accuracy: Accuracy | None = None) -> Criterion:
    """A criterion by name.

    Args:
        name: one of `NAMES`. poses: N, which O1 divides by. accuracy: over the task region; I and G need it.
    Raises:
        InputError: no such criterion, or I or G without a task region.
    """
    if name in ("I", "G"):
        if accuracy is None:
            raise InputError(f"criterion {name} is about a task region, and none is given", key="criterion", found=name)
        return _mean_error(accuracy) if name == "I" else _worst_error(accuracy)
    if name not in NAMES:
        raise InputError("no such criterion", key="criterion", found=name, allowed=NAMES)
    return {
        "D": lambda: Criterion("D", "1", True, _logdet, _score_d, _slope_d, True, True, added=_added_d),
        "O1": lambda: Criterion(
            "O1",
            "1",
            True,
            lambda m: np.exp(0.5 * _score_d(m)) / np.sqrt(poses),
            _score_d,
            _slope_d,
            True,
            True,
            root=0.5,
            added=_added_d,
        ),
        "A": lambda: Criterion("A", "1", False, _trace_inverse, _score_a, _slope_a, True, True),
        "O5": lambda: Criterion(
            "O5", "1", True, lambda m: np.exp(0.5 * _score_5(m)), _score_5, _slope_5, True, True, 0.5
        ),
        "E": lambda: Criterion(
            "E", "1", True, lambda m: np.asarray(_eigenvalues(m)[..., 0]), _score_e, _slope_e, True, False
        ),
        "O3": lambda: Criterion("O3", "1", True, lambda m: np.exp(0.5 * _score_e(m)), _score_e, _slope_e, True, False),
        "cond": lambda: Criterion("cond", "1", False, lambda m: np.exp(-_score_2(m)), _score_2, _slope_2, False, False),
        "O2": lambda: Criterion("O2", "1", True, lambda m: np.exp(_score_2(m)), _score_2, _slope_2, False, False),
        "O4": lambda: Criterion("O4", "1", True, lambda m: np.exp(_score_4(m)), _score_4, _slope_4, False, False),
    }[name]()


def _eigenvalues(m: Array) -> Array:
    """Ascending, shape (..., n), not below zero."""
    return np.asarray(np.maximum(np.linalg.eigvalsh(m), 0.0))


def _log(value: Array) -> Array:
    """Logarithm, minus infinity at zero and below."""
    safe = np.where(value > 0, value, 1.0)
    return np.asarray(np.where(value > 0, np.log(safe), -np.inf))


def _log_ratio(numerator: Array, denominator: Array) -> Array:
    """Logarithm of a ratio, minus infinity where the numerator is zero."""
    return _log(numerator / np.where(numerator > 0, denominator, 1.0))


def _logdet(m: Array) -> Array:
    sign, logarithm = np.linalg.slogdet(m)
    return np.asarray(np.where(sign > 0, logarithm, -np.inf))


def _score_d(m: Array) -> Array:
    return np.asarray(_logdet(m) / m.shape[-1])


def _added_d(m: Array, rows: Array) -> Array:
    """det(L L^T + F^T F) = det(L L^T) det(1 + F L^-T L^-1 F^T): small determinants instead of large ones."""
    try:
        half = np.linalg.inv(np.linalg.cholesky(m)).T
    except np.linalg.LinAlgError:
        return _score_d(m + rows.swapaxes(-1, -2) @ rows)
    seen = rows @ half
    small = seen @ seen.swapaxes(-1, -2) + np.eye(rows.shape[-2])
    return np.asarray(_score_d(m) + np.linalg.slogdet(small)[1] / len(m))


def _slope_d(m: Array) -> Array:
    return np.asarray(np.linalg.inv(m) / len(m))


def _reciprocals(m: Array, power: float) -> Array:
    """sum lambda_i^-power, infinite if M is singular."""
    values = _eigenvalues(m)
    safe = np.where(values > 0, values, 1.0)
    return np.asarray(np.where(values[..., 0] > 0, np.sum(safe**-power, axis=-1), np.inf))


def _trace_inverse(m: Array) -> Array:
    return _reciprocals(m, 1.0)


def _score_a(m: Array) -> Array:
    return np.asarray(-np.log(_reciprocals(m, 1.0)))


def _slope_a(m: Array) -> Array:
    inverse = np.linalg.inv(m)
    return np.asarray(inverse @ inverse / np.trace(inverse))


def _score_5(m: Array) -> Array:
    return np.asarray(-2.0 * np.log(_reciprocals(m, 0.5)))


def _slope_5(m: Array) -> Array:
    values, vectors = np.linalg.eigh(m)
    return np.asarray((vectors * values**-1.5) @ vectors.T / np.sum(values**-0.5))


def _score_e(m: Array) -> Array:
    return _log(_eigenvalues(m)[..., 0])


def _slope_e(m: Array) -> Array:
    values, vectors = np.linalg.eigh(m)
    return np.asarray(np.outer(vectors[:, 0], vectors[:, 0]) / values[0])


def _score_2(m: Array) -> Array:
    values = _eigenvalues(m)
    return 0.5 * _log_ratio(values[..., 0], values[..., -1])


def _slope_2(m: Array) -> Array:
    values, vectors = np.linalg.eigh(m)
    first, last = vectors[:, -1], vectors[:, 0]
    return np.asarray(0.5 * (np.outer(last, last) / values[0] - np.outer(first, first) / values[-1]))


def _score_4(m: Array) -> Array:
    values = _eigenvalues(m)
    return _log_ratio(values[..., 0], np.sqrt(values[..., -1]))


def _slope_4(m: Array) -> Array:
    values, vectors = np.linalg.eigh(m)
    first, last = vectors[:, -1], vectors[:, 0]
    return np.asarray(np.outer(last, last) / values[0] - 0.5 * np.outer(first, first) / values[-1])


def linear(weight: Array) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Score -log tr(W M^-1) and its slope, for a symmetric W >= 0, shape (n, n): what A, I and bounds are made of."""

    def score(m: Array) -> Array:
        trace = _weighted_inverse(m, weight)
        return np.asarray(
            np.where(trace > 0, -_log(trace), -np.inf)
        )  # rounding may make it negative where M is singular

    def slope(m: Array) -> Array:
        inverse = np.linalg.inv(m)
        middle = inverse @ weight @ inverse
        return np.asarray(middle / np.sum(inverse * weight))

    return score, slope


def _weighted_inverse(m: Array, weight: Array) -> Array:
    """tr(W M^-1), infinite unless M is positive definite."""
    definite = np.linalg.eigvalsh(m)[..., 0] > 0
    safe = np.where(definite[..., None, None], m, np.eye(m.shape[-1]))
    return np.asarray(np.where(definite, np.einsum("...ij,ij->...", np.linalg.inv(safe), weight), np.inf))


def _mean_error(accuracy: Accuracy) -> Criterion:
    score, slope = linear(accuracy.mean)
    return Criterion(
        "I", "mm", False, lambda m: np.sqrt(_weighted_inverse(m, accuracy.mean)), score, slope, True, True, 0.5
    )


def _worst_error(accuracy: Accuracy) -> Criterion:
    region = accuracy.region.poses
    few = region[:: max(len(region) // _G_POSES, 1)]
    rows = accuracy.function.rows(few)
    whole = accuracy.function.rows(region)

    def squares(m: Array, at: Array) -> Array:
        """Squared errors at each pose of the sample, shape (..., K); infinite unless M is positive definite."""
        definite = np.linalg.eigvalsh(m)[..., 0] > 0
        inverse = np.linalg.inv(np.where(definite[..., None, None], m, np.eye(m.shape[-1])))
        flat = at.reshape(-1, m.shape[-1])
        each = np.einsum("...ki,ki->...k", flat @ inverse, flat).reshape(*m.shape[:-2], len(at), -1).sum(axis=-1)
        return np.asarray(np.where(definite[..., None], each, np.inf))

    def score(m: Array) -> Array:
        errors = squares(m, rows)
        top = errors.max(axis=-1)
        finite = np.where(np.isfinite(top), top, 1.0)
        share = np.where(np.isfinite(errors), errors, 1.0) / finite[..., None]
        smooth = finite * np.mean(share**_G_POWER, axis=-1) ** (1 / _G_POWER)
        return np.asarray(np.where(np.isfinite(top), -np.log(smooth), -np.inf))

    def slope(m: Array) -> Array:
        errors = squares(m, rows)
        weights = (errors / errors.max()) ** (_G_POWER - 1)
        weights = weights / np.sum(weights * errors)
        weight = np.einsum("k,kci,kcj->ij", weights, rows, rows, optimize=True)
        inverse = np.linalg.inv(m)
        return np.asarray(inverse @ weight @ inverse)

    return Criterion("G", "mm", False, lambda m: np.sqrt(squares(m, whole).max(axis=-1)), score, slope, False, True)
