"""Information of a pose against finite differences of the measurement, and what priors and sampling promise."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats
from planning_cases import fr3, handling

from symcal import kinematics
from symcal.errors import InputError, RefusedError
from symcal.model.measurement import Setup
from symcal.model.observe import observe
from symcal.model.parameter_set import parameter_set
from symcal.model.task import Task
from symcal.planning.area import draw, halton, working_area
from symcal.planning.information import pose_information
from symcal.robot.files import load_robot


def test_even_poses_are_those_of_halton():
    for count, dimensions in ((1000, 7), (5, 25)):
        theirs = scipy.stats.qmc.Halton(dimensions, scramble=False).random(count)
        np.testing.assert_array_equal(halton(count, dimensions), theirs)


def test_handling_robot_shows_eleven_of_fifteen_to_positions():
    assert handling().rank == 11


def test_seven_axis_arm_shows_thirty_four_of_forty_to_poses():
    info = fr3()
    assert (info.rank, len(info.names)) == (34, 40)


@pytest.mark.parametrize("make", [handling, fr3])
def test_information_reproduces_the_covariance_of_the_whitened_fit(make, rng):
    info = make()
    poses = info.area.sample(rng, 60)
    measurement = info.measurement
    step, x0 = 1e-6, np.zeros(len(info.names))
    whitening = 1 / measurement.per_component(info.sigmas)
    stacked = []
    for q in poses:
        h = [
            np.array(measurement.predict(q, s * step * e, info.setup.vector)).ravel()
            for e in np.eye(len(x0))
            for s in (1, -1)
        ]
        z = np.array(measurement.predict(q, x0, info.setup.vector)).ravel()
        r = [
            np.array(measurement.residual(q, s * step * e, info.setup.vector, z)[0]).ravel()
            for e in np.eye(len(x0))
            for s in (1, -1)
        ]
        assert len(h) == len(r)
        difference = np.array([(a - b) / (2 * step) for a, b in zip(r[::2], r[1::2], strict=True)]).T
        stacked.append(whitening[:, None] * difference * info.scales)
    full = np.vstack(stacked)
    wanted = np.linalg.pinv(full, rcond=1e-6)
    covariance = info.scales[:, None] * (wanted @ wanted.T) * info.scales
    np.testing.assert_allclose(info.lift(np.linalg.inv(info.total(poses))), covariance, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("make", [handling, fr3])
def test_gradient_of_weighted_information_is_exact(make, rng):
    info = make()
    root = rng.normal(size=(info.rank, info.rank)) / info.rank
    weight, poses, step = root @ root.T, info.area.sample(rng, 7), 1e-5
    value, gradient = info.function.weighted_gradient(poses, weight)
    np.testing.assert_allclose(value, np.einsum("kij,ij->k", info.matrices(poses), weight), rtol=1e-10)
    for i, e in enumerate(np.eye(info.area.dof)):
        ahead, behind = (
            info.function.weighted(poses + step * e, weight),
            info.function.weighted(poses - step * e, weight),
        )
        np.testing.assert_allclose(gradient[:, i], (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-6 * value.max())


def test_prior_of_a_parameter_is_information_before_any_pose(configs):
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    parameters = parameter_set(robot).with_priors({"theta_5": 0.002, "d_4": 0.1})
    measurement = observe(kinematics.chain(robot, parameters), *Task.of("position").observations)
    info = pose_information(measurement, Setup(robot.base, robot.tool, np.zeros((1, 3))), {"position": 0.06})
    assert info.rank == 13  # theta_5, and one of the two directions that hide d_3, d_4 and alpha_4
    place = info.names.index("theta_5")
    plan = info.area.even(40)
    assert math.sqrt(info.lift(np.linalg.inv(info.total(plan)))[place, place]) == pytest.approx(0.002, rel=1e-6)


def test_rows_of_priors_do_the_same_as_prior_sigmas(configs):
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    setup, noise = Setup(robot.base, robot.tool, np.zeros((1, 3))), {"position": 0.06}
    plain = observe(kinematics.chain(robot, parameter_set(robot)), *Task.of("position").observations)
    with_prior = observe(
        kinematics.chain(robot, parameter_set(robot).with_priors({"d_3": 0.05})), *Task.of("position").observations
    )
    row = np.zeros((1, 15))
    row[0, plain.parameters.index("d_3")] = 1 / 0.05
    a, b = pose_information(with_prior, setup, noise), pose_information(plain, setup, noise, prior_rows=row)
    poses = a.area.even(40)
    np.testing.assert_allclose(a.lift(np.linalg.inv(a.total(poses))), b.lift(np.linalg.inv(b.total(poses))), atol=1e-9)


def test_working_area_narrows_limits_and_refuses_what_lies_outside(configs):
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    area = working_area(robot, {"waist": (-math.pi / 2, math.pi / 2), "q3": (100.0, 200.0)}, margin=0.1)
    np.testing.assert_allclose(area.upper[:3], [math.pi / 2, 1300.0, 200.0])
    with pytest.raises(InputError, match="within"):
        working_area(robot, {"waist": (-4.0, 1.0)})
    with pytest.raises(InputError, match="did you mean 'waist'"):
        working_area(robot, {"wast": (-1.0, 1.0)})


def test_snapped_sample_has_its_share_of_limits(rng):
    area = handling().area
    poses = area.snapped(rng, 20_000, 0.4)
    at_limit = (poses == area.lower) | (poses == area.upper)
    np.testing.assert_allclose(at_limit.mean(axis=0), 0.4, atol=0.015)
    assert area.contains(poses).all()


def test_drawing_keeps_the_feasible_and_refuses_an_empty_set(rng):
    area = handling().area
    poses = draw(area, rng, 500, lambda q: q[:, 2] > 500.0)
    assert poses.shape == (500, 5)
    assert (poses[:, 2] > 500.0).all()
    with pytest.raises(RefusedError, match="feasible"):
        draw(area, rng, 50, lambda q: q[:, 2] > 1e9)


def test_the_posterior_is_the_inverse_of_information_and_plausible_sizes(configs, rng):
    """Frames are nearly free, stated priors stand in for sizes, and several plans are as one at a time."""
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    parameters = parameter_set(robot, base=True).with_priors({"d_3": 0.05})
    measurement = observe(kinematics.chain(robot, parameters), *Task.of("position").observations)
    info = pose_information(measurement, Setup(robot.base, robot.tool, np.zeros((1, 3))), {"position": 0.06})
    plans = info.area.sample(rng, 60).reshape(2, 30, -1)
    rows = info.function.full(plans[1]).reshape(-1, len(info.names))
    sizes = np.array([1e3 if n.startswith("base") else 0.05 if n == "d_3" else 1.0 for n in info.names])
    expected = np.linalg.inv(rows.T @ rows + np.diag(1 / sizes**2))
    both = info.posterior(plans)
    np.testing.assert_allclose(both[1] @ both[1].T, expected, rtol=1e-4, atol=1e-6 * expected.max())
    np.testing.assert_allclose(both[1], info.posterior(plans[1]), atol=1e-9)
