"""Exported C against kinematics written independently, at a hundred thousand random readings; compensation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_build import needs_compiler
from c_robots import arm, handling, robot_pose, table_pose
from strategies import random_robot

from symcal.compensation.compensate import joint_caps
from symcal.export.c import CExport, export_c
from symcal.export.c.check import CLibrary, build_library, check_c, random_readings
from symcal.export.c.vectors import jacobian
from symcal.kernels.compiler import find_compiler
from symcal.robot.robot import Robot

DOUBLE, FLOAT = 1e-12, 5e-7  # of the reach
REACHED, LIMIT, CAP, CLOSEST, OUTSIDE = range(5)


# --------------------------------------------------------------------------------------------- against other kinematics


def distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(a - b, axis=1)


def test_the_paper_s_tables_at_random_readings(
    libraries: tuple[CLibrary, CLibrary], paper_robot: Robot, rng: np.random.Generator
) -> None:
    q = random_readings(paper_robot, rng, 20_000)
    for library, share in zip(libraries, (DOUBLE, FLOAT), strict=True):
        for name, errors in (("forward_nominal", False), ("forward", True)):
            pose = library.evaluate(name, q, 12).reshape(-1, 3, 4)
            expected = table_pose(q, errors)[:, :3]
            assert distance(pose[:, :, 3], expected[:, :, 3]).max() < share * paper_robot.reach
            assert np.abs(pose[:, :, :3] - expected[:, :, :3]).max() < share * 4


@needs_compiler
@pytest.mark.parametrize("name", ["franka_fr3", "tiago", "two_axis_positioner", "random"])
def test_other_robots_at_random_readings(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    one = arm(name) if name != "random" else random_robot(np.random.default_rng(11), "standard", 6)
    export = export_c(one, tmp_path / name, force=True)  # the random one was never judged
    q = random_readings(one, rng, 20_000)
    expected, nominal = robot_pose(one, q), robot_pose(one.nominal(), q)
    for real, share in ((np.float64, DOUBLE), (np.float32, FLOAT)):
        library = build_library(export, one, tmp_path, real, ["-O1"])
        pose = library.evaluate("forward", q, 12).reshape(-1, 3, 4)
        assert distance(pose[:, :, 3], expected[:, :3, 3]).max() < share * one.reach
        before = library.evaluate("forward_nominal", q, 12).reshape(-1, 3, 4)
        assert distance(before[:, :, 3], nominal[:, :3, 3]).max() < share * one.reach
        given_numbers = [given_errors(one), np.eye(4)[:3], one.tool[:3]]
        again = library.evaluate("forward_with", q[:1000], 12, given_numbers)
        np.testing.assert_allclose(again, pose[:1000].reshape(-1, 12), atol=2 * share * one.reach)
        columns = library.evaluate("jacobian", q[:300], 6 * one.dof).reshape(-1, 6, one.dof)
        columns_again = library.evaluate("jacobian_with", q[:300], 6 * one.dof, given_numbers)
        np.testing.assert_allclose(columns_again.reshape(-1, 6, one.dof), columns, atol=3 * share * one.reach)
        step, turned = 1e-5, np.empty_like(columns)
        for i in range(one.dof):
            ahead, behind = (robot_pose(one, q[:300] + s * step * np.eye(one.dof)[i]) for s in (1, -1))
            turned[:, :3, i] = (ahead - behind)[:, :3, 3] / (2 * step)
            spin = (ahead - behind)[:, :3, :3] @ np.swapaxes(expected[:300, :3, :3], 1, 2) / (2 * step)
            turned[:, 3:, i] = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        np.testing.assert_allclose(columns, turned, atol=1e-6 + 2 * share * one.reach)


def given_errors(robot: Robot) -> np.ndarray:
    """x of this calibration: what its numbers are above the nominal ones."""
    before = robot.nominal().parameters
    return np.array([value - before[name] for name, value in robot.parameters.items()])


def test_base_given_at_run_time(
    libraries: tuple[CLibrary, CLibrary], paper_robot: Robot, rng: np.random.Generator
) -> None:
    base = robot_pose(paper_robot, random_readings(paper_robot, rng, 1))[0]
    q = random_readings(paper_robot, rng, 100)
    pose = libraries[0].evaluate("forward_with", q, 12, [given_errors(paper_robot), base[:3], paper_robot.tool[:3]])
    np.testing.assert_allclose(pose.reshape(-1, 3, 4), (base @ table_pose(q, True))[:, :3], atol=1e-9)


@pytest.mark.parametrize("name", ["handling", "franka_fr3"])
def test_the_oracle_s_jacobian_is_a_derivative(name: str, rng: np.random.Generator) -> None:
    one = handling() if name == "handling" else arm(name)
    q, step = random_readings(one, rng, 1), 1e-5
    moved = [(robot_pose(one, q + s * step * np.eye(one.dof)) - 0)[:, :3, 3] for s in (1, -1)]
    np.testing.assert_allclose(jacobian(one, q[0])[:3], ((moved[0] - moved[1]) / (2 * step)).T, atol=1e-5)


# --------------------------------------------------------------------------------------------------------- compensation


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("name", ["compensate", "compensate_with"])
def test_compensation(
    libraries: tuple[CLibrary, CLibrary], paper_robot: Robot, rng: np.random.Generator, kind: int, name: str
) -> None:
    """Table III's errors over Table II's ranges: there unless a limit or a cap binds, never worse, always inside."""
    q = random_readings(paper_robot, rng, 10_000)
    given_numbers = [given_errors(paper_robot), paper_robot.tool[:3]] if name.endswith("_with") else []
    out, residual, status = libraries[kind].compensate(name, q, given_numbers)
    goal = table_pose(q, False)[:, :3, 3]
    before, after = (distance(table_pose(at, True)[:, :3, 3], goal) for at in (q, out))
    assert 4.0 < before.mean() < 4.6
    rounding = (DOUBLE, FLOAT)[kind] * paper_robot.reach
    assert (after <= before + 2 * rounding).all()
    np.testing.assert_allclose(residual, after, atol=2 * rounding)
    tolerance = (1e-6, 2.5e-3)[kind]
    assert (after[status == REACHED] <= tolerance + rounding).all()
    assert (status == REACHED).mean() > 0.99
    slack = 0.0 if kind == 0 else 2e-7
    assert (out >= paper_robot.lower * (1 - np.sign(paper_robot.lower) * slack) - slack).all()
    assert (out <= paper_robot.upper * (1 + np.sign(paper_robot.upper) * slack) + slack).all()
    assert (np.abs(out - q) <= joint_caps(paper_robot) * (1 + 1e-5) + slack * np.abs(q)).all()
    # what is left has its reason
    bound = (out <= paper_robot.lower + slack) | (out >= paper_robot.upper - slack * paper_robot.upper)
    assert (bound.any(axis=1) == (status == LIMIT))[status != REACHED].all()
    free = ~(bound | (np.abs(out - q) > joint_caps(paper_robot) * 0.999)).any(axis=1)
    assert (status[free] == REACHED).all()


def test_compensation_at_a_singularity(tmp_path: Path, rng: np.random.Generator) -> None:
    """Where the reach vanishes (d_3 + d_4 = 0) the waist cannot move the tool: never worse, no NaN."""
    if find_compiler() is None:
        pytest.skip("no C compiler on this machine")
    one = handling()
    links = list(one.links)
    links[2] = replace(links[2], joint=replace(links[2].joint, lower=-320.0, upper=-280.0))
    one = replace(one, links=tuple(links))
    export = export_c(one, tmp_path / "c")
    q = random_readings(one, rng, 5_000)
    q[:, 2] = np.float32(-300 + rng.normal(size=len(q)) * 1e-2)
    q[:100, 2], q[:100, 3] = -300.0, 0.0
    for real in (np.float64, np.float32):
        out, residual, status = build_library(export, one, tmp_path, real).compensate("compensate", q)
        assert np.isfinite(out).all()
        assert np.isfinite(residual).all()
        goal = table_pose(q, False)[:, :3, 3]
        before, after = (distance(table_pose(at, True)[:, :3, 3], goal) for at in (q, out))
        assert (after <= before + 1e-3 * (real is np.float32) + 1e-9).all()
        assert (status != OUTSIDE).all()


def test_inputs_that_are_no_readings(libraries: tuple[CLibrary, CLibrary], paper_robot: Robot) -> None:
    middle = (paper_robot.lower + paper_robot.upper) / 2
    rows = np.tile(middle, (2 * paper_robot.dof + 3, 1))
    caps = joint_caps(paper_robot)
    for i in range(paper_robot.dof):
        rows[2 * i, i], rows[2 * i + 1, i] = (
            paper_robot.lower[i] - 1.01 * caps[i],
            paper_robot.upper[i] + 1.01 * caps[i],
        )
    rows[-3, 0], rows[-2, 1], rows[-1, 2] = np.nan, np.inf, -np.inf
    for library in libraries:
        out, residual, status = library.compensate("compensate", rows)
        assert (status == OUTSIDE).all()
        assert (residual == -1).all()
        np.testing.assert_allclose(out, rows, rtol=1e-6)
    # a reading just beyond its limit is what rounding makes of one at the limit
    rows = np.tile(middle, (2, 1))
    rows[0, 3], rows[1, 2] = paper_robot.lower[3] - 1e-6, paper_robot.upper[2] + 1e-4
    _, _, status = libraries[1].compensate("compensate", rows)
    assert (status != OUTSIDE).all()


def test_a_robot_that_was_never_calibrated(rng: np.random.Generator, tmp_path: Path) -> None:
    if find_compiler() is None:
        pytest.skip("no C compiler on this machine")
    nominal = handling().nominal()
    q = random_readings(nominal, rng, 100)
    library = build_library(export_c(nominal, tmp_path / "c"), nominal, tmp_path, np.float64)
    np.testing.assert_array_equal(library.evaluate("forward", q, 12), library.evaluate("forward_nominal", q, 12))
    out, residual, status = library.compensate("compensate", q)
    np.testing.assert_allclose(out, q, atol=1e-9)
    assert residual.max() < 1e-9
    assert (status == REACHED).all()


@needs_compiler
def test_the_check_of_an_export(export: CExport, paper_robot: Robot, rng: np.random.Generator) -> None:
    found = check_c(export, paper_robot, rng, 500)
    assert found is not None
    assert found.double_mm < DOUBLE * paper_robot.reach
    assert 0 < found.float_mm < FLOAT * paper_robot.reach
    assert found.uncompensated_mm > 3
    assert found.compensated_mean_mm < 0.1
    assert found.reached > 0.97
