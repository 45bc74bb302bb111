"""Groups of joint terms that an identification may add: which there are for an arm, however it is mounted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import ARM, prismatic, revolute
from term_witness import CEILING, FLOOR, WALL, coordinates

from symcal.calibration.candidates import AUTO, GROUPS, candidates, gravity_terms
from symcal.errors import InputError
from symcal.joints.harmonics import Harmonics
from symcal.robot.robot import Robot

DIRECTIONS = tuple(f"q{i}_direction" for i in range(1, 7))


def moments(robot: Robot, count: int = 80) -> dict[int, np.ndarray]:
    """By joint, what each weight does there at random postures, by the witness; shape (count, points)."""
    rng = np.random.default_rng(7)
    q = rng.uniform(*robot.ranges, (count, robot.dof))
    found: dict[int, np.ndarray] = {}
    for term in gravity_terms(robot):
        alone = replace(robot, terms=(term,))
        columns = []
        for label in term.labels:
            x = {f"q{term.joint}_{label}": 1.0}
            shift = [coordinates(alone, row, x, {}) - coordinates(alone, row, {}, {}) for row in q]
            columns.append(np.array(shift)[:, term.joint - 1].real)
        found[term.joint] = np.column_stack(columns)
    return found


@pytest.mark.parametrize("down", [FLOOR, CEILING, WALL, (0.6, 0.0, -0.8)])
def test_weights_of_a_joint_are_independent_of_each_other_and_of_its_zero(down):
    robot = replace(ARM, down=down)
    for columns in moments(robot).values():
        whole = np.column_stack([np.ones(len(columns)), columns])
        singular = np.linalg.svd(whole / np.linalg.norm(whole, axis=0), compute_uv=False)
        assert singular[-1] > 1e-4 * singular[0]


@pytest.mark.parametrize("down", [FLOOR, WALL])
def test_no_point_that_is_left_out_would_add_a_moment(down):
    robot = replace(ARM, down=down)
    kept = {term.joint: term for term in gravity_terms(robot)}
    every = {
        t.joint: replace(t, points=("x", "y", *(f"q{j}" for j in range(t.joint + 1, 7)), "flange"))
        for t in kept.values()
    }
    q = np.random.default_rng(8).uniform(*robot.ranges, (60, 6))
    for joint, term in every.items():
        alone = replace(robot, terms=(term,))
        columns = {}
        for point in term.points:
            x = {f"q{joint}_gravity_{point}": 1.0}
            shift = [coordinates(alone, row, x, {}) - coordinates(alone, row, {}, {}) for row in q]
            columns[point] = np.array(shift)[:, joint - 1].real
        basis = np.column_stack([np.ones(len(q)), *(columns[p] for p in kept[joint].points)])
        for column in columns.values():
            left = column - basis @ np.linalg.lstsq(basis, column, rcond=None)[0]
            assert np.linalg.norm(left) < 2e-3 * np.sqrt(len(q))


def test_a_vertical_axis_feels_no_weight():
    standing = {term.joint: term.points for term in gravity_terms(ARM)}
    assert 1 not in standing
    assert {2, 3, 4, 5} <= set(standing)
    assert standing[2][:2] == ("x", "y")
    hanging = {term.joint: term.points for term in gravity_terms(replace(ARM, down=CEILING))}
    assert hanging == standing
    on_a_wall = {term.joint: term.points for term in gravity_terms(replace(ARM, down=WALL))}
    assert 1 in on_a_wall


def test_a_gantry_that_lifts_has_a_constant_weight():
    """Along a vertical slide the weight never changes: its zero takes it up; a horizontal one feels none."""
    gantry = Robot("gantry", "standard", (prismatic(d=0.0, alpha=1.2), revolute(theta=0.0, a=200.0)))
    assert [term.joint for term in gravity_terms(gantry)] == [2]


def test_groups_by_name():
    (wave,) = {type(t) for t in candidates(ARM, ["harmonics 3"], ())}
    assert wave is Harmonics
    assert [t.k for t in candidates(ARM, ["harmonics 3"], ())] == [(3,)] * 6
    kinds = [t.kind for t in candidates(ARM, ["ratio", "coupling"], ())]
    assert kinds == ["ratio"] * 6 + ["coupling"] * 3
    assert [(t.joint, t.by) for t in candidates(ARM, ["coupling"], ())] == [(5, 4), (6, 4), (6, 5)]
    every = [name for name in GROUPS if name not in ("backlash", "payload")]
    assert {n.group for t in candidates(ARM, every, ()) for n in t.numbers} == set(every)


def test_auto_takes_what_the_data_say():
    groups = [
        {n.group for t in candidates(ARM, ["auto"], c) for n in t.numbers} for c in ((), (*DIRECTIONS, "payload"))
    ]
    assert groups[0] == set(AUTO) - {"backlash", "payload"}
    assert groups[1] == set(AUTO)
    (one,) = candidates(ARM, ["backlash"], ("q4_direction",))
    assert (one.kind, one.joint) == ("backlash", 4)


def test_what_the_robot_has_is_not_added_again():
    robot = replace(ARM, terms=(Harmonics(2, True, k=(1, 2)),))
    assert [t.joint for t in candidates(robot, ["harmonics 1"], ())] == [1, 3, 4, 5, 6]


@pytest.mark.parametrize(
    ("wanted", "conditions", "found", "words"),
    [
        (["gravitation"], (), "gravitation", "did you mean 'gravity'?"),
        (["harmonics 41"], (), "harmonics 41", "no such group"),
        (["auto", "gravity"], (), "auto", "no such group"),
        (["backlash"], (), "backlash", "give columns q1_direction"),
        (["backlash"], ("payload",), "backlash", "give columns q1_direction"),
        (["gravity", "payload"], DIRECTIONS, "payload", "give columns payload_kg"),
    ],
)
def test_what_cannot_be_added_is_refused(wanted, conditions, found, words):
    with pytest.raises(InputError) as caught:
        candidates(ARM, wanted, conditions)
    assert (caught.value.key, caught.value.found) == ("identification.extend", found)
    assert words in str(caught.value)
