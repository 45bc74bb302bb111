"""What reaches a controller: the corrections' signs against kinematics, the JSON against the robot, the gate against
known faults."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from decisions import ACCEPTED

from symcal import spatial
from symcal.compensation.targets import tool_pose
from symcal.errors import RefusedError
from symcal.export.corrections import COLUMNS, ZERO, corrections
from symcal.export.gate import check_exportable, doubts
from symcal.export.json import robot_json, save_json
from symcal.export.urdf import roll_pitch_yaw
from symcal.robot.files import load_robot
from symcal.robot.robot import Record, Robot

ERRORS = {"theta_1": 2e-3, "alpha_2": -5e-3, "d_2": 0.3, "d_3": 0.2, "theta_4": 1e-3, "a_4": -0.1, "d_4": 0.2}


@pytest.fixture
def nominal(configs: Path) -> Robot:
    """The handling robot with signs, ratios and offsets in its readings."""
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    links = list(robot.links)
    for i, (sign, ratio, offset) in {0: (-1, 1.0, 0.2), 1: (1, 5.0, -10.0), 3: (-1, 0.5, 0.0)}.items():
        links[i] = replace(links[i], joint=replace(links[i].joint, sign=sign, ratio=ratio, offset=offset))
    return replace(robot, links=tuple(links))


def calibrated(robot: Robot, errors: dict[str, float], seen: np.ndarray | None = None, sigma: float = 1e-4) -> Robot:
    """A calibration; seen: orthonormal directions (columns) of the errors, mm and rad over 1 mm and 10 mrad, all when
    None."""
    scales = np.array([0.01 if name.startswith(("theta", "alpha", "beta", "tool_r")) else 1.0 for name in errors])
    basis = np.eye(len(errors)) if seen is None else seen
    covariance = sigma**2 * np.outer(scales, scales) * (basis @ basis.T)
    full = np.linalg.norm(basis, axis=1) > 1 - 1e-9
    deviations = np.sqrt(np.diag(covariance))
    sigmas = {name: float(s) if ok else None for name, s, ok in zip(errors, deviations, full, strict=True)}
    record = Record(errors, sigmas, covariance, robot.base, robot.tool, {"seed": 1} | ACCEPTED)
    return replace(robot.corrected({k: v for k, v in errors.items() if k in robot.parameters}), record=record)


def test_zero_offsets_are_added_to_the_reading(nominal: Robot, rng: np.random.Generator) -> None:
    """With zero offsets alone, the nominal robot at reading + correction is the calibrated robot at the reading."""
    errors = {"theta_1": 2e-3, "d_2": 0.3, "d_3": 0.2, "theta_4": 1e-3, "theta_5": -4e-3}
    robot = calibrated(nominal, errors)
    table = corrections(robot)
    assert tuple(table.columns) == COLUMNS
    assert set(table["quantity"]) == {ZERO}
    assert list(table["joint"]) == [joint.name for joint in robot.joints]
    assert list(table["unit"]) == ["deg", "mm", "mm", "deg", "deg"]
    shift = [math.radians(c) if u == "deg" else c for c, u in zip(table["correction"], table["unit"], strict=True)]
    for q in rng.uniform(nominal.lower, nominal.upper, (10, 5)):
        expected = tool_pose(robot)(q).full()
        np.testing.assert_allclose(tool_pose(nominal)(q + np.array(shift)).full(), expected, atol=1e-9)
    assert table["sigma"].iloc[1] == pytest.approx(1e-4 / 5)  # of the reading, behind a ratio of 5


def test_link_rows_say_from_what_to_what(nominal: Robot) -> None:
    robot = calibrated(nominal, ERRORS)
    table = corrections(robot).set_index("parameter")
    row = table.loc["d_4"]
    assert (row["joint"], row["quantity"], row["unit"]) == ("elbow", "offset along the joint axis", "mm")
    assert row["nominal"] == pytest.approx(300)
    assert row["corrected"] == pytest.approx(300.2)
    assert table.loc["alpha_2", "nominal"] == pytest.approx(-90)
    assert table.loc["alpha_2", "correction"] == pytest.approx(math.degrees(-5e-3))
    assert len(corrections(nominal)) == 0


def test_tool_frame_is_told_at_the_flange(nominal: Robot) -> None:
    before = spatial.transform(spatial.rpy_matrix(np.array([0.1, 0.2, 3.14])), np.array([1.0, 2.0, 100.0]))
    names = [f"tool_{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")]
    robot = calibrated(replace(nominal, tool=before), dict(zip(names, [0.5, 0, 0, 0, 0, 0.01], strict=True)))
    after = before @ spatial.transform(spatial.rpy_matrix(np.array([0, 0, 0.01])), np.array([0.5, 0, 0]))
    table = corrections(replace(robot, tool=after))
    np.testing.assert_allclose(table["corrected"][:3], after[:3, 3])
    np.testing.assert_allclose(table["correction"][:3], before[:3, 0] * 0.5)
    np.testing.assert_allclose(np.radians(table["corrected"][3:].to_numpy(float)), roll_pitch_yaw(after[:3, :3]))
    assert (np.abs(table["correction"][3:]) < 1).all()  # across the turn of yaw at 180 deg
    np.testing.assert_allclose(table["sigma"][:3].to_numpy(float), 1e-4)


def test_json_says_everything(nominal: Robot, tmp_path: Path) -> None:
    hidden = np.eye(len(ERRORS))[:, :6]
    errors = {**ERRORS, "d_4": 0.0}
    robot = calibrated(nominal, errors, hidden)
    save_json(robot, tmp_path / "robot.json")
    data = json.loads((tmp_path / "robot.json").read_text())
    assert data == robot_json(robot)
    assert data["parameters"]["theta_1"] == {
        "nominal": 0.0,
        "error": 2e-3,
        "identified": 2e-3,
        "sigma": pytest.approx(1e-6),
        "unit": "rad",
    }
    assert data["parameters"]["d_4"]["sigma"] is None  # it was held
    assert data["covariance"]["parameters"] == list(errors)
    np.testing.assert_array_equal(data["covariance"]["matrix"], robot.record.covariance if robot.record else None)
    assert [joint["name"] for joint in data["joints"]] == [joint.name for joint in robot.joints]
    assert data["links"][3]["a"] == robot.parameters["a_4"]
    assert [row["parameter"] for row in data["corrections"] if row["sigma"] is None] == ["d_4"]
    assert robot_json(nominal)["covariance"] is None


def test_a_good_calibration_passes(nominal: Robot) -> None:
    assert check_exportable(calibrated(nominal, ERRORS)) == ()
    assert check_exportable(nominal) == ()


def test_implausible_corrections_are_named(nominal: Robot) -> None:
    wild = calibrated(nominal, {**ERRORS, "theta_4": -0.37})
    assert [(doubt.parameter, doubt.kind) for doubt in doubts(wild)] == [("theta_4", "implausible")]
    with pytest.raises(RefusedError, match=r"theta_4 is off by -21\.2 deg"):
        check_exportable(wild)
    assert len(check_exportable(wild, force=True)) == 1
    assert doubts(replace(wild, scales={"theta_4": 0.1})) == ()  # where that much is to be expected


def test_what_the_data_did_not_tell_is_no_reason(nominal: Robot) -> None:
    """It stays near nominal, as uncertain as it was before."""
    assert doubts(calibrated(nominal, dict.fromkeys(ERRORS, 0.0), sigma=3.0)) == ()


def test_a_fit_that_did_not_converge_goes_nowhere(nominal: Robot) -> None:
    good = calibrated(nominal, ERRORS)
    assert good.record is not None
    trouble = "stopped: noise and sizes of the errors did not settle"
    bad = replace(good, record=replace(good.record, provenance={"trouble": trouble}))
    with pytest.raises(RefusedError, match="did not converge: stopped: noise and sizes"):
        check_exportable(bad)
    assert [doubt.kind for doubt in check_exportable(bad, force=True)] == ["unsettled"]


def test_where_the_instrument_stood_does_not_count(nominal: Robot) -> None:
    robot = calibrated(nominal, {**ERRORS, "base_x": 500.0, "tool_P1_x": 30.0})
    assert doubts(robot) == ()
    assert "base_x" not in set(corrections(robot)["parameter"])
