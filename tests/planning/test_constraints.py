"""Constraints against geometry written out by hand, and the words for what breaks them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from handling_arm import frames_by_hand, front_view, handling_chain, own_setup
from hypothesis import given
from hypothesis import strategies as st

from symcal.errors import InputError, RefusedError
from symcal.planning.area import working_area
from symcal.planning.camera_view import axis_angles, look_at, triangle_area
from symcal.planning.clearance import box_distance, keep_out, plane
from symcal.planning.constraints import (
    Constraint,
    complaints,
    feasible,
    insist,
    joint_limits,
    plan_violation,
    with_fixed,
)
from symcal.planning.coverage import apart, away_from, coverage, nearest_distance, pose_distance
from symcal.planning.sampling import feasible_poses, feasible_shares
from symcal.planning.skeleton import skeleton
from symcal.planning.visibility import visibility

MODEL = handling_chain()
ROBOT = MODEL.robot
ARM = skeleton(MODEL, own_setup(ROBOT))
VIEW = front_view(MODEL)
AREA = working_area(ROBOT, {"waist": (-np.pi / 2, np.pi / 2)})
LIMITS = joint_limits(ROBOT)


@pytest.fixture
def poses(rng):
    return AREA.sample(rng, 300)


# ------------------------------------------------------------------------------------------------------- the geometry


def test_skeleton_runs_through_the_link_frames(poses):
    nodes = ARM.nodes(poses[:20])
    for q, polyline in zip(poses, nodes, strict=False):
        frames = frames_by_hand(q)
        expected = np.array([np.zeros(3), *(f[:3, 3] for f in frames), frames[-1][:3, 3]])
        # every link of this robot runs along one axis only: a corner coincides with its end
        np.testing.assert_allclose(polyline[[0, 2, 4, 6, 8, 10, 11]], expected, atol=1e-9)
        np.testing.assert_allclose(polyline[[1, 3, 5, 7, 9]], expected[1:6], atol=1e-9)
    assert ARM.links == (1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6)


def test_tool_and_its_motion(poses):
    tools = ARM.tool(poses)
    np.testing.assert_allclose(tools[7], frames_by_hand(poses[7])[-1], atol=1e-9)
    position, jacobian = ARM.motion(poses)
    np.testing.assert_allclose(position, tools[:, :3, 3], atol=1e-9)
    for j in range(5):
        h = 1e-5 * np.eye(5)[j]
        slope = (ARM.motion(poses + h)[0] - ARM.motion(poses - h)[0]) / 2e-5
        np.testing.assert_allclose(jacobian[:, :, j], slope, atol=1e-4)


def test_look_at_sees_its_goal_in_the_centre_and_upright():
    eye, goal = np.array([300.0, 3000.0, 1200.0]), np.array([0.0, 500.0, 1100.0])
    T = look_at(eye, goal)
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    seen = T[:3, :3].T @ (goal - eye)
    np.testing.assert_allclose(seen, [0, 0, np.linalg.norm(goal - eye)], atol=1e-9)
    above = T[:3, :3].T @ (goal + np.array([0, 0, 10.0]) - eye)
    assert above[1] < 0  # image y points down
    with pytest.raises(InputError, match="parallel"):
        look_at(np.zeros(3), np.array([0, 0, 5.0]))


@given(st.lists(st.floats(-100, 100), min_size=6, max_size=6))
def test_image_area_is_twice_the_triangle_in_any_order(numbers):
    corners = np.array(numbers).reshape(3, 2)
    edges = np.column_stack([corners[1] - corners[0], corners[2] - corners[0]])
    for order in itertools.permutations(range(3)):
        assert triangle_area(corners[list(order)]) == pytest.approx(abs(np.linalg.det(edges)), abs=1e-6)


def test_axis_angles_over_the_whole_turn():
    points = np.array([[0, 0, 2.0], [1, 0, 1], [0, 3, 0], [0, -1, -1], [0, 0, -2]])
    np.testing.assert_allclose(axis_angles(points), np.deg2rad([0, 45, 90, 135, 180]))


def test_box_distance_inside_outside_and_at_an_edge():
    lower, upper = np.array([-1.0, -2, -3]), np.array([1.0, 2, 3])
    points = np.array([[0.0, 0, 0], [0, 1.5, 0], [4, 0, 0], [4, 6, 0], [2, 3, 4], [1, 0, 0]])
    np.testing.assert_allclose(box_distance(points, lower, upper), [-1, -0.5, 3, 5, np.sqrt(3), 0], atol=1e-12)


# ---------------------------------------------------------------------------------------------------- the constraints


def test_joint_limits_hold_on_the_limit_and_with_margin():
    at_limit = np.vstack([ROBOT.lower, ROBOT.upper])
    assert feasible(LIMITS)(at_limit).all()
    assert not feasible(joint_limits(ROBOT, angle_margin=0.01))(at_limit).any()
    beyond = ROBOT.upper + np.array([0.0, 7.0, 0.0, 0.2, 0.0])
    assert complaints(LIMITS, beyond[None]) == (
        "pose 1 breaks 'joint 2 'lift' within its limits' by 7 mm, 'joint 4 'elbow' within its limits' by 11.5 deg",
    )


def test_field_of_view_against_a_projection_by_hand(poses):
    margin = 20.0
    field = visibility(VIEW, margin=margin)[0]
    values = field.violation(poses)
    camera, r, t = VIEW.camera, VIEW.T_world_camera[:3, :3], VIEW.T_world_camera[:3, 3]
    for q, value in zip(poses, values, strict=True):
        tool = frames_by_hand(q)[-1]
        worst = -np.inf
        for p in VIEW.target.points:
            world = (tool @ VIEW.T_tool_target @ [*p, 1])[:3]
            x, y, z = r.T @ (world - t)
            u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
            reach = margin + camera.fx * VIEW.target.disc_radius / z
            worst = max(worst, -0.5 - u + reach, u - 2447.5 + reach, -0.5 - v + reach, v - 2047.5 + reach)
        assert value == pytest.approx(min(worst, 2448 + 2048), abs=1e-6)
    assert 0 < np.mean(values <= 0) < 1


def test_field_of_view_gets_worse_the_further_a_target_is_behind():
    from symcal.planning.camera_view import camera_view

    values = []
    for turn in (0.0, 100.0, 140.0, 175.0):
        c, s = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
        T = look_at(np.array([0, 3000.0, 1100]), np.array([0, 500.0, 1100]))
        T[:3, :3] = T[:3, :3] @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        away = camera_view(MODEL, VIEW.setup, VIEW.camera, T, VIEW.target, VIEW.T_tool_target)
        values.append(visibility(away)[0].violation(np.array([[0, 1100.0, 100, np.pi / 2, 0]]))[0])
    assert np.all(np.diff(values) > 0)
    assert np.all(np.isfinite(values))


def test_depth_and_incidence_by_hand(poses):
    _, depth, incidence = visibility(VIEW, depth=(2200.0, 2800.0), incidence=np.deg2rad(60))
    r, t = VIEW.T_world_camera[:3, :3], VIEW.T_world_camera[:3, 3]
    for q, by_depth, by_angle in zip(poses, depth.violation(poses), incidence.violation(poses), strict=True):
        target = frames_by_hand(q)[-1] @ VIEW.T_tool_target
        points = [(target @ [*p, 1])[:3] for p in VIEW.target.points]
        z = [(r.T @ (p - t))[2] for p in points]
        assert by_depth == pytest.approx(max(2200 - min(z), max(z) - 2800), abs=1e-6)
        to_camera = [(t - p) / np.linalg.norm(t - p) for p in points]
        angle = max(np.arccos(target[:3, 2] @ ray) for ray in to_camera)
        assert by_angle == pytest.approx(angle - np.pi / 3, abs=1e-6)


def test_plane_keeps_every_joint_above_it(poses):
    table = plane(ARM, "the table", np.array([0, 0, 900.0]), np.array([0, 0, 2.0]), margin=30.0, first_link=3)
    lowest = [min(frame[2, 3] for frame in frames_by_hand(q)[1:]) for q in poses]
    np.testing.assert_allclose(table.violation(poses), 930.0 - np.array(lowest), atol=1e-9)
    # the column stands on the floor: looked at from the first link, it is always below
    assert np.all(plane(ARM, "t", np.array([0, 0, 900.0]), np.array([0, 0, 1.0])).violation(poses) >= 900)


def test_box_against_dense_samples_of_the_arm(poses):
    T_world_box = look_at(np.array([-150.0, 350.0, 1100]), np.array([0.0, 600, 1000]))
    size, margin, spacing = np.array([200.0, 300, 250]), 15.0, 10.0
    box = keep_out(ARM, "the press", T_world_box, size, margin=margin, first_link=3, spacing=spacing)
    values = box.violation(poses)
    for q, value in zip(poses, values, strict=True):
        corners = [frame[:3, 3] for frame in frames_by_hand(q)[1:]]
        share = np.linspace(0, 1, 2001)[:, None]
        points = np.vstack([a + share * (b - a) for a, b in itertools.pairwise(corners)])
        local = (points - T_world_box[:3, 3]) @ T_world_box[:3, :3]
        outside = np.maximum(np.abs(local) - size / 2, 0)
        inside = (size / 2 - np.abs(local)).min(axis=1).max()
        true = margin - np.linalg.norm(outside, axis=1).min() if inside < 0 else margin + inside
        # never too lenient; too strict by at most half a spacing where it says that anything is broken
        assert true - 0.2 <= value <= max(true + spacing / 2 + 0.2, 0.0)
    assert 0 < np.mean(values <= 0) < 1


def test_boxes_and_planes_that_are_none():
    with pytest.raises(InputError, match="edges"):
        keep_out(ARM, "x", np.eye(4), np.array([1.0, 0, 1]))
    with pytest.raises(InputError, match="normal"):
        plane(ARM, "x", np.zeros(3), np.zeros(3))
    with pytest.raises(InputError, match="no such link"):
        plane(ARM, "x", np.zeros(3), np.ones(3), first_link=7)


# ---------------------------------------------------------------------------------------------- feasibility in words


def test_feasible_is_where_all_violations_are_zero(poses):
    constraints = (*LIMITS, *visibility(VIEW, margin=5, incidence=1.2))
    values = np.array([c.violation(poses) for c in constraints])
    np.testing.assert_array_equal(feasible(constraints)(poses), (values <= 1e-9).all(axis=0))
    single = plan_violation(constraints)(poses[:, None])
    np.testing.assert_array_equal(single == 0, feasible(constraints)(poses))
    plans = poses.reshape(3, 100, 5)
    np.testing.assert_allclose(plan_violation(constraints)(plans), single.reshape(3, 100).sum(axis=1))


def test_insisted_poses_are_named_with_what_they_break(poses):
    good = poses[:3]
    assert np.array_equal(insist(LIMITS, good), good)
    bad = good.copy()
    bad[1, 2] = 712.5
    with pytest.raises(RefusedError, match=r"1 of the 3 poses .*: home breaks 'joint 3 'reach' .*' by 12\.5 mm"):
        insist(LIMITS, bad, ["a", "home", "b"])


def test_a_violation_that_is_no_number_is_a_violation():
    odd = Constraint("odd", "mm", lambda q: np.full(len(q), np.nan))
    poses = np.zeros((2, 5))
    assert not feasible([odd])(poses).any()
    assert len(complaints([odd], poses)) == 2
    assert plan_violation([odd])(poses[None])[0] > 0


def test_fixed_poses_come_first(poses):
    def second(plans):
        assert plans.shape == (4, 5, 5)
        return plans[:, 1, 0]

    out = with_fixed(second, poses[:2])(poses[2:14].reshape(4, 3, 5))
    np.testing.assert_array_equal(out, np.full(4, poses[1, 0]))


# ------------------------------------------------------------------------------------------------------------ sampling


def test_sampler_gives_feasible_poses_by_seed():
    constraints = visibility(VIEW, margin=10)
    first = feasible_poses(np.random.default_rng(4), AREA, constraints, 200)
    assert first.shape == (200, 5)
    assert feasible(constraints)(first).all()
    assert AREA.contains(first).all()
    again = feasible_poses(np.random.default_rng(4), AREA, constraints, 200)
    np.testing.assert_array_equal(first, again)
    snapped = feasible_poses(np.random.default_rng(4), AREA, constraints, 200, snap=0.4)
    assert np.mean((snapped == AREA.lower) | (snapped == AREA.upper)) > 0.1


def test_sampler_is_uniform_over_the_feasible_part():
    half = Constraint("elbow below a right angle", "rad", lambda q: q[:, 3] - np.pi / 2)
    poses = feasible_poses(np.random.default_rng(0), AREA, [half], 20000)
    share = AREA.unit(poses)[:, 3] / (np.pi / 2 / AREA.upper[3])
    np.testing.assert_allclose(np.quantile(share, [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.015)


def test_shares_of_the_area_that_constraints_leave():
    half = Constraint("elbow below a right angle", "rad", lambda q: q[:, 3] - np.pi / 2)
    low = Constraint("lift below a quarter", "mm", lambda q: q[:, 1] - 975.0)
    whole, alone = feasible_shares(AREA, [half, low])
    assert alone == pytest.approx({half.name: 90 / 175, low.name: 0.25}, abs=0.01)
    assert whole == pytest.approx(0.25 * 90 / 175, abs=0.01)


def test_sampler_says_which_constraint_leaves_nothing():
    hopeless = Constraint("tool on the moon", "mm", lambda q: np.full(len(q), 3.8e11))
    with pytest.raises(RefusedError, match=r"only 0 of .* alone holds: 'tool on the moon' 0 %, 'joint 1"):
        feasible_poses(np.random.default_rng(0), AREA, [*LIMITS, hopeless], 5)


# ------------------------------------------------------------------------------------------------------ whole plans


def test_distance_of_poses_is_a_share_of_the_area(rng):
    assert pose_distance(AREA.lower, AREA.upper, AREA) == pytest.approx(np.sqrt(5))
    one_joint = AREA.lower.copy()
    one_joint[1] = AREA.upper[1]
    assert pose_distance(AREA.lower, one_joint, AREA) == pytest.approx(1.0)
    plan = AREA.sample(rng, 6)
    unit = AREA.unit(plan)
    gaps = np.linalg.norm(unit[:, None] - unit[None], axis=-1)
    expected = [min(row[j] for j in range(6) if j != i) for i, row in enumerate(gaps)]
    np.testing.assert_allclose(nearest_distance(plan, AREA), expected)


def test_plans_with_poses_too_close_are_violations(rng):
    plan = AREA.sample(rng, 12)
    minimum = 0.999 * nearest_distance(plan, AREA).min()
    twin = np.vstack([plan[:-1], plan[0]])
    values = apart(AREA, minimum)(np.array([plan, twin]))
    assert values[0] == 0
    assert values[1] == pytest.approx(2.0)  # both poses of the pair lack all of it
    keep = away_from(plan[:1], AREA, minimum)
    assert keep.violation(plan).tolist()[0] == pytest.approx(minimum)
    assert np.all(keep.violation(plan[1:]) <= 0)


def test_coverage_counts_reachable_cells(rng):
    sample = AREA.sample(rng, 30000)
    cells = coverage(lambda q: ARM.motion(q)[0], sample, (8, 6, 1))
    # the tool stays between 300 mm and 1000 mm from the column: corners and the column's cells are out of reach
    assert 20 <= len(cells.reachable) < 44
    one_each = np.array([sample[np.flatnonzero(cells.cell(sample) == c)[0]] for c in cells.reachable])
    assert cells.missed(one_each[None])[0] == 0
    assert cells.missed(one_each[None, 2:])[0] == 2
    assert cells.violation(1.0)(one_each[None, 2:])[0] == 2
    assert cells.violation(0.5)(one_each[None, 2:])[0] == 0


def test_coverage_that_cannot_be_asked_for(rng):
    sample = AREA.sample(rng, 5000)
    with pytest.raises(RefusedError, match="5 poses cannot cover"):
        coverage(lambda q: q[:, :3], sample, (3, 3, 3), poses=5)
    with pytest.raises(InputError, match="need 3 numbers"):
        coverage(lambda q: q[:, :3], sample, (3, 3))
