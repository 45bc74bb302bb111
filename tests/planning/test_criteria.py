"""Criteria against the singular values of the stacked Jacobian, finite differences, and simulated calibrations."""

from __future__ import annotations

import numpy as np
import pytest
from planning_cases import SIGMA, handling

from symcal.errors import InputError
from symcal.planning.criteria import NAMES, criterion
from symcal.planning.region import area_region, region_accuracy


@pytest.fixture(scope="module")
def accuracy():
    info = handling()
    return region_accuracy(info, area_region(info.area, np.random.default_rng(3), count=300))


@pytest.fixture
def stacked(rng):
    info = handling()
    return info.rows(info.area.sample(rng, 40)).reshape(-1, info.rank)


def test_values_are_those_of_the_singular_values(stacked):
    s = np.linalg.svd(stacked, compute_uv=False)
    wanted = {
        "D": 2 * np.log(s).sum(),
        "A": (s**-2).sum(),
        "E": s[-1] ** 2,
        "cond": s[0] / s[-1],
        "O1": np.exp(np.log(s).mean()) / np.sqrt(40),
        "O2": s[-1] / s[0],
        "O3": s[-1],
        "O4": s[-1] ** 2 / s[0],
        "O5": 1 / (1 / s).sum(),
    }
    found = {name: float(criterion(name, poses=40).value(stacked.T @ stacked)) for name in wanted}
    assert found == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_slope_is_the_derivative_of_the_score(name, stacked, accuracy, rng):
    merit, total = criterion(name, poses=40, accuracy=accuracy), stacked.T @ stacked
    slope = merit.slope(total)
    for _ in range(3):
        root = rng.normal(size=(2, len(total)))
        direction = root.T @ root
        h = 1e-4
        numeric = (merit.score(total + h * direction) - merit.score(total - h * direction)) / (2 * h)
        assert float(np.sum(slope * direction)) == pytest.approx(float(numeric), rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_a_batch_is_the_same_as_one_by_one(name, rng, accuracy):
    info, merit = handling(), criterion(name, poses=40, accuracy=accuracy)
    many = np.array([info.total(info.area.sample(rng, 40)) for _ in range(3)])
    np.testing.assert_allclose(merit.value(many), [merit.value(m) for m in many], rtol=1e-9)
    np.testing.assert_allclose(merit.score(many), [merit.score(m) for m in many], rtol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_a_few_rows_more_score_as_the_whole_matrix(name, rng, accuracy):
    merit = criterion(name, poses=3, accuracy=accuracy)
    base, rows = rng.normal(size=(40, 11)), rng.normal(size=(5, 3, 11))
    wanted = [merit.score(base.T @ base + f.T @ f) for f in rows]
    np.testing.assert_allclose(merit.with_each(base.T @ base, rows), wanted, rtol=1e-11)


@pytest.mark.parametrize("name", NAMES)
def test_score_agrees_with_value_on_what_is_better(name, rng, accuracy):
    info, merit = handling(), criterion(name, poses=40, accuracy=accuracy)
    many = np.array([info.total(info.area.sample(rng, 40)) for _ in range(40)])
    value = merit.value(many) if merit.larger_is_better else -merit.value(many)
    rank = np.corrcoef(np.argsort(np.argsort(value)), np.argsort(np.argsort(merit.score(many))))[0, 1]
    assert rank > (0.9 if name == "G" else 0.999)  # searches use a smooth stand-in of the largest error


@pytest.mark.parametrize("name", [n for n in NAMES if criterion(n if n not in "IG" else "D").concave and n != "G"])
def test_concave_criteria_are_bounded_by_their_slope(name, rng, accuracy):
    info, merit = handling(), criterion(name, poses=40, accuracy=accuracy)
    for _ in range(20):
        a, b = (info.total(info.area.sample(rng, int(rng.integers(8, 60)))) for _ in range(2))
        assert merit.score(b) <= merit.score(a) + np.log(np.sum(merit.slope(a) * b)) + 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_a_singular_matrix_scores_minus_infinity(name, accuracy):
    info = handling()
    vector = np.zeros((info.rank, info.rank))
    assert criterion(name, accuracy=accuracy).score(vector) == -np.inf


def test_mean_error_is_what_simulated_calibrations_show(rng):
    """Statistical law: linear fits to noisy rows err by the predicted I and G over the region; posterior means, of
    truths drawn from the plausible sizes, by the predicted error."""
    info = handling()
    region = area_region(info.area, rng, count=200)
    accuracy = region_accuracy(info, region)
    rows = info.rows(info.area.sample(rng, 40)).reshape(-1, info.rank)
    estimates = np.linalg.lstsq(rows, rng.normal(size=(len(rows), 4000)), rcond=None)[0]
    errors = np.sum((accuracy.function.rows(region.poses) @ estimates) ** 2, axis=1).mean(axis=1)
    total = rows.T @ rows
    assert float(criterion("I", accuracy=accuracy).value(total)) == pytest.approx(np.sqrt(errors.mean()), rel=0.03)
    assert float(criterion("G", accuracy=accuracy).value(total)) == pytest.approx(np.sqrt(errors.max()), rel=0.06)

    poses = info.area.sample(rng, 12)
    full = info.function.full(poses).reshape(-1, len(info.names))
    truth = rng.normal(size=(full.shape[1], 4000))
    stacked = np.vstack([full, np.eye(full.shape[1])])
    right = np.vstack([full @ truth + rng.normal(size=(len(full), 4000)), np.zeros_like(truth)])
    off = accuracy.everything.full(region.poses) @ (np.linalg.lstsq(stacked, right, rcond=None)[0] - truth)
    errors = np.sum(off**2, axis=1).mean(axis=1)
    posterior = info.posterior(poses)
    assert accuracy.mean_rms(posterior) == pytest.approx(np.sqrt(errors.mean()), rel=0.03)
    np.testing.assert_allclose(accuracy.at(region.poses, posterior), np.sqrt(errors), rtol=0.1)


def test_measured_positions_are_predicted_in_their_own_noise():
    info = handling()
    accuracy = region_accuracy(info, area_region(info.area, np.random.default_rng(0), count=50))
    poses = accuracy.region.poses
    np.testing.assert_allclose(accuracy.function.rows(poses), SIGMA * info.rows(poses), atol=1e-9)


def test_unknown_criterion_and_missing_region_are_refused():
    with pytest.raises(InputError, match="did you mean 'cond'"):
        criterion("cnd")
    with pytest.raises(InputError, match="task region"):
        criterion("I")
