"""Hand-eye frames from pairs of poses: of easy_handeye2, of MoveIt and their CSV twin, against another solver."""

from __future__ import annotations

import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import yaml
from pair_files import pairs, park_martin, write_csv, write_easy, write_moveit
from scipy.spatial.transform import Rotation

import symcal as sc
from symcal.readers.hand_eye import read_pairs
from symcal.robot.given import GIVEN_FILE, given_readings, is_given
from symcal.spatial import pose_matrix

Call = Callable[..., tuple[int, str, str]]
EXPERIMENT = """schema: symcal/experiment/1
name: hand eye
robot: {robot}
units: {{length: mm, angle: deg}}
base: unknown
tool: unknown
measurements:
  camera: {{instrument: pose, at: {{on: {at}}}, target: {{on: {target}}}, data: {{{data}}}}}
"""
PLACES = {"hand": {"at": "tool", "target": "world"}, "base": {"at": "world", "target": "tool"}}


def flange_poses(q: np.ndarray) -> np.ndarray:
    """Forward kinematics of the robot, link by link, from its file as it stands."""
    out = np.tile(np.eye(4), (len(q), 1, 1))
    for i, link in enumerate(yaml.safe_load(GIVEN_FILE.read_text())["links"]):
        turn, along = (0.0, q[:, i]) if link["joint"] == "prismatic" else (q[:, i], np.zeros(len(q)))
        step = np.tile(np.eye(4), (len(q), 1, 1))
        rz = Rotation.from_rotvec(np.outer(np.deg2rad(link["theta"]) + turn * np.ones(len(q)), [0, 0, 1]))
        rx = Rotation.from_euler("x", link.get("alpha", 0.0), degrees=True)
        step[:, :3, :3], step[:, 2, 3] = (rz * rx).as_matrix(), along
        out = out @ step
    return out


def test_readings_of_the_robot_put_its_flange_at_the_poses() -> None:
    rng = np.random.default_rng(2)
    t = np.tile(np.eye(4), (300, 1, 1))
    t[:, :3, :3] = Rotation.random(300, random_state=2).as_matrix()
    t[:, :3, 3] = rng.uniform(-900, 900, (300, 3))
    for i, pitch in enumerate((np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-10, np.pi / 2 - 1e-7)):
        t[i, :3, :3] = Rotation.from_euler("XYZ", [0.3, pitch, -1.2]).as_matrix()
    t[4, :3, :3] = np.eye(3)
    q = given_readings(t)
    np.testing.assert_allclose(flange_poses(q), t, rtol=0, atol=1e-9)
    robot = sc.load_robot(GIVEN_FILE)
    assert is_given(robot)
    ours = sc.simulate(sc.build_model(robot, sc.Task.of("pose")), {}, q, sc.Noise(), rng).z
    np.testing.assert_allclose(pose_matrix(ours), t, rtol=0, atol=1e-9)


@pytest.mark.parametrize("eye", ["hand", "base"])
def test_hand_eye_frames_are_those_of_the_csv_twin_and_of_another_solver(
    tmp_path: Path, symcal: Call, eye: str
) -> None:
    flange, seen, x = pairs(np.random.default_rng(7), eye)
    write_easy(tmp_path / "easy.samples", flange, seen, eye)
    write_moveit(tmp_path / "moveit.yaml", flange, seen)
    write_csv(tmp_path / "twin.csv", flange, seen)
    found, sigmas = {}, {}
    for name, data in (
        ("twin", "source: file, file: twin.csv"),
        ("easy", f"source: pairs, file: easy.samples, eye: {eye}"),
        ("moveit", "source: pairs, file: moveit.yaml"),
    ):
        path = tmp_path / f"{name}_experiment.yaml"
        path.write_text(EXPERIMENT.format(robot="given_poses", data=data, **PLACES[eye]))
        code, out, err = symcal("identify", path, "--no-report", "--out", tmp_path / name)
        assert code == 0, out + err
        robot = sc.load_robot(tmp_path / name / "calibrated.yaml")
        assert robot.parameters == sc.load_robot(GIVEN_FILE).parameters  # nothing but frames was freed
        assert {n for n, error in robot.record.errors.items() if error} <= {
            f"{of}_{c}" for of in ("base", "tool") for c in ("x", "y", "z", "rx", "ry", "rz")
        }
        found[name] = robot.tool if eye == "hand" else np.linalg.inv(robot.base)
        sigmas[name] = {n: sigma for n, sigma in robot.record.sigmas.items() if sigma is not None}
    for name in ("easy", "moveit"):
        np.testing.assert_allclose(found[name], found["twin"], rtol=0, atol=1e-9)
        assert sigmas[name] == pytest.approx(sigmas["twin"], rel=1e-6)
    witness = park_martin(flange if eye == "hand" else np.linalg.inv(flange), seen)
    for truth in (witness, x):  # 30 poses of 0.2 mm and 0.5 mrad
        assert np.linalg.norm(found["easy"][:3, 3] - truth[:3, 3] * 1000) < 0.5
        turned = Rotation.from_matrix(found["easy"][:3, :3] @ truth[:3, :3].T).magnitude()
        assert turned < 5e-4


def test_kinematics_are_refused_without_joints_and_identified_with_joints_beside(tmp_path: Path, symcal: Call) -> None:
    robot = sc.load_robot(Path(sc.__file__).parent / "robot" / "arms" / "ur5e.yaml")
    sc.save_robot(robot, tmp_path / "ur5e.yaml")
    rng = np.random.default_rng(4)
    q = rng.uniform(-1.5, 1.5, (40, 6))
    task = sc.Task.of("pose", {"base", "tool"})
    truth = {"theta_3": 0.004, "a_2": 0.8, "tool_x": 30.0, "base_z": 200.0}
    z = sc.simulate(sc.build_model(robot, task), truth, q, sc.Noise(position=0.02, orientation=1e-4), rng).z
    seen = pose_matrix(z)
    seen[:, :3, 3] /= 1000
    write_moveit(tmp_path / "pairs.yaml", seen, seen)
    experiment = tmp_path / "experiment.yaml"
    text = EXPERIMENT.format(robot="ur5e.yaml", data="source: pairs, file: pairs.yaml", at="world", target="tool")
    experiment.write_text(text)
    code, _, err = symcal("identify", experiment, "--no-report", "--out", tmp_path / "run")
    assert code == 1
    assert "pairs of poses hold no joint readings: hand-eye and other frames only, no kinematics" in " ".join(
        err.split()
    )
    assert not (tmp_path / "run").exists()
    names = [f"{joint.name}_joint" for joint in robot.joints]
    (tmp_path / "joints.yaml").write_text(
        yaml.safe_dump({"joint_names": names[::-1], "joint_values": q[:, ::-1].tolist()})
    )
    rows = [",".join(map(repr, row)) for row in np.rad2deg(q).tolist()]
    (tmp_path / "joints.csv").write_text("\n".join([",".join(f"q{i}_deg" for i in range(1, 7)), *rows]))
    found = []
    for file in ("joints.yaml", "joints.csv"):
        experiment.write_text(text.replace("pairs.yaml}", f"pairs.yaml, joints: {file}}}"))
        code, _, err = symcal("identify", experiment, "--no-report", "--out", tmp_path / "run")
        assert code == 0, err
        found.append(sc.load_robot(tmp_path / "run" / "calibrated.yaml").record.errors)
    assert found[0] == pytest.approx(found[1], abs=1e-9)
    assert found[0]["a_2"] == pytest.approx(0.8, abs=0.05)


def test_a_camera_that_is_not_where_it_is_said_is_found(tmp_path: Path, symcal: Call) -> None:
    flange, seen, _ = pairs(np.random.default_rng(3), "hand")
    write_easy(tmp_path / "easy.samples", flange, seen, "base")
    text = EXPERIMENT.format(robot="given_poses", data="source: pairs, file: easy.samples, eye: hand", **PLACES["hand"])
    (tmp_path / "experiment.yaml").write_text(text)
    code, _, err = symcal("identify", tmp_path / "experiment.yaml", "--no-report", "--out", tmp_path / "run")
    assert code == 1
    assert "the data look as if the poses are inverse" in " ".join(err.split())


@pytest.mark.parametrize("more", ["extend: auto", "remainder: smooth"])
def test_more_than_frames_is_refused_of_given_poses(tmp_path: Path, symcal: Call, more: str) -> None:
    flange, seen, _ = pairs(np.random.default_rng(1), "hand")
    write_moveit(tmp_path / "pairs.yaml", flange, seen)
    text = EXPERIMENT.format(robot="given_poses", data="source: pairs, file: pairs.yaml", **PLACES["hand"])
    (tmp_path / "experiment.yaml").write_text(f"{text}identification: {{{more}}}\n")
    code, _, err = symcal("check", tmp_path / "experiment.yaml")
    assert code == 1
    assert "frames only, no kinematics" in " ".join(err.split())


def test_samples_that_cannot_be_meant_are_refused_where_they_stand(tmp_path: Path) -> None:
    flange, seen, _ = pairs(np.random.default_rng(1), "hand", count=3)
    path = write_easy(tmp_path / "a.samples", flange, seen, "hand")
    with pytest.raises(sc.InputError, match="does not say where the camera is") as error:
        read_pairs(path)
    assert error.value.allowed == ("hand", "base")
    whole = path.read_text()
    write_easy(path, flange, seen, "hand", "eye_on_base")
    with pytest.raises(sc.InputError, match="the experiment says 'eye: hand', and the file this") as error:
        read_pairs(path, "hand")
    assert error.value.found == "eye_on_base"
    for old, new, message in (
        ("samples:", "sampled:", "unknown key"),
        ("    rotation:\n      x:", "    rotation:\n      x: 3\n      y:", "twice"),
        ("tracking:", "trucking:", "unknown key"),
        ("translation:\n      x: ", "translation:\n      x: a", "expected a number"),
    ):
        path.write_text(whole.replace(old, new, 1))
        with pytest.raises(sc.InputError, match=message) as error:
            read_pairs(path, "hand")
        assert error.value.line is not None
    moveit = write_moveit(tmp_path / "a.yaml", flange * 1.01, seen)
    with pytest.raises(sc.InputError, match="not the matrix of a pose") as error:
        read_pairs(moveit)
    assert (error.value.line, error.value.key) == (1, "pairs[0].effector_wrt_world")


def test_damaged_pairs_are_refused_in_one_sentence(tmp_path: Path) -> None:
    rng = random.Random(1)
    flange, seen, _ = pairs(np.random.default_rng(1), "hand", count=2)
    for path in (write_easy(tmp_path / "a", flange, seen, "hand"), write_moveit(tmp_path / "b", flange, seen)):
        whole = path.read_bytes()
        for _ in range(60):
            content = bytearray(whole[: rng.randrange(len(whole))] if rng.random() < 0.3 else whole)
            for _ in range(rng.randrange(4)):
                content[rng.randrange(len(content)) if content else 0 :] = content[1:]
                if content:
                    content[rng.randrange(len(content))] = rng.randrange(256)
            path.write_bytes(bytes(content))
            with suppress(sc.InputError):
                read_pairs(path, "hand")
