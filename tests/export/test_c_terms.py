"""Joint terms in exported C: against an evaluation of the exported JSON with NumPy, and the self-test's own oracle."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms_with_terms import calibrated, puma_with_terms, six_axis
from c_build import needs_compiler, needs_make, self_test
from hypothesis import given, settings
from json_arm import tool_pose
from strategies import generators, random_robot, with_terms

from symcal.compensation.compensate import joint_caps
from symcal.export.c import export_c
from symcal.export.c.check import build_library, check_c, random_readings
from symcal.export.c.terms import slope_rounding
from symcal.export.c.vectors import jacobian, pose
from symcal.export.json import robot_json
from symcal.joints.backlash import Backlash
from symcal.joints.harmonics import Harmonics
from symcal.joints.ratio import Ratio
from symcal.robot.robot import Robot

DOUBLE, FLOAT = 1e-12, 5e-7  # of the reach


def arm_with_all(seed: int, dof: int) -> Robot:
    """A calibrated robot with terms of all kinds, whose nominal one has them too, with other numbers."""
    rng = np.random.default_rng(seed)
    return calibrated(with_terms(rng, replace(random_robot(rng, dof=dof), record=None)), rng)


def by_json(robot: Robot, q: np.ndarray) -> np.ndarray:
    data = robot_json(robot)
    return np.array([tool_pose(data, row) for row in q])


@given(rng=generators)
@settings(max_examples=5)
def test_the_oracle_is_right(rng: np.random.Generator) -> None:
    robot = with_terms(rng, replace(random_robot(rng), record=None), 5.0)
    q = random_readings(robot, rng, 1)[0]
    np.testing.assert_allclose(pose(robot, q), by_json(robot, [q])[0], atol=1e-12 * max(robot.reach, 100.0))
    columns, step = jacobian(robot, q), 1e-4
    for i in range(robot.dof):
        ahead, behind, far, near = (pose(robot, q + s * step * np.eye(robot.dof)[i]) for s in (1, -1, 2, -2))
        slope = (8 * (ahead - behind) - (far - near)) / (12 * step)
        spin = slope[:3, :3] @ pose(robot, q)[:3, :3].T
        scale = max(robot.reach, 100.0)
        np.testing.assert_allclose(columns[:3, i], slope[:3, 3], atol=2e-8 * scale, rtol=1e-6)
        np.testing.assert_allclose(columns[3:, i], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-7, rtol=1e-6)


@needs_compiler
@pytest.mark.parametrize("name", ["puma", "random 3"])
def test_c_against_the_json(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    robot = puma_with_terms() if name == "puma" else arm_with_all(3, int(name[-1]))
    assert robot.record is not None
    export = export_c(robot, tmp_path / "c")
    q = random_readings(robot, rng, 100)
    expected, nominal = by_json(robot, q)[:, :3], by_json(robot.nominal(), q)[:, :3]
    slopes = np.array([jacobian(robot, row) for row in q])
    errors = np.array([robot.record.errors[p] for p in robot.parameters])
    numbers = [errors, np.eye(4)[:3], robot.tool[:3]]
    rate = np.array([abs(joint.ratio) for joint in robot.joints])
    for real, share in ((np.float64, DOUBLE), (np.float32, FLOAT)):
        library = build_library(export, robot, tmp_path, real, ["-O0"])
        slack = 4 * share + 2 * slope_rounding(robot) * np.finfo(real).eps
        for function, given_, wanted in (
            ("forward", [], expected),
            ("forward_nominal", [], nominal),
            ("forward_with", numbers, expected),
        ):
            found = library.evaluate(function, q, 12, given_).reshape(-1, 3, 4)
            assert np.linalg.norm(found[:, :, 3] - wanted[:, :, 3], axis=1).max() < share * robot.reach
            assert np.abs(found[:, :, :3] - wanted[:, :, :3]).max() < 4 * share
        for function, given_ in (("jacobian", []), ("jacobian_with", numbers)):
            columns = library.evaluate(function, q, 6 * robot.dof, given_).reshape(-1, 6, robot.dof)
            assert np.abs((columns - slopes) / rate).max() < slack * robot.reach


@needs_make
def test_the_self_test_knows_terms(tmp_path: Path) -> None:
    """Of a small arm; the emulators of continuous integration run that of a six-axis one."""
    robot = arm_with_all(8, 3)
    export = export_c(robot, tmp_path / "c")
    assert self_test(export.folder, optimisation="-O0").count("self-test passed") == 2
    without = export_c(replace(robot, terms=()), tmp_path / "without", prefix=export.prefix)
    assert without.model_hash != export.model_hash
    vectors = (export.folder / "test" / "vectors.h").read_text()
    (without.folder / "test" / "vectors.h").write_text(vectors)
    done = subprocess.run(
        ["make", "test", "CFLAGS=-O0"], cwd=without.folder, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "calibrated pose (mm)" in done.stdout


@needs_compiler
@pytest.mark.long
def test_commands_compensated_in_c_arrive(rng: np.random.Generator, tmp_path: Path) -> None:
    """Three full Newton steps converge nearly always away from singular wrists and elbows; no pose gets worse."""
    robot = puma_with_terms()
    export = export_c(robot, tmp_path / "c")
    q = random_readings(robot, rng, 150)
    library = build_library(export, robot, tmp_path, np.float64, ["-O0"])
    goal = by_json(robot.nominal(), q)
    for function, numbers in (("compensate", (1.0, 0.0)), ("compensate_pose", (1.0, 300.0))):
        out, residual, status = library.compensate(function, q)
        after, before = (by_json(robot, at) for at in (out, q))
        left, had = (_far(at, goal, numbers[1]) for at in (after, before))
        regular = (np.abs(np.sin(q[:, 4])) > 0.4) & (np.abs(np.cos(q[:, 2])) > 0.3)
        assert (status == 0).mean() > (0.95 if function == "compensate" else 0.7)
        assert (status[regular] == 0).mean() > 0.9
        assert left[status == 0].max() < 2e-6
        assert (left <= had + 1e-9).all()
        np.testing.assert_allclose(residual, left, atol=1e-9 + 1e-5 * left.max())
    found = check_c(export, robot, rng, 500)
    assert found is not None
    assert found.double_mm < DOUBLE * robot.reach
    assert found.uncompensated_mm > 1


def _far(a: np.ndarray, b: np.ndarray, lever: float) -> np.ndarray:
    """Distance, mm, with the angle between frames times a lever."""
    spin = np.linalg.norm(a[:, :3, :3] - b[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
    return np.hypot(np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1), lever * spin)


def test_caps_are_wide_enough_for_terms() -> None:
    robot = replace(six_axis(), terms=(Ratio(1, True),))
    narrow = joint_caps(calibrated(robot, np.random.default_rng(0), 0.1))
    wide = calibrated(robot, np.random.default_rng(0), 0.1)
    assert wide.record is not None
    wide = replace(wide, record=replace(wide.record, errors={**wide.record.errors, "q1_ratio": 0.01}))
    np.testing.assert_allclose(narrow, 0.02)
    np.testing.assert_allclose(joint_caps(wide), 3 * 0.026, rtol=0.1)  # 0.01 of 2.6 rad


def test_what_stays_at_nominal_is_said(tmp_path: Path) -> None:
    arm = six_axis()
    terms = tuple(Harmonics(i, True, k=(1, 2)) for i in (1, 2, 3))
    robot = calibrated(replace(arm, links=arm.links[:3], terms=terms), np.random.default_rng(1))
    export = export_c(robot, tmp_path / "c")
    assert export.left_out is None
    header = (export.folder / "puma_kinematics.h").read_text()
    assert "Joint terms are built in, as the robot file defines them: harmonics 1 and 2 of axis 1" in header
    assert "nominal:" not in header
    play = replace(robot, terms=(*robot.terms, Backlash(3, True, {"backlash": 5e-4})))
    other = export_c(play, tmp_path / "d")
    assert other.left_out is not None
    for name in ("puma_kinematics.h", "README.md"):
        text = " ".join((other.folder / name).read_text().replace(" * ", " ").split())
        assert "The C code keeps at nominal: backlash of axis 3. The tool is then up to" in text
        assert "from whatever side the joints come (searched over" in text
