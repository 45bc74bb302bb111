"""First values of frames: closed forms and alternation against known truth."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from cases import ARM, PLANAR, anywhere, handling
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import random_frame, seeds

from symcal.kernels import batch_function
from symcal.kinematics import chain, forward, frame_vector
from symcal.parameters import ParameterSet
from symcal.placing.registration import Registration, hand_eye, register, rigid_fit, virtual_points
from symcal.robot.robot import Robot
from symcal.spatial import transform

POINTS = np.array([[60.0, 0.0, 120.0], [0.0, 80.0, 120.0], [-40.0, 0.0, 180.0]])


def flanges(robot: Robot, count: int, rng: np.random.Generator) -> np.ndarray:
    kernel = batch_function(forward(chain(robot, ParameterSet(()))), evaluations=0)
    return kernel(anywhere(robot, count, rng), np.zeros(0), frame_vector(np.eye(4), np.eye(4)))[0]


FLANGES = {
    name: flanges(robot, 30, np.random.default_rng(1))
    for name, robot in {"arm": ARM, "handling": handling(), "planar": PLANAR}.items()
}
NOMINAL = Registration(np.eye(4), np.eye(4), POINTS, np.inf)


def apart(a: np.ndarray, b: np.ndarray, lever: float = 200.0) -> float:
    """Distance of two frames, mm."""
    turn = Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude()
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3]) + lever * turn)


def seen(base: np.ndarray, flange: np.ndarray, tool: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points on the tool in world, shape (N, k, 3)."""
    poses = base @ flange @ tool
    return poses[:, None, :3, 3] + np.einsum("nij,kj->nki", poses[:, :3, :3], points)


@given(seeds, st.integers(3, 30), st.booleans())
def test_a_rigid_fit_finds_any_frame(seed: int, count: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    truth, points = random_frame(rng, 5000.0), rng.normal(scale=300, size=(count, 3))
    if flat:
        points[:, 2] = 0.0  # where a reflection fits as well
    found = rigid_fit(points, points @ truth[:3, :3].T + truth[:3, 3])
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)
    assert apart(found, truth) < 1e-5


def test_a_rigid_fit_is_scipys(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=(20, 3)), rng.normal(size=(20, 3))
    witness, _ = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
    found = rigid_fit(a, b)
    assert np.allclose(found[:3, :3], witness.as_matrix(), atol=1e-9)
    assert np.allclose(found[:3, :3] @ a.mean(axis=0) + found[:3, 3], b.mean(axis=0))
    both = rigid_fit(np.array([a, b]), np.array([b, b]))
    assert np.allclose(both[0], found)
    assert np.allclose(both[1], np.eye(4), atol=1e-12)


@given(seeds, st.sampled_from(["arm", "handling"]))
def test_hand_eye_finds_base_and_tool(seed: int, robot: str) -> None:
    rng = np.random.default_rng(seed)
    base, tool = random_frame(rng, 5000.0), random_frame(rng, 200.0)
    flange = FLANGES[robot]
    found_base, found_tool = hand_eye(flange, base @ flange @ tool)
    assert apart(found_base, base) < 1e-6
    assert apart(found_tool, tool) < 1e-6


def test_hand_eye_of_a_planar_arm_is_finite_though_not_determined(rng: np.random.Generator) -> None:
    flange = FLANGES["planar"]
    for frame in hand_eye(flange, random_frame(rng) @ flange @ random_frame(rng)):
        assert np.isfinite(frame).all()
        assert np.allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3), atol=1e-9)


@given(seeds, st.sampled_from(["arm", "handling", "planar"]))
@settings(max_examples=20)
def test_poses_are_registered_whatever_the_frames(seed: int, robot: str) -> None:
    rng = np.random.default_rng(seed)
    base, tool = random_frame(rng, 5000.0), random_frame(rng, 200.0)
    flange = FLANGES[robot]
    poses = base @ flange @ tool
    b, x = hand_eye(flange, poses)
    corners = virtual_points(np.eye(4)[None])[0]
    nominal = Registration(np.eye(4), np.eye(4), corners, np.inf)
    start = Registration(b, x, corners, np.inf)
    best = register(flange, virtual_points(poses), nominal, base=True, tool="frame", starts=(start,))[0]
    assert best.rms < 5.0
    if robot != "planar":
        assert apart(best.base, base) < 20.0
        assert apart(best.tool, tool) < 20.0


@given(seeds, st.sampled_from(["arm", "handling"]), st.sampled_from(["position", "points"]))
@settings(max_examples=20)
def test_unknown_points_are_registered_whatever_the_base(seed: int, robot: str, tool: str) -> None:
    rng = np.random.default_rng(seed)
    base, flange = random_frame(rng, 5000.0), FLANGES[robot]
    points = POINTS[:1] if tool == "position" else POINTS
    measured = seen(base, flange, np.eye(4), points)
    nominal = Registration(np.eye(4), np.eye(4), np.zeros_like(points), np.inf)
    best = register(flange, measured, nominal, base=True, tool=tool)[0]  # type: ignore[arg-type]
    # alternation is slow, and a start is all that is asked for: near enough for the fit that follows
    assert best.rms < 0.1 * np.sqrt(np.mean(np.sum((measured - measured.mean(axis=(0, 1))) ** 2, axis=2)))


def test_what_is_known_stays(rng: np.random.Generator) -> None:
    base, tool, flange = random_frame(rng), random_frame(rng, 100.0), FLANGES["arm"]
    measured = seen(base, flange, tool, POINTS)
    (only_base,) = register(flange, measured, Registration(np.eye(4), tool, POINTS, np.inf), base=True, tool=None)
    assert apart(only_base.base, base) < 1e-6
    assert np.array_equal(only_base.tool, tool)
    (only_tool,) = register(flange, measured, Registration(base, np.eye(4), POINTS, np.inf), base=False, tool="frame")
    assert apart(only_tool.tool, tool) < 1e-6
    assert np.array_equal(only_tool.base, base)
    (shift,) = register(
        flange,
        seen(base, flange, transform(np.eye(3), np.array([1.0, 2.0, 3.0])), POINTS),
        Registration(base, np.eye(4), POINTS, np.inf),
        base=False,
        tool="position",
    )
    assert np.allclose(shift.tool[:3, 3], [1, 2, 3])
    assert shift.rms < 1e-9


def test_points_that_were_not_seen_do_not_count(rng: np.random.Generator) -> None:
    base, flange = random_frame(rng), FLANGES["arm"]
    measured = seen(base, flange, np.eye(4), POINTS)
    measured[rng.random(measured.shape[:2]) < 0.4] = np.nan
    (found,) = register(flange, measured, NOMINAL, base=True, tool=None)
    assert apart(found.base, base) < 1e-6


def test_a_point_that_is_never_seen_stays_where_it_was_said_to_be() -> None:
    flange = FLANGES["arm"]
    measured = seen(np.eye(4), flange, np.eye(4), POINTS)
    measured[:, 1] = np.nan
    wrong = np.array([[5.0, 0, 0], [7.0, 0, 0], [0, 0, 0]])
    start = Registration(np.eye(4), np.eye(4), POINTS + wrong, np.inf)
    best = register(flange, measured, start, base=False, tool="points")[0]
    wrong[0] = 0.0
    assert np.allclose(best.points, POINTS + wrong)


def test_where_the_data_leave_a_choice_the_nominal_tool_is_kept(rng: np.random.Generator) -> None:
    """A planar arm sees neither where along its axes the tool sits nor how it is turned about them."""
    flange, corners = FLANGES["planar"], virtual_points(np.eye(4)[None])[0]
    base, tool = random_frame(rng), random_frame(rng, 100.0)
    poses = base @ flange @ tool
    nominal = Registration(np.eye(4), tool, corners, np.inf)
    b, x = hand_eye(flange, poses)
    start = Registration(b, x, corners, np.inf)
    best = register(flange, virtual_points(poses), nominal, base=True, tool="frame", starts=(start,))[0]
    assert apart(best.tool, tool) < 1e-3
    assert apart(best.base, base) < 1e-3


def test_guesses_are_few_different_and_sorted(rng: np.random.Generator) -> None:
    base, flange = random_frame(rng), FLANGES["handling"]
    measured = seen(base, flange, np.eye(4), POINTS[:1]) + rng.normal(scale=1, size=(30, 1, 3))
    start = Registration(np.eye(4), np.eye(4), np.zeros((1, 3)), np.inf)
    rms = [g.rms for g in register(flange, measured, start, base=True, tool="position")]
    assert 1 <= len(rms) <= 3
    assert all(b > a for a, b in pairwise(rms))
