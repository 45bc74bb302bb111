"""Tests by ranks against SciPy's, and distribution functions against `scipy.stats`."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from symcal.fit.rank_tests import larger, mean_ranks, rank_correlation

_VALUES = st.lists(st.integers(0, 30).map(float), min_size=4, max_size=40)


@given(_VALUES)
def test_ranks(values: list[float]) -> None:
    np.testing.assert_array_equal(mean_ranks(np.array(values)), stats.rankdata(values))


@pytest.mark.parametrize("n", [4, 9, 57, 400])
@pytest.mark.parametrize("ties", [False, True])
def test_rank_correlation(n: int, ties: bool) -> None:
    rng = np.random.default_rng(n)
    x = rng.normal(size=n)
    y = x + rng.normal(size=n)
    if ties:
        x, y = np.round(x), np.round(y)
    found = stats.spearmanr(x, y)
    np.testing.assert_allclose(rank_correlation(x, y), (found.statistic, found.pvalue), rtol=1e-12, atol=1e-14)


def test_rank_correlation_of_the_same_order_is_sure() -> None:
    correlation, p = rank_correlation(np.arange(20.0), np.exp(np.arange(20.0)))
    assert correlation == pytest.approx(1.0, abs=1e-15)
    assert p < 1e-100


@pytest.mark.parametrize(("n", "m"), [(3, 4), (8, 60), (60, 5), (9, 9), (57, 57), (300, 40)])
@pytest.mark.parametrize("shift", [-0.5, 0.0, 0.7])
@pytest.mark.parametrize("ties", [False, True])
def test_larger_values(n: int, m: int, shift: float, ties: bool) -> None:
    rng = np.random.default_rng(n)
    x, y = rng.normal(shift, 1.0, n), rng.normal(size=m)
    if ties:
        x, y = np.round(x, 1), np.round(y, 1)
    witness = stats.mannwhitneyu(x, y, alternative="greater").pvalue
    np.testing.assert_allclose(larger(x, y), witness, rtol=1e-12)


def test_equal_values_are_not_larger() -> None:
    assert larger(np.ones(12), np.ones(15)) == 1.0


def test_the_distribution_functions_in_use_are_those_of_scipy_stats() -> None:
    """chi2.ppf, isf, sf and f.sf, f.ppf as `symcal.fit` and `symcal.calibration` write them."""
    k = np.array([1.0, 2.0, 3.0, 6.0, 40.0, 900.0])
    p = np.array([[1e-9], [0.05], [0.5], [0.95], [1 - 1e-6]])
    x = stats.chi2.ppf(p, k)
    np.testing.assert_allclose(2 * scipy.special.gammaincinv(k / 2, p), x, rtol=1e-12)
    np.testing.assert_allclose(scipy.special.chdtri(k, p), stats.chi2.isf(p, k), rtol=1e-12)
    np.testing.assert_allclose(scipy.special.chdtrc(k, x), stats.chi2.sf(x, k), rtol=1e-12)
    ratios = np.array([[0.1], [1.0], [3.0], [50.0]])
    np.testing.assert_allclose(scipy.special.fdtrc(k, 17.5, ratios), stats.f.sf(ratios, k, 17.5), rtol=1e-12)
    np.testing.assert_allclose(scipy.special.fdtri(k, 17.5, 0.95), stats.f.ppf(0.95, k, 17.5), rtol=1e-12)
