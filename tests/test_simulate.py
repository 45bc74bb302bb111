"""Simulated measurements: exact without noise, and noise of the size and frame that is stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import ARM, TABLE_III, TRIANGLE, anywhere, front_half, handling, handling_model
from scipy import stats
from scipy.spatial.transform import Rotation

from symcal.calibration.evaluate import evaluate
from symcal.calibration.simulate import concatenate, simulate
from symcal.data.dataset import with_random_test
from symcal.instruments.noise import Noise
from symcal.model.model import State, build_model
from symcal.model.task import Task
from symcal.spatial import inverse, pose_matrix


def test_without_noise_the_truth_explains_everything(rng: np.random.Generator) -> None:
    for kind in ("position", "pose"):
        model = build_model(handling(), Task.of(kind, points=dict(zip("abc", TRIANGLE, strict=True))))  # type: ignore[arg-type]
        data = simulate(model, TABLE_III, front_half(20, rng), Noise(), rng)
        found = evaluate(State(model, model.setup, model.parameters.vector(TABLE_III)), data)
        assert found.size.max() < 1e-9
        assert found.orientation is None or found.orientation.max() < 1e-9
        assert found.size.shape == ((60,) if kind == "position" else (20,))


def test_the_papers_nominal_pose_and_the_size_of_its_errors(rng: np.random.Generator) -> None:
    model = handling_model()
    pose = np.array([[np.pi / 4, 1100, 0, np.pi / 2, 0]])
    assert simulate(model, {}, pose, Noise(), rng).z[0] == pytest.approx([-229.81, 194.454, 1100], abs=1e-2)
    q = front_half(4000, rng)
    off = np.linalg.norm(simulate(model, TABLE_III, q, Noise(), rng).z - simulate(model, {}, q, Noise(), rng).z, axis=1)
    assert off.mean() == pytest.approx(4.3, abs=0.1)
    assert 5.4 < off.max() < 5.9


@pytest.mark.parametrize("distribution", ["normal", "uniform"])
def test_noise_has_the_stated_distribution(distribution: str, rng: np.random.Generator) -> None:
    noise = Noise(distribution, position=0.1, orientation=1e-3)  # type: ignore[arg-type]
    law = stats.norm(0, 0.1) if distribution == "normal" else stats.uniform(-0.1, 0.2)
    drawn = noise.draw(0.1, (4000,), rng)
    assert stats.kstest(drawn, law.cdf).pvalue > 1e-3
    assert np.std(drawn) == pytest.approx(noise.sigma(0.1), rel=0.05)
    assert noise.sigma(0.1) == pytest.approx(law.std())


def test_uniform_noise_of_a_tenth_has_a_mean_norm_of_0_096(rng: np.random.Generator) -> None:
    drawn = Noise("uniform").draw(0.1, (20000, 3), rng)
    assert np.linalg.norm(drawn, axis=1).mean() == pytest.approx(0.096, abs=1e-3)


@pytest.mark.parametrize("invert", [False, True])
def test_the_noise_of_a_pose_is_in_the_frame_of_the_instrument(invert: bool, rng: np.random.Generator) -> None:
    model = build_model(ARM, Task.of("pose", invert=invert))
    q = anywhere(ARM, 3000, rng)
    exact = pose_matrix(simulate(model, {}, q, Noise(), rng).z)
    noisy = simulate(model, {}, q, Noise("normal", 0.2, 1e-3), rng)
    assert np.allclose(np.linalg.norm(noisy.z[:, 3:], axis=1), 1)
    shift = noisy.z[:, :3] - exact[:, :3, 3]
    turn = Rotation.from_matrix((inverse(exact) @ pose_matrix(noisy.z))[:, :3, :3]).as_rotvec()
    assert np.std(shift, axis=0) == pytest.approx([0.2] * 3, rel=0.06)
    assert np.std(turn, axis=0) == pytest.approx([1e-3] * 3, rel=0.06)
    assert np.abs(np.corrcoef(np.hstack([shift, turn]).T) - np.eye(6)).max() < 0.08


def test_a_seed_gives_the_same_measurements() -> None:
    model = handling_model()
    q = front_half(5, np.random.default_rng(1))
    a, b = (simulate(model, TABLE_III, q, Noise("normal", 0.1), np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(a.z, b.z)


def test_two_sets_become_one_with_poses_numbered_through(rng: np.random.Generator) -> None:
    model = handling_model()
    first = simulate(model, {}, front_half(4, rng), Noise(), rng)
    second = simulate(model, {}, front_half(3, rng), Noise(), rng, "test")
    both = concatenate(first, second)
    assert both.labels == tuple("0123456")
    assert both.split == ("train",) * 4 + ("test",) * 3
    assert np.array_equal(both.part("test").q, second.q)
    assert np.array_equal(both.part("train").z, first.z)


def test_a_random_share_is_held_out(rng: np.random.Generator) -> None:
    model = handling_model()
    data = with_random_test(simulate(model, {}, front_half(40, rng), Noise(), rng), 0.25, rng)
    assert data.split.count("test") == 10
    assert data.split.count("train") == 30
    some = with_random_test(replace(data, split=("unused",) * 20 + ("train",) * 20), 0.25, rng)
    assert some.split[:20] == ("unused",) * 20
    assert (some.split.count("test"), some.split.count("train")) == (5, 15)
