"""The list of common arms: every file reads, names its sources, and puts the tool where another description does."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from symcal.errors import InputError
from symcal.kinematics import chain, forward, frame_vector
from symcal.parameters import ParameterSet
from symcal.robot.arms import arm, arm_file, arm_names
from symcal.robot.files import load_robot, save_robot

WITNESSES = yaml.safe_load(Path(__file__).with_name("arm_positions.yaml").read_text(encoding="utf-8"))

TOLERANCE = 1e-4
"""mm: the positions are written with four decimals."""


def position(robot, reading):
    """The tool's origin by the package, mm; readings in deg and mm."""
    q = [math.radians(v) if joint.revolute else v for v, joint in zip(reading, robot.joints, strict=True)]
    pose = forward(chain(robot, ParameterSet(())))(q, [], frame_vector(robot.base, robot.tool))[0]
    return np.array(pose)[:3, 3]


def test_every_arm_has_a_witness_and_every_witness_an_arm():
    assert set(arm_names()) == set(WITNESSES)
    assert len(arm_names()) >= 20


@pytest.mark.parametrize("name", arm_names())
def test_tool_stands_where_the_witness_says(name):
    robot = load_robot(arm_file(name))
    assert robot.name == name
    for pose in WITNESSES[name]["poses"]:
        for value, joint in zip(pose["at"], robot.joints, strict=True):
            at = math.radians(value) if joint.revolute else value
            assert joint.lower <= at <= joint.upper
        assert position(robot, pose["at"]) == pytest.approx(pose["mm"], abs=TOLERANCE)


@pytest.mark.parametrize("name", arm_names())
def test_every_arm_names_its_maker_and_its_sources(name):
    about = arm(name)
    assert about.maker
    assert about.model
    assert about.axes == len(load_robot(arm_file(name)).links)
    assert any(re.search(r" [0-9a-f]{7}\b", source) for source in about.sources)  # a repository at a commit
    witness = WITNESSES[name]
    assert (about.checked is None) == witness.get("one_source", False)
    assert witness["witness"] == (about.checked or about.sources[-1])


# reach in mm that the type's own name states, from axis 1 (from axis 2 where the maker counts from there)
NAMED_REACH = {
    "abb_irb120": (580, False),
    "abb_irb1200_7_70": (700, False),
    "abb_irb1600_6_12": (1220, True),
    "abb_irb2600_12_165": (1650, True),
    "abb_irb4600_60_205": (2050, True),
    "abb_irb6700_200_260": (2600, True),
    "kuka_kr3_r540": (540, True),
    "kuka_kr6_r700_sixx": (700, True),
    "kuka_kr6_r900_sixx": (900, True),
    "kuka_kr10_r900_2": (900, True),
    "kuka_kr10_r1100_sixx": (1100, True),
}


@pytest.mark.parametrize("name", NAMED_REACH)
def test_stretched_arm_reaches_as_far_as_its_name_says(name):
    """To the wrist's centre, upper arm and forearm in one line: makers round the name to ten millimetres."""
    reach, from_axis_1 = NAMED_REACH[name]
    _, shoulder, elbow, wrist, *_ = (link.parameters for link in load_robot(arm_file(name)).links)
    stretched = abs(elbow["a"]) + math.hypot(wrist["a"], wrist["d"])
    assert stretched + from_axis_1 * abs(shoulder["a"]) == pytest.approx(reach, abs=10)


def test_seven_axes_and_a_scara_reach_as_far_as_their_names_say():
    for name, reach in (("kuka_iiwa7", 800), ("kuka_iiwa14", 820)):
        links = load_robot(arm_file(name)).links
        assert links[2].parameters["d"] + links[4].parameters["d"] == pytest.approx(reach)
    scara = load_robot(arm_file("denso_hsr065")).links
    assert scara[1].parameters["a"] + scara[3].parameters["a"] == pytest.approx(650)


def test_an_arm_survives_being_written(tmp_path):
    for name in ("ur5e", "kinova_gen3", "denso_hsr065"):
        save_robot(load_robot(arm_file(name)), tmp_path / "robot.yaml")
        pose = WITNESSES[name]["poses"][0]
        assert position(load_robot(tmp_path / "robot.yaml"), pose["at"]) == pytest.approx(pose["mm"], abs=TOLERANCE)


def test_unknown_arm_is_named_with_a_guess():
    with pytest.raises(InputError, match="did you mean 'ur5e'"):
        arm_file("ur5ee")
