"""Compensation of arms with joint terms: the true arm, walked from its JSON by NumPy, arrives where it was sent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arms_with_terms import calibrated, puma_with_terms, six_axis, usual_terms
from json_arm import tool_pose
from strategies import with_terms

from symcal.calibration.compensation_check import hand_over
from symcal.compensation.compensate import compensate, joint_caps
from symcal.compensation.targets import commanded, wanted
from symcal.export.json import robot_json
from symcal.robot.robot import Robot


def walked(robot: Robot, q: np.ndarray) -> np.ndarray:
    data = robot_json(replace(robot, record=None))
    return np.array([tool_pose(data, row) for row in q])


def inside(robot: Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    margin = joint_caps(robot)
    return rng.uniform(robot.lower + margin, robot.upper - margin, (count, robot.dof))


@pytest.mark.parametrize("kinds", ["usual", "all", "nominal too"])
def test_the_true_arm_arrives(kinds: str, rng: np.random.Generator) -> None:
    """To 1e-9 mm and 1e-11 rad beyond what rounding costs, where neither a cap nor a singularity keeps it away."""
    robot = puma_with_terms()
    if kinds == "all":
        robot = calibrated(with_terms(rng, six_axis()), rng)
    elif kinds == "nominal too":  # a controller that has such terms already, with other numbers
        sizes = {p.name: p.scale for term in usual_terms() for p in term.parameters}
        robot = calibrated(replace(six_axis(), terms=tuple(t.corrected(sizes) for t in usual_terms())), rng)
    q = inside(robot, rng, 100)
    goal = walked(robot.nominal(), q)
    for targets in (commanded(robot, q), wanted(robot, goal, joints=q)):
        result = compensate(robot, targets, rng)
        reached = np.array(result.status) == "reached"
        assert reached.mean() > 0.8
        found, before = walked(robot, result.joints), walked(robot, q)
        left = np.linalg.norm((found - goal)[:, :3, 3], axis=1)
        assert left[reached].max() < 3e-9
        assert np.abs((found - goal)[reached][:, :3, :3]).max() < 1e-11
        assert np.linalg.norm((before - goal)[:, :3, 3], axis=1).mean() > 1
        np.testing.assert_allclose(result.residual_mm, left, atol=1e-8)


def test_the_check_of_a_simulation_knows_terms(rng: np.random.Generator) -> None:
    """With a perfect identification nothing is left; one that missed the terms keeps about what they are worth."""
    robot = puma_with_terms()
    assert robot.record is not None
    truth = replace(robot, record=None)
    q = inside(robot, rng, 200)
    perfect = hand_over(robot, truth, q, rng)
    np.testing.assert_allclose(perfect.wanted, walked(robot.nominal(), q)[:, :3, 3], atol=1e-8)
    assert perfect.after.size[perfect.reached].max() < 1e-8
    assert perfect.reached.mean() > 0.85
    errors = {name: 0.0 if name in robot.term_parameters else e for name, e in robot.record.errors.items()}
    missed = robot.corrected({name: -robot.record.errors[name] for name in robot.term_parameters})
    missed = replace(missed, record=replace(robot.record, errors=errors))
    assert hand_over(missed, truth, q, rng).after.size.mean() > 0.3
