"""What may be claimed from errors on poses that were not identified from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import ttest_rel

from symcal.calibration.claims import Gain, extrapolation, nearest, optimism, outside
from symcal.calibration.evaluate import Errors
from symcal.data.dataset import Dataset, readings


def errors(size: float, poses: int, rng: np.random.Generator, points: int = 2) -> Errors:
    """Normal errors of so many mm per axis."""
    pose, point = (a.ravel() for a in np.meshgrid(np.arange(poses), np.arange(points), indexing="ij"))
    return Errors(size * rng.normal(size=(poses * points, 3)), pose, point, None)


@pytest.mark.parametrize("where", ["test", "cross_validation", "left_out"])
def test_a_better_robot_is_beyond_chance(rng, where):
    found = {"train": {"after": errors(0.1, 50, rng)}}
    found[where] = {"before": errors(0.5, 50, rng), "after": errors(0.11, 50, rng)}
    gain = Gain.of(found)
    assert gain is not None
    assert gain.beyond_chance
    assert gain.part == where
    assert optimism(found) == ()


def test_the_gain_is_a_paired_test(rng):
    """Its mean over its standard error is SciPy's paired t."""
    found = {"test": {"before": errors(0.2, 40, rng, 1), "after": errors(0.19, 40, rng, 1)}}
    gain = Gain.of(found)
    assert gain is not None
    expected = ttest_rel(*(found["test"][state].size ** 2 for state in ("before", "after"))).statistic
    assert gain.mean / gain.error == pytest.approx(expected)


def test_without_unseen_poses_there_is_none(rng):
    assert Gain.of({"train": {"before": errors(0.5, 50, rng), "after": errors(0.1, 50, rng)}}) is None


def test_a_robot_that_is_worse_on_unseen_poses(rng):
    found = {
        "train": {"after": errors(0.1, 50, rng)},
        "test": {"before": errors(0.2, 50, rng), "after": errors(0.3, 50, rng)},
        "cross_validation": {"before": errors(0.5, 50, rng), "after": errors(0.11, 50, rng)},
    }
    gain = Gain.of(found)
    assert gain is not None
    assert "no better" in gain.text
    assert "do not support an accuracy claim" in gain.text
    assert "on the test poses" in gain.text
    assert "more poses would help" in optimism(found)[0]


def test_a_slip_that_is_set_aside_hides_no_gain(rng):
    before, after = errors(0.5, 40, rng, 1), errors(0.1, 40, rng, 1)
    for each in (before, after):
        each.vectors[7] += [50 + 0.2 * rng.normal(), 0, 0]
    before.vectors[7] -= [1.0, 0, 0]
    found = {"test": {"before": before, "after": after}}
    hidden, shown = Gain.of(found), Gain.of(found, {7})
    assert hidden is not None
    assert shown is not None
    assert not hidden.beyond_chance
    assert shown.beyond_chance
    assert shown.after == pytest.approx(np.sqrt(np.mean(np.delete(after.size, 7) ** 2)))


def test_chance_is_called_chance_as_often_as_it_should(rng):
    """Two equally good robots: a gain beyond two standard errors is luck, in about one case of forty."""
    lucky = 0
    for _ in range(400):
        gain = Gain.of({"test": {"before": errors(0.1, 30, rng), "after": errors(0.1, 30, rng)}})
        lucky += gain is not None and gain.beyond_chance
    assert 1 <= lucky <= 25


def test_as_many_postures_lie_outside_as_exchangeable_ones_must(rng):
    """Of postures like N training poses one in N + 1 has the largest leverage of all: no matter what they are like."""
    for draw in (rng.uniform, rng.normal):
        mixed = rng.normal(size=(6, 6))
        shares = [found.share for _ in range(60) if (found := outside(*_drawn(draw, mixed), "the area")) is not None]
        assert np.mean(shares) < 2 / 41
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 4)).reshape(4, -1).T
    assert outside(corners, rng.uniform(-1, 1, (200, 4)), "the area").share == 0  # a box is held by its corners


def _drawn(draw, mixed):
    some = draw(size=(240, 6)) @ mixed
    return some[:40], some[40:]


def test_postures_outside_are_counted(rng):
    train = rng.uniform(-1, 1, (60, 3))
    assert outside(train, 10 * rng.uniform(-1, 1, (500, 3)), "the area").share > 0.95
    assert outside(train * [1, 1, 0], rng.uniform(-1, 1, (500, 3)), "the area").share == 1.0  # a joint that stood still
    tied = np.column_stack([train[:, 0], -train[:, 0] + 0.05 * train[:, 1], train[:, 2]])
    assert outside(tied, rng.uniform(-0.9, 0.9, (500, 3)), "the area").share > 0.7  # combined in new ways
    assert outside(train[:4], train, "the area") is None


def poses(train: np.ndarray, test: np.ndarray) -> Dataset:
    q = np.vstack([train, test])
    labels = tuple(str(i) for i in range(len(q)))
    return Dataset(
        readings("position", ("P",)), q, np.zeros((len(q), 3)), labels, ("train",) * len(train) + ("test",) * len(test)
    )


def test_poses_of_the_same_kind_are_no_extrapolation(rng):
    """Also correlated ones, on a grid, and with a joint that never moved."""
    mixed = rng.normal(size=(6, 6))
    for _ in range(50):
        some = rng.normal(size=(80, 6)) @ mixed * [1, 1, 1, 1, 1, 0]
        said = extrapolation(poses(some[:60], some[60:]))
        assert not said or "beyond the range" in said[0]
    grid = np.array(np.meshgrid(*[np.linspace(-1, 1, 6)] * 3)).reshape(3, -1).T
    mask = rng.random(len(grid)) < 0.8
    assert extrapolation(poses(grid[mask], grid[~mask])) == ()


def test_joints_beyond_their_range_are(rng):
    some = rng.uniform(-1, 1, (60, 6))
    far = some[:10] * [1, 1, 1.5, 1, 1, 1]
    assert "have joints beyond the range of the training poses" in extrapolation(poses(some, far))[0]


def test_new_combinations_within_the_ranges_are(rng):
    first = rng.uniform(-1, 1, (200, 1))
    tied = np.hstack([first, -first + 0.05 * rng.normal(size=(200, 1)), rng.uniform(-1, 1, (200, 1))])
    free = rng.uniform(-0.9, 0.9, (20, 3))
    assert "combine the joints in other ways" in extrapolation(poses(tied, free))[0]
    assert extrapolation(poses(tied[:150], tied[150:])) == ()
    assert extrapolation(poses(tied, free[:0])) == ()


@pytest.mark.parametrize("count", [30, 600])
def test_nearest_poses_are_those_of_a_search_one_by_one(count: int) -> None:
    rng = np.random.default_rng(count)
    points, others = rng.normal(size=(count, 4)), rng.normal(size=(12, 4))
    own, beside = nearest(points, others)
    for i in (0, 7, count - 1):
        rest = np.delete(points, i, axis=0)
        assert own[i] == pytest.approx(min(float(np.linalg.norm(points[i] - each)) for each in rest), rel=1e-12)
    for found, other in zip(beside, others, strict=True):
        assert found == pytest.approx(min(float(np.linalg.norm(other - each)) for each in points), rel=1e-12)
