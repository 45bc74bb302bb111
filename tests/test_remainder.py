"""A smooth remainder: dense formulas of Gaussian processes, exact derivatives, files, and what it is worth."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from remainder_draws import NOISE, TASK, arm, measured, planted, tried
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from strategies import generators, random_robot, readings

from symcal import spatial
from symcal.calibration.calibrate import calibrate
from symcal.calibration.evaluate import evaluate, expected_position_rms
from symcal.calibration.remainder import outside, physics_of, remainder_facts, with_remainder
from symcal.compensation.compensate import compensate
from symcal.compensation.targets import commanded, tool_pose
from symcal.errors import InputError, RefusedError
from symcal.export import FORMATS, export_robot
from symcal.export.carries import refuse_remainder
from symcal.export.json import save_json
from symcal.export.urdf import save_urdf, urdf_text
from symcal.fit.correlated_rows import field_of
from symcal.fit.estimation import Options
from symcal.instruments.distance import Distance
from symcal.joints.remainder import SHIFTS, Kernel, Remainder, remainder_of
from symcal.kernels import batch_function
from symcal.kinematics import chain, frame_vector, omegas, stack
from symcal.model.model import build_model
from symcal.model.observation import Observation, Place, Target
from symcal.model.parameter_set import parameter_set
from symcal.model.shifted import with_shift
from symcal.model.task import Task
from symcal.parameters import Parameter, ParameterSet
from symcal.robot.conventions import convert
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Robot


def with_field(robot: Robot, rng: np.random.Generator, count: int = 5) -> Robot:
    revolute = tuple(joint.revolute for joint in robot.joints)
    lengths = np.where(revolute, rng.uniform(0.5, 2, robot.dof), rng.uniform(100, 400, robot.dof))
    centres = np.array([readings(rng, robot) for _ in range(count)])
    return replace(robot, remainder=Remainder(Kernel(revolute, lengths), centres, rng.normal(size=(count, 3)), 0.5))


def kernel_by_hand(kernel: Kernel, a: np.ndarray, b: np.ndarray) -> float:
    """The squared exponential of (cos, sin) of revolute joints and of readings of prismatic ones."""
    out = 1.0
    for turns, length, x, y in zip(kernel.revolute, kernel.lengths, a, b, strict=True):
        u, v = (
            (np.array([np.cos(x), np.sin(x)]), np.array([np.cos(y), np.sin(y)]))
            if turns
            else (np.array([x]), np.array([y]))
        )
        out *= np.exp(-np.sum((u - v) ** 2) / (2 * length**2))
    return out


# ------------------------------------------------------------------------------------------------------------ the field


@given(generators)
def test_kernel_and_displacement_are_the_squared_exponential_s(rng):
    robot = with_field(random_robot(rng), rng)
    found = robot.remainder
    q = np.array([readings(rng, robot) for _ in range(3)])
    k = np.array([[kernel_by_hand(found.kernel, a, c) for c in found.centres] for a in q])
    np.testing.assert_allclose(found.kernel(q, found.centres), k, rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(found.displacement(q), k @ found.weights, rtol=1e-10, atol=1e-13)
    f = ca.SX.sym("q", robot.dof)
    expression = ca.Function("f", [f], [found.expression(f)[0]])
    np.testing.assert_allclose(
        np.array([expression(a) for a in q])[:, :, 0], found.displacement(q), rtol=1e-10, atol=1e-13
    )


def test_functions_of_unit_variance_make_the_kernel(rng):
    kernel = Kernel((True, True, False), np.array([0.8, 1.1, 200.0]))
    q = np.column_stack([rng.uniform(-1, 1, (40, 2)), rng.uniform(0, 500, 40)])
    whole = kernel.basis(q, q)
    np.testing.assert_allclose(whole @ whole.T, kernel(q, q), atol=1e-8)
    chosen = kernel.spanning(q, 1000, 0.01)
    some = kernel.basis(q, q[chosen])
    left = 1 - (some**2).sum(axis=1)
    assert len(chosen) < 40
    assert left.max() <= 0.01 + 1e-9
    assert len(kernel.spanning(q, 7, 0.0)) == 7
    t = rng.normal(size=(len(chosen), 3))
    np.testing.assert_allclose(remainder_of(kernel, q[chosen], t, 1.0).displacement(q), some @ t, atol=1e-8)


@given(generators)
def test_screws_are_what_automatic_differentiation_gives(rng):
    robot = with_field(random_robot(rng), rng)
    own = parameter_set(robot, base=True, tool="frame")
    parameters = ParameterSet((*own.items, *(Parameter(name, "mm", 0.0, 1.0) for name in SHIFTS)))
    model = chain(robot, parameters)
    point = model.tool[:3, 3] + model.tool[:3, :3] @ ca.DM([10, -20, 30])
    both = ca.Function(
        "both",
        [model.q, model.x, model.frames],
        [
            stack(model.parameter_screws, point),
            ca.jacobian(point, model.x),
            stack(model.joint_screws, point),
            ca.jacobian(point, model.q),
            omegas(model.joint_screws),
            ca.jacobian(ca.vec(model.tool[:3, :3]), model.q),
            model.tool[:3, :3],
        ],
    )
    q, x = readings(rng, robot), rng.normal(0, 0.1, len(parameters))
    screws, ad, joints, joint_ad, spins, rotation_ad, rotation = (
        np.array(v) for v in both(q, x, frame_vector(robot.base, robot.tool))
    )
    np.testing.assert_allclose(screws, ad, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(joints, joint_ad, rtol=1e-9, atol=1e-8)
    for k in range(robot.dof):
        spin = rotation_ad[:, k].reshape(3, 3, order="F") @ rotation.T
        np.testing.assert_allclose(spins[:, k], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-9)


@given(generators)
def test_the_tool_is_displaced_along_the_axes_of_the_base(rng):
    plain = random_robot(rng)
    robot = with_field(plain, rng)
    q = readings(rng, robot)
    moved, still = (
        np.array(ca.Function("t", [m.q, m.x, m.frames], [m.tool])(q, [], frame_vector(robot.base, robot.tool)))
        for m in (chain(r, ParameterSet(())) for r in (robot, plain))
    )
    np.testing.assert_allclose(moved[:3, :3], still[:3, :3], atol=1e-12)
    shift = robot.base[:3, :3] @ robot.remainder.displacement(q[None])[0]
    np.testing.assert_allclose(moved[:3, 3] - still[:3, 3], shift, atol=1e-9)


@given(generators)
def test_another_convention_is_the_same_robot(rng):
    robot = replace(with_field(random_robot(rng), rng), record=None)
    other = convert(robot, "craig" if robot.convention == "standard" else "standard")
    q = readings(rng, robot)
    poses = [
        np.array(ca.Function("t", [m.q, m.x, m.frames], [m.tool])(q, [], frame_vector(r.base, r.tool)))
        for r, m in ((r, chain(r, ParameterSet(()))) for r in (robot, other))
    ]
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-8)


# ------------------------------------------------------------------------------------------------------------- the file


@given(generators)
def test_a_robot_file_holds_it(tmp_path_factory, rng):
    robot = with_field(random_robot(rng), rng)
    path = tmp_path_factory.mktemp("robot") / "robot.yaml"
    save_robot(robot, path, ("m", "deg") if rng.random() < 0.5 else ("mm", "rad"))
    found = load_robot(path).remainder
    for name in ("centres", "weights", "amplitude"):
        np.testing.assert_allclose(getattr(found, name), getattr(robot.remainder, name), rtol=1e-14)
    np.testing.assert_allclose(found.kernel.lengths, robot.remainder.kernel.lengths, rtol=1e-14)
    assert found.kernel.revolute == robot.remainder.kernel.revolute


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("lengths: [1, 1, 1, 1]", "lengths: [1, 1, 1]", "remainder.lengths"),
        ("lengths: [1, 1, 1, 1]", "lengths: [1, 1, 1, 0]", "remainder.lengths[3]"),
        ("[5, 6, 7, 8]]", "[5, 6, 7]]", "remainder.centres[1]"),
        ("[5, 6, 7, 8]]", "[1, 2, 3, 4]]", "remainder.centres"),
        ("[0, 1, 0]]", "[0, 1]]", "remainder.weights[1]"),
        ("[[1, 0, 0], [0, 1, 0]]", "[[1, 0, 0]]", "remainder.weights"),
        ("amplitude: 1", "amplitude: -1", "remainder.amplitude"),
        (", amplitude: 1", "", "remainder.amplitude"),
    ],
)
def test_wrong_shapes_are_said_once(tmp_path, old, new, key):
    path = tmp_path / "robot.yaml"
    save_robot(arm(), path)
    entry = (
        "lengths: [1, 1, 1, 1], amplitude: 1, centres: [[1, 2, 3, 4], [5, 6, 7, 8]], weights: [[1, 0, 0], [0, 1, 0]]"
    )
    text = path.read_text() + f"remainder: {{{entry}}}\n"
    path.write_text(text)
    assert load_robot(path).remainder is not None
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_robot(path)
    assert caught.value.key == key
    assert caught.value.line is not None


# -------------------------------------------------------------------------------------------------------------- the fit


def test_whitening_and_coefficients_are_those_of_the_dense_covariance(rng):
    poses, points, ratio = 6, 2, 3.7
    turns = Rotation.random(poses * points, rng=rng).as_matrix().reshape(poses, points, 3, 3)
    measured_points = np.ones((poses, points), dtype=bool)
    measured_points[2, 1] = measured_points[4] = False
    turns *= measured_points[:, :, None, None]
    basis = rng.normal(size=(poses, 4))
    columns = np.array([[0, 1, 2], [4, 5, 6]])  # column 3 is no position
    field = field_of(columns, turns, basis)
    values = rng.normal(size=(poses, 7, 2))
    values[~measured_points[:, 0], :3] = values[~measured_points[:, 1], 4:] = 0.0

    design = np.zeros((poses, 7, 4, 3))
    design[:, columns] = np.einsum("npij,nm->npimj", turns, basis)
    flat = design.reshape(poses * 7, 12)
    covariance = np.eye(poses * 7) + ratio * flat @ flat.T
    v = values.reshape(-1, 2)
    white = field.whitened(values, ratio).reshape(-1, 2)
    np.testing.assert_allclose(white.T @ white, v.T @ np.linalg.solve(covariance, v), rtol=1e-10)
    np.testing.assert_allclose(field.log_determinant(ratio), np.linalg.slogdet(covariance)[1], rtol=1e-10)
    mean = ratio * flat.T @ np.linalg.solve(covariance, v)
    np.testing.assert_allclose(field.coefficients(values, ratio).reshape(12, 2), mean, rtol=1e-9, atol=1e-12)


def test_an_identification_is_generalised_least_squares_with_a_dense_process(rng):
    """Estimate, field and predicted uncertainty against NumPy's dense formulas at the same variances."""
    true = planted(arm(), rng)
    data = measured(build_model(true, TASK), rng, 60, 20)
    options = Options(sigma={"position": NOISE}, scales="stated")
    plain = calibrate(build_model(arm(), TASK), None, data, options)
    found = with_remainder(plain, data, options, rng)
    assert found.trial is not None
    assert found.trial.kept
    kernel, a = found.trial.candidate.kernel, found.trial.candidate.amplitude
    train, test = data.part("train"), data.part("test")
    physics = physics_of(replace(plain, after=replace(found.after, remainder=None)), train, options)
    index = plain.model.parameters.indices(found.after.free)
    r, jacobian = physics.r, physics.jacobian[:, :, index]
    turns = physics.turns[:, 0]
    k = a**2 * kernel(train.q, train.q)
    inside = kernel.basis(train.q, found.trial.candidate.centres)
    np.testing.assert_allclose(a**2 * inside @ inside.T, k, atol=0.03 * a**2)  # what the centres leave untold
    rotation = block_diag(*turns)
    covariance = NOISE**2 * np.eye(180) + rotation @ np.kron(a**2 * inside @ inside.T, np.eye(3)) @ rotation.T
    weight = np.linalg.inv(covariance)
    items = [plain.model.parameters.items[i] for i in index]
    prior = np.diag([1 / (p.scale * (1e3 if p.unknown else 1)) ** 2 for p in items])
    flat, residual = jacobian.reshape(180, -1), r.reshape(-1)
    gradient = flat.T @ weight @ residual + prior @ found.after.x[index]
    posterior = np.linalg.inv(flat.T @ weight @ flat + prior)
    assert np.abs(posterior @ gradient / found.after.posterior.sigmas).max() < 1e-3  # at the minimum
    np.testing.assert_allclose(found.after.posterior.sigmas, np.sqrt(np.diag(posterior)), rtol=1e-6)

    cross = a**2 * kernel.basis(test.q, found.trial.candidate.centres) @ inside.T
    wide = np.kron(cross, np.eye(3)) @ rotation.T
    mean = -(wide @ weight @ residual).reshape(-1, 3)
    np.testing.assert_allclose(found.robot.remainder.displacement(test.q), mean, atol=1e-8)

    base = found.robot.base[:3, :3]
    _, slopes = found.model.points(test.q, found.after.x, found.after.setup.vector)
    turned = np.kron(np.eye(len(test)), base)
    left = slopes[:, :, index].reshape(-1, len(index)) - turned @ wide @ weight @ flat
    of_field = 3 * a**2 - np.einsum("ij,jk,ik->i", wide, weight, wide).reshape(-1, 3).sum(axis=1)
    variance = np.einsum("ij,jk,ik->i", left, posterior, left).reshape(-1, 3).sum(axis=1) + of_field
    np.testing.assert_allclose(expected_position_rms(found.model, found.after, test.q), np.sqrt(variance), rtol=1e-4)


def test_slopes_by_a_displacement_are_the_base_s(rng):
    """A displacement of the flange along the axes of the base is what a shift of the base is."""
    model = build_model(arm(), TASK)
    data = measured(model, rng, 60, 10)
    plain = calibrate(model, None, data, Options())
    physics = physics_of(plain, data.part("train"), Options())
    base = [model.parameters.index(f"base_{axis}") for axis in "xyz"]
    increment = Rotation.from_rotvec([plain.after.x[model.parameters.index(f"base_r{axis}")] for axis in "xyz"])
    shifted = physics.jacobian[:, :, base] @ increment.as_matrix()  # base_x stands before the base's rotation
    np.testing.assert_allclose(physics.turns[:, 0], shifted, atol=1e-9)


# ----------------------------------------------------------------------------------------------------- what it is worth


@pytest.fixture(scope="module")
def kept():
    return tried(0, planted(arm(), np.random.default_rng(5)), 100)


def test_a_planted_field_is_found_and_held_out_poses_say_so(kept):
    plain, found, data = kept
    test = data.part("test")
    before, after = (evaluate(c.states["after"], test).statistics.rms for c in (plain, found))
    assert found.trial.kept
    assert found.bare is plain.model
    assert after < 0.45 * before
    expected = np.sqrt(np.mean(expected_position_rms(found.model, found.after, test.q) ** 2))
    assert 0.75 < after / np.hypot(expected, np.sqrt(3) * NOISE) < 1.2
    assert abs(found.after.sigmas["position"] / NOISE - 1) < 0.2
    # held-out poses of the training set foretell unseen ones
    assert 0.6 < np.sqrt(np.mean(found.trial.given**2)) / after < 1.5


def test_states_before_are_without_it(kept):
    plain, found, data = kept
    test = data.part("test")
    for state in ("before", "offsets_only"):
        same = [evaluate(c.states[state], test).vectors for c in (plain, found)]
        np.testing.assert_array_equal(*same)
    assert found.robot.nominal().remainder is None


def test_compensation_uses_it(kept):
    _, found, _ = kept
    rng = np.random.default_rng(3)
    joints = rng.uniform(-0.7, 0.7, (10, 4))
    result = compensate(found.robot, commanded(found.robot, joints), rng)
    nominal, reached = (
        batch_function(tool_pose(r), evaluations=0)(q)[0][:, :3, 3]
        for r, q in ((found.robot.nominal(), joints), (found.robot, result.joints))
    )
    plain = batch_function(tool_pose(found.robot), evaluations=0)(joints)[0][:, :3, 3]
    # four joints cannot turn and shift at will: nearer than without
    assert np.linalg.norm(reached - nominal, axis=1).mean() < 0.5 * np.linalg.norm(plain - nominal, axis=1).mean()


def test_far_from_the_data_it_is_zero_and_says_so(kept):
    _, found, data = kept
    robot = found.robot
    train = data.part("train").q
    assert outside(robot, train) == 0
    far = np.tile([np.pi - 0.2, np.pi - 0.2, np.pi - 0.2, 0.0], (4, 1))
    assert outside(robot, far) == 1
    assert np.abs(robot.remainder.displacement(far)).max() < 1e-3
    facts = remainder_facts(found, np.random.default_rng(0), (np.full(4, -1.0), np.full(4, 1.0)))
    assert facts["kept"]
    assert facts["outside"] < 0.1
    wide = remainder_facts(found, np.random.default_rng(0), (np.full(4, -np.pi), np.full(4, np.pi)))
    assert wide["outside"] > 0.5
    # what is not known grows to the whole amplitude there
    assert found.after.remainder.variance(far) == pytest.approx(robot.remainder.amplitude**2, rel=1e-3)


def test_noise_alone_is_not_kept():
    """Short form; see `remainder_draws.py` for many draws."""
    plain, found, _ = tried(1, None, 40)
    assert not found.trial.kept
    assert found.robot is plain.robot
    assert found.model is plain.model
    assert "not kept" in found.notes[-1]
    facts = remainder_facts(found, np.random.default_rng(0))
    assert facts["kept"] is False
    assert "outside" not in facts


# ------------------------------------------------------------------------------------------------------ what is refused


def test_what_cannot_have_one_is_refused(rng, tmp_path):
    model = build_model(arm(), TASK)
    data = measured(model, rng, 40, 5)
    plain = calibrate(model, None, data, Options())
    with pytest.raises(RefusedError, match="huber"):
        with_remainder(plain, data, Options(loss="huber"), rng)
    with pytest.raises(RefusedError, match="every measurement"):
        with_remainder(plain, replace(data, sigma=np.full((len(data), 3), 0.1)), Options(), rng)
    with pytest.raises(RefusedError, match="fewer than"):
        with_remainder(plain, data.take(np.arange(20)), Options(), rng)
    stand = Place("world", spatial.transform(np.eye(3), np.array([2000.0, 0.0, 0.0])))
    wire = Observation(Distance(), "wire", at=stand, target=Target("tool", Place("tool"), {"P": (0.0, 0.0, 0.0)}))
    with pytest.raises(RefusedError, match="positions or poses"):
        with_shift(build_model(arm(), Task((wire,))))
    robot = planted(arm(), rng)
    with pytest.raises(RefusedError, match="remainder of 12 centres, which URDF"):
        urdf_text(robot)
    with pytest.raises(RefusedError, match="JSON"):
        save_json(robot, tmp_path / "robot.json")
    with pytest.raises(RefusedError, match="URDF"):
        save_urdf(robot, tmp_path / "robot.urdf", approximate=True)
    for way in FORMATS:
        with pytest.raises(RefusedError, match="smooth remainder"):
            export_robot(robot, way, tmp_path / way)
        assert not (tmp_path / way).exists()
    with pytest.raises(RefusedError, match="firmware"):
        refuse_remainder(robot, "firmware")
    refuse_remainder(arm(), "firmware")
    with pytest.raises(RefusedError, match="already"):
        with_remainder(replace(plain, model=build_model(robot, TASK)), data, Options(), rng)
