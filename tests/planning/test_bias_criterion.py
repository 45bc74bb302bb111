"""Plans for robots with errors that the model lacks: the criterion's law, and choices among many measured poses."""

from __future__ import annotations

import numpy as np
import pytest
from planning_cases import SIGMA, handling
from scipy.optimize import least_squares

from symcal.kernels import batch_function
from symcal.planning.bias_criterion import integrated_error
from symcal.planning.search import select_poses


def test_slope_is_the_derivative_of_the_score(rng):
    info = handling()
    extended, merit = integrated_error(info, info.area.sample(rng, 200), rng, 2.0)
    rows = extended.rows(info.area.sample(rng, 25))
    rows = rows.reshape(-1, rows.shape[2])
    total, slope, h = rows.T @ rows, None, 1e-3
    slope = merit.slope(total)
    for _ in range(3):
        root = rng.normal(size=(5, len(total)))
        d = root.T @ root * 1e-3
        numeric = (merit.score(total + h * d) - merit.score(total - h * d)) / (2 * h)
        assert float(np.sum(slope * d)) == pytest.approx(float(numeric), rel=1e-4)


def test_value_is_the_error_that_simulated_fits_make(rng):
    """Statistical law: least squares on rows plus random smooth error plus noise, asked over the region."""
    info = handling()
    region = info.area.sample(rng, 150)
    extended, merit = integrated_error(info, region, rng, 3.0)
    n = info.rank
    plan, asked = extended.rows(info.area.sample(rng, 20)), extended.rows(region)
    flat = plan.reshape(-1, plan.shape[2])
    c = rng.normal(size=(flat.shape[1] - n, 3000))
    noisy = flat[:, n:] @ c + rng.normal(size=(len(flat), 3000))
    fitted = np.linalg.lstsq(flat[:, :n], noisy, rcond=None)[0]
    misses = asked[:, :, :n] @ fitted - asked[:, :, n:] @ c
    simulated = np.sqrt(np.mean(np.sum(misses**2, axis=1)))
    assert float(merit.value(flat.T @ flat)) == pytest.approx(simulated, rel=0.03)
    # the field has the stated size in every component
    assert np.std(asked[:, :, n:] @ c) == pytest.approx(3.0, rel=0.1)


def test_without_unmodelled_error_it_is_the_variance_alone(rng):
    info = handling()
    region = info.area.sample(rng, 100)
    extended, merit = integrated_error(info, region, rng, 0.0)
    plan = info.area.sample(rng, 20)
    rows = extended.rows(plan).reshape(-1, info.rank + 90)
    wanted = np.sqrt(np.mean(info.function.weighted(region, np.linalg.inv(info.total(plan)))))
    assert float(merit.value(rows.T @ rows)) == pytest.approx(wanted)


def test_planning_in_the_continuous_set_works_too(rng):
    info = handling()
    plan = select_poses(info, 15, rng, criterion="J", sample=800, random=0)
    other = select_poses(info, 15, rng, criterion="J", sample=800, random=0, method="random")
    assert plan.value < other.value
    assert plan.certificate.criterion_efficiency_lower_bound is None


def test_choice_among_measured_poses_beats_random_choices():
    """A thousand poses of a robot with harmonic joint errors and outliers; robust fits, judged on the rest."""
    info = handling()
    predict, residual = batch_function(info.measurement.predict), batch_function(info.measurement.residual)
    basis, setup = info.scales[:, None] * info.basis, info.setup.vector
    rng = np.random.default_rng(11)
    q = info.area.sample(rng, 1000)
    truth = rng.normal(size=15) * info.scales * 0.3
    wave = np.array([3e-4, 0.12, 0.12, 3e-4, 3e-4]) * np.sin(np.array([5, 0.03, 0.03, 5, 5]) * q + rng.uniform(0, 6, 5))
    z = predict(q + wave, truth, setup)[0] + rng.uniform(-0.1, 0.1, (1000, 3))
    outlier = rng.random(1000) < 0.02
    z[outlier] += rng.normal(size=(outlier.sum(), 3)) * 3

    def error(chosen):
        def loss(y):
            return (residual(q[chosen], basis @ y, setup, z[chosen])[0] / SIGMA).ravel()

        def jacobian(y):
            return (residual(q[chosen], basis @ y, setup, z[chosen])[1] @ basis / SIGMA).reshape(-1, info.rank)

        y = least_squares(loss, np.zeros(info.rank), jacobian, loss="soft_l1", f_scale=2.0).x
        rest = np.setdiff1d(np.arange(1000), chosen)
        rest = rest[~outlier[rest]]
        return np.sqrt(np.mean(np.sum((predict(q[rest], basis @ y, setup)[0] - z[rest]) ** 2, axis=1)))

    ours = [
        error(select_poses(info, 20, np.random.default_rng(s), candidates=q, random=0, method="exchange").indices)
        for s in range(4)
    ]
    drawn = [error(rng.permutation(1000)[:20]) for _ in range(50)]
    assert np.mean(ours) < np.mean(drawn)
