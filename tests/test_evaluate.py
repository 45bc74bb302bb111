"""Errors and their statistics, cross-validation that never sees what it is judged on, and predicted errors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import ARM, TRIANGLE, measure, random_errors
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import random_frame

from symcal.calibration import compare as module
from symcal.calibration.calibrate import calibrate
from symcal.calibration.compare import compare, cross_validate, folds
from symcal.calibration.evaluate import evaluate, expected_position_rms, statistics
from symcal.data.dataset import Dataset, readings
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.model.model import Model, State, build_model
from symcal.model.task import Task
from symcal.outputs import side_by_side
from symcal.spatial import pose_matrix

POINTS = dict(zip("abc", TRIANGLE, strict=True))


@cache
def model_of(kind: str, estimate: frozenset[str], invert: bool = False) -> Model:
    return build_model(ARM, Task.of(kind, estimate, POINTS, invert=invert))  # type: ignore[arg-type]


@given(st.lists(st.floats(0, 100), min_size=1, max_size=200))
def test_statistics_are_numpys(values: list[float]) -> None:
    found = statistics(np.array(values))
    assert found.mean == pytest.approx(np.mean(values))
    assert found.rms == pytest.approx(np.sqrt(np.mean(np.square(values))))
    assert found.p95 == pytest.approx(np.quantile(values, 0.95))
    assert (found.max, found.count) == (max(values), len(values))


def test_errors_of_poses_are_distances_and_angles_in_world(rng: np.random.Generator) -> None:
    for invert in (False, True):
        model = model_of("pose", frozenset(), invert)
        data = measure(model, random_errors(model, rng), 20, rng, 1.0, 0.01)
        found = evaluate(State(model, model.setup, np.zeros(len(model.parameters))), data)
        plain = model_of("pose", frozenset())
        predicted = pose_matrix(measure_at(plain, data.q))
        seen = pose_matrix(data.z)
        seen = np.linalg.inv(seen) if invert else seen
        assert np.allclose(found.vectors, predicted[:, :3, 3] - seen[:, :3, 3], atol=1e-9)
        turn = Rotation.from_matrix(np.swapaxes(seen[:, :3, :3], 1, 2) @ predicted[:, :3, :3])
        assert np.allclose(found.orientation, turn.magnitude(), atol=1e-9)
        assert found.pose.tolist() == list(range(20))


def measure_at(model: Model, q: np.ndarray) -> np.ndarray:
    x = np.zeros(len(model.parameters))
    return np.array([np.array(model.measurement.predict(row, x, model.setup.vector)).ravel() for row in q])


def test_errors_of_points_leave_out_what_was_not_seen(rng: np.random.Generator) -> None:
    model = model_of("position", frozenset())
    data = measure(model, {}, 6, rng, 0.1)
    z = data.z.copy().reshape(6, 3, 3)
    z[2, 1] = z[4] = np.nan
    found = evaluate(State(model, model.setup, np.zeros(len(model.parameters))), replace(data, z=z.reshape(6, 9)))
    assert found.vectors.shape == (14, 3)
    assert found.orientation is None
    assert (2, 1) not in set(zip(found.pose.tolist(), found.point.tolist(), strict=True))
    assert 4 not in found.pose
    exact = measure_at(model, data.q).reshape(6, 3, 3)
    assert np.allclose(found.vectors, exact[found.pose, found.point] - z[found.pose, found.point], atol=1e-9)


@given(st.integers(2, 60), st.integers(2, 10), st.integers(0, 2**32 - 1))
def test_folds_are_a_partition_of_nearly_equal_parts(poses: int, count: int, seed: int) -> None:
    data = Dataset(
        readings("position", ("P",)), np.zeros((poses, 1)), np.zeros((poses, 3)), ("",) * poses, ("train",) * poses
    )
    rng = np.random.default_rng(seed)
    if poses < count:
        with pytest.raises(RefusedError, match="cannot be split"):
            folds(data, count, rng)
        return
    parts = folds(data, count, rng)
    assert sorted(np.concatenate(parts).tolist()) == list(range(poses))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    assert all((np.diff(part) > 0).all() for part in parts)


def test_cross_validation_never_trains_on_what_it_is_judged_by(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Poses that are held out may say anything: the identification on the others is the same."""
    model = model_of("pose", frozenset({"base", "tool"}))
    moved = replace(model, setup=replace(model.setup, base=random_frame(rng)))
    data = measure(moved, random_errors(model, rng), 40, rng, 0.1, 2e-4)
    asked: list[tuple[set[str], Dataset]] = []
    real = module.calibrate

    def watched(m: Model, baseline: Model | None, labelled: Dataset, options: Options, **given: object):
        asked.append((set(labelled.part("train").labels), labelled))
        return real(m, baseline, labelled, options, **given)

    monkeypatch.setattr(module, "calibrate", watched)
    monkeypatch.setattr(side_by_side, "may_fork", lambda: False)  # where it can be watched
    pooled = cross_validate(model, data, Options(), 4, np.random.default_rng(5))
    parts = folds(data, 4, np.random.default_rng(5))
    assert len(asked) == 4
    for (trained, labelled), held_out in zip(asked, parts, strict=True):
        assert trained == set(data.labels) - {data.labels[i] for i in held_out}
        z = labelled.z.copy()
        z[held_out, :3] += 1e4
        other = calibrate(model, None, replace(labelled, z=z), Options(), mistakes=())
        expected = compare(other, data.take(held_out))
        for name, errors in pooled.items():
            mine = errors.vectors[np.isin(errors.pose, held_out)]
            assert np.allclose(mine, expected[name].vectors, atol=1e-12)
    assert sorted(pooled["after"].pose.tolist()) == list(range(40))
    rms = {name: statistics(e.size).rms for name, e in pooled.items()}
    assert rms["after"] < 0.5 < rms["before"]


@pytest.mark.parametrize("case", [("pose", False), ("pose", True), ("position", False)])
def test_predicted_errors_come_true(case: tuple[str, bool]) -> None:
    """Over many noises: rms of the error against truth at new poses, per pose, is what the covariance says."""
    kind, invert = case
    model = model_of(kind, frozenset({"base"}), invert)
    rng = np.random.default_rng(6)
    moved = replace(model, setup=replace(model.setup, base=random_frame(rng, 1000.0)))
    truth = random_errors(moved, rng, 0.1, 5e-4)
    test = measure(moved, truth, 40, rng)
    realised, predicted = [], []
    for seed in range(25):
        data = measure(moved, truth, 30, np.random.default_rng(seed), 0.05, 1e-4)
        found = calibrate(model, None, data, Options())
        errors = evaluate(found.states["after"], test)
        realised.append(np.bincount(errors.pose, errors.size**2) / np.bincount(errors.pose))
        predicted.append(expected_position_rms(model, found.after, test.q) ** 2)
    ratio = np.sqrt(np.mean(realised, axis=0) / np.mean(predicted, axis=0))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.12)
    assert 0.5 < ratio.min() <= ratio.max() < 1.6
