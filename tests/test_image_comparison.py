"""P3P positions, correlated noise and rigid alignment: against truth, and against their own statistics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camera_scenes import ROBOT, TRUTH, camera, poses, scene_model, target
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.calibration.aligned import aligned_errors, centres, expected_centre_rms, target_points
from symcal.calibration.identify import identify
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset, readings
from symcal.errors import RefusedError
from symcal.fit.estimation import Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.images.comparison import compare_ways
from symcal.images.p3p_data import p3p_positions
from symcal.instruments.noise import Noise
from symcal.model.model import State, build_model
from symcal.model.task import Scene, Task, pixels_task
from symcal.placing.scene_placement import flange_poses

SCENE = Scene(camera(), target(mount=False))


@pytest.fixture(scope="module")
def case():
    rng = np.random.default_rng(11)
    model = scene_model()
    data = simulate(model, TRUTH, poses(model, 40, rng), Noise(image=0.02), rng)
    q = poses(model, 300, rng)
    truth = target_points(State(model, model.setup, model.parameters.vector(TRUTH)), q)
    return model, data, identify(ROBOT, data, pixels_task(SCENE)), q, truth


def rms(errors):
    return float(np.sqrt(np.mean(errors.size**2)))


def test_pixels_beat_one_p3p_solution_per_image(case):
    _, data, calibration, q, truth = case
    ways = compare_ways(calibration, SCENE, data, Options())
    found = {name: rms(errors) for name, errors in ways.errors(q, truth).items()}
    assert found["pixels"] < 0.01
    assert found["p3p"] > 3 * found["pixels"]
    assert found["p3p_points"] > 3 * found["pixels"]
    assert found["p3p_covariance"] < 2 * found["pixels"]
    # the covariance is right: whitened residuals have unit variance
    whitened = ways.ways["p3p_covariance"].fit
    assert whitened.chi_squared / whitened.dof == pytest.approx(1.0, abs=0.3)
    assert whitened.equations == 6 * 40
    assert ways.p3p.notes == ()


def test_errors_are_as_large_as_foretold(case):
    _, _, calibration, q, truth = case
    expected = np.sqrt(np.mean(expected_centre_rms(calibration.model, calibration.after, q) ** 2))
    found = rms(aligned_errors(centres(target_points(calibration.states["after"], q)), centres(truth)))
    assert 0.4 * expected < found < 2 * expected
    before = rms(aligned_errors(centres(target_points(calibration.states["before"], q)), centres(truth)))
    assert before > 1.0


def test_alignment_takes_out_a_rigid_motion_and_nothing_else():
    rng = np.random.default_rng(3)
    truth = rng.uniform(-500, 500, (50, 3, 3))
    motion = spatial.transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-900, 900, 3))
    moved = truth @ motion[:3, :3].T + motion[:3, 3]
    assert aligned_errors(moved, truth).size.max() < 1e-9
    stretched = aligned_errors(moved * 1.001, truth).size
    expected = 0.001 * np.linalg.norm(truth - truth.reshape(-1, 3).mean(axis=0), axis=2).ravel()
    np.testing.assert_allclose(stretched, expected, rtol=2e-2)


def test_p3p_positions_are_the_true_ones_and_carry_their_covariance(case):
    model, _, _, q, _ = case
    rng = np.random.default_rng(5)
    exact = simulate(model, {}, q[:1], Noise(), rng)
    many = replace(
        exact,
        q=np.repeat(exact.q, 600, axis=0),
        z=exact.z + rng.normal(0, 0.02, (600, 6)),
        labels=tuple(str(i) for i in range(600)),
        split=("train",) * 600,
    )
    T_camera_target = spatial.inverse(model.setup.places["camera"]) @ flange_poses(model, q[:1]) @ model.setup.tool
    predicted = np.repeat(T_camera_target, 600, axis=0)
    found = p3p_positions(many, camera(), target(), predicted, 0.02)
    points = target().points @ T_camera_target[0, :3, :3].T + T_camera_target[0, :3, 3]
    covariance = np.cov(found.points.z.T)
    stated = found.points.covariance.mean(axis=0)
    np.testing.assert_allclose(
        found.points.z.mean(axis=0), points.ravel(), atol=4 * np.sqrt(np.diag(stated) / 600).max()
    )
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), np.sqrt(np.diag(stated)), rtol=0.15)
    assert np.linalg.matrix_rank(stated, tol=1e-9 * np.abs(stated).max()) == 6
    np.testing.assert_allclose(found.centroid.z, found.points.z.reshape(-1, 3, 3).mean(axis=1))


def test_images_without_all_points_are_named_and_left_out(case):
    model, data, _, _, _ = case
    z = data.z.copy()
    z[4, 2:4] = np.nan
    predicted = spatial.inverse(model.setup.places["camera"]) @ flange_poses(model, data.q) @ model.setup.tool
    found = p3p_positions(replace(data, z=z), camera(), target(), predicted, 0.02)
    assert len(found.points) == len(data) - 1
    assert "(4)" in found.notes[0]
    with pytest.raises(RefusedError, match="no image"):
        p3p_positions(replace(data, z=np.full_like(z, np.nan)), camera(), target(), predicted, 0.02)


def test_correlated_noise_is_whitened():
    """With a known covariance the estimate is the generalised least squares one."""
    rng = np.random.default_rng(1)
    task = Task.of("position", frozenset({"tool"}), {"P": (0.0, 0.0, 50.0)}, fix=tuple(ROBOT.parameters))
    model = build_model(ROBOT, task)
    q = rng.uniform(ROBOT.lower, ROBOT.upper, (30, ROBOT.dof))
    roots = rng.normal(size=(30, 3, 3)) * 0.1
    exact = simulate(model, {"tool_x": 0.4, "tool_y": -0.2, "tool_z": 0.1}, q, Noise(), rng)
    z = exact.z + np.einsum("nij,nj->ni", roots, rng.normal(size=(30, 3)))
    covariance = roots @ roots.swapaxes(1, 2)
    data = Dataset(readings("position", ("P",)), q, z, exact.labels, exact.split, covariance=covariance)
    found = fit(rows_of(model.measurement, data, model.setup), model.placement, Options())
    (slopes,) = model.jacobian(q, np.zeros(len(model.parameters)), model.setup.vector)
    slopes = slopes[:, :, model.parameters.indices(model.placement)]
    (start,) = model.accuracy(q, np.zeros(len(model.parameters)), model.setup.vector, np.zeros((30, 3)))
    weight = np.linalg.inv(covariance)
    normal = np.einsum("nki,nkl,nlj->ij", slopes, weight, slopes)
    right = np.einsum("nki,nkl,nl->i", slopes, weight, z - start)
    np.testing.assert_allclose(
        found.x[model.parameters.indices(model.placement)], np.linalg.solve(normal, right), rtol=1e-5
    )
    assert found.estimated == ()
