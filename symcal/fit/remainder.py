r"""Which smooth remainder the data ask for: length scales by marginal likelihood, and the proof on held-out poses.

A remainder is a Gaussian process in joint readings that displaces the flange (`symcal.fit.correlated_rows`). For length
scales on a grid, one per joint, its variance over that of the noise, the noise and the sizes of the parameters are
those of largest marginal likelihood; and so are the length scales, found in turns (automatic relevance,
[Rasmussen2006] sec. 5.1). All of it is for the model linearised at the estimate of the physics.

A remainder is kept when it predicts held-out poses better by more than two standard errors of the paired differences of
their squared errors, each fold with length scales and variances of its own, and its gain is above that asked of a group
of joint terms. The rule is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.correlated_rows import Field, FrozenRows, field_of
from symcal.fit.estimation import Fit, Options, variance_model
from symcal.fit.groups import enough
from symcal.fit.residual_rows import Linear, Rows
from symcal.fit.variance_components import most_likely
from symcal.fit.variances import Variances
from symcal.joints.remainder import Kernel

Array = NDArray[np.float64]
Poses = NDArray[np.intp]

MOST = 400
"""Centres at most."""
_LEFT = 0.02  # share of a displacement's variance that the centres may leave untold at a training pose
_ARM = 3  # joints of an arm, before those of its wrist
_SHORTEST, _LONGEST = -10, 4  # exponents of sqrt(2): lengths of 0.03 to 4 rad
_TRAVEL = np.pi  # the range of a prismatic joint counts as half a turn
_RATIOS = (-10.0, 14.0)  # logarithms of the process's variance over that of the noise
_TOLERANCE = 0.05  # of logarithms of variances: the marginal likelihood is flat there
_ERRORS = 2.0  # standard errors by which held-out poses must be predicted better


@dataclass(frozen=True, slots=True)
class Physics:
    """A fit without a remainder, linearised.

    rows: of the training poses. r, jacobian: residuals and slopes at the estimate, (N, m) and (N, m, n). columns: of
    the positions, by point, (P, 3). turns: slopes of positions by a displacement along the axes of the base,
    (N, P, 3, 3), zero where not measured. at: where stated priors are centred, (n,). ranges: of the joints, (dof,).
    """

    rows: Rows
    r: Array
    jacobian: Array
    columns: NDArray[np.intp]
    turns: Array
    fit: Fit
    options: Options
    at: Array
    revolute: tuple[bool, ...]
    ranges: Array

    def kernel(self, exponents: Sequence[int]) -> Kernel:
        """The kernel of length scales sqrt(2)^e, by joint."""
        sizes = 2.0 ** (np.array(exponents) / 2)
        return Kernel(self.revolute, np.where(self.revolute, sizes, sizes * self.ranges / _TRAVEL))

    def linearised(self, poses: Poses, last: Variances, values: Array | None = None) -> Linearised:
        """The model of some poses at its most likely variances, started from the last ones.

        Args:
            values: slopes and residuals, (N', m, n + 1), in place of its own.
        """
        values = self.values[poses] if values is None else values
        rows, count = self.rows, values.shape[2] - 1
        frozen = FrozenRows(
            measurement=rows.measurement,
            data=rows.data.take(poses),
            setup=rows.setup,
            kernels=rows.kernels,
            poses=(),
            z=rows.z[poses],
            seen=rows.seen[poses],
            unplaced=rows.unplaced,
            linear=Linear(
                values[:, :, count], ((slice(0, values.shape[1]), np.arange(len(poses)), values[:, :, :count]),)
            ),
        )
        model = variance_model(frozen, self.fit.free, self.options, prior_mean=self.at)
        variances = Variances(last.sigmas, last.factors, frozen.seen.astype(float))
        names, blocks, fixed = model.linearised(self.fit.x, variances)
        start, ties = model.phi(names, variances), model.ties(names)
        found = most_likely(blocks, fixed, start, ties, tolerance=_TOLERANCE)
        step = np.zeros(len(self.fit.x))
        step[model.system.index] = model.system.scales * found.y
        return Linearised(found.value, step, model.named(names, found.phi, variances))

    def with_field(self, poses: Poses, last: Variances, field: Field) -> tuple[Linearised, float]:
        """The same at the most likely ratio of the variances of displacement and noise, and that ratio.

        Rows of positions may be exchanged for any with the same squared norms: those along the field's directions, the
        rest in as few as there are parameters, and zeros.
        """
        values = self.values[poses].copy()
        along, rest = field.parts(values)
        pose, point = np.nonzero(field.turns.any(axis=(2, 3)))
        best: dict[float, Linearised] = {}

        def value(logarithm: float) -> float:
            ratio = float(np.exp(logarithm))
            scaled = (along / np.sqrt(1 + ratio * field.s**2)[:, None]).reshape(-1, rest.shape[1])
            stacked = np.vstack([scaled, rest])
            rows = np.zeros((3 * len(pose), rest.shape[1]))
            rows[: len(stacked)] = stacked
            values[pose[:, None], self.columns[point]] = rows.reshape(len(pose), 3, -1)
            near = min(best, key=lambda other: abs(other - logarithm), default=None)
            start = last if near is None else best[near].variances
            found = self.linearised(poses, start, values)
            best[logarithm] = replace(found, value=found.value + field.log_determinant(ratio))
            return best[logarithm].value

        scipy.optimize.minimize_scalar(value, bounds=_RATIOS, method="bounded", options={"xatol": 2 * _TOLERANCE})
        logarithm = min(best, key=lambda each: best[each].value)
        return best[logarithm], float(np.exp(logarithm))

    @property
    def values(self) -> Array:
        """Slopes and residuals side by side, (N, m, n + 1)."""
        return np.concatenate([self.jacobian, self.r[:, :, None]], axis=2)

    def displaced(self, poses: Poses, model: Linearised) -> Array:
        """Residuals of some poses at the estimate of a linearised model, shape (N', m)."""
        return np.asarray(self.r[poses] + self.jacobian[poses] @ model.step)


@dataclass(frozen=True, slots=True)
class Linearised:
    """value: -2 log L. step: to the estimate, of all parameters. variances: the most likely ones."""

    value: float
    step: Array
    variances: Variances


@dataclass(frozen=True, slots=True)
class Candidate:
    """A kernel with its centres among the poses, shape (M, dof), and what it brings.

    field: of the poses. ratio: variance over that of the noise. gain: twice that in log marginal likelihood. amplitude:
    standard deviation of a component, mm. plain, found: the model of the poses without it and with it.
    """

    kernel: Kernel
    centres: Array
    field: Field
    ratio: float
    gain: float
    amplitude: float
    plain: Linearised
    found: Linearised


def best_candidate(physics: Physics, poses: Poses) -> Candidate:
    """The length scales of largest marginal likelihood of some poses: all together first, wrist and arm, then each."""
    plain = physics.linearised(poses, physics.fit.variances)
    tried: dict[tuple[int, ...], Candidate] = {}

    def candidate(exponents: tuple[int, ...]) -> Candidate:
        if exponents not in tried:
            tried[exponents] = _candidate(physics, physics.kernel(exponents), poses, plain)
        return tried[exponents]

    now = (0,) * len(physics.revolute)
    for direction in _directions(len(now)):
        for sign in (-1, 1):
            while True:
                there = tuple(e + sign * d for e, d in zip(now, direction, strict=True))
                inside = all(_SHORTEST <= e <= _LONGEST for e in there)
                if not inside or candidate(there).gain <= candidate(now).gain:
                    break
                now = there
    return candidate(now)


def _directions(dof: int) -> list[tuple[int, ...]]:
    """Which exponents are changed together: all, those of the wrist, those of the arm, then each."""
    wrist = np.arange(dof) >= _ARM
    groups = [wrist, ~wrist] if dof > _ARM else []
    return [tuple(np.asarray(each, dtype=int).tolist()) for each in (np.ones(dof), *groups, *np.eye(dof))]


def candidate_of(physics: Physics, kernel: Kernel) -> Candidate:
    """What a kernel brings."""
    every = np.arange(len(physics.r))
    return _candidate(physics, kernel, every, physics.linearised(every, physics.fit.variances))


def _candidate(physics: Physics, kernel: Kernel, poses: Poses, plain: Linearised) -> Candidate:
    q = physics.rows.data.q[poses]
    centres = q[kernel.spanning(q, MOST, _LEFT)]
    field = field_of(physics.columns, physics.turns[poses], kernel.basis(q, centres))
    found, ratio = physics.with_field(poses, plain.variances, field)
    sigma = next(found.variances.sigmas[g.name] for g in physics.rows.measurement.groups if g.unit == "mm")
    gain, amplitude = plain.value - found.value, float(np.sqrt(ratio)) * sigma
    return Candidate(kernel, centres, field, ratio, gain, amplitude, plain, found)


@dataclass(frozen=True, slots=True)
class Trial:
    """What became of a remainder.

    without, given: rms position error of each training pose when it was held out, shape (N,), mm, without a remainder
    and with one.
    """

    candidate: Candidate
    without: Array
    given: Array

    @property
    def better(self) -> float:
        """Mean of the differences of squared errors, mm^2."""
        return float(np.mean(self.without**2 - self.given**2))

    @property
    def standard_error(self) -> float:
        """Of `better`."""
        return float(np.std(self.without**2 - self.given**2, ddof=1) / np.sqrt(len(self.given)))

    @property
    def kept(self) -> bool:
        return self.candidate.gain > enough(1) and self.better > _ERRORS * self.standard_error


def trial(physics: Physics, folds: Sequence[Poses]) -> Trial:
    """The proof: poses of every fold predicted from the others, with the remainder that these ask for, and without."""
    every = np.arange(len(physics.r))
    without, given = np.zeros_like(physics.r), np.zeros_like(physics.r)
    for fold in folds:
        others = np.setdiff1d(every, fold)
        own = best_candidate(physics, others)
        without[fold] = physics.displaced(fold, own.plain)
        coefficients = own.field.coefficients(-physics.displaced(others, own.found), own.ratio)
        moved = own.kernel.basis(physics.rows.data.q[fold], own.centres) @ coefficients
        given[fold] = physics.displaced(fold, own.found)
        given[fold] += _spread(physics, fold, moved)
    errors = (_position_errors(physics, residual) for residual in (without, given))
    return Trial(best_candidate(physics, every), *errors)


def _spread(physics: Physics, poses: Poses, moved: Array) -> Array:
    """What displacements (N', 3) do to the residuals, (N', m)."""
    out = np.zeros((len(poses), physics.r.shape[1]))
    out[:, physics.columns] = np.einsum("npij,nj->npi", physics.turns[poses], moved)
    return out


def _position_errors(physics: Physics, residual: Array) -> Array:
    """rms over the points of each pose, shape (N,), mm; zero where none was measured."""
    measured = physics.turns.any(axis=(2, 3))
    squares = (residual[:, physics.columns] ** 2).sum(axis=2) * measured
    return np.asarray(np.sqrt(squares.sum(axis=1) / np.maximum(measured.sum(axis=1), 1)))
