"""Views and joint readings of random arms with errors: swapped and shifted names are found, good ones left alone.

Arms, mounts and joint areas are drawn; the poses of the board are made by matrices here, and no image is needed. The
long form (`python tests/test_agreement.py 200`) prints how often a good view is called foreign, a foreign one missed.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.data.measurement_file import load_measurements
from symcal.images.measure import flange_poses
from symcal.model.parameter_set import parameter_set
from symcal.placing.agreement import Agreement, agreement
from symcal.placing.pairing import foreign_views
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot

ROBOTS = Path(__file__).resolve().parent.parent / "configs" / "robots"
ARMS = ("ur5", "franka_fr3", "handling_robot", "two_axis_positioner")
CENTRE = np.array([150.0, 100.0, 0.0])
ERRORS = ((1.0, 5.0), (0.3, 1.0), (3.0, 10.0))
"""Of every link parameter, mm and mrad: usual, good, and bad robots."""
NEAR = 10.0
"""Of the scatter: postures that are less apart may be swapped unnoticed."""


@dataclass(frozen=True)
class Session:
    """flange: by the nominal robot, shape (N, 4, 4). views: T_camera_board as seen, shape (N, 4, 4)."""

    flange: np.ndarray
    views: np.ndarray
    mount: str

    def found(self, rng: np.random.Generator, shown: np.ndarray | None = None, scale: float = 1.0) -> Agreement | None:
        """What views agree on if image i shows posture shown[i], and the board is said to be so many times as large."""
        views = self.views[np.arange(len(self.flange)) if shown is None else shown]
        views = views.copy()
        views[:, :3, 3] *= scale
        return agreement(self.flange, np.arange(len(views)), views[:, None], CENTRE * scale, rng)


def frame(rng: np.random.Generator, size: float) -> np.ndarray:
    return spatial.transform(Rotation.from_quat(rng.normal(size=4)).as_matrix(), rng.normal(size=3) * size)


def session(robot: Robot, count: int, area: float, errors: tuple[float, float], rng: np.random.Generator) -> Session:
    """A camera in the hand or beside the robot; the board's poses are seen to 0.3 mm and 1 mrad."""
    low, high = (
        np.where(np.isfinite(limit), limit, 2.5 * sign) for limit, sign in ((robot.lower, -1), (robot.upper, 1))
    )
    middle, half = rng.uniform(low, high), area * (high - low) / 2
    q = rng.uniform(np.maximum(middle - half, low), np.minimum(middle + half, high), (count, robot.dof))
    units = parameter_set(robot).units
    names = robot.parameters
    off = {n: rng.normal() * (errors[0] if u == "mm" else 1e-3 * errors[1]) for n, u in zip(names, units, strict=True)}
    base, tool = frame(rng, 800.0), frame(rng, 80.0)
    true = base @ flange_poses(robot.corrected(off), q) @ tool
    mount = str(rng.choice(["hand", "world"]))
    noise = np.array([spatial.transform(turn(rng, 1e-3), rng.normal(size=3) * 0.3) for _ in range(count)])
    views = (spatial.inverse(true) if mount == "hand" else true) @ noise
    return Session(flange_poses(robot, q), views, mount)


def turn(rng: np.random.Generator, size: float) -> np.ndarray:
    return Rotation.from_rotvec(rng.normal(size=3) * size).as_matrix()


def sessions(trials: int, seed: int) -> Iterator[tuple[Session, np.random.Generator]]:
    rng = np.random.default_rng(seed)
    for trial in range(trials):
        arm = load_robot(ROBOTS / f"{ARMS[trial % len(ARMS)]}.yaml")
        count = int(rng.choice([10, 20, 40, 60]))
        yield session(arm, count, float(rng.choice([0.1, 0.5])), ERRORS[trial % len(ERRORS)], rng), rng


def swapped(count: int, rng: np.random.Generator) -> np.ndarray:
    """Which posture each image shows: two pairs of names swapped, one pair where there are few."""
    shown = np.arange(count)
    for i, j in rng.permutation(count)[: 4 if count > 10 else 2].reshape(-1, 2):
        shown[[i, j]] = j, i
    return shown


@dataclass
class Count:
    views: int = 0
    false: int = 0
    swapped: int = 0
    named: int = 0
    misnamed: int = 0
    mounts: int = 0
    sessions: int = 0
    resized: int = 0


def counted(trials: int, seed: int) -> Count:
    count = Count()
    for each, rng in sessions(trials, seed):
        count_foreign(each, rng, count)
    return count


def count_foreign(each: Session, rng: np.random.Generator, count: Count) -> None:
    """The session as it is, and with swapped names."""
    number = len(each.flange)
    own, sigma = np.arange(number), np.full(number, 0.3)
    plain = each.found(rng)
    if plain is None:  # the flange turned about one axis only
        return
    count.sessions += 1
    count.views += number
    count.false += len(foreign_views(plain, own, sigma))
    count.mounts += plain.mount == each.mount
    count.resized += plain.scale != 1
    shown = swapped(number, rng)
    found = each.found(rng, shown)
    assert found is not None
    fits = {foreign.view: foreign.fits for foreign in foreign_views(found, own, sigma)}
    changed = np.flatnonzero(shown != own)
    # of postures that are hardly apart nothing can be told
    apart = [int(i) for i in changed if plain.misfit[shown[i], i] > NEAR * plain.typical]
    count.swapped += len(apart)
    count.named += sum(fits.get(i) == int(shown[i]) for i in apart)
    count.misnamed += sum(v not in changed or fits[v] != shown[v] for v in fits)


def test_swapped_names_are_found_and_good_ones_left_alone() -> None:
    count = counted(16, seed=4)
    assert count.sessions >= 14
    assert count.false == 0
    assert count.misnamed == 0
    assert count.named == count.swapped > 30
    assert count.mounts == count.sessions
    assert count.resized == 0


@pytest.mark.parametrize("shift", [1, -1, 2])
def test_names_that_are_all_shifted_are_told(shift: int) -> None:
    rng = np.random.default_rng(2)
    each = session(load_robot(ROBOTS / "ur5.yaml"), 24, 0.3, ERRORS[0], rng)
    own = np.arange(2, 22)
    found = agreement(each.flange, own, each.views[own + shift][:, None], CENTRE, rng)
    assert found is not None
    assert found.shift == shift
    foreign = foreign_views(found, own, np.full(20, 0.3))
    assert [one.fits for one in foreign] == list(own + shift)


def test_names_that_are_shifted_from_one_on_are_told() -> None:
    rng = np.random.default_rng(3)
    each = session(load_robot(ROBOTS / "ur5.yaml"), 21, 0.3, ERRORS[0], rng)
    own = np.arange(20)
    shown = np.where(own < 8, own, own + 1)
    found = agreement(each.flange, own, each.views[shown][:, None], CENTRE, rng)
    assert found is not None
    foreign = foreign_views(found, own, np.full(20, 0.3))
    assert {one.view: one.fits for one in foreign} == {i: i + 1 for i in range(8, 20)}


def test_the_size_of_a_board_is_told_by_the_motion() -> None:
    rng = np.random.default_rng(5)
    for scale in (1 / 1.2, 1.2):
        each = session(load_robot(ROBOTS / "ur5.yaml"), 20, 0.3, ERRORS[0], rng)
        found = each.found(rng, swapped(20, rng), scale)
        assert found is not None
        assert found.scale == pytest.approx(1 / scale, rel=0.02)


def test_where_a_robot_only_turns_about_a_point_no_size_is_told() -> None:
    rng = np.random.default_rng(5)
    each = session(load_robot(ROBOTS / "two_axis_positioner.yaml"), 20, 0.5, ERRORS[0], rng)
    found = each.found(rng, scale=1.2)
    assert found is not None
    assert found.scale == 1


def test_nearly_equal_postures_are_not_called_swapped() -> None:
    rng = np.random.default_rng(7)
    each = session(load_robot(ROBOTS / "ur5.yaml"), 20, 0.3, ERRORS[0], rng)
    flange, views = each.flange.copy(), each.views.copy()
    step = spatial.transform(turn(rng, 1e-3), np.array([1.0, -0.5, 0.5]))
    flange[7] = flange[3] @ step
    near = spatial.transform(turn(rng, 1e-3), np.array([0.5, 0.5, 1.0]))
    views[7] = views[3] @ near
    shown = np.arange(20)
    shown[[3, 7]] = 7, 3
    found = Session(flange, views, each.mount).found(rng, shown)
    assert found is not None
    assert foreign_views(found, np.arange(20), np.full(20, 0.3)) == []


def test_a_view_of_no_posture_is_told() -> None:
    rng = np.random.default_rng(8)
    each = session(load_robot(ROBOTS / "ur5.yaml"), 20, 0.3, ERRORS[0], rng)
    views = each.views.copy()
    views[5] = frame(rng, 500.0)
    found = Session(each.flange, views, each.mount).found(rng)
    assert found is not None
    (foreign,) = foreign_views(found, np.arange(20), np.full(20, 0.3))
    assert (foreign.view, foreign.fits) == (5, None)


def test_few_views_and_turns_about_one_axis_say_nothing() -> None:
    rng = np.random.default_rng(9)
    each = session(load_robot(ROBOTS / "ur5.yaml"), 5, 0.3, ERRORS[0], rng)
    assert each.found(rng) is None
    about_z = np.array(
        [spatial.transform(Rotation.from_rotvec([0, 0, a]).as_matrix(), np.ones(3)) for a in np.linspace(0, 2, 9)]
    )
    assert agreement(about_z, np.arange(9), about_z[:, None], CENTRE, rng) is None


def test_a_real_arm_with_a_camera_in_its_hand(symcal_data: Path) -> None:
    """Franka FR3: views and joint readings agree to 7 mm by the nominal robot, and all of them belong together."""
    robot = load_robot(ROBOTS / "franka_fr3.yaml")
    columns = {"pose": "id", **{f"{c}_m": f"cam_{c}_m" for c in "xyz"}, **{f"q{c}": f"cam_q{c}" for c in "xyzw"}}
    data = load_measurements(symcal_data / "franka_fr3_realsense" / "data.csv", robot, "pose", columns=columns)
    whole = Session(flange_poses(robot, data.q), spatial.inverse(spatial.pose_matrix(data.z)), "hand")
    rng = np.random.default_rng(4)
    count = Count()
    for number in (114, 60, 40, 20, 20, 14, 14, 10, 10):
        chosen = rng.permutation(114)[:number]
        count_foreign(Session(whole.flange[chosen], whole.views[chosen], "hand"), rng, count)
    assert count.false == count.misnamed == count.resized == 0
    assert count.mounts == count.sessions == 9
    assert count.named == count.swapped > 20


if __name__ == "__main__":
    print(counted(int(sys.argv[1]) if len(sys.argv) > 1 else 200, seed=1))
