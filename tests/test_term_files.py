"""Joint terms, masses and gravity in robot files: what goes out comes back, and what is wrong is said at its place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import generators, random_frame, random_record, readings
from term_witness import coordinates, poses, random_arm, random_conditions
from test_robot import assert_same, refused

from symcal.joints.coupling import Coupling
from symcal.joints.harmonics import Harmonics
from symcal.kinematics import chain, frame_vector
from symcal.model.parameter_set import parameter_set
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Record, Robot

UNITS = (st.sampled_from(["mm", "m", "um", "cm", "in"]), st.sampled_from(["deg", "rad", "mrad"]))

FILE = """\
name: arm
convention: craig
units: {length: mm, angle: deg}
links:
  - {joint: revolute,  name: waist, theta: 0, d: 300}
  - {joint: revolute,  name: elbow, alpha: -90, a: 0, theta: 0, d: 0}
  - {joint: prismatic, name: lift,  alpha: 90, a: 400, d: 0}
  - {joint: revolute,  name: wrist, alpha: 0, a: 0, theta: 0, d: 80}
terms:
  - {term: harmonics,  joint: waist, k: [1, 2], values: {sin_1: 0.02, cos_2: -0.01}}
  - {term: harmonics,  joint: waist, k: [1], gear: 101, values: {motor_sin_1: 0.003}}
  - {term: harmonics,  joint: lift, k: [1], pitch: 20, values: {sin_1: 0.05}}
  - {term: ratio,      joint: wrist, values: {ratio: 0.001}}
  - {term: coupling,   joint: wrist, by: waist, values: {by_q1: 0.002}}
  - {term: coupling,   joint: elbow, by: lift, values: {by_q3: 0.01}}
  - {term: backlash,   joint: elbow, values: {backlash: 0.01}}
  - {term: compliance, joint: elbow, values: {compliance: 1.0e-6}}
  - {term: gravity,    joint: elbow, points: [x, q4, flange], values: {gravity_x: 0.1}}
  - {term: payload,    joint: elbow}
gravity: [0, 0, 2]
masses:
  - {on: elbow, mass_kg: 8, at: [150, 0, 0]}
  - {on: flange, mass_kg: 1}
payload: {mass_kg: 2, at: [0, 0, 50]}
scales: {q1_sin_1: 0.5, q2_compliance: 1.0e-5}
"""


@pytest.fixture
def write(tmp_path):
    def to_file(text: str) -> Path:
        path = tmp_path / "robot.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return to_file


def test_a_file_in_mm_and_rad(write):
    robot = load_robot(write(FILE))
    degree, values = np.pi / 180, {name: p.value for name, p in robot.term_parameters.items()}
    assert values == pytest.approx(
        {
            "q1_sin_1": 0.02 * degree,
            "q1_cos_1": 0.0,
            "q1_sin_2": 0.0,
            "q1_cos_2": -0.01 * degree,
            "q1_motor_sin_1": 0.003 * degree,
            "q1_motor_cos_1": 0.0,
            "q3_sin_1": 0.05,  # mm
            "q3_cos_1": 0.0,
            "q4_ratio": 0.001,
            "q4_by_q1": 0.002,  # rad/rad
            "q2_by_q3": 0.01 * degree,  # rad/mm
            "q2_backlash": 0.01 * degree,
            "q2_compliance": 1e-6 * degree,  # rad/(N mm)
            "q2_gravity_x": 0.1 * degree,
            "q2_gravity_q4": 0.0,
            "q2_gravity_flange": 0.0,
            "q2_payload": 0.0,
        },
        abs=1e-18,
        rel=1e-12,
    )
    assert list(robot.parameters)[-len(values) :] == list(values)
    assert robot.conditions == ("q2_direction", "payload")
    assert robot.down == (0, 0, 1)
    assert [(m.on, m.kg, m.at) for m in robot.masses] == [(2, 8, (150, 0, 0)), (5, 1, (0, 0, 0))]
    assert (robot.payload.kg, robot.payload.at) == (2, (0, 0, 50))
    sizes = {p.name: p.scale for p in robot.described}
    assert sizes["q1_sin_1"] == pytest.approx(0.5 * degree)
    assert sizes["q2_compliance"] == pytest.approx(1e-5 * degree)


def same_physics(a: Robot, b: Robot) -> None:
    assert_same(a, b, 1e-12)
    assert [p.name for p in a.described] == [p.name for p in b.described]
    for one, other in zip(a.described, b.described, strict=True):
        assert (one.unit, one.group) == (other.unit, other.group)
        # assert_same judges in mm and rad, where a compliance is next to nothing
        assert one.nominal == pytest.approx(other.nominal, rel=1e-12, abs=0)
        assert one.scale == pytest.approx(other.scale, rel=1e-12, abs=0)
    for one, other in zip(a.terms, b.terms, strict=True):
        assert (one.kind, one.joint, one.revolute) == (other.kind, other.joint, other.revolute)
        mine, theirs = one.entry(), other.entry()
        assert (mine.pop("pitch", 0) or 0) == pytest.approx(theirs.pop("pitch", 0) or 0, rel=1e-12)
        assert mine == theirs
    np.testing.assert_allclose(a.down, b.down, rtol=1e-12, atol=1e-15)
    for one, other in zip((*a.masses, a.payload), (*b.masses, b.payload), strict=True):
        assert one.kg == other.kg
        assert getattr(one, "on", 0) == getattr(other, "on", 0)
        np.testing.assert_allclose(one.at, other.at, rtol=1e-12, atol=1e-12)


@settings(max_examples=12)
@given(generators, *UNITS)
def test_what_is_saved_is_loaded(tmp_path, rng, length, angle):
    robot = random_arm(rng, share=0.3)
    scales = {name: float(rng.uniform(0.5, 2) * p.scale) for name, p in robot.term_parameters.items()}
    robot = replace(robot, scales=scales, record=random_record(rng, robot) if rng.random() < 0.5 else None)
    save_robot(robot, tmp_path / "saved.yaml", (length, angle))
    same_physics(load_robot(tmp_path / "saved.yaml"), robot)


def predicted(robot: Robot, q: np.ndarray, conditions: dict[str, float]) -> np.ndarray:
    """The tool at x = 0, by the package."""
    parameters = parameter_set(robot)
    c = chain(robot, parameters, conditions=True)
    given_ = [conditions[name] for name in robot.conditions]
    evaluate = ca.Function("tool", [c.q, c.x, c.frames, c.conditions], [c.tool])
    return np.array(evaluate(q, np.zeros(len(parameters)), frame_vector(robot.base, robot.tool), given_))


@settings(max_examples=12)
@given(generators, *UNITS)
def test_a_calibrated_robot_predicts_the_same_when_it_comes_back(tmp_path, rng, length, angle):
    nominal = random_arm(rng, share=0.3)
    errors = {p.name: float(0.1 * rng.normal() * p.scale) for p in nominal.described}
    record = Record(errors, {}, np.zeros((len(errors),) * 2), nominal.base, nominal.tool)
    robot = replace(nominal.corrected(errors), record=record, base=random_frame(rng), tool=random_frame(rng))
    save_robot(robot, tmp_path / "calibrated.yaml", (length, angle))
    back = load_robot(tmp_path / "calibrated.yaml")
    q, conditions = readings(rng, robot), random_conditions(rng, robot)
    before = predicted(robot, q, conditions)
    size = max(np.abs(before).max(), robot.reach if np.isfinite(robot.reach) else 0.0)
    np.testing.assert_allclose(predicted(back, q, conditions), before, rtol=0, atol=1e-12 * size)
    # identified = nominal + error, in the terms as in the links; and nominal() takes them off again
    by_error = poses(replace(nominal, base=robot.base, tool=robot.tool), q, errors, conditions)["tool"].real
    np.testing.assert_allclose(before, by_error, rtol=0, atol=1e-11 * size)
    same_physics(back.nominal(), nominal)


def test_corrected_adds_to_the_numbers_of_terms(write):
    robot = load_robot(write(FILE))
    errors = {"q1_sin_1": 1e-3, "q2_compliance": 2e-8, "a_3": 0.5}
    found = robot.corrected(errors)
    wanted = {name: value + errors.get(name, 0.0) for name, value in robot.parameters.items()}
    assert found.parameters == wanted
    with pytest.raises(KeyError):
        robot.corrected({"q1_sin_7": 1.0})
    q = [0.3, -0.2, 50.0, 0.4]
    u = coordinates(robot, q, errors, {})
    np.testing.assert_allclose(coordinates(found, q, {}, {}), u, rtol=1e-12)


def test_a_robot_without_terms_says_nothing_of_them(write, tmp_path):
    text = FILE[: FILE.index("terms:")]
    save_robot(load_robot(write(text)), tmp_path / "saved.yaml")
    assert not {"terms", "gravity", "masses", "payload"} & set(yaml.safe_load((tmp_path / "saved.yaml").read_text()))


def line_of(text: str, key: str) -> int:
    return next(i for i, line in enumerate(text.splitlines(), start=1) if key in line)


@pytest.mark.parametrize(
    ("old", "new", "key", "found", "words"),
    [
        ("joint: waist, k: [1, 2]", "joint: shoulder, k: [1, 2]", "terms[0].joint", "shoulder", "waist, elbow, lift"),
        ("term: ratio", "term: ratios", "terms[3].term", "ratios", "did you mean 'ratio'?"),
        ("{term: ratio,      joint", "{joint", "terms[3].term", None, "missing"),
        ("joint: wrist, values: {ratio: 0.001}", "values: {ratio: 0.001}", "terms[3].joint", None, "missing"),
        ("by: waist", "by: wrist", "terms[4].by", "wrist", "does not drive itself"),
        ("by: waist", "by: nobody", "terms[4].by", "nobody", "no such joint"),
        ("joint: wrist, by: waist", "joint: wrist", "terms[4].by", None, "missing"),
        ("points: [x, q4, flange]", "points: [x, q1, flange]", "terms[8].points", "q1", "x, y, q3, q4, flange"),
        ("points: [x, q4, flange]", "points: [x, q2, flange]", "terms[8].points", "q2", "that the joint carries"),
        ("points: [x, q4, flange]", "points: [x, x]", "terms[8].points", "x", "once"),
        ("points: [x, q4, flange]", "points: []", "terms[8].points", "[]", "at least 1"),
        (
            "term: gravity,    joint: elbow, points: [x, q4, flange], values: {gravity_x: 0.1}",
            "term: gravity, joint: lift, points: [y]",
            "terms[8].points",
            "y",
            "allowed: x, q4, flange",
        ),
        ("gravity_x: 0.1", "gravity_y: 0.1", "terms[8].values", "gravity_y", "gravity_x, gravity_q4, gravity_flange"),
        ("sin_1: 0.02", "sin_3: 0.02", "terms[0].values", "sin_3", "sin_1, cos_1, sin_2, cos_2"),
        ("sin_1: 0.02", "sin_1: .nan", "terms[0].values.sin_1", "nan", "NaN"),
        ("sin_1: 0.02", "sin_1: much", "terms[0].values.sin_1", "much", "number"),
        ("joint: waist, k: [1], gear: 101", "joint: waist, k: [1]", "terms[1].values", "motor_sin_1", "no such number"),
        (
            "joint: waist, k: [1], gear: 101, values: {motor_sin_1: 0.003}",
            "joint: waist, k: [3, 2]",
            "terms[1].term",
            None,
            "'q1_sin_2' stands in two terms",
        ),
        ("gear: 101", "gear: 0", "terms[1].gear", "0", "greater than 0"),
        ("gear: 101", "pitch: 20", "terms[1].pitch", "20.0", "no pitch"),
        ("k: [1], pitch: 20", "k: [1]", "terms[2]", None, "need 'pitch'"),
        ("pitch: 20", "pitch: 20, gear: 3", "terms[2].gear", "3.0", "says it all"),
        ("pitch: 20", "pitch: -20", "terms[2].pitch", "-20", "greater than 0"),
        ("k: [1, 2]", "k: [1, 1]", "terms[0].k", "[1, 1]", "once"),
        ("k: [1, 2]", "k: [0, 2]", "terms[0].k[0]", "0", "greater than 0"),
        ("k: [1, 2]", "k: [1.5]", "terms[0].k[0]", "1.5", "whole number"),
        ("k: [1, 2]", "k: 1", "terms[0].k", "1", "list"),
        ("gravity: [0, 0, 2]", "gravity: [0, 0, 0]", "gravity", "[0, 0, 0]", "direction"),
        ("gravity: [0, 0, 2]", "gravity: [0, 0]", "gravity", "[0, 0]", "at least 3"),
        ("gravity: [0, 0, 2]", "gravity: [0, 0, .nan]", "gravity[2]", "nan", "NaN"),
        ("gravity: [0, 0, 2]", "gravity: down", "gravity", "down", "list"),
        ("on: elbow", "on: tool", "masses[0].on", "tool", "waist, elbow, lift, wrist, flange"),
        ("mass_kg: 8", "mass_kg: -8", "masses[0].mass_kg", "-8", "must be at least 0"),
        ("mass_kg: 8", "mass: 8", "masses[0].mass", "mass", "did you mean 'mass_kg'?"),
        ("mass_kg: 2", "mass_kg: -2", "payload.mass_kg", "-2", "must be at least 0"),
        ("q1_sin_1: 0.5", "q1_sin_5: 0.5", "scales.q1_sin_5", "q1_sin_5", "no such parameter"),
        ("q1_sin_1: 0.5", "q1_sin_1: 0", "scales.q1_sin_1", "0", "greater than 0"),
    ],
)
def test_each_mistake_is_one_error_at_its_place(write, old, new, key, found, words):
    assert FILE.count(old) == 1
    error = refused(write(FILE.replace(old, new)))
    assert (error.line, error.key, error.found) == (line_of(FILE, old), key, found)
    assert words in str(error)


def test_a_compliance_takes_known_masses(write):
    text = "\n".join(line for line in FILE.splitlines() if not line.startswith(("masses", "  - {on", "payload")))
    error = refused(write(text))
    assert (error.line, error.key) == (line_of(text, "term: compliance"), "terms[7].term")
    assert "'masses' or 'payload'" in str(error)
    # a mass before the joint is none that it carries
    error = refused(write(text + "\nmasses: [{on: waist, mass_kg: 8}]\n"))
    assert error.key == "terms[7].term"


def test_numbers_keep_their_names_whatever_the_order():
    assert Harmonics(3, True, k=(2, 1)).labels == ("sin_2", "cos_2", "sin_1", "cos_1")
    assert [Coupling(2, a, by=1, by_revolute=b).numbers[0].unit for a in (True, False) for b in (True, False)] == [
        "1",
        "rad/mm",
        "mm/rad",
        "1",
    ]
