"""Paths: straight where they say so, within limits, from pose to pose; and their files."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from handling_arm import frames_by_hand, handling_chain, own_setup

from symcal.errors import InputError
from symcal.planning.area import working_area
from symcal.planning.clearance import keep_out
from symcal.planning.ordering import joint_time, shortest_tour, tour_of
from symcal.planning.path import follow_line, joint_motion, plan_path
from symcal.planning.plan_file import read_plan, write_plan, write_waypoints
from symcal.planning.skeleton import skeleton

MODEL = handling_chain()
ROBOT = MODEL.robot
ARM = skeleton(MODEL, own_setup(ROBOT))
AREA = working_area(ROBOT, {"waist": (-np.pi / 2, np.pi / 2)})
START = np.array([np.pi / 4, 1100, 0, np.pi / 2, 0])
SPEEDS = np.array([1.5, 300.0, 500.0, 2.0, 3.0])
LIMITS = (ROBOT.lower, ROBOT.upper)


def tool(q):
    return frames_by_hand(q)[-1][:3, 3]


def between(waypoints, parts=7):
    """Poses on a motion that is linear between waypoints."""
    return [a + s * (b - a) for a, b in itertools.pairwise(waypoints) for s in np.linspace(0, 1, parts)]


@pytest.fixture(scope="module", params=[0, 1])
def plan(request):
    poses = AREA.snapped(np.random.default_rng(request.param), 15)
    tour = shortest_tour(poses, START, SPEEDS)
    return poses, tour, plan_path(ARM, poses, tour, START, SPEEDS, LIMITS)


def test_segments_lead_from_the_start_through_all_poses(plan):
    poses, tour, path = plan
    np.testing.assert_array_equal(path.order, tour.order)
    ends = [START, *poses[tour.order]]
    for (a, b), segment in zip(itertools.pairwise(ends), path.segments, strict=True):
        np.testing.assert_allclose(segment.waypoints[0], a, atol=1e-12)
        np.testing.assert_allclose(segment.waypoints[-1], b, atol=1e-12)


def test_lines_are_straight_to_a_hundredth_everywhere(plan):
    _, _, path = plan
    assert "line" in path.kinds
    for segment in path.segments:
        if segment.kind == "line":
            a, b = tool(segment.waypoints[0]), tool(segment.waypoints[-1])
            along = (b - a) / np.linalg.norm(b - a)
            shares = []
            for q in between(segment.waypoints, 5):
                p = tool(q)
                shares.append((p - a) @ along)
                assert np.linalg.norm(p - a - shares[-1] * along) <= 0.0101
            assert np.all(np.diff(shares) > -0.0101)  # never backwards
            assert segment.why == ""
        else:
            assert segment.why


def test_every_waypoint_is_within_limits(plan):
    for segment in plan[2].segments:
        assert np.all(segment.waypoints >= ROBOT.lower - 1e-9)
        assert np.all(segment.waypoints <= ROBOT.upper + 1e-9)


def test_times_are_those_of_the_slowest_joint(plan):
    _, tour, path = plan
    for segment, shortest in zip(path.segments, tour.times, strict=True):
        steps = [max(abs(b - a) / SPEEDS) for a, b in itertools.pairwise(segment.waypoints)]
        np.testing.assert_allclose(np.diff(segment.times), steps, atol=1e-12)
        assert segment.time >= shortest - 1e-9  # a line is never faster than all joints at once
        if segment.kind == "joint":
            assert segment.time == pytest.approx(shortest)
    assert path.total_time == pytest.approx(sum(s.time for s in path.segments))


def test_a_prismatic_move_is_a_line_of_its_own_accord():
    a, b = np.array([0.3, 900.0, 100, 1, 0]), np.array([0.3, 1300.0, 100, 1, 0])
    way = follow_line(ARM, a, b, LIMITS)
    assert not isinstance(way, str)
    np.testing.assert_allclose(way, a + np.linspace(0, 1, len(way))[:, None] * (b - a), atol=1e-9)


def test_a_line_through_the_column_is_not_followed():
    a, b = np.array([-1.5, 1000.0, 50, 0, 0]), np.array([1.6, 1000.0, 50, 0, 0])
    assert np.linalg.norm(tool(a) - tool(b)) > 600  # straight across the base
    why = follow_line(ARM, a, b, LIMITS)
    assert isinstance(why, str)
    path = plan_path(ARM, b[None], tour_of([0], b[None], a, SPEEDS), a, SPEEDS, LIMITS)
    assert path.kinds == ("joint",)
    assert path.segments[0].why == why
    assert path.conflicts == ()


def test_a_line_that_breaks_a_constraint_gives_way_to_a_joint_motion_that_does_not():
    a, b = np.array([-0.8, 1000.0, 500, 1.5, 0]), np.array([0.8, 1000.0, 500, 1.5, 0])
    way = follow_line(ARM, a, b, LIMITS)
    assert not isinstance(way, str)
    # a post in the middle of the straight way of the tool; the swing of the waist passes outside
    post = np.eye(4)
    post[:3, 3] = tool(way[len(way) // 2])
    obstacle = keep_out(ARM, "the post", post, np.array([40.0, 40, 40]), first_link=6)
    assert obstacle.violation(joint_motion(a, b, LIMITS)).max() <= 0
    single = tour_of([0], b[None], a, SPEEDS)
    assert plan_path(ARM, b[None], single, a, SPEEDS, LIMITS).kinds == ("line",)
    path = plan_path(ARM, b[None], single, a, SPEEDS, LIMITS, constraints=[obstacle])
    assert path.kinds == ("joint",)
    assert path.segments[0].why.startswith("the line breaks 'clear of the post' by ")
    assert path.conflicts == ()


def test_a_way_that_is_blocked_is_named():
    a, b = np.array([-0.8, 1000.0, 500, 1.5, 0]), np.array([0.8, 1000.0, 500, 1.5, 0])
    block = np.eye(4)
    block[:3, 3] = (0, 600, 1000)
    press = keep_out(ARM, "the press", block, np.array([100.0, 2000, 400]), first_link=4)
    assert np.all(press.violation(np.array([a, b])) <= 0)
    path = plan_path(ARM, b[None], tour_of([0], b[None], a, SPEEDS), a, SPEEDS, LIMITS, constraints=[press])
    assert len(path.conflicts) == 1
    assert path.conflicts[0].startswith("the way from the start to pose 1 breaks 'clear of the press' by ")


def test_staying_at_a_pose_takes_no_time():
    path = plan_path(ARM, START[None], tour_of([0], START[None], START, SPEEDS), START, SPEEDS, LIMITS)
    assert path.total_time == 0


# -------------------------------------------------------------------------------------------------------------- files


def test_plan_file_round_trip(plan, tmp_path):
    poses, tour, path = plan
    file = tmp_path / "plan.csv"
    write_plan(file, ROBOT, poses, path)
    header, first, *_ = file.read_text(encoding="utf-8").splitlines()
    assert header == "pose,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg,segment,time_s"
    assert first.split(",")[0] == str(tour.order[0] + 1)
    back, names = read_plan(file, ROBOT)
    np.testing.assert_allclose(back, poses[tour.order], rtol=1e-14)
    assert names == tuple(str(i + 1) for i in tour.order)
    times = [float(line.split(",")[-1]) for line in file.read_text(encoding="utf-8").splitlines()[1:]]
    assert sum(times) == pytest.approx(path.total_time)


def test_plan_without_a_path(tmp_path):
    poses = AREA.sample(np.random.default_rng(0), 4)
    write_plan(tmp_path / "plan.csv", ROBOT, poses)
    back, names = read_plan(tmp_path / "plan.csv", ROBOT)
    np.testing.assert_allclose(back, poses, rtol=1e-14)
    assert names == ("1", "2", "3", "4")


def test_waypoints_run_through_all_poses_in_time(plan, tmp_path):
    poses, tour, path = plan
    write_waypoints(tmp_path / "waypoints.csv", ROBOT, path)
    lines = [line.split(",") for line in (tmp_path / "waypoints.csv").read_text(encoding="utf-8").splitlines()]
    assert lines[0] == ["time_s", "q1_deg", "q2_mm", "q3_mm", "q4_deg", "q5_deg", "segment", "pose"]
    times = np.array([float(row[0]) for row in lines[1:]])
    assert times[0] == 0
    assert np.all(np.diff(times) >= 0)
    assert times[-1] == pytest.approx(path.total_time)
    q = np.array([[float(c) for c in row[1:6]] for row in lines[1:]])
    q[:, [0, 3, 4]] = np.deg2rad(q[:, [0, 3, 4]])
    reached = [(int(row[7]) - 1, at) for row, at in zip(lines[1:], q, strict=True) if row[7]]
    assert [i for i, _ in reached] == tour.order.tolist()
    for i, at in reached:
        np.testing.assert_allclose(at, poses[i], atol=1e-9)
    assert np.all(joint_time(q[:-1], q[1:], SPEEDS) <= np.diff(times) + 1e-9)


def test_candidates_with_joint_names_other_units_and_repeated_observations(tmp_path):
    file = tmp_path / "candidates.csv"
    file.write_text(
        "pose,waist_rad,lift_m,q3_mm,q4_deg,q5_deg,x_mm\na,0.5,1.1,20,90,0,1\na,0.5,1.1,20,90,0,2\nb,0,1,0,0,0,3\n"
    )
    poses, names = read_plan(file, ROBOT)
    assert names == ("a", "b")
    np.testing.assert_allclose(poses[0], [0.5, 1100, 20, np.pi / 2, 0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pose,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\n", "no rows"),
        ("q1_deg,q2_mm,q3_mm,q4_deg\n1,2,3,4\n", "no column for joint 5 'wrist'"),
        ("q1,q2_mm,q3_mm,q4_deg,q5_deg\n1,2,3,4,5\n", "has no unit"),
        ("q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\n1,2,x,4,5\n", "not a finite number"),
        ("pose,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\na,1,2,3,4,5\na,1,2,3,4,6\n", "stands in line 2 with other"),
    ],
)
def test_files_that_are_no_plan(tmp_path, text, message):
    file = tmp_path / "plan.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_plan(file, ROBOT)


def test_a_file_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_plan(tmp_path / "nowhere" / "plan.csv", ROBOT, START[None])
