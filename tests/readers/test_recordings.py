"""Joint readings and poses recorded side by side, against means taken here by the known stops."""

from __future__ import annotations

import json
import random
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from recordings import BEGIN, MEASURED, Recording, record, write_bag
from rosbags.rosbag2 import StoragePlugin
from scipy.spatial.transform import Rotation

import symcal as sc
from symcal.documents.table import Table
from symcal.readers.bags import Bag, read_bag
from symcal.readers.still import still_intervals
from symcal.readers.streams import Matching
from symcal.readers.time_shift import found_shift
from symcal.readers.trajectories import read_trajectory

Call = Callable[..., tuple[int, str, str]]
ROBOT = Path(sc.__file__).parent / "robot" / "arms" / "ur5e.yaml"
EXPERIMENT = """schema: symcal/experiment/1
name: recording
robot: ur5e.yaml
units: {{length: mm, angle: deg}}
base: unknown
measurements:
  tracker: {{instrument: pose, target: {{on: tool}}, data: {{{data}}}}}
"""


@pytest.fixture(scope="module")
def robot() -> sc.Robot:
    return sc.load_robot(ROBOT)


@pytest.fixture(scope="module")
def model(robot: sc.Robot) -> sc.Model:
    return sc.build_model(robot, sc.Task.of("pose", {"base"}))


@pytest.fixture(scope="module")
def recording(model: sc.Model) -> Recording:
    return record(model, 8)


def joints(robot: sc.Robot) -> list[tuple[str, bool]]:
    return [(joint.name, joint.revolute) for joint in robot.joints]


def numbers(table: Table) -> np.ndarray:
    return np.column_stack([table.numbers(column) for column in table.columns[1:]])


def means(recording: Recording, settle: float = 0.2, tolerance: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Readings and poses over the known stops, as the rule says, from whole and not from found standstills."""
    q, seen = [], []
    for stop in recording.still:
        begin, end = recording.t[(recording.t >= stop[0] - 1e-9) & (recording.t <= stop[1] + 1e-9)][[0, -1]]
        own = (recording.t >= begin + settle) & (recording.t <= end - tolerance)
        q.append(recording.q[own].mean(axis=0))
        poses = recording.seen[(recording.seen_t >= begin + settle) & (recording.seen_t <= end - tolerance)]
        rotation = Rotation.from_quat(poses[:, 3:]).mean().as_quat()
        seen.append([*poses[:, :3].mean(axis=0), *(rotation * np.sign(rotation[3]))])
    return np.array(q), np.array(seen)


def write_twin(path: Path, recording: Recording, settle: float, tolerance: float) -> None:
    q, seen = means(recording, settle, tolerance)
    head = [*(f"q{i}_rad" for i in range(1, 7)), "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
    rows = [",".join(map(repr, row)) for row in np.hstack([q, seen]).tolist()]
    path.write_text("\n".join([",".join(head), *rows]))


@pytest.mark.parametrize(
    ("kind", "storage"),
    [(kind, StoragePlugin.MCAP) for kind in MEASURED] + [(next(iter(MEASURED)), StoragePlugin.SQLITE3)],
)
def test_a_bag_gives_the_means_of_its_standstills(
    tmp_path: Path, robot: sc.Robot, recording: Recording, kind: str, storage: StoragePlugin
) -> None:
    path = write_bag(tmp_path / "bag", recording, kind, storage)
    bag = Bag(frames=("world", "tool") if "TF" in kind else None)
    found = read_bag(path, joints(robot), bag, Matching())
    q, seen = means(recording)
    assert len(found) == len(q) == 8
    # an interval begins with the end of the move before and ends in the next, as far as joints are within their band
    np.testing.assert_allclose(numbers(found)[:, :6], q, rtol=0, atol=2e-5)
    assert np.abs(numbers(found)[:, 6:9] - seen[:, :3]).max() < 5e-5
    if "qx" in found.columns:
        turned = Rotation.from_quat(numbers(found)[:, 9:]) * Rotation.from_quat(seen[:, 3:]).inv()
        assert turned.magnitude().max() < 5e-5
    assert "left out" in found.notes[0]  # the gripper's messages
    assert "8 poses where the robot stands still for 0.5 s or more" in found.notes[-1]


def test_a_bag_identifies_as_its_csv_twin(tmp_path: Path, model: sc.Model, robot: sc.Robot, symcal: Call) -> None:
    # readings that do not tremble: stops are then found as they are, and the means are those of the twin
    exact = record(model, 24, noise=0.0)
    write_bag(tmp_path / "bag", exact)
    write_twin(tmp_path / "twin.csv", exact, 0.195, 0.025)
    sc.save_robot(robot, tmp_path / "ur5e.yaml")
    found = {}
    tight = "source: bag, file: bag, joint_topic: /joint_states, topic: /tracker/pose, still_rad: 1.0e-9"
    tight += ", settle_s: 0.195, tolerance_s: 0.025"  # no reading stands just there
    for name, data in (("bag", tight), ("twin", "source: file, file: twin.csv")):
        path = tmp_path / f"{name}.yaml"
        path.write_text(EXPERIMENT.format(data=data))
        code, out, err = symcal("identify", path, "--no-report", "--out", tmp_path / f"run_{name}")
        assert code == 0, out + err
        found[name] = sc.load_robot(tmp_path / f"run_{name}" / "calibrated.yaml").record
    assert found["bag"].errors == pytest.approx(found["twin"].errors, abs=1e-9)
    results = json.loads((tmp_path / "run_bag" / "results.json").read_text())
    assert "24 poses where the robot stands still" in " ".join(results["warnings"])
    assert any("metadata.yaml" in name for name in results["inputs"])


# ------------------------------------------------------------------------------------------------------- trajectories


def write_joints(path: Path, recording: Recording) -> Path:
    rows = [",".join(map(repr, row)) for row in np.column_stack([recording.t + BEGIN, recording.q]).tolist()]
    path.write_text("\n".join(["t_s,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad", *rows]))
    return path


def write_tum(path: Path, recording: Recording) -> Path:
    rows = np.column_stack([recording.seen_t + BEGIN, recording.seen]).tolist()
    path.write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join(" ".join(map(repr, row)) for row in rows))
    return path


def write_euroc(path: Path, recording: Recording) -> Path:
    lines = ["#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"]
    for t, (x, y, z, qx, qy, qz, qw) in zip(recording.seen_t, recording.seen.tolist(), strict=True):
        lines.append(f"{BEGIN * 10**9 + round(t * 1e9)},{x!r},{y!r},{z!r},{qw!r},{qx!r},{qy!r},{qz!r},0,0,0")
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("write", [write_tum, write_euroc])
def test_trajectories_are_matched_as_bags_are(
    tmp_path: Path, robot: sc.Robot, recording: Recording, write: Callable[[Path, Recording], Path]
) -> None:
    path, beside = write(tmp_path / "a.txt", recording), write_joints(tmp_path / "joints.csv", recording)
    found = read_trajectory(path, beside, joints(robot), Matching())
    q, seen = means(recording)
    np.testing.assert_allclose(numbers(found)[:, :6], q, rtol=0, atol=2e-5)
    assert np.abs(numbers(found)[:, 6:9] - seen[:, :3]).max() < 5e-5


@pytest.mark.long
def test_a_trajectory_identifies(tmp_path: Path, robot: sc.Robot, model: sc.Model, symcal: Call) -> None:
    recording = record(model, 20)
    write_euroc(tmp_path / "a.csv", recording)
    write_joints(tmp_path / "joints.csv", recording)
    sc.save_robot(robot, tmp_path / "ur5e.yaml")
    (tmp_path / "a.yaml").write_text(EXPERIMENT.format(data="source: trajectory, file: a.csv, joints: joints.csv"))
    code, out, err = symcal("identify", tmp_path / "a.yaml", "--no-report", "--out", tmp_path / "run")
    assert code == 0, out + err
    found = sc.load_robot(tmp_path / "run" / "calibrated.yaml")
    assert found.base[0, 3] == pytest.approx(40, abs=0.5)
    assert found.record.errors["a_3"] == pytest.approx(0.6, abs=0.2)


def test_nearest_readings_are_those_nearest_in_time(tmp_path: Path, robot: sc.Robot, recording: Recording) -> None:
    path, beside = write_tum(tmp_path / "a.txt", recording), write_joints(tmp_path / "joints.csv", recording)
    found = read_trajectory(path, beside, joints(robot), Matching("nearest", tolerance=0.002))
    apart = np.abs(recording.seen_t[:, None] - recording.t)
    kept = apart.min(axis=1) <= 0.002
    assert 0 < kept.sum() < len(kept)
    np.testing.assert_array_equal(numbers(found)[:, :6], recording.q[apart.argmin(axis=1)[kept]])
    np.testing.assert_array_equal(numbers(found)[:, 6:], recording.seen[kept])
    assert f"{(~kept).sum()} measurements without such readings left out" in found.notes[-1]


# ------------------------------------------------------------------------------------------------- shifts, standstills


@pytest.mark.parametrize("shift", [0.0, 0.35, -1.2])
def test_a_shift_of_the_clocks_is_found_and_said(
    tmp_path: Path, robot: sc.Robot, model: sc.Model, shift: float
) -> None:
    recording = record(model, 8, shift=shift)
    path, beside = write_tum(tmp_path / "a.txt", recording), write_joints(tmp_path / "joints.csv", recording)
    found = read_trajectory(path, beside, joints(robot), Matching())
    said = [note for note in found.notes if "come" in note]
    assert len(said) == bool(shift)
    if shift:
        assert f"{abs(shift):.2f}" in said[0][:30]
        assert ("later" if shift > 0 else "earlier") in said[0]
        told = float(said[0].rsplit(" ", 1)[1].strip("'"))
        assert told == pytest.approx(shift, abs=0.01)
        right = read_trajectory(path, beside, joints(robot), Matching(shift=told))
        np.testing.assert_allclose(numbers(right)[:, 6:9], means(record(model, 8))[1][:, :3], rtol=0, atol=5e-5)
        assert not [note for note in right.notes if "come" in note]


def test_speeds_that_have_nothing_in_common_tell_no_shift() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(0, 60, 0.02)
    assert found_shift(t, rng.random(len(t)), t, rng.random(len(t))) is None
    assert found_shift(t, np.ones(len(t)), t, rng.random(len(t))) is None
    assert found_shift(t[:10], rng.random(10), t, rng.random(len(t))) is None


def test_standstills_are_those_that_every_start_would_find() -> None:
    """Against the definition, reading by reading: from the first one on that lasts, each as long as it can be."""
    rng = np.random.default_rng(6)
    for _ in range(40):
        t = np.cumsum(rng.choice([0.1, 0.1, 0.1, 5.0], 60, p=[0.4, 0.3, 0.28, 0.02]))
        q = np.round(np.cumsum(rng.choice([0.0, 0.0, 0.4, -0.4], (60, 2)), axis=0), 1)
        gap, expected, first = 10 * np.median(np.diff(t)), [], 0
        while first < len(t):
            end = first + 1
            while end < len(t) and t[end] - t[end - 1] <= gap and (np.ptp(q[first : end + 1], axis=0) <= 0.5).all():
                end += 1
            lasts = t[end - 1] - t[first] >= 0.35
            expected += [(first, end)] if lasts else []
            first = end if lasts else first + 1
        assert still_intervals(t, q, np.full(2, 0.5), 0.35) == expected


# -------------------------------------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("bag", "how", "message", "found"),
    [
        (Bag(joints="/joints"), Matching(), "the bag has no such topic", "/joints"),
        (
            Bag(measured="/joint_states"),
            Matching(),
            "'topic' cannot be read from messages",
            "sensor_msgs/msg/JointState",
        ),
        (Bag(names=("a",) * 6), Matching(), "no message has a position of every joint", "a"),
        (Bag(names=("a",)), Matching(), "'joint_names' names 1 joints, the robot has 6", None),
        (Bag(), Matching(still=3.0), "the robot never stands still for 3 s", None),
        (Bag(), Matching("nearest", tolerance=1e-7), "no measurement is within 1e-07 s", None),
        (Bag(), Matching(shift=1e5), "have no time in common", None),
    ],
)
def test_what_a_bag_does_not_have_is_said(
    bag_folder: Path, robot: sc.Robot, bag: Bag, how: Matching, message: str, found: str | None
) -> None:
    with pytest.raises(sc.InputError, match=message) as error:
        read_bag(bag_folder, joints(robot), bag, how)
    assert error.value.file == bag_folder
    assert found is None or error.value.found == found


@pytest.fixture(scope="module")
def bag_folder(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("recorded") / "bag", recording)


def test_one_file_of_a_bag_is_enough_and_damaged_ones_are_refused(
    bag_folder: Path, tmp_path: Path, robot: sc.Robot
) -> None:
    (file,) = bag_folder.glob("*.mcap")
    assert len(read_bag(file, joints(robot), Bag(), Matching())) == 8
    rng, whole = random.Random(2), file.read_bytes()
    for end in (".mcap", ".db3", ".bag", ".txt"):
        path = tmp_path / f"a{end}"
        for content in (b"", rng.randbytes(500), whole[: len(whole) // 3], whole[:-60]):
            path.write_bytes(content)
            with pytest.raises(sc.InputError):
                read_bag(path, joints(robot), Bag(), Matching())
    for _ in range(12):
        content = bytearray(whole)
        for _ in range(30):
            content[rng.randrange(len(content))] = rng.randrange(256)
        (tmp_path / "b.mcap").write_bytes(content)
        with suppress(sc.InputError):
            read_bag(tmp_path / "b.mcap", joints(robot), Bag(), Matching())
    with pytest.raises(sc.InputError, match="the bag cannot be read"):
        read_bag(tmp_path, joints(robot), Bag(), Matching())


def test_lengths_of_prismatic_joints_become_mm(bag_folder: Path, robot: sc.Robot) -> None:
    turning = read_bag(bag_folder, joints(robot), Bag(), Matching())
    sliding = [(name, i > 0) for i, (name, _) in enumerate(joints(robot))]
    found = read_bag(bag_folder, sliding, Bag(), Matching(band_length=1.0))
    assert found.columns[1:3] == ("q1_mm", "q2_rad")
    np.testing.assert_allclose(found.numbers("q1_mm"), turning.numbers("q1_rad") * 1000, rtol=1e-12)


def test_a_bag_without_the_package_says_how_to_get_it(
    bag_folder: Path, robot: sc.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(sc.InputError, match=r"pip install 'symcal\[ros\]'"):
        read_bag(bag_folder, joints(robot), Bag(), Matching())


def test_frames_of_transforms_must_be_said(tmp_path: Path, robot: sc.Robot, recording: Recording) -> None:
    path = write_bag(tmp_path / "bag", recording, "tf2_msgs/msg/TFMessage")
    for frames, message in ((None, "say with 'frames"), (("tool", "world"), "no such frames")):
        with pytest.raises(sc.InputError, match=message) as error:
            read_bag(path, joints(robot), Bag(frames=frames), Matching())
        assert error.value.allowed == ("map to world", "world to tool")
        assert error.value.part == "topic '/tracker/pose'"


@pytest.mark.parametrize(
    ("lines", "line", "message"),
    [
        (["0 0 0 0 0 0 1"], 1, "a line of a TUM trajectory is"),
        (["# a", "0 0 0 0 0 0 0 1", "1 0 0 x 0 0 0 1"], 3, "not a finite number, where a TUM trajectory"),
        (["0 0 0 nan 0 0 0 1"], 1, "not a finite number"),
        (["0 0 0 0 0 0 0 2"], 1, "is not of unit length"),
        (["0,0,0,0,1,0,0"], 1, "a line of a EuRoC trajectory is"),
        (["# nothing"], None, "the file has no poses"),
    ],
)
def test_a_line_that_is_no_pose_is_named(
    tmp_path: Path, robot: sc.Robot, lines: list[str], line: int | None, message: str
) -> None:
    path, beside = tmp_path / "a.txt", tmp_path / "joints.csv"
    path.write_text("\n".join(lines))
    beside.write_text("t_s,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad\n0,0,0,0,0,0,0\n")
    with pytest.raises(sc.InputError, match=message) as error:
        read_trajectory(path, beside, joints(robot), Matching())
    assert (error.value.file, error.value.line) == (path, line)


def test_a_joint_file_without_times_is_refused(tmp_path: Path, robot: sc.Robot) -> None:
    beside = tmp_path / "joints.csv"
    beside.write_text("q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad\n0,0,0,0,0,0\n")
    with pytest.raises(sc.InputError, match="one column with the time") as error:
        read_trajectory(tmp_path / "a.txt", beside, joints(robot), Matching())
    assert error.value.allowed == ("t_s", "t_ms", "t_us")
