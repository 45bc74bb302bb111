"""Covariance on the identifiable subspace against linear least squares and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from test_identifiability import plain

from symcal.identification.identifiability import analyse
from symcal.identification.uncertainty import correlation, covariance, predicted_rms, sigma_interval, sigmas

RNG = np.random.default_rng(2)
SCALES = (1.0, 0.01, 1.0, 5.0)
ROWS = RNG.normal(size=(50, 4)) / np.array(SCALES) * 20


def test_of_a_full_rank_problem_it_is_the_inverse_of_the_normal_matrix() -> None:
    seen = analyse(ROWS, plain("a t c d", SCALES))
    assert seen.rank == 4
    expected = np.linalg.inv(ROWS.T @ ROWS)
    assert np.allclose(covariance(seen), expected, rtol=1e-9)
    assert sigmas(seen) == pytest.approx(np.sqrt(np.diag(expected)).tolist())
    c = correlation(seen)
    assert np.allclose(np.diag(c), 1)
    assert np.allclose(c, expected / np.sqrt(np.outer(np.diag(expected), np.diag(expected))))


def test_with_a_gauge_it_is_the_pseudo_inverse_in_scaled_coordinates() -> None:
    rows = ROWS.copy()
    rows[:, 2] = rows[:, 0]  # a and c cannot be told apart
    seen = analyse(rows, plain("a t c d", SCALES))
    assert seen.rank == 3
    scaled = rows * SCALES
    expected = np.diag(SCALES) @ np.linalg.pinv(scaled.T @ scaled, rcond=1e-9, hermitian=True) @ np.diag(SCALES)
    assert np.allclose(covariance(seen), expected, rtol=1e-7)
    found = sigmas(seen)
    assert found[0] is None
    assert found[2] is None
    assert found[1] == pytest.approx(np.sqrt(expected[1, 1]))
    assert found[3] == pytest.approx(np.sqrt(expected[3, 3]))


def test_minimum_norm_estimates_scatter_as_it_says() -> None:
    rows = ROWS.copy()
    rows[:, 2] = rows[:, 0]
    seen = analyse(rows, plain("a t c d", SCALES))
    scaled = rows * SCALES
    noise = RNG.normal(size=(50, 4000))
    estimates = np.array(SCALES)[:, None] * (np.linalg.pinv(scaled, rcond=1e-9) @ noise)
    assert np.allclose(
        np.cov(estimates) / np.outer(SCALES, SCALES), covariance(seen) / np.outer(SCALES, SCALES), atol=2e-4
    )


def test_a_parameter_without_any_measurement_has_no_sigma_and_no_correlation() -> None:
    rows = ROWS.copy()
    rows[:, 1] = 0
    seen = analyse(rows, plain("a t c d", SCALES))
    assert sigmas(seen)[1] is None
    assert not correlation(seen)[1].any()


def test_predicted_rms_is_that_of_many_draws() -> None:
    seen = analyse(ROWS, plain("a t c d", SCALES))
    c = covariance(seen)
    jacobian = RNG.normal(size=(6, 3, 4)) / SCALES
    draws = RNG.multivariate_normal(np.zeros(4), c, size=20000)
    realised = np.sqrt(np.mean(np.sum(np.einsum("pki,di->dpk", jacobian, draws) ** 2, axis=2), axis=0))
    assert predicted_rms(jacobian, c) == pytest.approx(realised, rel=0.03)


def test_the_mean_prediction_over_the_training_rows_is_sigma_root_of_n_over_m() -> None:
    """tr(J C J^T) = sigma^2 n summed over the rows that made C, by the trace rule."""
    sigma = 0.3
    jacobian = RNG.normal(size=(40, 3, 4))
    seen = analyse(jacobian.reshape(-1, 4) / sigma, plain("a b c d"))
    rms = predicted_rms(jacobian, covariance(seen))
    assert np.sqrt(np.mean(rms**2)) == pytest.approx(sigma * np.sqrt(4 / 40))


@pytest.mark.parametrize("dof", [3, 30, 300])
def test_the_interval_of_a_sigma_holds_the_truth_as_often_as_it_says(dof: int) -> None:
    estimates = 2.0 * np.sqrt(stats.chi2.rvs(dof, size=3000, random_state=1) / dof)
    inside = [low < 2.0 < high for low, high in (sigma_interval(s, dof, 0.9) for s in estimates)]
    assert np.mean(inside) == pytest.approx(0.9, abs=0.025)
