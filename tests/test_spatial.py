"""Rotations and transforms against SciPy, and their derivatives at the points where formulas break."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from symcal import spatial

axes = st.sampled_from([np.eye(3)[0], np.eye(3)[1], -np.eye(3)[2], np.array([1.0, -2.0, 3.0]) / np.sqrt(14)])
directions = axes | st.integers(0, 2**32 - 1).map(lambda seed: unit(np.random.default_rng(seed).normal(size=3)))
angles = st.sampled_from([0.0, 1e-12, 1e-8, 9.9e-5, 1e-4, 1.1e-4, 1e-3, np.pi / 2, np.pi - 1e-9, np.pi]) | st.floats(
    0, np.pi
)
vectors = st.builds(lambda axis, angle: angle * axis, directions, angles)
quaternions = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).normal(size=4))


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def compiled(f, rows: int, columns: int = 1) -> ca.Function:
    """The expression and its AD Jacobian as one function."""
    symbol = ca.SX.sym("s", rows, columns)
    value = f(symbol)
    return ca.Function("f", [symbol], [value, ca.jacobian(ca.vec(ca.densify(value)), ca.vec(symbol))])


EXP = compiled(spatial.exp_rotation, 3)
LOG = compiled(spatial.log_rotation, 3, 3)
ROUND_TRIP = compiled(lambda r: spatial.log_rotation(spatial.exp_rotation(r)), 3)
QUATERNION = compiled(spatial.quaternion_matrix, 4)
LEFT = compiled(spatial.left_jacobian, 3)
RIGHT_INVERSE = compiled(spatial.right_jacobian_inverse, 3)


def dense(function: ca.Function, *arguments: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.array(value) for value in function.call([ca.DM(a) for a in arguments]))


@given(st.integers(0, 2), st.floats(-10, 10))
def test_elementary_rotation(axis, angle):
    value = np.array(ca.DM(spatial.rotation(axis, angle)))
    np.testing.assert_allclose(value, Rotation.from_euler("xyz"[axis], angle).as_matrix(), atol=1e-15)


def test_skew_is_the_cross_product(rng):
    v, w = rng.normal(size=(2, 3))
    np.testing.assert_allclose(np.array(ca.DM(spatial.skew(ca.SX(v)))) @ w, np.cross(v, w), atol=1e-15)


@given(vectors)
def test_exponential(r):
    value, _ = dense(EXP, r)
    np.testing.assert_allclose(value, Rotation.from_rotvec(r).as_matrix(), atol=4e-16)


@given(vectors)
def test_derivative_of_the_exponential(r):
    # the Frechet derivative of the matrix exponential: expm of the block matrix [[K, dK], [0, K]] has it in a corner
    _, jacobian = dense(EXP, r)
    k = np.cross(np.eye(3), r)
    for i, e in enumerate(np.eye(3)):
        direction = np.cross(np.eye(3), e)
        frechet = expm(np.block([[k, direction], [np.zeros((3, 3)), k]]))[:3, 3:]
        np.testing.assert_allclose(jacobian[:, i].reshape(3, 3, order="F"), frechet, atol=1e-11)


@given(vectors)
def test_left_jacobian_is_the_derivative_of_the_exponential(r):
    rotation, derivative = dense(EXP, r)
    left, _ = dense(LEFT, r)
    for i in range(3):
        spin = derivative[:, i].reshape(3, 3, order="F") @ rotation.T
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], left[:, i], atol=1e-11)


@given(vectors)
def test_right_jacobian_inverse(r):
    # J_r(r) = J_l(-r)
    inverse, _ = dense(RIGHT_INVERSE, r)
    left, _ = dense(LEFT, -r)
    np.testing.assert_allclose(inverse @ left, np.eye(3), atol=1e-12)


@given(vectors)
def test_logarithm(r):
    matrix = Rotation.from_rotvec(r).as_matrix()
    value = dense(LOG, matrix)[0].ravel()
    assert np.linalg.norm(value) <= np.pi + 1e-12
    # at half a turn either sign of the axis is right, so the rotations are compared, and the vectors away from it
    np.testing.assert_allclose(Rotation.from_rotvec(value).as_matrix(), matrix, atol=4e-15)
    if np.linalg.norm(r) < 3.1:
        np.testing.assert_allclose(value, r, atol=2e-14)


@given(vectors)
def test_logarithm_undoes_the_exponential_with_the_identity_as_derivative(r):
    if np.linalg.norm(r) < np.pi - 1e-6:
        value, jacobian = dense(ROUND_TRIP, r)
        np.testing.assert_allclose(value.ravel(), r, atol=2e-14)
        np.testing.assert_allclose(jacobian, np.eye(3), atol=1e-7)


@pytest.mark.parametrize("function", [EXP, ROUND_TRIP, LEFT, RIGHT_INVERSE], ids=["exp", "log exp", "left", "right"])
@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-160, 1e-12, 9.999e-5, 1.0001e-4, np.pi])
@pytest.mark.parametrize("axis", [*np.eye(3), -np.eye(3)[1], unit(np.array([1.0, 1.0, 0.0])), np.ones(3) / np.sqrt(3)])
def test_finite_at_the_singular_points_themselves(function, angle, axis):
    assert all(np.isfinite(value).all() for value in dense(function, angle * axis))


def test_exact_derivatives_at_zero():
    zero = np.zeros(3)
    np.testing.assert_array_equal(dense(ROUND_TRIP, zero)[1], np.eye(3))
    np.testing.assert_array_equal(dense(LEFT, zero)[0], np.eye(3))
    np.testing.assert_array_equal(dense(RIGHT_INVERSE, zero)[0], np.eye(3))


def test_second_derivative_at_zero_is_finite():
    # a Hessian of a squared rotation residual, as an exact-Newton solver asks for it at the first iterate
    r = ca.SX.sym("r", 3)
    log = spatial.log_rotation(spatial.exp_rotation(r))
    hessian = ca.Function("h", [r], [ca.hessian(ca.dot(log, log), r)[0]])
    np.testing.assert_allclose(np.array(hessian(np.zeros(3))), 2 * np.eye(3), atol=1e-12)


@given(quaternions)
def test_quaternion_of_any_length_and_sign(q):
    expected = Rotation.from_quat(q).as_matrix()
    np.testing.assert_allclose(dense(QUATERNION, q)[0], expected, atol=1e-15)
    np.testing.assert_allclose(dense(QUATERNION, -q)[0], expected, atol=1e-15)
    np.testing.assert_allclose(dense(QUATERNION, 7 * q)[0], expected, atol=1e-15)


@given(st.lists(st.floats(-7, 7), min_size=3, max_size=3))
def test_roll_pitch_yaw_is_urdf_s(rpy):
    roll, pitch, yaw = rpy
    expected = (
        Rotation.from_rotvec([0, 0, yaw]) * Rotation.from_rotvec([0, pitch, 0]) * Rotation.from_rotvec([roll, 0, 0])
    )
    matrix = spatial.rpy_matrix(np.array(rpy))
    np.testing.assert_allclose(matrix, expected.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(spatial.rpy_matrix(spatial.matrix_rpy(matrix)), matrix, atol=1e-7)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_gimbal_lock_is_silent_and_keeps_the_rotation(pitch):
    matrix = spatial.rpy_matrix(np.array([0.3, pitch, 1.1]))
    rpy = spatial.matrix_rpy(matrix)
    assert rpy[2] == 0.0
    np.testing.assert_allclose(spatial.rpy_matrix(rpy), matrix, atol=1e-9)


@pytest.mark.parametrize("shape", [(), (5,), (2, 3)])
def test_poses_round_trip_and_invert(rng, shape):
    pose = rng.normal(scale=300, size=(*shape, 7))
    pose[..., 3:] /= np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
    matrix = spatial.pose_matrix(pose)
    again = spatial.matrix_pose(matrix)
    assert again.shape == pose.shape
    assert (again[..., 6] >= 0).all()
    np.testing.assert_allclose(again, pose * np.where(pose[..., 6:] < 0, [1, 1, 1, -1, -1, -1, -1], 1), atol=1e-13)
    inverse = spatial.inverse(matrix)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrix), atol=1e-12)
    np.testing.assert_allclose(inverse @ matrix, np.broadcast_to(np.eye(4), matrix.shape), atol=1e-12)


def test_transform_composes_rotation_and_translation():
    matrix = spatial.transform(spatial.rpy_matrix(np.array([0, 0, np.pi / 2])), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(matrix @ [10, 0, 0, 1], [1, 12, 3, 1], atol=1e-14)


_ROTATIONS = Rotation.concatenate(
    [
        Rotation.random(200, rng=5),
        Rotation.identity(),
        Rotation.from_rotvec(np.pi * np.vstack([np.eye(3), [0.6, -0.8, 0.0], [0.0, -0.6, 0.8]])),
        Rotation.from_rotvec([[1e-9, 2e-9, -1e-12], [3.1415926, 1e-7, 0.0]]),
    ]
)


def test_numeric_formats_are_those_of_scipy() -> None:
    matrices, quaternions = _ROTATIONS.as_matrix(), _ROTATIONS.as_quat()
    np.testing.assert_allclose(spatial.quaternion_matrices(-3.0 * quaternions), matrices, atol=1e-15)
    np.testing.assert_allclose(spatial.vector_matrix(_ROTATIONS.as_rotvec()), matrices, atol=2e-15)
    assert np.array_equal(spatial.vector_matrix(np.zeros(3)), np.eye(3))
    found = spatial.matrix_quaternions(matrices)
    np.testing.assert_allclose(np.abs(np.sum(found * quaternions, axis=1)), 1.0, atol=1e-15)
    np.testing.assert_allclose(spatial.quaternion_matrices(found), matrices, atol=2e-15)
    assert (found[:, 3] >= 0).all()
    np.testing.assert_allclose(spatial.vector_matrix(spatial.matrix_vectors(matrices)), matrices, atol=2e-15)
    vectors, expected = spatial.matrix_vectors(matrices), _ROTATIONS.as_rotvec()
    half_turn = np.abs(np.linalg.norm(expected, axis=1) - np.pi) < 1e-9  # both signs of the axis are right
    np.testing.assert_allclose(vectors[~half_turn], expected[~half_turn], atol=1e-14)
    assert np.array_equal(spatial.matrix_vectors(np.eye(3)), np.zeros(3))
    angles = np.random.default_rng(3).uniform(-np.pi, np.pi, (4, 5, 3))
    witness = Rotation.from_euler("xyz", angles.reshape(-1, 3)).as_matrix().reshape(4, 5, 3, 3)
    np.testing.assert_allclose(spatial.rpy_matrix(angles), witness, atol=1e-15)


def test_the_mean_rotation_is_that_of_scipy() -> None:
    near = Rotation.from_rotvec(np.random.default_rng(4).normal(scale=0.8, size=(30, 3))) * Rotation.random(rng=6)
    np.testing.assert_allclose(spatial.mean_rotation(near.as_matrix()), near.mean().as_matrix(), atol=1e-13)


def test_many_roll_pitch_yaw_at_once_are_those_of_each() -> None:
    matrices = np.concatenate([_ROTATIONS.as_matrix(), spatial.rpy_matrix(np.array([[0.3, np.pi / 2, 1.0]]))])
    found = spatial.matrix_rpy(matrices)
    np.testing.assert_allclose(spatial.rpy_matrix(found), matrices, atol=1e-12)
    free = np.cos(found[:, 1]) > 1e-3
    expected = Rotation.from_matrix(matrices[free]).as_euler("xyz")  # half a turn is both pi and -pi
    np.testing.assert_allclose(np.exp(1j * found[free]), np.exp(1j * expected), atol=1e-12)


@pytest.mark.parametrize("pitch", [0.3, -1.2, np.pi / 2, -np.pi / 2])
def test_roll_pitch_yaw_come_back(pitch: float) -> None:
    matrix = spatial.rpy_matrix(np.array([0.7, pitch, -2.1]))
    found = spatial.matrix_rpy(matrix)
    np.testing.assert_allclose(spatial.rpy_matrix(found), matrix, atol=1e-12)
    if abs(pitch) < 1.5:
        np.testing.assert_allclose(found, [0.7, pitch, -2.1], atol=1e-14)
    else:
        assert found[2] == 0.0
