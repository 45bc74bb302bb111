r"""Plans for a robot that has errors which the model lacks: the integrated mean squared error V + B of [Box1959].

Let the measurement be F(q) y + u(q) + noise, in units of the noise, with u a smooth random function of the joint
readings that no parameter can express. Least squares then errs by variance *and* by bias,

    J = tr(W M^-1) + mean over the region of |F(x) M^-1 X c - u(x)|^2,     u = Phi c,  X = sum_i F(q_i)^T Phi(q_i)

A plan that only knows the noise goes to the corners of joint space and lets them speak for the whole; a plan that
minimises J balances this against how well its poses represent the region. Phi is a fixed draw of random cosines
([Rahimi2007]), which is ours: [Box1959] treat polynomials. M and X are sums over the poses, so the criterion works on
rows [F, Phi].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.planning.criteria import Criterion
from symcal.planning.information import PoseInformation

Array = NDArray[np.float64]

NAME = "J"

_FEATURES = 30  # cosines per measured component
_LENGTH = 0.5  # of the working area, over which the unmodelled error keeps its sign or so


@dataclass(frozen=True, slots=True)
class ExtendedRows:
    """Rows [F, Phi] of a pose, shape (m, n + k m).

    frequencies: shape (k, dof), per unit of the working area. phases: shape (k,). amplitude: of a cosine, in units of
    the noise.
    """

    info: PoseInformation
    frequencies: Array
    phases: Array
    amplitude: float

    def rows(self, poses: Array) -> Array:
        """Shape (N, m, n + k m)."""
        seen = self.info.rows(poses)
        waves = self.amplitude * np.cos(self.info.area.unit(poses) @ self.frequencies.T + self.phases)
        unseen = np.einsum("nk,ab->nakb", waves, np.eye(seen.shape[1])).reshape(len(poses), seen.shape[1], -1)
        return np.concatenate([seen, unseen], axis=2)

    def fixed(self, information: Array) -> Array:
        """Information of the parameters alone, shape (n, n), as one of the extended rows."""
        size = self.info.rank + len(self.phases) * self.info.components
        out = np.zeros((size, size))
        out[: self.info.rank, : self.info.rank] = information
        return out


def integrated_error(
    info: PoseInformation, region: Array, rng: np.random.Generator, ratio: float
) -> tuple[ExtendedRows, Criterion]:
    """The criterion J for extended rows: its value is the root of the mean over the region, in units of the noise.

    Args:
        region: poses over which accuracy matters, shape (K, dof). ratio: rms of the unmodelled error per measured
            component, in units of its noise; 0 leaves the variance alone.
    """
    n, m = info.rank, info.components
    frequencies = rng.normal(size=(_FEATURES, info.area.dof)) / _LENGTH
    extended = ExtendedRows(
        info, frequencies, rng.uniform(0.0, 2 * np.pi, _FEATURES), ratio * float(np.sqrt(2.0 / _FEATURES))
    )
    rows = extended.rows(region)
    rows = rows[np.isfinite(rows).all(axis=(1, 2))]
    flat = rows.reshape(-1, n + _FEATURES * m) / np.sqrt(len(rows))
    within, across = flat[:, :n].T @ flat[:, :n], flat[:, :n].T @ flat[:, n:]
    own = float(np.sum(flat[:, n:] ** 2))

    def square(total: Array) -> Array:
        """J, shape (...), infinite unless the parameters' information is positive definite."""
        information, mixed = total[..., :n, :n], total[..., :n, n:]
        definite = np.linalg.eigvalsh(information)[..., 0] > 0
        inverse = np.linalg.inv(np.where(definite[..., None, None], information, np.eye(n)))
        alias = inverse @ mixed
        variance = np.einsum("...ij,ij->...", inverse, within)
        bias = np.einsum("...ir,...ir->...", alias, within @ alias - 2 * across) + own
        return np.asarray(np.where(definite, variance + np.maximum(bias, 0.0), np.inf))

    def slope(total: Array) -> Array:
        inverse = np.linalg.inv(total[:n, :n])
        alias = inverse @ total[:n, n:]
        by_mixed = inverse @ (2 * (within @ alias - across))
        by_information = by_mixed @ alias.T
        out = np.zeros_like(total)
        out[:n, :n] = -inverse @ within @ inverse - 0.5 * (by_information + by_information.T)
        out[:n, n:] = 0.5 * by_mixed
        out[n:, :n] = out[:n, n:].T
        return np.asarray(-out / square(total))

    return extended, Criterion(
        name=NAME,
        unit="sigma",
        larger_is_better=False,
        value=lambda total: np.sqrt(square(total)),
        score=lambda total: -np.log(square(total)),
        slope=slope,
        concave=False,
        smooth=True,
    )
