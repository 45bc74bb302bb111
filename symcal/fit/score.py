r"""Score tests: whether the residuals of a fit follow something that its model does not have.

Of the linear model at the estimate, whitened, data above and what is known beforehand below,

    [J; P] y + [r; p] = e,    Q its orthonormal range,    b = (1 - Q Q^T) [r; p]

a column c that the model lacks is tested by the part c' of it that no parameter can take up at its price,

    c' = (1 - Q Q^T) [c; 0],    S = |(range of c')^T b|^2 .

b on the data rows is V^-1 r, V the covariance of the data when parameters are drawn from their priors, and |c'|^2 is
c^T V^-1 c: S is the score of the marginal likelihood over its standard deviation, squared, and parameters that are held
back by their priors are accounted for ([Cox1974] ch. 9 for scores; [Cook1982] for added variables). Then
S / (f nu) is Beta(d / 2, (nu - d) / 2), as for the F test, where f is the variance of what is left and nu its degrees
of freedom: by noise group, and, where a pose has more rows than the robot has joints, of what joints can move alone.

Joints that do not repeat make residuals larger where levers are long, and alike for all that is read of a pose. Where
poses are enough to tell, the probability is therefore that of S with the scatter of the shares of each pose for its
variance ([White1980]), with as many degrees of freedom as poses count. That it is Beta as above is Hotelling's, and
the use of it here ours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.pose_rows import Displacement, PoseRows

Array = NDArray[np.float64]

FEWEST = 3.0
"""Degrees of freedom without which no pattern is looked for."""
_GONE = 1e-6  # of a column: what is left of it is rounding
_ENOUGH = 30  # poses whose scatter tells by how much S scatters
_TINY = 1e-290  # probabilities below are about to be nothing
_ALL = 1e-12  # of the residuals: as good as all


@dataclass(frozen=True, slots=True)
class Tested:
    """A pattern of d columns, tested.

    weight: minus the logarithm of the probability when all poses scatter alike: ranks patterns. coefficients: of the
    columns, as they would be estimated, shape (d,); zero of those that others can stand for.
    pattern: what they explain of the rows when all else is estimated again, shape (k,), in standard deviations.
    """

    p: float
    weight: float
    columns: int
    coefficients: Array
    pattern: Array


@dataclass(frozen=True, slots=True)
class Score:
    """Residuals of a fit with what its parameters take up; made by `score_of`.

    rows: whitened anew, so that those of every noise group have variance one. q: shape (K, n'), b: shape (K,), the data
    first. variance, dof: f and nu, beyond that of the groups. scales: by which rows were multiplied, shape (k,).
    uneven: the poses are enough to tell how they scatter, which they need not do alike.
    """

    rows: PoseRows
    q: Array
    b: Array
    variance: float
    dof: float
    scales: Array
    uneven: bool

    def test(self, columns: Array) -> Tested | None:
        """Whether the residuals follow some columns, shape (k, d); None where it cannot be told."""
        directions, back = self._left(columns)
        d = directions.shape[1]
        if not d or self.dof - d < 1:
            return None
        along = directions.T @ self.b
        share = min(float(along @ along) / (self.variance * self.dof), 1 - _ALL)
        p = _probability(d, self.dof, share)
        return Tested(
            p=self._by_pose(directions, along) if self.uneven else p,
            weight=-float(np.log(p)) if p > _TINY else -(self.dof - d) / 2 * float(np.log1p(-share)),
            columns=d,
            coefficients=-back @ along,
            pattern=(directions @ along)[: len(self.scales)] / self.scales,
        )

    def with_columns(self, columns: Array) -> Score:
        """The same where the model has these columns."""
        directions, _ = self._left(columns)
        along = directions.T @ self.b
        left = max(self.variance * self.dof - float(along @ along), _ALL)
        dof = self.dof - directions.shape[1]
        b = self.b - directions @ along
        return replace(self, q=np.hstack([self.q, directions]), b=b, variance=left / dof, dof=dof)

    def _left(self, columns: Array) -> tuple[Array, Array]:
        """Orthonormal directions that the model lacks, shape (K, d'), and coefficients by them, shape (d, d')."""
        own = np.zeros((len(self.b), columns.shape[1]))
        own[: len(columns)] = columns * self.scales[:, None]
        size = np.linalg.norm(own, axis=0)
        kept: list[int] = []
        basis = np.zeros((len(self.b), 0))
        for i in np.flatnonzero(size > 0):
            rest = own[:, i] / size[i]
            for _ in range(2):
                rest = rest - self.q @ (self.q.T @ rest)
                rest = rest - basis @ (basis.T @ rest)
            length = float(np.linalg.norm(rest))
            if length > _GONE:
                kept.append(int(i))
                basis = np.column_stack([basis, rest / length])
        back = np.zeros((columns.shape[1], len(kept)))
        if kept:
            back[kept] = scipy.linalg.solve_triangular(np.triu(basis.T @ own[:, kept]), np.eye(len(kept)))
        return basis, back

    def _by_pose(self, directions: Array, along: Array) -> float:
        """Probability of S where the scatter of what each pose adds to it is its variance."""
        blocks, beyond = self.rows.by_pose(directions[: len(self.scales)]), directions[len(self.scales) :]
        own = np.einsum("nhd,nh->nd", blocks, self.rows.by_pose(self.data))
        took = np.einsum("nhd,nhj->ndj", blocks, self.rows.by_pose(self.taken))
        weight = np.sum(blocks**2, axis=(1, 2))
        left = 1 - float(np.sum(took**2)) / float(weight.sum())
        triangle = np.linalg.qr(np.vstack([own / np.sqrt(left), beyond]), mode="r")  # beyond: known beforehand
        count = float(np.sum(directions**2) ** 2 / np.sum(weight**2))
        if np.abs(np.diag(triangle)).min() < _ALL * np.abs(triangle).max() or count < len(along) + 1:
            return 1.0
        statistic = scipy.linalg.solve_triangular(triangle, along, trans="T")
        return _probability(len(along), count, float(statistic @ statistic) / count)

    @property
    def taken(self) -> Array:
        """Q of the data rows, shape (k, n')."""
        return self.q[: len(self.scales)]

    @property
    def data(self) -> Array:
        """b of the data rows, shape (k,)."""
        return self.b[: len(self.scales)]

    def sizes(self) -> tuple[Array, Array]:
        """By pose the squared residuals over their expectation times the number of rows, and that number, (N,)."""
        count = np.bincount(self.rows.pose)
        free = count - np.bincount(self.rows.pose, np.sum(self.taken**2, axis=1))
        squares = np.bincount(self.rows.pose, self.data**2) / self.variance
        return np.asarray(count * squares / np.maximum(free, _GONE)), np.asarray(count, dtype=np.float64)

    def neighbours(self, moved: Displacement) -> tuple[float, float] | None:
        """Correlation of what looks like displacements of consecutive poses, and its probability when there is none.

        The moments of the quadratic form are those of residuals, not of errors ([Durbin1950]); the tail is the
        normal law's.
        """
        block = self.rows.by_pose(moved.columns * self.scales[:, None])
        seen = np.flatnonzero(block.any(axis=(1, 2)))
        if len(seen) < FEWEST + 1:
            return None
        axes, triangle = np.linalg.qr(block[seen])
        sign = np.sign(np.einsum("nii->ni", triangle))
        axes = axes * sign[:, None, :]
        g = np.einsum("nha,nh->na", axes, self.rows.by_pose(self.data)[seen])
        h = np.einsum("nha,nhj->naj", axes, self.rows.by_pose(self.taken)[seen])
        free = float((sign**2).sum() - np.sum(h**2))
        total = float(np.sum(g**2))
        if free < FEWEST or total == 0:
            return None
        flat = h.reshape(-1, h.shape[2])
        mean = -float(np.sum(flat * _beside(h).reshape(flat.shape))) / free
        shifted = (_beside(h) - mean * h).reshape(flat.shape)
        squares = (len(seen) - 1) * g.shape[1] / 2 + mean**2 * float((sign**2).sum())
        spread = squares - 2 * float(np.sum(shifted**2)) + float(np.sum((flat.T @ shifted) * (shifted.T @ flat)))
        off = float(np.sum(g * (_beside(g) - mean * g))) / (total / free)
        if spread <= 0:
            return None
        return float(np.sum(g * _beside(g)) / total), float(scipy.special.ndtr(-off / np.sqrt(2 * spread)))


def _probability(columns: int, dof: float, share: float) -> float:
    """That a share of so many degrees of freedom falls to some columns."""
    return float(scipy.special.betaincc(columns / 2, (dof - columns) / 2, min(share, 1 - _ALL)))


def _beside(values: Array) -> Array:
    """Half the sum of the values of the poses before and after."""
    out = np.zeros_like(values)
    out[1:] += values[:-1] / 2
    out[:-1] += values[1:] / 2
    return out


def score_of(rows: PoseRows, slopes: Array, known: Array, joints: Array) -> Score | None:
    """The residuals of a fit and what its parameters take up.

    Args:
        slopes: whitened rows of the data by the free parameters, shape (k, n'). known: whitened [P, p] of what is known
            beforehand, shape (l, n' + 1). joints: the rows by the joints' coordinates, shape (k, dof).
    Returns:
        None where too little is left over to say anything.
    """
    scales = np.ones(len(rows.r))
    for _ in range(2):
        stacked = np.vstack([slopes * scales[:, None], known[:, :-1]])
        q = np.asarray(np.linalg.qr(stacked)[0])
        b = np.concatenate([rows.r * scales, known[:, -1]])
        for _ in range(2):
            b = b - q @ (q.T @ b)
        if (scales != 1).any():
            break
        for group in np.unique(rows.group):
            own = np.flatnonzero(rows.group == group)
            free = len(own) - float(np.sum(q[own] ** 2))
            squares = float(np.sum(b[own] ** 2))
            if free > 1 and squares > 0:
                scales[own] = np.sqrt(free / squares)
        if (scales == 1).all():
            break
    poses = len(np.unique(rows.pose))
    score = Score(rows, q, b, 1.0, 0.0, scales, uneven=poses >= _ENOUGH)
    variance, dof = _common(score, joints)
    return replace(score, variance=variance, dof=dof) if dof > FEWEST and variance > 0 else None


def _common(score: Score, joints: Array) -> tuple[float, float]:
    """Variance and degrees of freedom of the residuals; of what the joints can move, where poses have more rows."""
    rows, taken, data = score.rows, score.taken, score.data
    if np.bincount(rows.pose).max() <= joints.shape[1]:
        dof = len(data) - float(np.sum(taken**2))
        return float(data @ data) / dof if dof > 0 else 0.0, dof
    axes, size, _ = np.linalg.svd(rows.by_pose(joints * score.scales[:, None]), full_matrices=False)
    axes = axes * (size > _GONE * size.max(axis=1, initial=0.0, keepdims=True))[:, None, :]
    g = np.einsum("nha,nh->na", axes, rows.by_pose(data))
    h = np.einsum("nha,nhj->naj", axes, rows.by_pose(taken))
    dof = float(np.sum(axes**2) - np.sum(h**2))
    return float(np.sum(g**2)) / dof if dof > 0 else 0.0, dof
