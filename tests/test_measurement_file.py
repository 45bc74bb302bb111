"""Files of measurements: there and back, in every layout, and what is said about the wrong ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import generators, random_robot

from symcal.data.dataset import Dataset, readings, with_random_test
from symcal.data.measurement_file import Split, load_measurements
from symcal.data.saved_measurements import save_measurements
from symcal.errors import InputError
from symcal.robot.robot import Joint, Link, Robot

labels = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=6).filter(
    lambda text: not text.startswith("#")
)


def random_dataset(rng: np.random.Generator, robot: Robot, kind: str, names: list[str]) -> Dataset:
    n = len(names)
    q = np.column_stack([rng.uniform(-3, 3, n) * (1 if j.revolute else 200) for j in robot.joints])
    split = (*map(str, rng.choice(["train", "test"], n - 1)), "train")
    if kind == "pose":
        z = np.hstack([rng.normal(size=(n, 3)) * 1e3, Rotation.random(n, rng=rng).as_quat()])
        sigma = rng.uniform(0.01, 1, (n, 6)) if rng.random() < 0.5 else None
        return Dataset(readings("pose"), q, z, tuple(names), split, sigma)
    points = tuple("ABC"[: rng.integers(1, 4)])
    z = rng.normal(size=(n, 3 * len(points))) * 1e3
    hidden = rng.random((n, len(points))) < 0.2
    hidden[:, rng.integers(len(points))] = False
    hidden[0] = False
    z[np.repeat(hidden, 3, axis=1)] = np.nan
    sigma = np.where(np.isnan(z), np.nan, rng.uniform(0.01, 1, z.shape)) if rng.random() < 0.5 else None
    return Dataset(readings("position", points), q, z, tuple(names), split, sigma)


@given(generators, st.sampled_from(["position", "pose"]), st.lists(labels, min_size=1, max_size=8, unique=True))
def test_what_is_written_is_read_back(tmp_path, rng, kind, names):
    robot = random_robot(rng)
    data = random_dataset(rng, robot, kind, names)
    path = tmp_path / "measurements.csv"
    save_measurements(data, robot, path)
    found = load_measurements(path, robot, kind, point_names=data.only.features)
    assert (found.only.kind, found.labels, found.split, found.only.features) == (
        data.only.kind,
        data.labels,
        data.split,
        data.only.features,
    )
    np.testing.assert_allclose(found.q, data.q, rtol=0, atol=1e-13)  # rad -> deg -> rad
    np.testing.assert_allclose(found.z, data.z, rtol=1e-15, atol=0)
    if data.sigma is None:
        assert found.sigma is None
    else:
        np.testing.assert_allclose(found.sigma, data.sigma, rtol=1e-15)


ARM = Robot(
    "arm",
    "standard",
    tuple(
        Link(Joint("revolute", f"j{i}", -2, 2), {"theta": 0.0, "a": 300.0, "alpha": 1.0, "d": 0.0}) for i in (1, 2, 3)
    ),
    np.eye(4),
    np.eye(4),
)
JOINTS = "j1_deg,j2_deg,j3_deg"


@pytest.fixture
def load(tmp_path):
    def from_text(text: str, kind: str = "position", robot: Robot = ARM, **options) -> Dataset:
        path = tmp_path / "data.csv"
        path.write_text(text, encoding="utf-8")
        return load_measurements(path, robot, kind, **options)

    return from_text


def test_wide_and_long_files_hold_the_same(load):
    wide = load(f"{JOINTS},A_x_mm,A_y_mm,A_z_mm,B_x_m,B_y_m,B_z_m\n1,2,3,10,20,30,0.04,0.05,0.06\n4,5,6,1,2,3,,,\n")
    head = f"pose,{JOINTS},point,x_cm,y_cm,z_cm\n"
    long = load(head + "0,1,2,3,A,1,2,3\n0,1,2,3,B,4,5,6\n1,4,5,6,A,0.1,0.2,0.3\n")
    unnamed = load((head + "1,2,3,A,1,2,3\n1,2,3,B,4,5,6\n4,5,6,A,0.1,0.2,0.3\n").replace("pose,", ""))
    for found in (wide, long, unnamed):
        assert found.only.features == ("A", "B")
        np.testing.assert_allclose(found.q, np.deg2rad([[1, 2, 3], [4, 5, 6]]))
        np.testing.assert_allclose(found.z, [[10, 20, 30, 40, 50, 60], [1, 2, 3, np.nan, np.nan, np.nan]])
        assert "in 1 pose at least one point was not seen" in found.notes


def test_points_are_put_in_the_order_asked_for(load):
    text = f"{JOINTS},A_x_mm,A_y_mm,A_z_mm,B_x_mm,B_y_mm,B_z_mm,C_x_mm,C_y_mm,C_z_mm\n1,2,3,1,2,3,4,5,6,7,8,9\n"
    found = load(text, point_names=("C", "A"))
    np.testing.assert_array_equal(found.z, [[7, 8, 9, 1, 2, 3]])
    assert any("points that the measurement does not name: B" in note for note in found.notes)


GANTRY = Robot(
    "gantry",
    "standard",
    (*(Link(Joint("prismatic", n, 0, 900), {"d": 0.0, "alpha": 1.0}) for n in "xyz"), Link(Joint("revolute", "c"), {})),
    np.eye(4),
    np.eye(4),
)


def test_a_gantry_moves_along_x_and_is_measured_along_x(load):
    q, z = [1, 2, 3, np.pi / 6], [[7, 8, 9]]
    long = load("q1_mm,q2_mm,q3_mm,c_deg,x_mm,y_mm,z_mm\n1,2,3,30,7,8,9\n", robot=GANTRY)
    wide = load("x_mm,y_mm,z_mm,c_deg,T_x_mm,T_y_mm,T_z_mm\n1,2,3,30,7,8,9\n", robot=GANTRY, point_names=("T",))
    for found in (long, wide):
        np.testing.assert_allclose(found.q, [q])
        np.testing.assert_array_equal(found.z, z)
    with pytest.raises(InputError, match="whose name is also that of a measured 'x'"):
        load("x_mm,y_mm,z_mm,c_deg\n1,2,3,30\n", robot=GANTRY)


@given(generators, st.sampled_from(["deg", "rad"]))
def test_angles_are_rotations_about_fixed_axes(tmp_path, rng, unit):
    turn = Rotation.random(rng=rng)
    roll, pitch, yaw = turn.as_euler("xyz", degrees=unit == "deg")
    path = tmp_path / "pose.csv"
    head = f"{JOINTS},x_mm,y_mm,z_mm,roll_{unit},pitch_{unit},yaw_{unit}"
    path.write_text(f"{head}\n1,2,3,4,5,6,{roll},{pitch},{yaw}\n")
    found = load_measurements(path, ARM, "pose")
    assert (Rotation.from_quat(found.z[0, 3:]) * turn.inv()).magnitude() < 1e-9


POSE = f"{JOINTS},x_mm,y_mm,z_mm,qx,qy,qz,qw\n"


@pytest.mark.parametrize(
    ("text", "kind", "line", "words"),
    [
        (POSE + "1,2,3,4,5,6,0,0,0,1.1\n", "pose", 2, "the quaternion is not of unit length (found: 1.1)"),
        (POSE + "1,2,3,4,5,6,0,0,0,0\n", "pose", 2, "the quaternion is not of unit length (found: 0)"),
        (POSE.replace("qz", "q_z") + "1,2,3,4,5,6,0,0,0,1\n", "pose", 1, "column 'qz': a quaternion column is missing"),
        (f"{JOINTS},x_mm,y_mm,z_mm\n1,2,3,4,5,6\n", "pose", 1, "there is no column for the measured roll (or qx"),
        (f"{JOINTS},x_mm,y_mm\n1,2,3,4,5\n", "position", 1, "there is no column for the measured z"),
        (f"{JOINTS},x_mm,y_mm,z_mm\n", "position", None, "the file has a header but no rows"),
        (f"{JOINTS},x_mm,y_mm,z_mm,sigma_mm\n1,2,3,4,5,6,0\n", "position", 2, "a sigma must be positive"),
        (f"{JOINTS},x_mm,y_mm,z_mm,sigma\n1,2,3,4,5,6,1\n", "position", 1, "the measurement's sigma has no unit"),
        (
            f"{JOINTS},x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm\n1,2,3,4,5,6,1,1\n",
            "position",
            1,
            "there is no column for the measurement's sigma_z",
        ),
        (f"{JOINTS},A_x_mm,A_y_mm,A_z_mm\n1,2,3,,,\n", "position", 2, "no point was measured in this row"),
        (
            f"pose,{JOINTS},point,x_mm,y_mm,z_mm\n7,1,2,3,A,4,5,6\n7,1,2,9,B,4,5,6\n",
            "position",
            3,
            "has other joint readings here than in line 2",
        ),
        (
            f"pose,{JOINTS},x_mm,y_mm,z_mm\n7,1,2,3,4,5,6\n7,1,2,3,4,5,6\n",
            "position",
            3,
            "stands twice; give repeated measurements a pose of their own",
        ),
        (
            f"pose,{JOINTS},point,x_mm,y_mm,z_mm,split\n7,1,2,3,A,4,5,6,train\n7,1,2,3,B,4,5,6,test\n",
            "position",
            3,
            "this pose has another split in line 2",
        ),
    ],
)
def test_each_slip_is_one_error_at_its_line(load, text, kind, line, words):
    with pytest.raises(InputError) as caught:
        load(text, kind)
    assert caught.value.line == line
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "names", "words"),
    [
        (f"{JOINTS},x_mm,y_mm,z_mm\n1,2,3,4,5,6\n", ("A", "B"), "has 2 points, but the file has no 'point' column"),
        (f"{JOINTS},point,x_mm,y_mm,z_mm\n1,2,3,a,4,5,6\n", ("A",), "no such point among those of the measurement"),
        (f"{JOINTS},A_x_mm,A_y_mm,A_z_mm\n1,2,3,4,5,6\n", ("B",), "no columns for this point of the measurement"),
    ],
)
def test_points_that_are_not_there(load, text, names, words):
    with pytest.raises(InputError, match=words.replace("(", r"\(")):
        load(text, point_names=names)


SPLIT = f"{JOINTS},x_mm,y_mm,z_mm,set\n" + "".join(f"{i},2,3,4,5,6,{'abc'[i % 3]}\n" for i in range(9))


def test_labels_of_any_name_become_the_split(load):
    found = load(SPLIT, split=Split("set", ("a",), ("b",)))
    assert found.split == ("train", "test", "unused") * 3
    assert "3 poses with a split label that is neither train nor test: not used" in found.notes
    assert load(SPLIT, split=Split("set", ("a", "c"), ("b",))).split == ("train", "test", "train") * 3
    assert set(load(SPLIT).split) == {"train"}


def test_labels_that_are_not_there(load):
    with pytest.raises(InputError, match=r"none has the label 'x' \(found: a, b, c\)"):
        load(SPLIT, split=Split("set", ("x",), ("b",)))
    with pytest.raises(InputError, match="did you mean 'set'"):
        load(SPLIT, split=Split("Set"))
    text = SPLIT.replace(",set\n", ",split\n")
    with pytest.raises(InputError, match=r"say under 'data\.split' which labels are which"):
        load(text)
    assert set(load(text, split=Split(test_fraction=0.2)).split) == {"train"}  # drawn later, the labels do not count


@given(st.integers(2, 40), st.floats(0.001, 0.999), generators)
def test_a_random_share_leaves_poses_on_both_sides(count, fraction, rng):
    data = Dataset(
        readings("position", ("P",)), np.zeros((count, 1)), np.zeros((count, 3)), ("",) * count, ("train",) * count
    )
    split = with_random_test(data, fraction, rng).split
    assert 1 <= split.count("test") <= count - 1
    assert abs(split.count("test") - fraction * count) <= 1


def rows(q: np.ndarray) -> str:
    return f"{JOINTS},x_mm,y_mm,z_mm\n" + "".join(f"{a},{b},{c},{i},2,3\n" for i, (a, b, c) in enumerate(q))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda q: np.rad2deg(q) * 5, "joint 1 'j1' is outside its limits in"),
        (lambda q: np.deg2rad(q), "are angles in radians given as degrees?"),
        (lambda q: q * [1, 0, 1], "the reading of joint 'j2' is the same in all poses"),
        (lambda q: np.vstack([q, q[:2]]), "2 poses repeat the joint readings of another (0 and 20, 1 and 21)"),
    ],
)
def test_what_can_be_meant_is_said(load, change, words):
    q = np.random.default_rng(1).uniform(-100, 100, (20, 3))
    assert load(rows(q)).notes == ()
    assert any(words in note for note in load(rows(change(q))).notes)


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("sgima_mm", "column 'sgima_mm' is not read: is it 'sigma'?"),
        ("Split", "column 'Split' is not read: is it 'split'?"),
        ("sigma_A_mm", "column 'sigma_A_mm' is not read"),
        ("temperature", None),
    ],
)
def test_columns_that_nearly_mean_something_are_named(load, column, words):
    notes = load(f"{JOINTS},x_mm,y_mm,z_mm,{column}\n1,2,3,4,5,6,7\n").notes
    assert notes == () if words is None else any(words in note for note in notes)


def test_a_map_to_nothing_that_is_known(load):
    with pytest.raises(InputError, match="a name that means nothing here"):
        load(SPLIT, columns={"colour": "set"})


def test_provenance_is_the_file(load, tmp_path):
    assert load(SPLIT).provenance == str(tmp_path / "data.csv")
