"""Factory calibrations of Universal Robots: the tool is where the numbers of the file put it, composed here again.

The deltas are those of three robots in ur_calibration/test/calibration_test.cpp of UniversalRobots/
Universal_Robots_ROS2_Driver at 696e1a7; `corrected` is its calibration.cpp in NumPy, from the definition.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import symcal as sc
from symcal.robot.arms import arm_file
from symcal.robot.universal_robots import FRAMES, load_calibration_conf, load_six_frames
from symcal.spatial import pose_matrix

Array = NDArray[np.float64]
Call = Callable[..., tuple[int, str, str]]


def six(text: str) -> list[float]:
    return [float(number) for number in text.split()]


DELTAS: list[tuple[str, dict[str, list[float]]]] = [
    (
        "ur10",
        {
            "d": six(
                "0.00065609212979853 1.4442162376284788 0.854147723854608 -2.2989425877563705"
                " -1.573498686836816e-05 1.9072435590711256e-05"
            ),
            "a": six(
                "4.6311376834935676e-05 -0.00012568315331862312 0.00186216581161458 9.918593870679266e-05"
                " 4.215462720453189e-06 0"
            ),
            "theta": six(
                "-7.290070070824746e-05 -0.01713897289704999 -0.03707159413492756 0.054279462160583214"
                " 1.488984257025741e-07 1.551499479707493e-05"
            ),
            "alpha": six(
                "0.000211987863869334 -0.0072553625957652995 -0.013483226769541364 0.0013495820227329425"
                " -0.001263136163679901 0"
            ),
        },
    ),
    (
        "ur10e",
        {
            "d": six(
                "-0.000144894975118076141 303.469135666158195 -309.88394307789747 6.41459904397394975"
                " -4.48232900190081995e-05 -0.00087071402790364627"
            ),
            "a": six(
                "0.000108651068627930392 0.240324175250532346 0.00180628180213493472 2.63076149165684402e-05"
                " 3.96638632500012715e-06 0"
            ),
            "theta": six(
                "1.59613525316931737e-07 -0.917209621528830232 7.12936131346499469 0.0710299029424392298"
                " -1.64258976526054923e-06 9.17286101034808787e-08"
            ),
            "alpha": six(
                "-0.000444781952841921679 -0.00160215112531214153 0.00631917793331091861"
                " -0.00165055247340828437 0.000763682515545038854 0"
            ),
        },
    ),
    (
        "ur10e",
        {
            "d": six(
                "-0.000160188285741325043 439.140974079900957 -446.027059806332147 6.88618689642360149"
                " -3.86588496858186748e-05 -0.00087908274257374186"
            ),
            "a": six(
                "2.12234865571205891e-05 0.632017132627700651 0.00229833638891230319 -4.61409023720933908e-05"
                " -6.39280053471801522e-05 0"
            ),
            "theta": six(
                "-2.41478068943590252e-07 1.60233952386694556 -1.68607190752171299 0.0837331147700118711"
                " -1.01260355871157781e-07 3.91986209186123702e-08"
            ),
            "alpha": six(
                "-0.000650246557584166496 0.00139416666825590402 0.00693818880325995126"
                " -0.000811641562390219562 0.000411120504570705592 0"
            ),
        },
    ),
]
NOMINAL = {  # of the same test, m and rad
    "ur10": {"d": [0.1273, 0, 0, 0.163941, 0.1157, 0.0922], "a": [0, -0.612, -0.5723, 0, 0, 0]},
    "ur10e": {"d": [0.1807, 0, 0, 0.17415, 0.11985, 0.11655], "a": [0, -0.6127, -0.57155, 0, 0, 0]},
}
ALPHA = [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]


def write_conf(path: Path, deltas: dict[str, list[float]]) -> Path:
    rows = [f"delta_{kind} = [ {', '.join(map(repr, deltas[kind]))}]" for kind in ("theta", "a", "d", "alpha")]
    more = ["joint_checksum = [ 0xb3241580, 0xb10112f1]", "calibration_status = 2 # 0 == notInitialized"]
    path.write_text("\n".join(["# written by the controller", "[mounting]", *rows, *more, "[other]", "delta_d = [1]"]))
    return path


def rz(angle: float, along: float = 0.0) -> Array:
    t = np.eye(4)
    t[:3, :3], t[2, 3] = Rotation.from_euler("z", angle).as_matrix(), along
    return t


def rx(angle: float, along: float = 0.0) -> Array:
    t = np.eye(4)
    t[:3, :3], t[0, 3] = Rotation.from_euler("x", angle).as_matrix(), along
    return t


def parameters(arm: str, deltas: dict[str, list[float]]) -> list[tuple[float, float, float, float]]:
    """theta, d, a, alpha of every joint, m and rad."""
    nominal = {"theta": [0] * 6, "alpha": ALPHA, **NOMINAL[arm]}
    return [tuple(nominal[kind][i] + deltas[kind][i] for kind in ("theta", "d", "a", "alpha")) for i in range(6)]


def tool(arm: str, deltas: dict[str, list[float]], q: Array) -> Array:
    """T = product of Rz(theta + q) Tz(d) Rx(alpha) Tx(a), m."""
    t = np.eye(4)
    for (theta, d, a, alpha), angle in zip(parameters(arm, deltas), q, strict=True):
        t = t @ rz(theta + angle, d) @ rx(alpha, a)
    return t


def corrected(arm: str, deltas: dict[str, list[float]]) -> list[Array]:
    """The six frames of ur_calibration: d of the upper arm and the forearm are made zero, one after the other."""
    table = parameters(arm, deltas)
    chain = [part for theta, d, a, alpha in table for part in (rz(theta, d), rx(alpha, a))]
    for i in (1, 2):
        next_root = chain[2 * i] @ chain[2 * i + 1]
        origin = next_root[:3, 3]
        direction = (next_root @ chain[2 * i + 2])[:3, 3] - origin
        direction /= np.linalg.norm(direction)
        along = -origin[2] / direction[2]  # to the plane z = 0
        met = origin + along * direction
        theta = np.arctan2(met[1], met[0]) - (np.pi if abs(chain[2 * i + 1][0, 3]) > 0 else 0.0)
        chain[2 * i] = rz(theta)
        chain[2 * i + 1] = rz(table[i][0] - theta) @ rx(table[i][3])
        chain[2 * i + 1][0, 3] = -np.linalg.norm(met)
        chain[2 * i + 2][2, 3] -= along * np.sign(direction[2])
    return [chain[0], *(chain[k] @ chain[k + 1] for k in range(1, 10, 2))]


def write_frames(path: Path, frames: list[Array]) -> Path:
    kinematics = {}
    for name, t in zip(FRAMES, frames, strict=True):
        angles = Rotation.from_matrix(t[:3, :3]).as_euler(
            "XYZ"
        )  # about the turned axes, as Eigen's eulerAngles(0, 1, 2)
        values = [*t[:3, 3], *angles]
        names = ("x", "y", "z", "roll", "pitch", "yaw")
        kinematics[name] = dict(zip(names, map(float, values), strict=True))
    path.write_text(yaml.safe_dump({"kinematics": {**kinematics, "hash": "calib_12788084448423163542"}}))
    return path


def ours(robot: sc.Robot, q: Array) -> Array:
    rng = np.random.default_rng(0)
    return pose_matrix(sc.simulate(sc.build_model(robot, sc.Task.of("pose")), {}, q, sc.Noise(), rng).z)


@pytest.mark.parametrize(("arm", "deltas"), DELTAS, ids=["ur10", "ur10e 303 m", "ur10e 439 m"])
def test_the_tool_is_where_calibration_conf_puts_it(tmp_path: Path, arm: str, deltas: dict[str, list[float]]) -> None:
    nominal = sc.load_robot(arm_file(arm))
    robot = load_calibration_conf(write_conf(tmp_path / "calibration.conf", deltas), nominal)
    sc.save_robot(robot, tmp_path / "robot.yaml")
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (400, 6))
    expected = np.array([tool(arm, deltas, row) for row in q])
    for found in (ours(robot, q), ours(sc.load_robot(tmp_path / "robot.yaml"), q)):
        assert np.linalg.norm(found[:, :3, 3] - expected[:, :3, 3] * 1000, axis=1).max() < 1e-6
        np.testing.assert_allclose(found[:, :3, :3], expected[:, :3, :3], rtol=0, atol=1e-9)
    for link, before in zip(
        robot.links, nominal.links, strict=True
    ):  # no link is far away, and joints are those of the arm
        assert link.joint == before.joint
        for kind, value in link.parameters.items():
            assert abs(value - before.parameters.get(kind, 0.0)) < (3.0 if kind in "ad" else 0.02)


@pytest.mark.parametrize(("arm", "deltas"), DELTAS, ids=["ur10", "ur10e 303 m", "ur10e 439 m"])
def test_the_tool_is_where_six_frames_put_it(tmp_path: Path, arm: str, deltas: dict[str, list[float]]) -> None:
    frames = corrected(arm, deltas)
    path = write_frames(tmp_path / "my_robot.yaml", frames)
    q = np.random.default_rng(2).uniform(-np.pi, np.pi, (400, 6))
    t = np.tile(np.eye(4), (len(q), 1, 1))
    for i, frame in enumerate(frames):
        t = t @ frame @ np.array([rz(angle) for angle in q[:, i]])
    found = ours(load_six_frames(path), q)
    assert np.linalg.norm(found[:, :3, 3] - t[:, :3, 3] * 1000, axis=1).max() < 1e-9
    # the same robot as that of its calibration.conf, which says so in another way
    far = np.array([tool(arm, deltas, row) for row in q])
    assert np.linalg.norm(found[:, :3, 3] - far[:, :3, 3] * 1000, axis=1).max() < 1e-6
    urdf = ours(load_six_frames(path, "urdf", sc.load_robot(arm_file(arm))), q)
    apart = np.linalg.norm(urdf[:, :3, 3] - found[:, :3, 3], axis=1).max()
    assert 1e-6 < apart < 0.1


def test_a_calibration_is_imported(tmp_path: Path, symcal: Call) -> None:
    arm, deltas = DELTAS[1]
    conf = write_conf(tmp_path / "calibration.conf", deltas)
    frames = write_frames(tmp_path / "frames.yaml", corrected(arm, deltas))
    code, out, err = symcal("import", conf, "--arm", arm, "--out", tmp_path / "a.yaml")
    assert code == 0, err
    assert "ur10e_calibrated: 6 joints" in out
    code, out, err = symcal("import", frames, "--arm", arm, "--out", tmp_path / "b.yaml")
    assert code == 0, err
    assert "mm apart at most in 200 random postures (--angles)" in " ".join(out.split())
    q = np.random.default_rng(3).uniform(-3, 3, (50, 6))
    one, other = (ours(sc.load_robot(tmp_path / name), q) for name in ("a.yaml", "b.yaml"))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-6)
    for arguments, sentence in (
        ((conf,), "say which that is, as --arm ur5e"),
        ((conf, "--arm", "ur99"), "no arm of this name"),
        ((conf, "--arm", "franka_panda"), "an arm of Universal Robots"),
        ((frames, "--angles", "eigen"), "no such order of angles"),
        ((frames, "--arm", "kuka_iiwa7"), "six revolute joints"),
    ):
        code, _, err = symcal("import", *arguments, "--out", tmp_path / "c.yaml")
        assert code == 1
        assert sentence in " ".join(err.split())
    assert symcal("import", tmp_path / "robot.urdf")[0] == 2
    assert not (tmp_path / "c.yaml").exists()


@pytest.mark.long
def test_six_frames_that_were_exported_are_read_back(tmp_path: Path, symcal: Call) -> None:
    arm, deltas = DELTAS[2]
    robot = load_calibration_conf(write_conf(tmp_path / "calibration.conf", deltas), sc.load_robot(arm_file(arm)))
    sc.save_robot(robot, tmp_path / "robot.yaml")
    assert symcal("export", tmp_path / "robot.yaml", "--to", "ur", "--out", tmp_path)[0] == 0
    assert symcal("import", tmp_path / "ur_kinematics.yaml", "--arm", arm, "--out", tmp_path / "back.yaml")[0] == 0
    q = np.random.default_rng(4).uniform(-3, 3, (200, 6))
    np.testing.assert_allclose(ours(sc.load_robot(tmp_path / "back.yaml"), q), ours(robot, q), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message", "line"),
    [
        ("[mounting]", "[mount]", r"no section \[mounting\]", None),
        ("delta_a", "delta_b", "this key is missing", None),
        ("delta_a", "delta_theta", "stands here twice", 4),
        ("delta_a = [ ", "delta_a = [ 1, ", "expected six numbers", 4),
        ("delta_a = [ ", "delta_a = [ nan", "not a finite number", 4),
        ("delta_a = [ ", "delta_a =  ", "expected six numbers", 4),
    ],
)
def test_what_is_no_calibration_conf_is_refused(
    tmp_path: Path, old: str, new: str, message: str, line: int | None
) -> None:
    path = write_conf(tmp_path / "calibration.conf", DELTAS[0][1])
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(sc.InputError, match=message) as error:
        load_calibration_conf(path, sc.load_robot(arm_file("ur10")))
    assert (error.value.file, error.value.line) == (path, line)


def test_damaged_calibrations_are_refused_in_one_sentence(tmp_path: Path) -> None:
    rng, arm = random.Random(4), sc.load_robot(arm_file("ur10"))
    conf = write_conf(tmp_path / "a.conf", DELTAS[0][1])
    frames = write_frames(tmp_path / "a.yaml", corrected(*DELTAS[0]))
    for path in (conf, frames):
        whole = path.read_bytes()
        for _ in range(60):
            content = bytearray(whole[: rng.randrange(1, len(whole))] if rng.random() < 0.3 else whole)
            for _ in range(rng.randrange(1, 6)):
                content[rng.randrange(len(content))] = rng.randrange(256)
            path.write_bytes(bytes(content))
            with suppress(sc.InputError):
                load_calibration_conf(path, arm) if path == conf else load_six_frames(path)
