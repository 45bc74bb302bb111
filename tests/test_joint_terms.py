"""Joint terms in the kinematics against matrices and moments written in NumPy, complex steps, pinocchio."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import generators, random_robot, readings
from term_witness import CEILING, FLOOR, MOUNTS, SIZES, WALL, coordinates, poses, random_arm, random_conditions
from test_kinematics import complex_step, pinocchio_model

from symcal.joints import TERMS
from symcal.joints.arm import G, Mass, Payload
from symcal.joints.compliance import Compliance
from symcal.joints.gravity import Gravity
from symcal.joints.harmonics import Harmonics
from symcal.kinematics import Screw, bases, chain, frame_vector, function, omegas, pose_of, stack
from symcal.model.parameter_set import parameter_set
from symcal.parameters import ParameterSet
from symcal.robot.files import load_robot
from symcal.robot.robot import Joint, Link, Robot

SIZE = {**SIZES, "rad": 0.01, "mm": 10.0}


def twist(screws: tuple[Screw, ...], point: ca.SX) -> ca.SX:
    return ca.vertcat(stack(screws, point), omegas(screws))


def errors(rng: np.random.Generator, parameters: ParameterSet) -> np.ndarray:
    return rng.normal(size=len(parameters)) * [SIZE[unit] for unit in parameters.units]


def scaled(jacobian: np.ndarray, sizes: list[float]) -> np.ndarray:
    """Per size of error, turns at 200 mm: so that one tolerance, of 1e-9 mm or so, fits all units."""
    return jacobian * np.array([[1.0]] * 3 + [[200.0]] * 3) * sizes


@settings(max_examples=14)
@given(generators)
def test_poses_and_slopes_are_those_of_the_witness(rng):
    robot = random_arm(rng)
    parameters = parameter_set(robot, base=True, tool="frame")
    q, x, given_ = readings(rng, robot), errors(rng, parameters), random_conditions(rng, robot)
    c = chain(robot, parameters, conditions=True)
    names = list(c.stations)
    outputs = {f"pose{k}": pose_of(c.stations[n]) for k, n in enumerate(names)}
    outputs |= {f"slopes{k}": twist(c.stations[n].screws, c.stations[n].origin) for k, n in enumerate(names)}
    outputs |= {"joints": twist(c.joint_screws, c.tool[:3, 3]), "own": twist(c.parameter_screws, c.tool[:3, 3])}
    evaluate = function("all", {"q": c.q, "x": c.x, "f": c.frames, "c": c.conditions}, outputs)
    numbers = evaluate(q=q, x=x, f=frame_vector(robot.base, robot.tool), c=[given_[n] for n in robot.conditions])
    out = {key: np.array(value) for key, value in numbers.items()}
    sizes = [SIZE[unit] for unit in parameters.units]

    stations = [name for name in names if name != "world"]

    def by_x(values: np.ndarray) -> np.ndarray:
        found = poses(robot, q, dict(zip(parameters.names, values, strict=True)), given_)
        return np.array([found[name] for name in stations])

    exact, wanted = by_x(x).real, complex_step(by_x, x)
    for k, name in enumerate(names):
        if name == "world":
            assert not out[f"slopes{k}"].any()
            continue
        own = stations.index(name)
        np.testing.assert_allclose(out[f"pose{k}"], exact[own], atol=1e-8)
        np.testing.assert_allclose(scaled(out[f"slopes{k}"], sizes), scaled(wanted[own], sizes), rtol=1e-9, atol=1e-8)
    np.testing.assert_array_equal(out["own"], out[f"slopes{names.index('tool')}"])
    moved = [0.1 if joint.revolute else 10.0 for joint in robot.joints]
    wanted = complex_step(lambda v: poses(robot, v, parameters.mapping(x), given_)["tool"], q)
    np.testing.assert_allclose(scaled(out["joints"], moved), scaled(wanted, moved), rtol=1e-9, atol=1e-8)


@settings(max_examples=30)
@given(generators)
def test_slopes_are_those_of_automatic_differentiation(rng):
    robot = random_arm(rng)
    parameters = parameter_set(robot, base=True, tool="frame")
    c = chain(robot, parameters, conditions=True)
    point = c.tool[:3, 3] + c.tool[:3, :3] @ ca.DM([10, -20, 30])
    outputs = [stack(c.parameter_screws, point), ca.jacobian(point, c.x)]
    outputs += [stack(c.joint_screws, point), ca.jacobian(point, c.q)]
    both = ca.Function("both", [c.q, c.x, c.frames, c.conditions], outputs)
    given_ = random_conditions(rng, robot)
    x, frames = errors(rng, parameters), frame_vector(robot.base, robot.tool)
    values = both(readings(rng, robot), x, frames, [given_[n] for n in robot.conditions])
    own, automatic, own_q, automatic_q = (np.array(value) for value in values)
    sizes = [SIZE[unit] for unit in parameters.units]
    np.testing.assert_allclose(own * sizes, automatic * sizes, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(own_q, automatic_q, rtol=1e-9, atol=1e-8)


def test_the_random_robots_have_every_kind_on_both_kinds_of_joints():
    found = set()
    for seed in range(40):
        found |= {(term.kind, term.revolute) for term in random_arm(np.random.default_rng(seed)).terms}
    assert found == {(kind, turns) for kind in TERMS for turns in (True, False)}


@settings(max_examples=30)
@given(generators)
def test_bases_are_slopes_of_the_coordinates_at_nominal_conditions(rng):
    robot = random_arm(rng)
    q = readings(rng, robot)
    nominal = dict.fromkeys(robot.conditions, 0.0)
    found = np.array(bases(robot)(q)).ravel()
    names = list(robot.term_parameters)
    assert found.shape == (len(names),)
    for name, slope in zip(names, found, strict=True):
        joint = int(name[1 : name.index("_")])
        # linear in its own number: a step of any length does
        moved = [coordinates(robot, q, {name: value}, nominal)[joint - 1].real for value in (0.0, 1.0)]
        np.testing.assert_allclose(slope, moved[1] - moved[0], rtol=1e-9, atol=1e-9)


def test_no_condition_is_the_nominal_one(rng):
    robot = random_arm(rng, share=1.0)
    parameters = parameter_set(robot)
    c = chain(robot, parameters)
    assert c.conditions.numel() == 0
    q = readings(rng, robot)
    tool = ca.Function("tool", [c.q, c.x, c.frames], [c.tool])
    pose = np.array(tool(q, np.zeros(len(parameters)), frame_vector(robot.base, robot.tool)))
    np.testing.assert_allclose(pose, poses(robot, q)["tool"].real, atol=1e-9)


# ------------------------------------------------------------------------------------------------------- pinocchio


@given(generators, st.sampled_from(["standard", "craig"]), st.sampled_from(MOUNTS))
def test_moments_are_pinocchio_s(rng, convention, down):
    """What a compliance of one yields is minus the generalised gravity of rigid body dynamics, in N mm and N."""
    robot = replace(random_robot(rng, convention, int(rng.integers(1, 7))), record=None, base=np.eye(4))
    masses = [
        (int(on), float(kg), rng.uniform(-200, 200, 3))
        for on, kg in zip(rng.integers(1, robot.dof + 2, 4), rng.uniform(0.5, 8, 4), strict=True)
    ]
    payload = Payload(float(rng.uniform(0, 4)), tuple(rng.uniform(-90, 90, 3).tolist()))
    robot = replace(
        robot,
        down=down,
        masses=tuple(Mass(on, kg, tuple(at.tolist())) for on, kg, at in masses),
        payload=payload,
        terms=tuple(Compliance(j, joint.revolute) for j, joint in enumerate(robot.joints, start=1)),
    )
    model, tool = pinocchio_model(replace(robot, tool=np.eye(4)))
    model.gravity.linear = G * np.array(down)
    flange = model.frames[tool].placement
    # pinocchio's joint frames are those before theta and d
    for on, kg, at in [*masses, (robot.dof + 1, payload.kg, np.array(payload.at))]:
        joint = min(on, robot.dof)
        own = robot.links[joint - 1].parameters
        turned = pin.SE3(pin.utils.rotate("z", own.get("theta", 0.0)), np.array([0, 0, own.get("d", 0.0)]))
        place = flange if on > robot.dof else turned
        model.appendBodyToJoint(joint, pin.Inertia(kg, at, np.zeros((3, 3))), place)
    q = readings(rng, robot)
    u = np.array([j.sign * j.ratio * v + j.offset for j, v in zip(robot.joints, q, strict=True)])
    wanted = -pin.computeGeneralizedGravity(model, model.createData(), u)
    np.testing.assert_allclose(np.array(bases(robot)(q)).ravel(), wanted, rtol=1e-9, atol=1e-7)


def test_an_arm_that_hangs_yields_the_other_way():
    """By hand: 2 kg at 500 mm on a horizontal axis turn it by 2 g 500 N mm; half of it at 60 deg below that."""
    link = Link(Joint("revolute", "shoulder"), {"alpha": -np.pi / 2, "theta": 0.0})
    arm = Robot("one", "craig", (link,), masses=(Mass(1, 2.0, (500.0, 0.0, 0.0)),), terms=(Compliance(1, True),))
    moment = 2 * 9.80665 * 500  # N mm; the axis is +y of the base, and turns +x downward
    for down, angle, share in ((FLOOR, 0.0, 1.0), (FLOOR, np.pi / 3, 0.5), (CEILING, 0.0, -1.0), (WALL, 0.3, 0.0)):
        found = float(bases(replace(arm, down=down))(angle))
        assert found == pytest.approx(share * moment, abs=1e-9)


def test_a_weight_at_300_mm_on_a_horizontal_arm_yields_its_number():
    link = Link(Joint("revolute", "shoulder"), {"alpha": -np.pi / 2, "theta": 0.0})
    arm = Robot("one", "craig", (link,), terms=(Gravity(1, True, points=("x", "y")),))
    np.testing.assert_allclose(np.array(bases(arm)([0.0])).ravel(), [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.array(bases(arm)([-np.pi / 2])).ravel(), [0.0, 1.0], atol=1e-12)


# ----------------------------------------------------------------------------------------------------------- costs


def instructions(robot: Robot) -> int:
    """Of the tool's position and its slopes by all parameters, base and tool included."""
    c = chain(robot, parameter_set(robot, base=True, tool="frame"))
    p = c.tool[:3, 3]
    inputs = {"q": c.q, "x": c.x, "frames": c.frames}
    return function("g", inputs, {"p": p, "J": stack(c.parameter_screws, p)}).n_instructions()


def test_what_terms_cost(configs):
    plain = load_robot(configs / "robots" / "ur5.yaml")
    bare = instructions(plain)
    assert bare <= 1016
    assert instructions(replace(plain, masses=(Mass(2, 8.0),), payload=Payload(5.0), down=CEILING)) == bare
    waves = tuple(Harmonics(j, True, k=(1, 2)) for j in range(1, 7))
    assert bare < instructions(replace(plain, terms=waves)) <= 1.5 * bare
    soft = tuple(Compliance(j, True, {"compliance": 2e-8}) for j in (2, 3, 5))
    masses = (Mass(2, 8.0), Mass(3, 3.0), Mass(7, 2.0))
    assert instructions(replace(plain, terms=soft, masses=masses, payload=Payload(5.0))) <= 3 * bare
