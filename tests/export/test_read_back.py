"""Files that are handed over, read back by yourdfpy and xacro; their numbers against SciPy and a published table."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from decisions import ACCEPTED
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from symcal.compensation.targets import tool_pose
from symcal.errors import RefusedError
from symcal.export import proof as proving
from symcal.export.export import export_robot
from symcal.export.joint_offsets import joint_offsets
from symcal.export.ur_frames import NAMES, ur_frames, ur_text
from symcal.export.urdf import urdf_poses, urdf_text
from symcal.robot.files import load_robot
from symcal.robot.robot import Record, Robot
from symcal.robot.urdf import load_urdf

ARMS = Path(__file__).parents[2] / "symcal" / "robot" / "arms"
TWELVE = (
    *("ur5e", "ur10", "ur30", "abb_irb120", "abb_irb2400_10", "kuka_kr6_r900_sixx", "fanuc_m10ia", "franka_fr3"),
    *("kinova_gen3", "staubli_tx90", "doosan_m1013", "denso_hsr065"),
)
_TURN = 3e-3  # rad: one standard deviation of the errors that are drawn; of lengths 1 mm


def calibrated(robot: Robot, seed: int, errors: dict[str, float] | None = None) -> Robot:
    """With random errors of every parameter, as an identification would have left them."""
    rng = np.random.default_rng(seed)
    drawn = {
        name: float(rng.normal() * (1.0 if name.split("_")[0] in ("a", "d") else _TURN)) for name in robot.parameters
    }
    found = drawn if errors is None else {name: errors.get(name, 0.0) for name in robot.parameters}
    tool = np.eye(4)
    tool[:3, :3] = Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()
    tool[:3, 3] = (20.0, -30.0, 150.0)
    record = Record(
        errors=found,
        sigmas=dict.fromkeys(found, 0.1),
        covariance=np.eye(len(found)),
        nominal_base=robot.base,
        nominal_tool=robot.tool @ tool,
        provenance=ACCEPTED,
    )
    return replace(robot.corrected(found), tool=robot.tool @ tool, record=record)


def arm(name: str) -> Robot:
    return load_robot(ARMS / f"{name}.yaml")


def round_trip(name: str, folder: Path) -> None:
    robot = calibrated(arm(name), seed=len(name))
    for to in ("urdf", "xacro", "offsets", *(["ur"] if name.startswith("ur") else [])):
        found = export_robot(robot, to, folder / to)
        assert found.proof is not None
        assert found.proof.reader is not None
        assert found.proof.mm <= 1e-9
        assert found.proof.rad <= 1e-12


@pytest.mark.parametrize("name", ["ur5e", "kinova_gen3", "denso_hsr065"])
def test_a_reader_finds_the_same_robot(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proving, "POSES", 100)
    round_trip(name, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("name", TWELVE)
def test_twelve_arms_come_back(name: str, tmp_path: Path) -> None:
    round_trip(name, tmp_path)


def test_a_file_that_says_something_else_is_not_handed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = calibrated(arm("ur5e"), 1)
    text = urdf_text(robot)
    spoilt = re.sub(r'xyz="(-0\.42\d+) ', lambda found: f'xyz="{float(found[1]) + 2e-9!r} ', text, count=1)
    assert spoilt != text

    def read(folder: Path, q: NDArray[np.float64]) -> NDArray[np.float64]:
        return urdf_poses(folder, q, robot)

    with pytest.raises(RefusedError, match=r"yourdfpy .* puts the tool up to 2e-06 mm .* elsewhere"):
        proving.proof(robot, {"robot.urdf": spoilt}, read, ("yourdfpy",))
    monkeypatch.setattr("symcal.export.export.text_of", lambda *_: spoilt)
    with pytest.raises(RefusedError, match="Nothing was written"):
        export_robot(robot, "urdf", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_without_a_reader_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proving, "find_spec", lambda _: None)
    found = export_robot(calibrated(arm("denso_hsr065"), 1), "urdf", tmp_path)
    assert found.proof is not None
    assert found.proof.text == "not read back: yourdfpy is not installed (pip install 'symcal[proof]')"


def test_xacro_properties_are_the_urdf_s_numbers(tmp_path: Path) -> None:
    robot = calibrated(arm("ur5e"), 2)
    export_robot(robot, "xacro", tmp_path)
    properties = {
        each.attrib["name"]: each.attrib["value"]
        for each in ET.parse(tmp_path / "calibration.xacro").iter("{http://www.ros.org/wiki/xacro}property")
    }
    joint = next(each for each in ET.fromstring(urdf_text(robot)).iter("joint") if each.attrib["name"] == "elbow")
    origin = joint.find("origin")
    assert origin is not None
    assert [properties[f"elbow_{axis}"] for axis in "xyz"] == origin.attrib["xyz"].split()
    assert [properties[f"elbow_{axis}"] for axis in ("roll", "pitch", "yaw")] == origin.attrib["rpy"].split()
    first, second = (
        replace(link, joint=replace(link.joint, name=name))
        for link, name in zip(robot.links[:2], ("a b", "a-b"), strict=True)
    )
    with pytest.raises(RefusedError, match="joints a b and a-b would both be the properties a_b_x"):
        export_robot(replace(robot, links=(first, second, *robot.links[2:])), "xacro", tmp_path / "b")


# six frames

DEFAULT = {
    "shoulder": ((0, 0, 0.1625), (0, 0, 0)),
    "upper_arm": ((0, 0, 0), (1.570796327, 0, 0)),
    "forearm": ((-0.425, 0, 0), (0, 0, 0)),
    "wrist_1": ((-0.3922, 0, 0.1333), (0, 0, 0)),
    "wrist_2": ((0, -0.0997, -2.044881182297852e-11), (1.570796327, 0, 0)),
    "wrist_3": ((0, 0.0996, -2.042830148012698e-11), (1.570796326589793, 3.141592653589793, 3.141592653589793)),
}
"""The maker's: UniversalRobots/Universal_Robots_ROS2_Description 2221ec0, config/ur5e/default_kinematics.yaml."""


def test_frames_are_the_maker_s() -> None:
    read = yaml.safe_load(ur_text(ur_frames(arm("ur5e"))))["kinematics"]
    assert list(read) == [*NAMES, "hash"]
    for name, (xyz, rpy) in DEFAULT.items():
        assert [read[name][axis] for axis in "xyz"] == pytest.approx(xyz, abs=1e-9)
        ours = Rotation.from_euler("ZYX", [read[name][axis] for axis in ("yaw", "pitch", "roll")])
        assert (ours.inv() * Rotation.from_euler("ZYX", rpy[::-1])).magnitude() < 1e-9


def test_frames_of_a_description_come_back(tmp_path: Path) -> None:
    """Through URDF, where the flange is known only as the tip of the chain."""
    robot = arm("ur5e").corrected({"alpha_2": 0.003, "a_3": 0.7, "theta_4": -0.002})
    path = tmp_path / "robot.urdf"
    path.write_text(urdf_text(robot), encoding="utf-8")
    again = load_urdf(path, "base_link", "tool")
    q = np.random.default_rng(1).uniform(-3, 3, (20, 6))
    for found in (ur_frames(robot), ur_frames(again)):
        for each in q:
            at = np.eye(4)
            for frame, angle in zip(found.frames, each, strict=True):
                turn = np.eye(4)
                turn[:3, :3] = Rotation.from_rotvec([0, 0, angle]).as_matrix()
                at = at @ frame @ turn
            assert np.abs(at @ found.tcp - np.asarray(tool_pose(robot)(each))).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("franka_fr3", "has not six revolute joints"),
        ("abb_irb120", r"is not built like an arm of Universal Robots \(its axes stand 90, 0, 90, 90, 90 deg"),
    ],
)
def test_frames_are_for_one_maker(name: str, words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        ur_frames(arm(name))


def test_a_chain_without_a_flange_has_no_six_frames(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(urdf_text(calibrated(arm("ur5e"), 3)), encoding="utf-8")
    with pytest.raises(RefusedError, match="nothing says where its flange is"):
        ur_frames(load_urdf(path, "base_link", "tool"))


# zero offsets


def test_errors_of_zeros_alone_are_found() -> None:
    errors = {f"theta_{i}": value for i, value in enumerate([0.01, -0.004, 0.006, -0.002, 0.003, 0.005], start=1)}
    found = joint_offsets(calibrated(arm("ur5e"), 0, errors))
    assert found.readings == pytest.approx(list(errors.values()), abs=1e-12)
    assert found.largest_mm < 1e-9


def test_offsets_are_in_readings() -> None:
    """Of a joint that counts backwards, half turns and millimetres: what is added to the reading makes the pose."""
    robot = arm("denso_hsr065")
    joints = [replace(link.joint, sign=-1, ratio=2.0) for link in robot.links]
    robot = replace(robot, links=tuple(replace(link, joint=j) for link, j in zip(robot.links, joints, strict=True)))
    errors = {("theta" if link.joint.revolute else "d") + f"_{i}": 0.01 * i for i, link in enumerate(robot.links, 1)}
    true = calibrated(robot, 0, {name: value for name, value in errors.items() if name in robot.parameters})
    found, q = joint_offsets(true), (true.lower + true.upper) / 3
    nominal = replace(true.nominal(), tool=true.tool)
    off = np.asarray(tool_pose(nominal)(q + found.readings)) - np.asarray(tool_pose(true)(q))
    assert np.abs(off).max() < 1e-9


def test_offsets_are_the_least_squares(tmp_path: Path) -> None:
    """SciPy's, by finite differences, over the same postures; and the files say the same."""
    robot = calibrated(arm("ur5e"), 5)
    found = joint_offsets(robot)
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (1024, 6))
    nominal, true = tool_pose(replace(robot.nominal(), tool=robot.tool)), tool_pose(robot)
    wanted = np.array([np.asarray(true(each)) for each in q[:150]])

    def rows(offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        poses = np.array([np.asarray(nominal(each + offsets)) for each in q[:150]])
        turns = Rotation.from_matrix(wanted[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
        return np.concatenate([(wanted - poses)[:, :3, 3], 300 * turns], axis=1).ravel()

    best = least_squares(rows, np.zeros(6), xtol=1e-12, ftol=1e-12).x
    # of 150 of its 1024 postures: as near as that many let it be
    assert np.abs(best - found.readings).max() < 5e-4
    assert np.linalg.norm(rows(found.readings)) < 1.02 * np.linalg.norm(rows(best))
    assert np.linalg.norm(rows(-found.readings)) > 1.1 * np.linalg.norm(rows(best))
    export_robot(robot, "offsets", tmp_path)
    ros = yaml.safe_load((tmp_path / "joint_offsets.yaml").read_text(encoding="utf-8"))["joint_offsets"]
    assert list(ros.values()) == found.readings.tolist()
    given = [float(each.text or "nan") for each in ET.parse(tmp_path / "transmissions.xml").iter("offset")]
    assert given == found.readings.tolist()
    table = (tmp_path / "joint_offsets.csv").read_text(encoding="utf-8").splitlines()
    assert table[0] == "joint,unit,add_to_reading"
    assert float(table[3].split(",")[2]) == pytest.approx(np.degrees(found.readings[2]))


def test_a_nominal_robot_has_no_offsets(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="was never calibrated"):
        export_robot(arm("ur5e"), "offsets", tmp_path)
