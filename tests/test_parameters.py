"""The parameter vector: its order, names, units, scales and priors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from strategies import robots

from symcal.camera.camera import INTRINSIC_NAMES, Camera
from symcal.errors import InputError
from symcal.instruments import seen_by
from symcal.model.parameter_set import parameter_set
from symcal.parameters import FRAME_AXES, Parameter, ParameterSet
from symcal.robot.robot import Joint, Link, Robot

ROBOT = Robot(
    "two",
    "craig",
    (
        Link(Joint("revolute", "one"), {"theta": 0.1, "a": 2.0}),
        Link(Joint("prismatic", "two"), {"theta": 0.3, "alpha": 0.4, "d": 5.0, "beta": 0.6}),
    ),
    scales={"d_2": 0.25},
)


def test_order_names_units_and_nominal_values():
    items = parameter_set(ROBOT, base=True, tool="frame", points=("tool_P1", "tool_P2"))
    links = "theta_1 theta_2 alpha_2 a_1 d_2 beta_2"
    base = "base_x base_y base_z base_rx base_ry base_rz"
    tool = "tool_x tool_y tool_z tool_rx tool_ry tool_rz"
    points = "tool_P1_x tool_P1_y tool_P1_z tool_P2_x tool_P2_y tool_P2_z"
    assert items.names == tuple(f"{links} {base} {tool} {points}".split())
    frame = "mm mm mm rad rad rad "
    assert items.units == tuple(("rad rad rad mm mm rad " + 2 * frame + 6 * "mm ").split())
    np.testing.assert_array_equal(items.nominal[:6], [0.1, 0.3, 0.4, 2.0, 5.0, 0.6])
    np.testing.assert_array_equal(items.nominal[6:], 0)


def test_scales_are_1_mm_and_10_mrad_unless_the_robot_says_otherwise():
    items = parameter_set(ROBOT, base=True)
    assert dict(zip(items.names, items.scales, strict=True))["d_2"] == 0.25
    default = {"mm": 1.0, "rad": 0.010}
    assert all(p.scale == default[p.unit] for p in items.items if p.name != "d_2")
    assert all(p.prior_sigma is None for p in items.items)


def test_of_links_something_is_known_before_of_frames_points_and_camera_nothing():
    camera = Camera(2000, 1500, 3000.0, 3001.0, 999.5, 749.5)
    own, priors = seen_by(camera, calibrate=True).unknowns("")
    places = {"camera": FRAME_AXES}
    items = parameter_set(ROBOT, base=True, points=("tool_P",), places=places, own=own, priors=priors)
    assert {p.name for p in items.items if not p.unknown} == set(ROBOT.parameters)


def test_position_of_the_tool_alone():
    assert parameter_set(ROBOT, tool="position").names[6:] == ("tool_x", "tool_y", "tool_z")
    assert len(parameter_set(ROBOT)) == 6


@given(robots)
def test_link_parameters_follow_the_robot(robot):
    items = parameter_set(robot)
    assert items.mapping(items.nominal) == robot.parameters
    for p in items.items:
        assert p.unit == ("rad" if p.name.startswith(("theta", "alpha", "beta")) else "mm")
        assert p.scale == robot.scales.get(p.name, {"rad": 0.01, "mm": 1.0}[p.unit])


@given(robots)
def test_places_and_vectors(robot):
    items = parameter_set(robot, base=True, tool="frame")
    for i, name in enumerate(items.names):
        assert items.index(name) == i
    np.testing.assert_array_equal(items.indices(reversed(items.names)), np.arange(len(items))[::-1])
    x = np.arange(1.0, len(items) + 1)
    np.testing.assert_array_equal(items.vector(items.mapping(x)), x)


def test_a_vector_from_some_of_its_parameters():
    items = parameter_set(ROBOT)
    np.testing.assert_array_equal(items.vector({"d_2": 3.0}), [0, 0, 0, 0, 3, 0])
    with pytest.raises(KeyError):
        items.vector({"d_1": 3.0})
    with pytest.raises(KeyError):
        items.index("d_1")
    with pytest.raises(ValueError, match=r"shorter|longer"):
        items.mapping(np.zeros(5))


def test_scales_and_priors_are_replaced_in_a_new_set():
    items = parameter_set(ROBOT)
    scaled = items.with_scales({"a_1": 7.0})
    prior = scaled.with_priors({"theta_1": 0.002})
    assert scaled.scales[scaled.index("a_1")] == 7.0
    assert items.scales[items.index("a_1")] == 1.0
    assert prior.items[0] == Parameter("theta_1", "rad", 0.1, 0.01, 0.002)
    assert prior.scales[prior.index("a_1")] == 7.0


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_scales_and_priors_are_positive_numbers(value):
    items = parameter_set(ROBOT)
    for method in (items.with_scales, items.with_priors):
        with pytest.raises(InputError, match="must be positive") as caught:
            method({"a_1": value})
        assert caught.value.key == "a_1"
        with pytest.raises(InputError, match="did you mean 'theta_1'") as caught:
            method({"thetta_1": 1.0})
        assert caught.value.allowed == items.names


def test_no_name_stands_twice():
    with pytest.raises(InputError, match="two parameters have this name") as caught:
        parameter_set(ROBOT, points=("tool_A", "tool_A"))
    assert caught.value.found == "tool_A_x"
    with pytest.raises(InputError, match="two parameters"):
        ParameterSet((Parameter("p", "mm", 0, 1), Parameter("p", "rad", 0, 1)))


def test_an_empty_set_is_a_set():
    empty = ParameterSet(())
    assert len(empty) == 0
    assert empty.names == ()
    assert empty.scales.shape == empty.nominal.shape == empty.vector({}).shape == (0,)


def test_a_joint_prior_is_the_inverse_covariance():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(9, 9)) * np.array([5.0, 5, 3, 3, 0.01, 0.05, 1e-4, 1e-4, 0.0])[:, None]
    camera = Camera(2000, 1500, 3000.0, 3001.0, 999.5, 749.5, (-0.1, 0.02), covariance=root @ root.T)
    own, priors = seen_by(camera, calibrate=True).unknowns("")
    found = parameter_set(ROBOT, places={"camera": FRAME_AXES}, own=own, priors=priors)
    free = [name for name in INTRINSIC_NAMES if name != "k3"]
    assert found.names[-8:] == tuple(free)
    assert "camera_rz" in found.names
    rows = found.prior_rows(found.names)
    assert rows.shape == (8, len(found))
    np.testing.assert_allclose(rows[:, -8:].T @ rows[:, -8:] @ camera.covariance[:8, :8], np.eye(8), atol=1e-6)
    # held at nominal: the prior of the others given that error zero, by the Schur complement of the covariance
    kept = [0, 1, 2, 3, 5, 6, 7]
    part = found.prior_rows([free[i] for i in kept])
    c = camera.covariance
    given = c[np.ix_(kept, kept)] - np.outer(c[kept, 4], c[4, kept]) / c[4, 4]
    np.testing.assert_allclose(part.T @ part @ given, np.eye(7), atol=1e-6)


def test_priors_add_up():
    found = parameter_set(ROBOT, tool="frame").with_priors({"tool_x": 2.0, "tool_rz": 0.1})
    np.testing.assert_allclose(found.prior_rows(["tool_rz", "tool_y", "tool_x"]), [[0, 0, 0.5], [10, 0, 0]])
