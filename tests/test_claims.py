"""What may be claimed from errors on poses that were not identified from."""

from __future__ import annotations

import numpy as np
import pytest

from symcal.calibration.claims import claim, extrapolation
from symcal.calibration.evaluate import Errors
from symcal.data.dataset import Dataset, readings


def errors(size: float, poses: int, rng: np.random.Generator, points: int = 2) -> Errors:
    """Normal errors of so many mm per axis."""
    pose, point = (a.ravel() for a in np.meshgrid(np.arange(poses), np.arange(points), indexing="ij"))
    return Errors(size * rng.normal(size=(poses * points, 3)), pose, point, None)


@pytest.mark.parametrize("where", ["test", "cross_validation"])
def test_a_better_robot_may_be_claimed(rng, where):
    found = {"train": {"after": errors(0.1, 50, rng)}}
    found[where] = {"before": errors(0.5, 50, rng), "after": errors(0.11, 50, rng)}
    assert claim(found) == ()


def test_without_unseen_poses_nothing_may(rng):
    (said,) = claim({"train": {"before": errors(0.5, 50, rng), "after": errors(0.1, 50, rng)}})
    assert "nothing was held out" in said


def test_a_robot_that_is_worse_on_unseen_poses(rng):
    found = {
        "train": {"after": errors(0.1, 50, rng)},
        "test": {"before": errors(0.2, 50, rng), "after": errors(0.3, 50, rng)},
        "cross_validation": {"before": errors(0.5, 50, rng), "after": errors(0.11, 50, rng)},
    }
    said = claim(found)
    assert "no better" in said[0]
    assert "do not support an accuracy claim" in said[0]
    assert "on the test poses" in said[0]
    assert "more poses would help" in said[1]


def test_chance_is_called_chance_as_often_as_it_should(rng):
    """Two equally good robots: a gain beyond two standard errors is luck, in about one case of forty."""
    lucky = 0
    for _ in range(400):
        found = {"train": {"after": errors(0.1, 30, rng)}}
        found["test"] = {"before": errors(0.1, 30, rng), "after": errors(0.1, 30, rng)}
        lucky += not any("accuracy claim" in said for said in claim(found))
    assert 1 <= lucky <= 25


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
