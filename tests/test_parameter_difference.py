"""The difference of two estimates: its law in linear models with drawn truths, gauges, and names at a joint level."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, combinations

import numpy as np
import pytest
from scipy import stats

from symcal.calibration.parameter_difference import Difference, Estimate, difference
from symcal.fit.difference import HalfRows, holm
from symcal.fit.difference import difference as by_halves

SIZES = np.array([1.0, 0.01, 3.0, 0.2, 1.0])
DRAWS = 800


def designs(seed: int, rows: tuple[int, int] = (14, 20)) -> tuple[np.ndarray, np.ndarray]:
    """Whitened Jacobians of two plans; what they tell of a plausible size goes from a tenth of a noise to thirty."""
    rng = np.random.default_rng(seed)
    strength = np.geomspace(0.1, 30, len(SIZES))
    return tuple(rng.normal(size=(n, len(SIZES))) * rng.permutation(strength) / SIZES for n in rows)  # type: ignore[return-value]


def posterior(j: np.ndarray, truth: np.ndarray, rng: np.random.Generator) -> Estimate:
    covariance = np.linalg.inv(j.T @ j + np.diag(SIZES**-2.0))
    return Estimate(covariance @ j.T @ (j @ truth + rng.normal(size=len(j))), covariance, SIZES)


def drawn(a: np.ndarray, b: np.ndarray, size: float = 1.0, change: np.ndarray | float = 0.0) -> list[Difference]:
    rng, out = np.random.default_rng(3), []
    for _ in range(DRAWS):
        truth = size * SIZES * rng.normal(size=len(SIZES))
        out.append(difference(posterior(a, truth, rng), posterior(b, truth + change, rng)))
    return out


def test_differences_have_the_covariance_that_is_said_and_uniform_probabilities():
    found = drawn(*designs(1))
    white = np.array([each.values / each.sigmas for each in found])
    assert white.var(axis=0) == pytest.approx(1, abs=4.5 * np.sqrt(2 / DRAWS))
    p = np.array([each.p for each in found])
    assert np.mean(p < 0.05) < stats.binom.isf(1e-4, DRAWS, 0.05) / DRAWS
    assert stats.kstest(p, "uniform").pvalue > 1e-3
    assert np.mean([len(each.differing()) > 0 for each in found]) < stats.binom.isf(1e-4, DRAWS, 0.05) / DRAWS


def test_the_whole_covariance_is_that_of_many_draws():
    found = drawn(*designs(2, (40, 60)))
    values = np.array([each.values for each in found])
    said = np.median([each.covariance for each in found], axis=0)  # a few draws are far off
    ratio = np.linalg.eigvals(np.linalg.solve(said, np.cov(values.T))).real
    assert ratio == pytest.approx(1, abs=6 / np.sqrt(DRAWS / 2))


def test_a_robot_far_beyond_its_plausible_sizes_raises_no_alarm():
    p = np.array([each.p for each in drawn(*designs(1), size=20.0)])
    assert np.mean(p < 0.05) < stats.binom.isf(1e-4, DRAWS, 0.05) / DRAWS


def test_a_change_along_what_one_does_not_see_is_none_and_any_other_is():
    a, b = (10 * j for j in designs(4))
    unseen = SIZES * np.array([1.0, -1, 0, 0, 0])  # b sees nothing of it
    way = unseen / SIZES / np.linalg.norm(unseen / SIZES)
    b = (b * SIZES) @ (np.eye(5) - np.outer(way, way)) / SIZES
    found = drawn(a, b, change=2 * unseen)
    assert {each.directions for each in found} <= {3, 4}
    assert np.mean([each.p < 0.05 for each in found]) < 0.08
    seen = drawn(a, b, change=SIZES * np.array([0.0, 0, 1, 0, 0]))
    assert np.mean([each.p < 0.05 for each in seen]) > 0.95


def test_two_estimates_that_know_nothing_in_common_are_not_judged():
    rng, nothing = np.random.default_rng(0), np.zeros((4, 5))
    left, right = nothing.copy(), nothing.copy()
    left[:2, :2], right[:2, 2:4] = 30 * np.eye(2) / SIZES[:2], 30 * np.eye(2) / SIZES[2:4]
    found = difference(posterior(left, SIZES, rng), posterior(right, SIZES, rng))
    assert (found.directions, found.p, found.statistic) == (0, 1.0, 0.0)
    assert np.isnan(found.each).all()
    assert len(found.differing()) == 0


def test_a_direction_that_data_know_nothing_of_is_left_out():
    """A size that was not enlarged with the others looks as if it were known."""
    a, b = (10 * j for j in designs(5))
    way = np.ones(5) / np.sqrt(5)
    rng = np.random.default_rng(1)
    estimates = []
    for j in (a, b):
        j = (j * SIZES) @ (np.eye(5) - np.outer(way, way)) / SIZES
        precision = j.T @ j + np.diag((3 * SIZES) ** -2.0) + np.outer(way, way) * (1 - 1 / 9) / np.outer(SIZES, SIZES)
        covariance = np.linalg.inv(precision)
        mean = covariance @ j.T @ (j @ SIZES + rng.normal(size=len(j)))
        estimates.append(Estimate(mean, covariance, 3 * SIZES))
    fooled = difference(*estimates)
    assert difference(*estimates, blind=way / SIZES).directions == fooled.directions - 1


def test_noise_from_few_readings_makes_the_f_law():
    """Two equal designs whose common unknown noise was estimated with the degrees of freedom that are stated."""
    rng, dof, p = np.random.default_rng(2), 4, []
    j = 100 * designs(1)[0]
    covariance = np.linalg.inv(j.T @ j + np.diag(SIZES**-2.0))
    root = np.linalg.cholesky(covariance)
    for _ in range(DRAWS):
        off, scale = rng.normal(size=(2, 5)), rng.chisquare(2 * dof) / (2 * dof)
        a, b = (Estimate(root @ each, covariance * scale, SIZES * 1.0, dof) for each in off)
        p.append(difference(a, b).p)
    assert stats.kstest(p, "uniform").pvalue > 1e-3
    assert stats.kstest([_normal(each, 5, 2 * dof) for each in p], "uniform").pvalue < 1e-3  # a test that can fail


def _normal(p: float, k: int, dof: int) -> float:
    """What the chi-squared law would say instead."""
    return float(stats.chi2.sf(k * stats.f.isf(p, k, dof), k))


def test_names_are_those_of_closed_testing():
    """Holm is the short cut of testing every set of hypotheses by Bonferroni."""
    p = np.array([0.011, 0.04, 0.002, 0.3, np.nan, 0.012])
    known = [i for i in range(6) if np.isfinite(p[i])]
    sets = list(chain.from_iterable(combinations(known, k) for k in range(1, 6)))
    expected = [max(min(len(s) * p[list(s)].min(), 1.0) for s in sets if i in s) for i in known]
    assert holm(p)[known] == pytest.approx(expected)
    assert np.isnan(holm(p)[4])


def test_units_do_not_matter():
    rng, (a, b) = np.random.default_rng(8), designs(6)
    one, two = posterior(a, SIZES, rng), posterior(b, SIZES, rng)
    unit = np.array([1e3, 1e-3, 1.0, 57.0, 1e-6])
    turned = [
        replace(e, mean=e.mean * unit, covariance=e.covariance * np.outer(unit, unit), sizes=e.sizes * unit)
        for e in (one, two)
    ]
    plain, other = difference(one, two), difference(*turned)
    assert other.p == pytest.approx(plain.p)
    assert other.adjusted == pytest.approx(plain.adjusted, nan_ok=True)
    assert other.sigmas / unit == pytest.approx(plain.sigmas)


def test_it_is_the_covariance_that_halves_have_from_their_rows():
    """Posteriors are enough for the law that rows of both estimates give (`symcal.fit.difference`)."""
    rng = np.random.default_rng(8)
    slopes, pose = np.vstack(designs(5, (18, 27))), np.repeat(np.arange(15), 3)
    first, truth = pose < 6, SIZES * rng.normal(size=len(SIZES))
    z = slopes @ truth + rng.normal(size=len(slopes))
    estimates = []
    for own in (first, ~first):
        covariance = np.linalg.inv(slopes[own].T @ slopes[own] + np.diag(SIZES**-2.0))
        estimates.append(Estimate(np.clip(covariance @ slopes[own].T @ z[own], -SIZES, SIZES), covariance, SIZES))
    known = np.column_stack([np.eye(len(SIZES)), np.zeros(len(SIZES))])
    rows = HalfRows(slopes * SIZES, -z, pose, np.zeros_like(pose), known, [np.inf], [1.0], [1.0])
    by_rows = by_halves(rows, np.arange(15) < 6)
    by_posteriors = difference(*estimates)
    scale = np.outer(by_posteriors.sigmas, by_posteriors.sigmas)
    there = by_rows.covariance * np.outer(SIZES, SIZES)
    np.testing.assert_allclose(there / scale, by_posteriors.covariance / scale, rtol=0, atol=1e-9)
