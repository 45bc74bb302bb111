"""Covariance, learnt shares and Student t intervals against linear regression by the book, and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from symcal.fit.posterior import MOST_DOF, Posterior, posterior_of, predicted_rms
from symcal.fit.variance_components import Block, at_variances, most_likely

RNG = np.random.default_rng(2)
NAMES = ("a", "t", "c", "d")
SCALES = np.array([1.0, 0.01, 1.0, 5.0])
ROWS = RNG.normal(size=(50, 4)) / SCALES * 20
FLAT = np.full(4, np.inf)


def of_known(rows: np.ndarray, sized: bool = True) -> Posterior:
    """Of whitened rows by the parameters, noise known; the plausible sizes are a prior or nothing is."""
    prior = np.eye(4) if sized else np.zeros((0, 4))
    scaled = np.vstack([rows * SCALES, prior])
    found = at_variances((), np.column_stack([scaled, np.zeros(len(scaled))]), np.zeros(0))
    return posterior_of(NAMES, SCALES, found, (), SCALES if sized else FLAT)


def regression(x: np.ndarray, y: np.ndarray, lowest: float = -np.inf) -> Posterior:
    """Straight regression of y on the columns of x, noise unknown, nothing assumed."""
    block = Block(np.column_stack([x, -y]), len(y), lowest, np.inf)
    found = most_likely((block,), np.zeros((0, x.shape[1] + 1)), np.zeros(1), tolerance=1e-12)
    return posterior_of(NAMES[: x.shape[1]], np.ones(x.shape[1]), found, (block,), FLAT[: x.shape[1]])


def test_with_nothing_assumed_it_is_the_inverse_of_the_normal_matrix() -> None:
    found, expected = of_known(ROWS, sized=False), np.linalg.inv(ROWS.T @ ROWS)
    assert np.allclose(found.covariance, expected, rtol=1e-9)
    assert found.sigmas == pytest.approx(np.sqrt(np.diag(expected)))
    c = found.correlation()
    assert np.allclose(np.diag(c), 1)
    assert np.allclose(c, expected / np.sqrt(np.outer(np.diag(expected), np.diag(expected))))
    assert found.learnt == pytest.approx(np.ones(4))  # of nothing, everything


def test_plausible_sizes_are_a_prior() -> None:
    rows = ROWS / 20  # about as much as is known before
    found, expected = of_known(rows), np.linalg.inv(rows.T @ rows + np.diag(SCALES**-2.0))
    assert np.allclose(found.covariance, expected, rtol=1e-9)
    assert found.learnt == pytest.approx(1 - np.diag(expected) / SCALES**2)


def test_what_cannot_be_told_apart_keeps_its_plausible_size_between() -> None:
    rows = ROWS.copy()
    rows[:, 2] = rows[:, 0]  # a and c act alike
    c = of_known(rows).covariance[np.ix_([0, 2], [0, 2])]
    assert np.array([1, -1]) @ c @ [1, -1] == pytest.approx(2.0)  # as before the data
    assert np.array([1, 1]) @ c @ [1, 1] < 1e-3
    assert of_known(rows).learnt[[0, 2]] == pytest.approx(0.5, abs=1e-3)
    assert of_known(rows).correlation()[0, 2] == pytest.approx(-1.0, abs=1e-3)


def test_a_parameter_without_any_measurement_keeps_its_size_and_correlates_with_none() -> None:
    rows = ROWS.copy()
    rows[:, 1] = 0
    found = of_known(rows)
    assert found.sigmas[1] == pytest.approx(SCALES[1])
    assert found.learnt[1] == pytest.approx(0.0, abs=1e-12)
    assert np.allclose(found.correlation()[1], [0, 1, 0, 0])


def test_posterior_means_of_drawn_truths_scatter_as_it_says() -> None:
    rows = ROWS / 20
    posterior = of_known(rows)
    truth = SCALES[:, None] * RNG.normal(size=(4, 4000))
    measured = rows @ truth + RNG.normal(size=(50, 4000))
    mean = np.linalg.solve(rows.T @ rows + np.diag(SCALES**-2.0), rows.T @ measured)
    outer = np.outer(posterior.sigmas, posterior.sigmas)
    assert np.allclose(np.cov(mean - truth) / outer, posterior.covariance / outer, atol=0.06)
    inside = np.abs(mean - truth) < posterior.half_widths(0.9)[:, None]
    assert inside.mean(axis=1) == pytest.approx(0.9, abs=0.02)


def test_predicted_rms_is_that_of_many_draws() -> None:
    posterior = of_known(ROWS)
    jacobian = RNG.normal(size=(6, 3, 4)) / SCALES
    draws = RNG.multivariate_normal(np.zeros(4), posterior.covariance, size=20000)
    realised = np.sqrt(np.mean(np.sum(np.einsum("pki,di->dpk", jacobian, draws) ** 2, axis=2), axis=0))
    assert posterior.predicted_rms(jacobian) == pytest.approx(realised, rel=0.03)


def test_the_mean_prediction_over_the_training_rows_is_sigma_root_of_n_over_m() -> None:
    """tr(J C J^T) = sigma^2 n summed over the rows that made C, by the trace rule."""
    sigma = 0.3
    jacobian = RNG.normal(size=(40, 3, 4))
    rms = predicted_rms(jacobian, of_known(jacobian.reshape(-1, 4) / sigma, sized=False).covariance)
    assert np.sqrt(np.mean(rms**2)) == pytest.approx(sigma * np.sqrt(4 / 40))


@pytest.mark.parametrize("count", [3, 5, 30, 300])
def test_the_interval_of_a_mean_is_students(count: int) -> None:
    """By SciPy; count - 1 degrees of freedom."""
    y = RNG.normal(2.0, 0.7, count)
    found = regression(np.ones((count, 1)), y)
    low, high = stats.ttest_1samp(y, 0.0).confidence_interval(0.95)
    assert found.dof == pytest.approx([count - 1])
    assert found.half_widths(0.95) == pytest.approx([(high - low) / 2])


def test_the_intervals_of_a_line_are_those_of_linear_regression() -> None:
    x, n = np.sort(RNG.uniform(0, 10, 9)), 9
    y = 1 + 0.5 * x + RNG.normal(size=n)
    found, line = regression(np.column_stack([np.ones(n), x]), y), stats.linregress(x, y)
    t = stats.t.ppf(0.975, n - 2)
    assert found.half_widths() == pytest.approx([t * line.intercept_stderr, t * line.stderr])
    at = np.array([-3.0, 4.0, 20.0])
    s = np.sqrt(np.sum((y - line.intercept - line.slope * x) ** 2) / (n - 2))
    expected = t * s * np.sqrt(1 / n + (at - x.mean()) ** 2 / np.sum((x - x.mean()) ** 2))
    assert found.prediction_half_widths(np.column_stack([np.ones(3), at])) == pytest.approx(expected)


def test_known_noise_or_noise_at_its_limit_leaves_the_normal_law() -> None:
    y = RNG.normal(size=6)
    for found in (of_known(ROWS), regression(np.ones((6, 1)), y, lowest=5.0)):
        assert (found.dof == MOST_DOF).all()
        assert found.half_widths(0.95) == pytest.approx(1.96 * found.sigmas, rel=1e-4)


def test_the_uncertainty_of_the_variances_adds_what_it_moves_the_estimate() -> None:
    """[Kass1989]: J V J^T with J = dy / dphi, here by differences of the estimate, V the inverse information."""
    jacobians = [RNG.normal(size=(m, 4)) for m in (12, 9)]
    y = RNG.normal(size=4)
    parts = [
        np.column_stack([j, s * RNG.normal(size=len(j)) - j @ y]) for j, s in zip(jacobians, (0.3, 1.0), strict=True)
    ]
    blocks = (*(Block(p, len(p), -50.0, 50.0) for p in parts), Block(np.eye(4, 5), 4, -50.0, 50.0))
    nothing = np.zeros((0, 5))
    found = most_likely(blocks, nothing, np.zeros(3), tolerance=1e-10)
    step = 1e-4 * np.eye(3)
    moves = np.array([at_variances(blocks, nothing, found.phi + s).y - found.y for s in step]) / 1e-4
    added = moves.T @ (2 * np.linalg.inv(found.fisher)) @ moves
    posterior = posterior_of(NAMES, SCALES, found, blocks, SCALES)
    outer = np.outer(SCALES, SCALES)
    assert np.allclose(posterior.covariance / outer, found.covariance + added, rtol=1e-3, atol=1e-6)
    # the derivatives of the covariance that its degrees of freedom are made of
    slopes = [(at_variances(blocks, nothing, found.phi + s).covariance - found.covariance) / 1e-4 for s in step]
    assert np.allclose(posterior.slopes / outer, slopes, rtol=1e-3, atol=1e-6)
