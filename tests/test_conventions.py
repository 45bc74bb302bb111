"""One link convention as the other, with joint terms, masses and gravity: the same poses, whatever is asked."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from strategies import generators, random_robot, readings, with_terms

from symcal.errors import RefusedError
from symcal.joints.gravity import Gravity
from symcal.kinematics import chain, frame_vector
from symcal.parameters import ParameterSet
from symcal.robot.conventions import convert
from symcal.robot.robot import Convention, Robot


def pose(robot: Robot, q: np.ndarray, conditions: np.ndarray) -> np.ndarray:
    """T_world_tool, shape (4, 4)."""
    model = chain(robot, ParameterSet(()), conditions=True)
    at = ca.Function("pose", [model.q, model.frames, model.conditions], [model.tool])
    return at(q, frame_vector(robot.base, robot.tool), conditions).full()


@given(rng=generators)
@settings(max_examples=20)
def test_terms_stay_what_they_are(rng: np.random.Generator) -> None:
    robot = with_terms(rng, replace(random_robot(rng), record=None), 10.0)
    other: Convention = "craig" if robot.convention == "standard" else "standard"
    there = convert(robot, other)
    back = convert(there, robot.convention)
    scaled = replace(robot, scales=dict.fromkeys(robot.term_parameters, 0.5))
    assert set(convert(scaled, other).scales) == set(robot.term_parameters)
    for _ in range(3):
        q = readings(rng, robot)
        conditions = rng.uniform(-1, 1, len(robot.conditions))
        expected = pose(robot, q, conditions)
        bare = pose(replace(robot, terms=()), q, np.zeros(0))
        assert not robot.terms or np.abs(bare - expected).max() > 1e-9
        reach = max(robot.reach + np.linalg.norm(robot.base[:3, 3]), np.abs(q).max(), 1.0)
        for found in (pose(there, q, conditions), pose(back, q, conditions)):
            np.testing.assert_allclose(found[:3, 3], expected[:3, 3], rtol=0, atol=1e-12 * reach)
            np.testing.assert_allclose(found[:3, :3], expected[:3, :3], rtol=0, atol=1e-12)


def test_a_weight_at_a_flange_that_moves_is_refused() -> None:
    robot = replace(random_robot(np.random.default_rng(3), "standard", 3), record=None)
    robot = replace(robot, terms=(Gravity(1, True, {"gravity_flange": 1e-3}, ("flange",)),))
    last = robot.links[-1]
    moved = replace(robot, links=(*robot.links[:-1], replace(last, parameters={**last.parameters, "a": 40.0})))
    with pytest.raises(RefusedError, match=r"gravity of axis 1 with weights at flange .* moves by 40 mm"):
        convert(moved, "craig")
    kept = {kind: value for kind, value in last.parameters.items() if kind != "a"}
    still = replace(robot, links=(*robot.links[:-1], replace(last, parameters={**kept, "alpha": 0.4})))
    q = np.array([0.3, -0.2, 0.8])
    np.testing.assert_allclose(pose(convert(still, "craig"), q, np.zeros(0)), pose(still, q, np.zeros(0)), atol=1e-9)
