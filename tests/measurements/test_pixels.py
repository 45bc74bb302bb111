"""The pixel measurement against OpenCV, finite differences and automatic differentiation; and what it can identify."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import cv2
import numpy as np
import pytest
from camera_scenes import ROBOT, T_WORLD_CAMERA, TRUTH, camera, poses, scene_model, target
from scipy.spatial.transform import Rotation
from strategies import random_frame, random_robot

from symcal import spatial
from symcal.calibration.compare import cross_validate
from symcal.calibration.identify import identify
from symcal.calibration.simulate import simulate
from symcal.camera.camera import INTRINSIC_NAMES, Camera
from symcal.camera.files import read_camera, write_camera
from symcal.camera.target import Target
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Options
from symcal.fit.identifiability import analyse
from symcal.instruments.noise import Noise
from symcal.kinematics import chain
from symcal.model.measurement import Setup
from symcal.model.model import build_model, nominal_setup
from symcal.model.observe import observe
from symcal.model.task import Scene, Task, pixels_task

NAMES = ("P1", "P2", "P3", "P4")


def random_case(seed):
    """Any robot, any camera that sees the points, errors of all parameters; points estimated or the tool."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    tool = seed % 2 == 0
    lens = Camera(2000, 1500, 2100.0, 2090.0, 990.0, 760.0, (-0.1, 0.05, 1e-3, -2e-3, 0.02))
    marks = Target(NAMES, rng.uniform(-80, 80, (4, 3)), 5.0)
    task = pixels_task(Scene(lens, marks, np.eye(4)), ("tool" if tool else "points", "camera", "intrinsics"))
    parameters = task.parameters(robot)
    measurement = observe(chain(robot, parameters), *task.observations)
    sizes = {"mm": 1.0, "rad": 0.01}
    x = 0.5 * rng.normal(size=len(parameters)) * [sizes.get(p.unit, p.scale) for p in parameters.items]
    q = rng.uniform(-1, 1, robot.dof)
    setup = nominal_setup(robot, task)
    world, _ = measurement.points(q, x, setup.vector)
    middle = np.array(world).reshape(4, 3).mean(axis=0)
    turn = Rotation.random(rng=rng).as_matrix()
    place = spatial.transform(turn, middle - turn @ np.array([50.0, -40.0, 900.0]))
    return measurement, q, x, replace(setup, places={"camera": place}), lens


@pytest.mark.parametrize("seed", range(8))
def test_images_agree_with_opencv(seed):
    measurement, q, x, setup, _ = random_case(seed)
    values = measurement.parameters.mapping(x)
    moved = setup.moved(values, measurement.points_called)
    world = np.array(measurement.points(q, x, setup.vector)[0]).reshape(4, 3)
    inverse = spatial.inverse(moved.places["camera"])
    errors = [values.get(name, 0.0) for name in INTRINSIC_NAMES]
    fx, fy, cx, cy, *dist = np.array(list(setup.own.values())) + errors
    expected, _ = cv2.projectPoints(
        world,
        Rotation.from_matrix(inverse[:3, :3]).as_rotvec(),
        inverse[:3, 3],
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        np.array(dist),
    )
    found = np.array(measurement.predict(q, x, setup.vector)).reshape(4, 2)
    np.testing.assert_allclose(found, expected.reshape(4, 2), atol=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_jacobian_is_the_derivative(seed):
    measurement, q, x, setup, _ = random_case(seed)
    n = len(x)
    symbol = ca.SX.sym("x", n)
    h = measurement.predict(q, symbol, setup.vector)
    automatic = np.array(ca.Function("slope", [symbol], [ca.jacobian(h, symbol)])(x))
    z = np.zeros(8)
    _, jacobian = (np.array(a) for a in measurement.residual(q, x, setup.vector, z))
    np.testing.assert_allclose(jacobian, automatic, rtol=1e-9, atol=1e-7 * np.abs(automatic).max())
    np.testing.assert_array_equal(jacobian, np.array(measurement.jacobian(q, x, setup.vector)))
    for i in range(n):
        step = np.zeros(n)
        step[i] = 1e-5 * {"mm": 1.0, "rad": 0.01}.get(measurement.parameters.units[i], measurement.parameters.scales[i])
        up, down = (np.array(measurement.predict(q, x + s, setup.vector)).ravel() for s in (step, -step))
        slope = (up - down) / (2 * step[i])
        np.testing.assert_allclose(jacobian[:, i], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max() + 3e-7)


def test_the_error_in_mm_lies_across_the_line_of_sight_and_explains_the_residual():
    measurement, q, x, setup, lens = random_case(0)
    z = np.array(measurement.predict(q, x, setup.vector)).ravel() + 0.3
    error = np.array(measurement.accuracy(q, x, setup.vector, z)).reshape(4, 3)
    world = np.array(measurement.points(q, x, setup.vector)[0]).reshape(4, 3)
    moved = setup.moved(measurement.parameters.mapping(x), measurement.points_called)
    sight = world - moved.places["camera"][:3, 3]
    across = np.abs(np.einsum("ki,ki->k", error, sight)) / np.linalg.norm(sight, axis=1)
    assert np.all(across < 0.3 * np.linalg.norm(error, axis=1))
    distance = sight @ moved.places["camera"][:3, 2]
    np.testing.assert_allclose(np.linalg.norm(error, axis=1), 0.3 * np.sqrt(2) * distance / lens.fx, rtol=0.25)


def test_twenty_one_of_twenty_seven_with_mount_and_camera_unknown():
    model = scene_model(estimate=("tool", "camera"))
    q = poses(model, 60, np.random.default_rng(4))
    (jacobian,) = model.jacobian(q, np.zeros(len(model.parameters)), model.setup.vector)
    seen = analyse(jacobian.reshape(-1, 27) / 0.02, model.parameters)
    assert (len(seen.names), seen.rank, seen.numerical_rank) == (27, 21, 21)


@pytest.fixture(scope="module")
def simulated():
    rng = np.random.default_rng(7)
    model = scene_model()
    return simulate(model, TRUTH, poses(model, 40, rng), Noise(image=0.02), rng)


def test_camera_and_mount_are_found_and_the_noise_with_them(simulated):
    found = identify(ROBOT, simulated, pixels_task(Scene(camera(), target(mount=False))))
    assert len(found.after.free) == 35
    assert found.after.identifiability.rank == 29  # 21 of robot, mount and camera, and 8 intrinsics with their prior
    assert found.after.sigmas["image"] == pytest.approx(0.02, rel=0.2)
    assert np.linalg.norm(found.setup.places["camera"][:3, 3] - T_WORLD_CAMERA[:3, 3]) < 20
    assert found.notes == ()


def test_a_prior_of_the_intrinsics_moves_them_no_further_than_it_says(simulated):
    found = identify(ROBOT, simulated, pixels_task(Scene(camera(), target(mount=False))))
    errors = found.model.parameters.mapping(found.after.x)
    sigma = np.sqrt(np.diag(camera().covariance))
    assert abs(errors["fx"]) < 4 * sigma[0]
    assert abs(errors["k1"]) < 4 * sigma[4]
    assert "k3" not in errors


def test_points_of_the_target_instead_of_its_mount(simulated):
    scene = Scene(camera(), target(mount=False))
    found = identify(ROBOT, simulated, pixels_task(scene, ("points", "camera")))
    assert found.after.sigmas["image"] == pytest.approx(0.02, rel=0.25)


@pytest.mark.parametrize("estimate", [("tool", "camera"), ("points", "camera")])
def test_targets_of_more_points_that_do_not_lie_in_a_plane(estimate):
    rng = np.random.default_rng(9)
    corners = [[90, 0, 0], [-45, 80, 0], [-50, -75, 10], [0, 0, 45], [60, 60, 25]]
    mount = target().mount
    own = Target(("A", "B", "C", "D", "E"), np.array(corners, dtype=float), 15.0, mount=mount)
    known = build_model(ROBOT, pixels_task(Scene(camera(), own, T_WORLD_CAMERA), ("tool", "camera")))
    data = simulate(known, TRUTH, poses(known, 40, rng), Noise(image=0.02), rng)
    unknown = Target(own.names, own.points, own.disc_radius)
    found = identify(ROBOT, data, pixels_task(Scene(camera(), unknown), estimate))
    assert found.after.sigmas["image"] == pytest.approx(0.02, rel=0.15)
    folds = cross_validate(found.model, data, Options(), 4, rng)
    assert np.sqrt(np.mean(folds["after"].size ** 2)) < 0.03


def test_joint_readings_of_another_robot_are_refused(simulated, monkeypatch):
    monkeypatch.setattr("symcal.calibration.calibrate.told_by_identification", lambda *_: ())  # a search of seconds
    wrong = replace(simulated, q=simulated.q[:, [3, 1, 2, 0, 4]])
    with pytest.raises(RefusedError):
        identify(ROBOT, wrong, pixels_task(Scene(camera(), target(mount=False))))


def test_points_not_seen_are_passed_over(simulated):
    z = simulated.z.copy()
    z[3, :2], z[8, 4:] = np.nan, np.nan
    found = identify(ROBOT, replace(simulated, z=z), pixels_task(Scene(camera(), target(mount=False))))
    assert found.after.equations == 240 - 4
    assert found.after.sigmas["image"] == pytest.approx(0.02, rel=0.2)


@pytest.mark.parametrize(
    ("estimate", "message"),
    [(("base", "camera"), "moving the robot is moving everything"), (("tool", "points"), "both")],
)
def test_parts_that_contradict_each_other(estimate, message):
    with pytest.raises(InputError, match=message):
        build_model(ROBOT, pixels_task(Scene(camera(), target(), T_WORLD_CAMERA), estimate))
    with pytest.raises(InputError, match="camera"):
        build_model(ROBOT, Task.of("position", frozenset({"camera"})))


def test_simulated_points_out_of_the_image_are_not_seen():
    model = scene_model()
    rng = np.random.default_rng(2)
    lower, upper = ROBOT.lower, ROBOT.upper
    q = rng.uniform(lower, upper, (200, ROBOT.dof))
    z = simulate(model, {}, q, Noise(), rng).z
    seen = z[np.isfinite(z)]
    assert np.isnan(z).any()
    assert seen.min() >= -0.5
    assert seen.max() <= 2447.5


def test_random_frames_are_no_special_case():
    """A setup without increments projects with the frames as they are."""
    rng = np.random.default_rng(5)
    frame = random_frame(rng)
    np.testing.assert_allclose(Setup(frame, frame, places={"camera": frame}).moved({}).places["camera"], frame)


def test_a_skewed_camera_measures_as_well_and_its_skew_is_found(tmp_path):
    """The skew goes from camera.yaml through readings, starts and fit; known to 0.5 px, it is 0.4 px off."""
    covariance = np.zeros((10, 10))
    covariance[:9, :9], covariance[9, 9] = camera().covariance, 0.5**2
    write_camera(tmp_path / "camera.yaml", replace(camera(), skew=3.0, covariance=covariance))
    nominal, rng = read_camera(tmp_path / "camera.yaml"), np.random.default_rng(7)
    true = build_model(ROBOT, pixels_task(Scene(replace(nominal, skew=3.4), target(), T_WORLD_CAMERA)))
    data = simulate(true, TRUTH, poses(true, 40, rng), Noise(image=0.02), rng)
    found = identify(ROBOT, data, pixels_task(Scene(nominal, target(mount=False))))
    errors = found.model.parameters.mapping(found.after.x)
    sigma = dict(zip(found.after.posterior.names, found.after.posterior.sigmas, strict=True))["skew"]
    assert found.after.sigmas["image"] == pytest.approx(0.02, rel=0.2)
    assert errors["skew"] == pytest.approx(0.4, abs=4 * sigma)
    assert sigma < 0.5
    straight = identify(ROBOT, data, pixels_task(Scene(camera(), target(mount=False))))
    assert straight.after.sigmas["image"] > 1.5 * found.after.sigmas["image"]
