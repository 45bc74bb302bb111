"""Forward kinematics and Jacobians against matrices written here, pinocchio, real arms and published numbers."""

from __future__ import annotations

import importlib.metadata
from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
from cases import TABLE_III
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from strategies import generators, random_robot, readings

from symcal.kinematics import chain, forward, frame_vector, function, omegas, stack
from symcal.model.parameter_set import parameter_set
from symcal.parameters import ParameterSet
from symcal.robot.files import load_robot
from symcal.robot.robot import Joint, Link, Robot, is_angle

TOOLS = st.sampled_from(["frame", "position", None])


def evaluate(robot: Robot, q: np.ndarray, parameters: ParameterSet | None = None, x: np.ndarray | None = None):
    """Pose, joint Jacobian and parameter Jacobian from the package."""
    parameters = ParameterSet(()) if parameters is None else parameters
    x = np.zeros(len(parameters)) if x is None else x
    out = forward(chain(robot, parameters))(q, x, frame_vector(robot.base, robot.tool))
    return tuple(np.array(value) for value in out)


# -------------------------------------------------------------------------------- the oracle: 4x4 matrices in NumPy


def turn(axis: int, angle: complex) -> np.ndarray:
    matrix = np.eye(4, dtype=complex)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i] = np.sin(angle)
    matrix[i, j] = -np.sin(angle)
    return matrix


def shift(x: complex = 0, y: complex = 0, z: complex = 0) -> np.ndarray:
    matrix = np.eye(4, dtype=complex)
    matrix[:3, 3] = x, y, z
    return matrix


def increment(x: dict[str, complex], frame: str) -> np.ndarray:
    """T(x, y, z) exp(rx, ry, rz) with SciPy's matrix exponential."""
    rx, ry, rz = (x.get(f"{frame}_r{axis}", 0) for axis in "xyz")
    matrix = shift(*(x.get(f"{frame}_{axis}", 0) for axis in "xyz"))
    matrix[:3, :3] = expm(np.array([[0, -rz, ry], [rz, 0, -rx], [-ry, rx, 0]], dtype=complex))
    return matrix


def oracle(robot: Robot, q: np.ndarray, x: dict[str, complex] | None = None) -> np.ndarray:
    """T_world_tool; complex, so that a complex step gives exact derivatives."""
    x = x or {}
    pose = robot.base.astype(complex) @ increment(x, "base")
    for i, (link, reading) in enumerate(zip(robot.links, q, strict=True), start=1):
        p = {kind: value + x.get(f"{kind}_{i}", 0) for kind, value in link.parameters.items()}
        theta, alpha, a, d, beta = (p.get(kind, 0) for kind in ("theta", "alpha", "a", "d", "beta"))
        coordinate = link.joint.sign * link.joint.ratio * reading + link.joint.offset
        if link.joint.kind == "revolute":
            theta = theta + coordinate
        else:
            d = d + coordinate
        if robot.convention == "standard":
            pose = pose @ turn(2, theta) @ shift(z=d) @ shift(x=a) @ turn(0, alpha) @ turn(1, beta)
        else:
            pose = pose @ turn(0, alpha) @ shift(x=a) @ turn(1, beta) @ turn(2, theta) @ shift(z=d)
    return pose @ robot.tool @ increment(x, "tool")


def complex_step(pose_of, values: np.ndarray) -> np.ndarray:
    """Velocity of the origin and angular velocity, in world, per value; shape (6, n), or (k, 6, n) of k poses."""
    rotation = pose_of(values.astype(complex))[..., :3, :3].real
    columns = np.empty((len(values), *rotation.shape[:-2], 6))
    for i in range(len(values)):
        stepped = values.astype(complex)
        stepped[i] += 1e-30j
        rate = pose_of(stepped).imag / 1e-30
        spin = rate[..., :3, :3] @ rotation.swapaxes(-2, -1)
        columns[i, ..., :3] = rate[..., :3, 3]
        columns[i, ..., 3:] = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    return np.moveaxis(columns, 0, -1)


def small_errors(rng: np.random.Generator, parameters: ParameterSet, turn: float) -> np.ndarray:
    """Errors of 10 mm and 10 mrad, with increments of the frames' rotation up to ``turn`` rad."""
    x = rng.normal(size=len(parameters)) * np.where([u == "mm" for u in parameters.units], 10.0, 0.01)
    for i, name in enumerate(parameters.names):
        if name.startswith(("base_r", "tool_r")):
            x[i] = rng.uniform(-turn, turn)
    return x


@given(generators, TOOLS)
def test_pose_is_the_product_of_the_elementary_matrices(rng, tool):
    robot = random_robot(rng)
    parameters = parameter_set(robot, base=True, tool=tool)
    q, x = readings(rng, robot), small_errors(rng, parameters, 2.0)
    pose, _, _ = evaluate(robot, q, parameters, x)
    np.testing.assert_allclose(pose, oracle(robot, q, parameters.mapping(x)).real, atol=1e-9)


@given(generators, TOOLS, st.sampled_from([0.0, 1e-9, 1e-3, 2.0, 5.0]))
def test_jacobians_are_the_complex_step_s(rng, tool, turn):
    robot = random_robot(rng)
    parameters = parameter_set(robot, base=True, tool=tool)
    q, x = readings(rng, robot), small_errors(rng, parameters, turn)
    _, by_joints, by_parameters = evaluate(robot, q, parameters, x)

    def pose_of_x(values: np.ndarray) -> np.ndarray:
        return oracle(robot, q, dict(zip(parameters.names, values, strict=True)))

    def pose_of_q(values: np.ndarray) -> np.ndarray:
        return oracle(robot, values, parameters.mapping(x))

    np.testing.assert_allclose(by_parameters, complex_step(pose_of_x, x), rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(by_joints, complex_step(pose_of_q, q), rtol=1e-9, atol=1e-8)


@given(generators, st.sampled_from([0.0, 1e-3, 2.0]))
def test_screws_are_what_automatic_differentiation_gives(rng, turn):
    robot = random_robot(rng)
    model = chain(robot, parameter_set(robot, base=True, tool="frame"))
    point = ca.vertcat(*(model.tool[:3, 3] + model.tool[:3, :3] @ ca.DM([10, -20, 30])).nz)
    both = ca.Function(
        "both",
        [model.q, model.x, model.frames],
        [
            stack(model.parameter_screws, point),
            ca.jacobian(point, model.x),
            stack(model.joint_screws, point),
            ca.jacobian(point, model.q),
            omegas(model.parameter_screws),
            ca.jacobian(ca.vec(model.tool[:3, :3]), model.x),
            model.tool[:3, :3],
        ],
    )
    q, x = readings(rng, robot), small_errors(rng, model.parameters, turn)
    screws, ad, joint_screws, joint_ad, spins, rotation_ad, rotation = (
        np.array(v) for v in both(q, x, frame_vector(robot.base, robot.tool))
    )
    np.testing.assert_allclose(screws, ad, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(joint_screws, joint_ad, rtol=1e-9, atol=1e-8)
    for k in range(len(x)):
        spin = rotation_ad[:, k].reshape(3, 3, order="F") @ rotation.T
        np.testing.assert_allclose(spins[:, k], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-9)


def test_jacobians_at_zero_increments_against_central_differences(rng):
    robot = random_robot(rng, dof=6)
    parameters = parameter_set(robot, base=True, tool="frame")
    q, x = readings(rng, robot), np.zeros(len(parameters))
    f = forward(chain(robot, parameters))
    frames = frame_vector(robot.base, robot.tool)
    velocity = np.array(f(q, x, frames)[2])[:3]
    for k, unit in enumerate(parameters.units):
        step = np.zeros(len(parameters))
        step[k] = 1e-2 if unit == "mm" else 1e-5
        ahead, behind = (np.array(f(q, sign * step, frames)[0])[:3, 3] for sign in (1, -1))
        np.testing.assert_allclose(velocity[:, k], (ahead - behind) / (2 * step[k]), atol=1e-5)


def test_parameters_of_points_move_no_frame(rng):
    robot = random_robot(rng, dof=3)
    parameters = parameter_set(robot, points=("P1",))
    _, _, jacobian = evaluate(robot, readings(rng, robot), parameters)
    np.testing.assert_array_equal(jacobian[:, -3:], 0)
    np.testing.assert_array_equal(evaluate(robot, readings(rng, robot))[2].shape, (6, 0))


@given(generators)
def test_some_of_the_parameters_are_as_good_as_all(rng):
    robot = random_robot(rng)
    full = parameter_set(robot, base=True, tool="frame")
    some = ParameterSet(tuple(p for p in full.items if rng.random() < 0.5))
    q, x = readings(rng, robot), small_errors(rng, some, 1.0)
    pose, _, jacobian = evaluate(robot, q, some, x)
    same_pose, _, same = evaluate(robot, q, full, full.vector(some.mapping(x)))
    np.testing.assert_allclose(pose, same_pose, atol=1e-9)
    np.testing.assert_allclose(jacobian, same[:, full.indices(some.names)], rtol=1e-9, atol=1e-8)


@given(generators)
def test_errors_in_the_vector_or_in_the_robot_are_the_same(rng):
    robot = random_robot(rng)
    parameters = parameter_set(robot)
    q, x = readings(rng, robot), small_errors(rng, parameters, 0.0)
    moved, _, _ = evaluate(robot.corrected(parameters.mapping(x)), q)
    np.testing.assert_allclose(evaluate(robot, q, parameters, x)[0], moved, atol=1e-9)


def test_link_frames_and_flange(rng):
    robot = random_robot(rng, dof=4)
    model = chain(robot, ParameterSet(()))
    inputs = {"q": model.q, "x": model.x, "frames": model.frames}
    links = function("links", inputs, {f"T{i}": link for i, link in enumerate(model.links)} | {"flange": model.flange})
    q = readings(rng, robot)
    *frames, flange = (np.array(v) for v in links(q, [], frame_vector(robot.base, robot.tool)))
    np.testing.assert_array_equal(frames[-1], flange)
    for i in range(4):
        part = replace(robot, links=robot.links[: i + 1], tool=np.eye(4))
        np.testing.assert_allclose(frames[i], oracle(part, q[: i + 1]).real, atol=1e-9)


# ------------------------------------------------------------------------------------------------------- pinocchio


def se3(kind: str, value: float) -> pin.SE3:
    axis = {"theta": 2, "d": 2, "a": 0, "alpha": 0, "beta": 1}[kind]
    direction = np.eye(3)[axis]
    if is_angle(kind):
        return pin.SE3(pin.AngleAxis(value, direction).toRotationMatrix(), np.zeros(3))
    return pin.SE3(np.eye(3), value * direction)


def pinocchio_model(robot: Robot) -> tuple[pin.Model, int]:
    """The robot joint by joint: (model, id of the tool frame); joints about and along z, in mm."""
    model = pin.Model()
    parent, placement = 0, pin.SE3(robot.base)
    order = ("theta", "d", "a", "alpha", "beta") if robot.convention == "standard" else ("alpha", "a", "beta")
    for i, link in enumerate(robot.links, start=1):
        moved = pin.JointModelRZ() if link.joint.revolute else pin.JointModelPZ()
        constant = [se3(kind, link.parameters[kind]) for kind in order if kind in link.parameters]
        if robot.convention == "standard":  # joint first: it commutes with theta and d
            parent = model.addJoint(parent, moved, placement, f"{i}")
            placement = pin.SE3.Identity()
            for step in constant:
                placement = placement * step
        else:  # joint after alpha, a, beta
            for step in constant:
                placement = placement * step
            parent = model.addJoint(parent, moved, placement, f"{i}")
            placement = pin.SE3.Identity()
            for kind in ("theta", "d"):
                placement = placement * se3(kind, link.parameters.get(kind, 0.0))
    tool = pin.Frame("tool", parent, 0, placement * pin.SE3(robot.tool), pin.FrameType.OP_FRAME)
    return model, model.addFrame(tool)


@given(generators, st.sampled_from(["standard", "craig"]))
def test_pinocchio_agrees_on_random_robots(rng, convention):
    robot = random_robot(rng, convention)
    q = readings(rng, robot)
    rates = np.array([joint.sign * joint.ratio for joint in robot.joints])
    coordinates = rates * q + [joint.offset for joint in robot.joints]
    model, tool = pinocchio_model(robot)
    data = model.createData()
    jacobian = pin.computeFrameJacobian(model, data, coordinates, tool, pin.LOCAL_WORLD_ALIGNED)
    pin.framesForwardKinematics(model, data, coordinates)
    pose, by_joints, _ = evaluate(robot, q)
    np.testing.assert_allclose(pose, data.oMf[tool].homogeneous, atol=1e-9)
    np.testing.assert_allclose(by_joints, jacobian.reshape(6, -1) * rates, rtol=1e-9, atol=1e-8)


def urdf_model(name: str) -> pin.Model:
    """An arm of example-robot-data; lengths in m."""
    file = next(f for f in importlib.metadata.files("example-robot-data") or () if f.name == name)
    model = pin.buildModelFromUrdf(str(file.locate()))
    # the files write pi/2 with eleven digits: right angles are made what they mean, or 5e-12 rad stay in every joint
    for placement in [*model.jointPlacements, *(frame.placement for frame in model.frames)]:
        right = np.round(placement.rotation)
        if np.abs(placement.rotation - right).max() < 1e-10:
            placement.rotation = right
    return model


def urdf_pose(model: pin.Model, joints: list[str], q: np.ndarray, base: str, tool: str) -> np.ndarray:
    """T_base_tool in mm at these joint values (rad, m)."""
    data = model.createData()
    configuration = pin.neutral(model)
    for name, value in zip(joints, q, strict=True):
        configuration[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, configuration)
    pose = (data.oMf[model.getFrameId(base)].inverse() * data.oMf[model.getFrameId(tool)]).homogeneous
    pose[:3, 3] *= 1000
    return pose


def arm(convention: str, rows: list[tuple[float, float, float, float]], **frames: np.ndarray) -> Robot:
    """A revolute arm from a published table of (theta, d, a, alpha); deg, mm."""
    links = []
    for i, (theta, d, a, alpha) in enumerate(rows, start=1):
        angles = {"theta": np.radians(theta), "alpha": np.radians(alpha)}
        links.append(Link(Joint("revolute", f"joint {i}"), angles | {"d": d, "a": a}))
    return Robot("arm", convention, tuple(links), **frames)


def test_panda_from_its_published_table(rng):
    # Craig's convention, as the maker publishes it; the flange (link 8) is 107 mm along the last axis
    rows = [
        (0, 333, 0, 0),
        (0, 0, 0, -90),
        (0, 316, 0, 90),
        (0, 0, 82.5, 90),
        (0, 384, -82.5, -90),
        (0, 0, 0, 90),
        (0, 0, 88, 90),
    ]
    panda = arm("craig", rows, tool=shift(z=107).real)
    model = urdf_model("panda.urdf")
    joints = [f"panda_joint{i}" for i in range(1, 8)]
    for q in rng.uniform(-3, 3, (20, 7)):
        expected = urdf_pose(model, joints, q, "panda_link0", "panda_link8")
        np.testing.assert_allclose(evaluate(panda, q)[0], expected, atol=1e-9)


def test_ur5_from_its_published_table(rng):
    # standard convention, as the maker publishes it; its base frame is half a turn about z from the URDF's base_link
    rows = [
        (0, 89.159, 0, 90),
        (0, 0, -425, 0),
        (0, 0, -392.25, 0),
        (0, 109.15, 0, 90),
        (0, 94.65, 0, -90),
        (0, 82.3, 0, 0),
    ]
    ur5 = arm("standard", rows, base=np.diag([-1.0, -1.0, 1.0, 1.0]))
    model = urdf_model("ur5_robot.urdf")
    joints = [f"{name}_joint" for name in ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]]
    for q in rng.uniform(-3, 3, (20, 6)):
        expected = urdf_pose(model, joints, q, "base_link", "tool0")
        np.testing.assert_allclose(evaluate(ur5, q)[0], expected, atol=1e-9)


def test_shipped_tiago_is_its_urdf(rng, configs):
    # a prismatic lift before seven revolute joints
    tiago = load_robot(configs / "robots" / "tiago.yaml")
    model = urdf_model("tiago_no_hand.urdf")
    joints = ["torso_lift_joint", *(f"arm_{i}_joint" for i in range(1, 8))]
    metres = np.array([1000.0, *[1.0] * 7])
    for q in rng.uniform(tiago.lower, tiago.upper, (20, 8)):
        expected = urdf_pose(model, joints, q / metres, "base_link", "arm_tool_link")
        np.testing.assert_allclose(evaluate(tiago, q)[0], expected, atol=1e-9)
    limits = [model.joints[model.getJointId(name)].idx_q for name in joints]
    np.testing.assert_allclose(tiago.lower / metres, model.lowerPositionLimit[limits], atol=1e-9)
    np.testing.assert_allclose(tiago.upper / metres, model.upperPositionLimit[limits], atol=1e-9)


def test_shipped_fr3_has_the_panda_s_table_and_the_camera_s_mount(rng, configs):
    fr3 = load_robot(configs / "robots" / "franka_fr3.yaml")
    model = urdf_model("panda.urdf")
    mount = shift(94.5, -9, 40.55).real @ turn(2, np.pi / 2).real
    for q in rng.uniform(fr3.lower, fr3.upper, (20, 7)):
        flange = urdf_pose(model, [f"panda_joint{i}" for i in range(1, 8)], q, "panda_link0", "panda_link8")
        np.testing.assert_allclose(evaluate(fr3, q)[0], flange @ mount, atol=1e-9)


# ------------------------------------------------------------------------------------------- the paper's robot


ERRORS = TABLE_III


def test_the_paper_s_robot_at_a_pose_worked_out_by_hand(configs):
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    pose, _, _ = evaluate(robot, np.array([np.pi / 4, 1100, 0, np.pi / 2, 0]))
    # along the elbow's axis, 300 mm across the waist's direction, then the wrist's 25 mm back
    np.testing.assert_allclose(pose[:3, 3], [-325 / np.sqrt(2), 275 / np.sqrt(2), 1100], atol=1e-9)
    np.testing.assert_allclose(pose[:3, 3], [-229.81, 194.454, 1100], atol=5e-4)


def test_the_paper_s_errors_displace_its_robot_by_four_millimetres(rng, configs):
    # the paper reports 4.17 mm in the mean and 5.46 mm at most on a test set that it does not give
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    parameters = parameter_set(robot)
    assert set(parameters.names) == set(ERRORS)
    f = forward(chain(robot, parameters))
    frames = frame_vector(robot.base, robot.tool)
    lower, upper = robot.lower.copy(), robot.upper.copy()
    lower[0], upper[0] = -np.pi / 2, np.pi / 2
    x = parameters.vector(ERRORS)
    displaced = [
        np.linalg.norm(np.array(f(q, x, frames)[0] - f(q, 0 * x, frames)[0])[:3, 3])
        for q in rng.uniform(lower, upper, (200, 5))
    ]
    assert 4.1 < np.mean(displaced) < 4.5
    assert 5.2 < np.max(displaced) < 6.0
