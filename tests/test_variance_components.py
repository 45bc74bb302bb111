"""Restricted marginal likelihood against the dense model, its textbook formulas and SciPy's minimisers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime, minimize

from symcal.fit.variance_components import Block, Tie, at_variances, compressed, most_likely

FLAT, SIZED, COUNTS = 3, 6, (40, 25)  # fixed effects, random effects, rows of two noise groups
TRUTH = np.log([0.04, 4.0, 2.25])  # variances of the noise groups and of the sizes
OPEN = (-np.inf, np.inf)


@dataclass(frozen=True)
class Linear:
    """r = -J y + noise: rows of two noise groups, of known unit noise, and the random effects' centre."""

    jacobians: tuple[np.ndarray, ...]
    residuals: tuple[np.ndarray, ...]
    known: np.ndarray
    centre: np.ndarray

    @property
    def blocks(self) -> tuple[Block, ...]:
        parts = [np.column_stack([j, r]) for j, r in zip(self.jacobians, self.residuals, strict=True)]
        parts.append(np.column_stack([np.zeros((SIZED, FLAT)), np.eye(SIZED), self.centre]))
        return tuple(Block(compressed(rows), len(rows), *OPEN) for rows in parts)

    @property
    def design(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fixed effects X, random effects Z and observations of the marginal model, centre taken off."""
        jacobian = np.vstack([*self.jacobians, self.known[:, :-1]])
        z = jacobian[:, FLAT:]
        return jacobian[:, :FLAT], z, z @ self.centre - np.concatenate([*self.residuals, self.known[:, -1]])

    def slopes(self, phi: np.ndarray) -> list[np.ndarray]:
        """dV / dphi of every variance."""
        _, z, _ = self.design
        group = np.repeat([0, 1, 2], [*COUNTS, len(self.known)])
        noises = [np.exp(phi[k]) * np.diag((group == k).astype(float)) for k in (0, 1)]
        return [*noises, np.exp(phi[2]) * z @ z.T]

    def dense(self, phi: np.ndarray) -> tuple[float, np.ndarray]:
        """-2 log L = log|V| + log|X^T V^-1 X| + r^T P r, and P."""
        x, _, observed = self.design
        v = sum(self.slopes(phi), np.diag((np.arange(len(observed)) >= sum(COUNTS)).astype(float)))
        inverse = np.linalg.inv(v)
        inner = x.T @ inverse @ x
        p = inverse - inverse @ x @ np.linalg.solve(inner, x.T @ inverse)
        value = np.linalg.slogdet(v)[1] + np.linalg.slogdet(inner)[1] + observed @ p @ observed
        return float(value), p


def drawn(seed: int, jacobians: tuple[np.ndarray, ...] | None = None) -> Linear:
    rng = np.random.default_rng(seed)
    n = FLAT + SIZED
    jacobians = jacobians or tuple(rng.normal(size=(m, n)) for m in (*COUNTS, 5))
    y = np.concatenate([rng.normal(size=FLAT) * 10, np.exp(TRUTH[2] / 2) * rng.normal(size=SIZED)])
    centre = rng.normal(size=SIZED)
    y[FLAT:] -= centre
    noises = [*np.exp(TRUTH[:2] / 2), 1.0]
    r = [s * rng.normal(size=len(j)) - j @ y for j, s in zip(jacobians, noises, strict=True)]
    return Linear(tuple(jacobians[:2]), tuple(r[:2]), np.column_stack([jacobians[2], r[2]]), centre)


phis = st.lists(st.floats(-6, 6), min_size=3, max_size=3).map(np.array)


@given(phis, phis, st.integers(0, 20))
def test_the_value_is_that_of_the_dense_marginal_model_up_to_a_constant(a: np.ndarray, b: np.ndarray, s: int) -> None:
    model = drawn(s)
    mine = at_variances(model.blocks, model.known, a).value - at_variances(model.blocks, model.known, b).value
    witness, other = model.dense(a)[0], model.dense(b)[0]
    assert mine == pytest.approx(witness - other, abs=1e-8 * (1 + abs(witness) + abs(other)))


@given(phis)
def test_slope_moves_and_fisher_matrix_are_the_derivatives(phi: np.ndarray) -> None:
    """Central differences of the value and of the minimiser; tr(P V_i P V_j) by the textbook ([Harville1977])."""
    model = drawn(1)
    found = at_variances(model.blocks, model.known, phi)
    step = 1e-4
    for i, direction in enumerate(np.eye(3) * step):
        up, down = (at_variances(model.blocks, model.known, phi + sign * direction) for sign in (1, -1))
        change = (up.value - down.value) / (2 * step)
        assert found.slope[i] == pytest.approx(change, rel=1e-5, abs=1e-7 * (1 + abs(found.value)))
        assert np.allclose(found.moves[i], (up.y - down.y) / (2 * step), rtol=1e-5, atol=1e-7)
    products = [model.dense(phi)[1] @ v for v in model.slopes(phi)]
    assert np.allclose(found.fisher, [[np.trace(a @ b) for b in products] for a in products], rtol=1e-7, atol=1e-9)


def test_y_and_covariance_are_the_generalised_least_squares_solution() -> None:
    model = drawn(2)
    found = at_variances(model.blocks, model.known, TRUTH)
    rows = np.vstack([*(b.rows * np.exp(-v / 2) for b, v in zip(model.blocks, TRUTH, strict=True)), model.known])
    assert np.allclose(found.y, np.linalg.lstsq(rows[:, :-1], -rows[:, -1], rcond=None)[0], atol=1e-10)
    assert np.allclose(found.covariance, np.linalg.inv(rows[:, :-1].T @ rows[:, :-1]), rtol=1e-9, atol=1e-14)


def test_at_the_truth_slopes_have_mean_zero_and_twice_the_fisher_matrix_as_covariance() -> None:
    jacobians = tuple(np.random.default_rng(3).normal(size=(m, FLAT + SIZED)) for m in (*COUNTS, 5))
    models = [drawn(seed, jacobians) for seed in range(2000)]
    slopes = np.array([at_variances(m.blocks, m.known, TRUTH).slope for m in models])
    fisher = at_variances(models[0].blocks, models[0].known, TRUTH).fisher
    sigma = np.sqrt(2 * np.diag(fisher))
    assert np.abs(slopes.mean(axis=0) / sigma).max() < 3.5 / np.sqrt(len(models))
    assert np.allclose(np.cov(slopes.T) / np.outer(sigma, sigma), 2 * fisher / np.outer(sigma, sigma), atol=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_from_every_start_the_maximum_is_scipys(seed: int) -> None:
    model = drawn(seed)
    witness = min(
        (minimize(lambda phi: model.dense(phi)[0], start, method="BFGS") for start in (TRUTH, TRUTH + 2, TRUTH - 1)),
        key=lambda each: each.fun,
    )
    for start in (TRUTH, np.zeros(3), TRUTH + np.array([6, -6, 5]), TRUTH - 4):
        found = most_likely(model.blocks, model.known, start, tolerance=1e-9)
        assert model.dense(found.phi)[0] <= witness.fun + 1e-9
        assert found.phi == pytest.approx(witness.x, abs=2e-3)  # as near as differences bring SciPy
        assert np.abs(found.slope).max() < 1e-4
        assert not found.held.any()


@settings(max_examples=10)
@given(st.integers(0, 100))
def test_a_limit_holds_and_the_others_are_the_best_beside_it(seed: int) -> None:
    model = drawn(seed)
    low = TRUTH[0] + 3  # more noise in the first group than there is
    blocks = (replace(model.blocks[0], lowest=low), *model.blocks[1:])
    found = most_likely(blocks, model.known, TRUTH, tolerance=1e-9)
    assert found.phi[0] == low
    assert found.held.tolist() == [True, False, False]
    witness = minimize(lambda phi: model.dense(np.array([low, *phi]))[0], TRUTH[1:], method="BFGS")
    assert found.phi[1:] == pytest.approx(witness.x, abs=1e-3)
    high = TRUTH[2] - 8
    capped = most_likely(
        (*model.blocks[:2], replace(model.blocks[2], highest=high)), model.known, TRUTH, tolerance=1e-9
    )
    assert capped.phi[2] == high
    assert capped.held[2]


@pytest.mark.parametrize("width", [0.1, 0.5, 3.0])
def test_a_width_adds_a_cauchy_law_about_one(width: float) -> None:
    """The density 1 / (1 + (phi / w)^2), twice over in -2 log L; pulled to one inside, let go far outside."""
    model = drawn(5)
    blocks = (*model.blocks[:2], replace(model.blocks[2], width=width))

    def value(phi: np.ndarray) -> float:
        return model.dense(phi)[0] - 2 * float(np.log(1 / (1 + (phi[2] / width) ** 2)))

    for phi in (np.zeros(3), np.array([1.0, -1.0, 0.3]), np.array([0.0, 1.0, -4.0])):
        mine = at_variances(blocks, model.known, phi)
        assert mine.value - at_variances(blocks, model.known, TRUTH).value == pytest.approx(value(phi) - value(TRUTH))
        assert mine.slope == pytest.approx(approx_fprime(phi, value), rel=1e-4, abs=1e-3)
    found, without = (most_likely(b, model.known, TRUTH, tolerance=1e-9) for b in (blocks, model.blocks))
    assert abs(found.phi[2]) < abs(without.phi[2])
    witness = minimize(value, found.phi + 0.1, method="BFGS")
    assert value(found.phi) <= witness.fun + 1e-9
    assert found.phi == pytest.approx(witness.x, abs=5e-3)


def test_a_tie_adds_a_cauchy_law_about_a_difference() -> None:
    model = drawn(5)
    tie = Tie(0, 1, 0.7, 0.4)

    def value(phi: np.ndarray) -> float:
        return model.dense(phi)[0] + 2 * float(np.log(1 + ((phi[1] - phi[0] - 0.7) / 0.4) ** 2))

    for phi in (np.zeros(3), np.array([1.0, -1.0, 0.3]), np.array([0.0, 2.0, -1.0])):
        mine, zero = (at_variances(model.blocks, model.known, p, (tie,)) for p in (phi, TRUTH))
        assert mine.value - zero.value == pytest.approx(value(phi) - value(TRUTH))
        assert mine.slope == pytest.approx(approx_fprime(phi, value), rel=1e-4, abs=1e-3)
    found = most_likely(model.blocks, model.known, TRUTH, (tie,), tolerance=1e-9)
    assert found.phi == pytest.approx(minimize(value, found.phi + 0.1, method="BFGS").x, abs=5e-3)


def test_nothing_unknown_is_a_model_too() -> None:
    rows = np.random.default_rng(1).normal(size=(12, 4))
    found = most_likely((), rows, np.zeros(0), tolerance=1e-6)
    assert found.y == pytest.approx(np.linalg.lstsq(rows[:, :3], -rows[:, 3], rcond=None)[0])
    assert found.moves.shape == (0, 3)
    assert found.fisher.shape == (0, 0)


@given(st.integers(1, 30), st.integers(0, 1000))
def test_a_triangle_has_the_norms_of_the_rows_it_stands_for(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, y = rng.normal(size=(count, 6)), rng.normal(size=6)
    assert len(compressed(rows)) <= 6
    assert np.linalg.norm(compressed(rows) @ y) == pytest.approx(np.linalg.norm(rows @ y))
