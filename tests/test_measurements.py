"""Every kind of measurement: derivatives against central differences and AD, residuals against SciPy."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from cases import ARM, TRIANGLE, handling
from hypothesis import given
from scipy.spatial.transform import Rotation
from strategies import random_frame, random_robot, readings, seeds

from symcal.kinematics import chain
from symcal.model.measurement import Measurement, Setup
from symcal.model.observe import observe
from symcal.model.parameter_set import parameter_set
from symcal.model.task import Task
from symcal.robot.robot import Robot
from symcal.spatial import inverse, pose_matrix

POINTS = {name: tuple(xyz) for name, xyz in zip("abc", TRIANGLE, strict=True)}
KINDS = ("position", "points", "pose", "inverted")
ROBOTS = (ARM, *(random_robot(np.random.default_rng(seed)) for seed in (1, 5)))
every_kind = pytest.mark.parametrize("kind", KINDS)


@lru_cache(maxsize=8)
def build(kind: str, robot: Robot = ARM) -> Measurement:
    """With everything unknown that may be."""
    if kind == "points":
        return observe(
            chain(robot, parameter_set(robot, base=True, points=("tool_a", "tool_b", "tool_c"))),
            *Task.of("position", ("points",), POINTS).observations,
        )
    symbolic = chain(robot, parameter_set(robot, base=True, tool="frame"))
    if kind == "position":
        return observe(symbolic, *Task.of("position", (), POINTS).observations)
    return observe(symbolic, *Task.of("pose", invert=kind == "inverted").observations)


@lru_cache(maxsize=16)
def derivative(kind: str, robot: Robot) -> ca.Function:
    """What automatic differentiation makes of the residual."""
    residual = build(kind, robot).residual
    symbols = [ca.SX.sym(name, residual.size1_in(i)) for i, name in enumerate(residual.name_in())]
    return ca.Function("J", symbols, [ca.jacobian(residual(*symbols)[0], symbols[1])])


def a_setup(measurement: Measurement, rng: np.random.Generator) -> Setup:
    points = np.array(TRIANGLE) if measurement.points_called else np.zeros((0, 3))
    return Setup(random_frame(rng), random_frame(rng, 100.0), points)


def errors(measurement: Measurement, rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=len(measurement.parameters)) * measurement.parameters.scales


def measured(measurement: Measurement, q, x, vector, rng, turn: float = 0.02) -> np.ndarray:
    """What an instrument with a little noise would give; a pose's quaternion of either sign and any length."""
    z = np.array(measurement.predict(q, x, vector)).ravel()
    if measurement.observations[0].instrument.reads == "points":
        return z + rng.normal(size=z.size)
    rotation = Rotation.from_quat(z[3:]) * Rotation.from_rotvec(turn * rng.normal(size=3))
    return np.concatenate([z[:3] + rng.normal(size=3), rng.choice([-1.3, 0.7]) * rotation.as_quat()])


@every_kind
@given(seed=seeds)
def test_jacobians_are_the_slopes_of_the_residual(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = ROBOTS[seed % len(ROBOTS)]
    measurement = build(kind, robot)
    q, x, vector = readings(rng, robot), errors(measurement, rng), a_setup(measurement, rng).vector
    z = measured(measurement, q, x, vector, rng, turn=0.5)
    r, jacobian = (np.array(v) for v in measurement.residual(q, x, vector, z))
    scaled = measurement.parameters.scales
    exact = np.array(derivative(kind, robot)(q, x, vector, z))
    assert np.allclose(jacobian * scaled, exact * scaled, rtol=1e-9, atol=1e-9)

    def residual(at: np.ndarray) -> np.ndarray:
        return np.array(measurement.residual(q, at, vector, z)[0]).ravel()

    for i in rng.choice(x.size, min(6, x.size), replace=False):
        step = 1e-4 * scaled[i] * np.eye(x.size)[i]
        slope = (residual(x + step) - residual(x - step)) / (2e-4 * scaled[i])
        assert np.allclose(slope * scaled[i], jacobian[:, i] * scaled[i], rtol=1e-5, atol=1e-6)
    assert r.shape == (measurement.rows, 1)


@every_kind
@given(seed=seeds)
def test_the_jacobian_of_a_plan_is_that_of_the_residual_where_it_vanishes(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    measurement = build(kind)
    q, x, vector = readings(rng, ARM), errors(measurement, rng), a_setup(measurement, rng).vector
    z = np.array(measurement.predict(q, x, vector)).ravel()
    r, jacobian = measurement.residual(q, x, vector, z)
    assert np.abs(np.array(r)).max() < 1e-9
    assert np.allclose(np.array(jacobian), np.array(measurement.jacobian(q, x, vector)), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("kind", ["pose", "inverted"])
@given(seed=seeds)
def test_the_residual_of_a_pose_is_scipys_logarithm(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    measurement = build(kind)
    q, x, setup = readings(rng, ARM), errors(measurement, rng), a_setup(build(kind), rng)
    at_nominal = np.array(measurement.predict(q, x, setup.vector)).ravel()
    z = np.concatenate([rng.normal(scale=500, size=3), Rotation.random(rng=rng).as_quat()])
    r, _ = measurement.residual(q, x, setup.vector, z)
    r = np.array(r).ravel()
    turn = Rotation.from_quat(z[3:]).inv() * Rotation.from_quat(at_nominal[3:])
    assert np.allclose(r[:3], at_nominal[:3] - z[:3], atol=1e-9)
    # half a turn has two vectors
    assert np.allclose(Rotation.from_rotvec(r[3:]).as_matrix(), turn.as_matrix(), atol=1e-9)
    assert np.linalg.norm(r[3:]) == pytest.approx(turn.magnitude(), abs=1e-7)
    flipped, _ = measurement.residual(q, x, setup.vector, np.concatenate([z[:3], -z[3:]]))
    assert np.allclose(np.array(flipped).ravel(), r, atol=1e-9)


@given(seed=seeds)
def test_an_inverted_pose_is_the_inverse_and_is_judged_in_world(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plain, inverted = build("pose"), build("inverted")
    q, x, vector = readings(rng, ARM), errors(plain, rng), a_setup(plain, rng).vector
    t = pose_matrix(np.array(plain.predict(q, x, vector)).ravel())
    z = np.array(inverted.predict(q, x, vector)).ravel()
    assert np.allclose(pose_matrix(z), inverse(t), atol=1e-9)
    seen = pose_matrix(measured(inverted, q, x, vector, rng))
    other = np.concatenate([inverse(seen)[:3, 3], Rotation.from_matrix(inverse(seen)[:3, :3]).as_quat()])
    of_inverted = inverted.accuracy(
        q, x, vector, np.concatenate([seen[:3, 3], Rotation.from_matrix(seen[:3, :3]).as_quat()])
    )
    assert np.allclose(np.array(of_inverted), np.array(plain.accuracy(q, x, vector, other)), atol=1e-9)


@given(seed=seeds)
def test_points_ride_on_the_tool(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, points = build("pose"), build("position")
    setup = replace(a_setup(points, rng), points=np.array(TRIANGLE))
    q, x = readings(rng, ARM), errors(pose, rng)
    t = pose_matrix(np.array(pose.predict(q, x, replace(setup, points=np.zeros((0, 3))).vector)).ravel())
    h = np.array(points.predict(q, x, setup.vector)).reshape(3, 3)
    assert np.allclose(h, np.array(TRIANGLE) @ t[:3, :3].T + t[:3, 3], atol=1e-9)


@every_kind
@given(seed=seeds)
def test_carrying_out_the_increments_moves_nothing(kind: str, seed: int) -> None:
    """Frames and points with their errors, and moved frames and points without, are the same place."""
    rng = np.random.default_rng(seed)
    measurement = build(kind)
    setup, q = a_setup(measurement, rng), readings(rng, ARM)
    x = 50 * errors(measurement, rng)
    moved = setup.moved(measurement.parameters.mapping(x), measurement.points_called)
    links = np.array([name in ARM.parameters for name in measurement.parameters.names])
    before = np.array(measurement.predict(q, x, setup.vector)).ravel()
    after = np.array(measurement.predict(q, np.where(links, x, 0.0), moved.vector)).ravel()
    if measurement.observations[0].instrument.reads == "frame":
        before, after = pose_matrix(before), pose_matrix(after)
    assert np.allclose(before, after, atol=1e-8)


def test_groups_cover_every_component_once_with_its_unit() -> None:
    for kind in KINDS:
        measurement = build(kind)
        columns = [c for group in measurement.groups for c in group.columns]
        assert sorted(columns) == list(range(measurement.rows))
        assert all(len(group.columns) % group.block == 0 for group in measurement.groups)
        assert {g.name: g.unit for g in measurement.groups}["position"] == "mm"
    spread = build("pose").per_component({"position": 2.0, "orientation": 0.1})
    assert spread.tolist() == [2, 2, 2, 0.1, 0.1, 0.1]


def test_a_pose_that_agrees_has_a_finite_slope() -> None:
    """At the identity the logarithm is a quotient of zeros, and so is a half turn's quaternion."""
    robot = handling()
    measurement = observe(chain(robot, parameter_set(robot, base=True, tool="frame")), *Task.of("pose").observations)
    vector = Setup(np.eye(4), np.eye(4)).vector
    for q in (np.zeros(5), np.array([np.pi, 1000, 100, np.pi, np.pi]), np.array([0, 1000, 0, np.pi / 2, np.pi])):
        z = np.array(measurement.predict(q, np.zeros(len(measurement.parameters)), vector)).ravel()
        assert np.linalg.norm(z[3:]) == pytest.approx(1.0)
        r, jacobian = measurement.residual(q, np.zeros(len(measurement.parameters)), vector, z)
        assert np.abs(np.array(r)).max() < 1e-9
        assert np.isfinite(np.array(jacobian)).all()
