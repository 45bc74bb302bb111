"""What files say of poses beside joint readings: directions of approach and payload, read, written and checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import generators, random_robot
from test_measurement_file import random_dataset

from symcal.data.conditions import directions_from_order
from symcal.data.dataset import Dataset, merged, readings
from symcal.data.measurement_file import load_measurements
from symcal.data.saved_measurements import save_measurements
from symcal.errors import InputError
from symcal.joints.arm import Payload
from symcal.robot.robot import Joint, Link, Robot

ARM = Robot(
    "arm",
    "standard",
    (
        Link(Joint("revolute", "waist", -2, 2), {"theta": 0.0, "a": 300.0, "alpha": 1.0, "d": 0.0}),
        Link(Joint("prismatic", "lift", 0, 500), {"theta": 0.0, "a": 300.0, "alpha": 1.0, "d": 0.0}),
    ),
    payload=Payload(2.0),
)

LONG = """\
pose,waist_deg,lift_mm,q1_direction,lift_direction,payload_kg,point,x_mm,y_mm,z_mm
a,1,2,1,0,2,P,1,2,3
a,1,2,1,0,2,Q,1,2,3
b,2,3,-1,1,5.5,P,1,2,3
b,2,3,-1,1,5.5,Q,1,2,3
"""
WIDE = """\
pose,q1_deg,q2_mm,waist_direction,q2_direction,payload_kg,P_x_mm,P_y_mm,P_z_mm,Q_x_mm,Q_y_mm,Q_z_mm
a,1,2,1,0,2,1,2,3,1,2,3
b,2,3,-1.0,+1,5.5,1,2,3,1,2,3
"""
POSE = """\
pose,q1_deg,q2_mm,q1_direction,q2_direction,payload_kg,x_mm,y_mm,z_mm,qx,qy,qz,qw
a,1,2,1,0,2,1,2,3,0,0,0,1
b,2,3,-1,1,5.5,1,2,3,0,0,0,1
"""
DISTANCE = """\
pose,q1_deg,q2_mm,q1_direction,q2_direction,payload_kg,distance_mm
a,1,2,1,0,2,1000
b,2,3,-1,1,5.5,1001
"""
PIXELS = """\
pose,q1_deg,q2_mm,q1_direction,q2_direction,payload_kg,point,u_px,v_px
a,1,2,1,0,2,P,100,200
b,2,3,-1,1,5.5,P,100,201
"""
TOUCH = """\
q1_deg,q2_mm,q1_direction,q2_direction,payload_kg
1,2,1,0,2
2,3,-1,1,5.5
"""


@pytest.fixture
def load(tmp_path):
    def from_text(text: str, kind: str = "position", robot: Robot = ARM, **options) -> Dataset:
        path = tmp_path / "data.csv"
        path.write_text(text, encoding="utf-8")
        return load_measurements(path, robot, kind, **options)

    return from_text


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (LONG, "position"),
        (WIDE, "position"),
        (POSE, "pose"),
        (DISTANCE, "distance"),
        (PIXELS, "pixels"),
        (TOUCH, "fixed_point"),
    ],
    ids=["long", "wide", "pose", "distance", "pixels", "fixed_point"],
)
def test_every_layout_says_them(load, text, kind):
    data = load(text, kind)
    found = {name: values.tolist() for name, values in data.conditions.items()}
    assert found == {"q1_direction": [1, -1], "q2_direction": [0, 1], "payload": [0, 3.5]}
    assert len(data) == 2
    assert not any("not read" in note for note in data.notes)


def test_a_file_without_them_says_nothing(load):
    assert load("q1_deg,q2_mm,x_mm,y_mm,z_mm\n1,2,3,4,5\n").conditions == {}


def test_columns_may_be_called_otherwise(load):
    text = LONG.replace("payload_kg", "load").replace("lift_direction", "came")
    data = load(text, columns={"payload_kg": "load", "q2_direction": "came"})
    assert data.conditions["payload"].tolist() == [0, 3.5]
    assert data.conditions["q2_direction"].tolist() == [0, 1]


def test_a_near_miss_is_named(load):
    notes = load(LONG.replace("payload_kg", "payload").replace("lift_direction", "lift_dirction")).notes
    assert any("column 'payload' is not read: is it 'payload_kg'?" in note for note in notes)
    assert any("column 'lift_dirction' is not read: is it 'lift_direction'?" in note for note in notes)


@pytest.mark.parametrize(
    ("old", "new", "line", "column", "found", "words"),
    [
        ("b,2,3,-1,1,5.5,P", "b,2,3,-2,1,5.5,P", 4, "q1_direction", "-2", "-1 or 1, or 0"),
        ("b,2,3,-1,1,5.5,P", "b,2,3,-1,0.5,5.5,P", 4, "lift_direction", "0.5", "allowed: -1, 0, 1"),
        ("b,2,3,-1,1,5.5,P", "b,2,3,-,1,5.5,P", 4, "q1_direction", "-", "not a finite number"),
        ("b,2,3,-1,1,5.5,P", "b,2,3,,1,5.5,P", 4, "q1_direction", None, "an empty cell"),
        ("b,2,3,-1,1,5.5,P", "b,2,3,-1,1,-5,P", 4, "payload_kg", "-5", "less than nothing"),
        ("b,2,3,-1,1,5.5,P", "b,2,3,-1,1,heavy,P", 4, "payload_kg", "heavy", "not a finite number"),
        ("b,2,3,-1,1,5.5,Q", "b,2,3,1,1,5.5,Q", 5, "q1_direction", "1", "pose 'b' has another value of this here"),
        ("b,2,3,-1,1,5.5,Q", "b,2,3,-1,1,5,Q", 5, "payload_kg", "5", "than in line 4"),
        ("q1_direction", "q2_direction", 1, None, None, "the same direction twice"),
    ],
)
def test_each_slip_is_one_error_at_its_place(load, old, new, line, column, found, words):
    assert old in LONG
    with pytest.raises(InputError) as caught:
        load(LONG.replace(old, new))
    error = caught.value
    assert (error.line, error.column, error.found) == (line, column, found)
    assert words in str(error)
    assert "\n" not in str(error)


def test_postures_without_a_name_differ_by_them_too(load):
    text = "q1_deg,q2_mm,q1_direction,point,x_mm,y_mm,z_mm\n1,2,1,P,1,2,3\n1,2,1,Q,1,2,3\n1,2,-1,P,1,2,3\n"
    data = load(text)
    assert data.conditions["q1_direction"].tolist() == [1, -1]
    assert not any("repeat" in note for note in data.notes)  # the same readings from the other side are no repetition


@settings(max_examples=30)
@given(generators, st.sampled_from(["position", "pose"]), st.integers(1, 6))
def test_what_is_written_is_read_back(tmp_path, rng, kind, count):
    robot = replace(random_robot(rng), payload=Payload(float(rng.uniform(0, 3))))
    data = random_dataset(rng, robot, kind, [str(i) for i in range(count)])
    some = [i for i in range(1, robot.dof + 1) if rng.random() < 0.6]
    conditions = {f"q{i}_direction": rng.integers(-1, 2, count).astype(float) for i in some}
    if rng.random() < 0.5:
        conditions["payload"] = rng.uniform(-robot.payload.kg, 5, count)
    save_measurements(replace(data, conditions=conditions), robot, tmp_path / "m.csv")
    found = load_measurements(tmp_path / "m.csv", robot, kind, point_names=data.only.features)
    assert set(found.conditions) == set(conditions)
    for name, values in conditions.items():
        np.testing.assert_allclose(found.conditions[name], values, rtol=0, atol=1e-14)
    assert not any("not read" in note for note in found.notes)


# ---------------------------------------------------------------------------------------------- several observations


def poses(names: str, kind: str, **conditions: list[float]) -> Dataset:
    n = len(names)
    q = np.array([[ord(name), 0.0] for name in names], dtype=float)
    z = np.ones((n, 7 if kind == "pose" else 3))
    of = readings(kind, () if kind == "pose" else ("P",))
    found = {name: np.array(values, dtype=float) for name, values in conditions.items()}
    return Dataset(of, q, z, tuple(names), ("train",) * n, conditions=found)


def test_merged_keeps_what_any_observation_says():
    first = poses("abc", "position", payload=[0, 1, 2])
    second = poses("cbd", "pose", q1_direction=[1, -1, 1], payload=[2, 1, 3])
    found = merged([first, second], ["", ""])
    assert found.labels == ("a", "b", "c", "d")
    assert found.conditions["payload"].tolist() == [0, 1, 2, 3]
    assert found.conditions["q1_direction"].tolist() == [0, -1, 1, 1]  # of 'a' nobody says it: not known
    taken = found.take([3, 1])
    assert taken.conditions["payload"].tolist() == [3, 1]


def test_one_posture_has_one_payload():
    first, second = poses("ab", "position", payload=[0, 1]), poses("b", "pose", payload=[2])
    with pytest.raises(InputError, match="pose 'b' has another payload with 'pose'"):
        merged([first, second], ["", ""])
    assert merged([first, second], ["", "tuesday"]).conditions["payload"].tolist() == [0, 1, 2]


# --------------------------------------------------------------------------------------------- directions from order


def test_directions_are_signs_of_the_change_since_the_pose_before():
    q = np.array([[0.0, 10.0], [0.1, 5.0], [0.1 + 9e-7, 5.0 + 9e-5], [0.1 - 2e-6, 5.0 + 3e-4], [-1.0, 600.0]])
    data = Dataset(readings("position", ("P",)), q, np.zeros((5, 3)), tuple("abcde"), ("train",) * 5)
    found = directions_from_order(data, ARM).conditions
    assert found["q1_direction"].tolist() == [0, 1, 0, -1, -1]
    assert found["q2_direction"].tolist() == [0, -1, 0, 1, 1]


def test_each_session_begins_anew_and_what_a_file_says_stays():
    labels = ("mon/1", "tue/1", "mon/2", "tue/2")
    q = np.array([[0.0, 0.0], [5.0, 0.0], [1.0, 0.0], [4.0, 0.0]])
    data = Dataset(readings("position", ("P",)), q, np.zeros((4, 3)), labels, ("train",) * 4)
    assert directions_from_order(data, ARM).conditions["q1_direction"].tolist() == [0, 0, 1, -1]
    said = replace(data, conditions={"q1_direction": np.ones(4)})
    assert directions_from_order(said, ARM).conditions["q1_direction"].tolist() == [1] * 4
    assert directions_from_order(said, ARM).conditions["q2_direction"].tolist() == [0] * 4
