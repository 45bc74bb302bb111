"""Many identifications at once against one at a time, and the mirror of the last link."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from study_case import outcome

from symcal.data.dataset import Dataset, readings
from symcal.fit.estimation import Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.fit.many import fit_many
from symcal.paper.mirror import canonical
from symcal.paper.repetitions import cramer_rao, judge, measure
from symcal.paper.setting import positions


def single(setting, q, z, model=None):
    model = model or setting.model
    names = tuple(str(i) for i in range(len(q)))
    data = Dataset(readings("position", ("P",)), q, z, names, ("train",) * len(q))
    rows = rows_of(model.measurement, data, model.setup, model.residuals)
    return fit(rows, model.parameters.names, Options(sigma={"position": setting.sigma}, scales="stated"))


@pytest.mark.parametrize("fresh", [False, True])
def test_many_fits_are_the_fits_of_the_estimator(rng, fresh):
    setting = outcome().study.setting
    count = 12
    shape = (count, 40) if fresh else (40,)
    q = setting.info.area.sample(rng, int(np.prod(shape))).reshape(*shape, -1)
    z = measure(setting, q, count, rng)
    many = fit_many(setting.model, q, z, setting.sigma)
    assert (many.rank == 11).all()
    for i in range(count):
        one = single(setting, q[i] if fresh else q, z[i])
        assert one.identifiability.rank == 11
        # in units of what the data leave open, and as positions
        seen = one.identifiability
        off = seen.seen.T @ ((many.x[i] - one.x) / seen.scales)
        assert np.abs(off * seen.seen_values).max() < 1e-3
        gap = positions(setting, setting.test_poses, many.x[i]) - positions(setting, setting.test_poses, one.x)
        assert np.abs(gap).max() < 1e-4


def test_they_minimise_the_penalised_sum(rng):
    """The gradient of |r / sigma|^2 + |x / scale|^2 vanishes, by finite differences."""
    setting = outcome().study.setting
    model, scales = setting.model, setting.model.parameters.scales
    q = setting.info.area.sample(rng, 40)
    z = measure(setting, q, 1, rng)
    x = fit_many(model, q, z, setting.sigma).x[0]

    def cost(u):
        r = positions(setting, q, u * scales) - z[0]
        return np.sum((r / setting.sigma) ** 2) + np.sum(u**2)

    step = 1e-4
    for i in range(len(x)):
        h = step * np.eye(len(x))[i]
        slope = (cost(x / scales + h) - cost(x / scales - h)) / (2 * step)
        curvature = (cost(x / scales + h) - 2 * cost(x / scales) + cost(x / scales - h)) / step**2
        assert abs(slope / curvature) < 1e-3


def test_the_bound_is_what_finite_differences_say(rng):
    setting = outcome().study.setting
    scales, truth = setting.model.parameters.scales, setting.truth
    q = setting.info.area.sample(rng, 40)

    def slopes(poses):
        step = 1e-4
        return np.stack(
            [
                (positions(setting, poses, truth + h) - positions(setting, poses, truth - h)).ravel() / (2 * step)
                for h in step * np.diag(scales)
            ],
            axis=1,
        )

    _, s, vt = np.linalg.svd(slopes(q) / setting.sigma, full_matrices=False)
    asked = slopes(setting.test_poses)
    spread = asked @ (vt[s > 1].T / s[s > 1])
    bound = np.sqrt(np.sum(spread**2) / len(setting.test_poses))
    assert cramer_rao(setting, q) == pytest.approx(bound, rel=1e-6)
    many = cramer_rao(setting, np.stack([q, q[::-1]]))
    np.testing.assert_allclose(many, bound, rtol=1e-6)


def test_the_true_robot_is_judged_faultless():
    setting = outcome().study.setting
    figures = judge(setting, np.stack([setting.truth] * 60), np.random.default_rng(0))
    np.testing.assert_allclose(figures[:, 2:], 0.0, atol=1e-9)
    # noise uniform in a cube of half width 0.1: mean norm 0.0961, never beyond its corner
    assert figures[:, 0].mean() == pytest.approx(0.0961, abs=5e-4)
    assert figures[:, 1].max() < 0.1 * np.sqrt(3)


def test_repetitions_have_the_spread_that_the_covariance_predicts():
    """The sample covariance of identified errors along the seen directions is the inverse information."""
    study = outcome().study
    plan = study.plans["random"]
    errors = study.repetitions.errors["random"]
    seen = study.simulation_2["random"].fit.identifiability
    along = (errors / seen.scales) @ seen.seen * seen.seen_values
    covariance = np.cov(along.T)
    assert len(plan.poses) == 40
    np.testing.assert_allclose(covariance, np.eye(seen.rank), atol=6 / np.sqrt(len(errors)))


@given(
    a=st.floats(-2, 2),
    theta=st.floats(-20, 20),
    turns=st.integers(-3, 3),
)
def test_the_mirror_moves_no_point_and_the_canonical_form_is_one(a, theta, turns):
    setting = outcome().study.setting
    parameters = setting.model.parameters
    x = setting.truth.copy()
    x[parameters.index("a_5")], x[parameters.index("theta_5")] = a, theta
    mirrored = x.copy()
    mirrored[parameters.index("a_5")] = -a
    mirrored[parameters.index("theta_5")] = theta + (2 * turns + 1) * np.pi
    poses = setting.test_poses[:20]
    np.testing.assert_allclose(positions(setting, poses, mirrored), positions(setting, poses, x), atol=1e-9)
    one, _ = canonical(x, parameters, 5)
    np.testing.assert_allclose(positions(setting, poses, one), positions(setting, poses, x), atol=1e-9)
    assert abs(one[parameters.index("theta_5")]) <= np.pi / 2 + 1e-9 or a == 0 or abs(a) < 1e-6
    again, changed = canonical(one, parameters, 5)
    np.testing.assert_allclose(again, one, atol=1e-9)
    assert not changed or abs(abs(one[parameters.index("theta_5")]) - np.pi / 2) < 1e-6
