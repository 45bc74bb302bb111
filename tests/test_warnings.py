"""What is said before anybody believes a result: wrong units, slips, too few poses, wrong noise."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import ARM, measure, random_errors
from strategies import random_frame

from symcal.calibration.calibrate import Calibration, calibrate
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.model.model import Model, build_model
from symcal.model.task import Task

BOTH = frozenset({"base", "tool"})


@cache
def model_of(kind: str, invert: bool = False) -> Model:
    return build_model(ARM, Task.of(kind, BOTH, {"P": (30.0, 20.0, 80.0)}, invert=invert))  # type: ignore[arg-type]


@cache
def good(kind: str, invert: bool = False, poses: int = 45) -> Dataset:
    rng = np.random.default_rng(1)
    model = model_of(kind, invert)
    moved = replace(model, setup=replace(model.setup, base=random_frame(rng, 2000.0)))
    return measure(moved, random_errors(model, rng), poses, rng, 0.05, 1e-4)


def notes(data: Dataset, kind: str, options: Options = Options(), invert: bool = False) -> str:
    return "; ".join(calibrated(data, kind, options, invert).notes)


def calibrated(data: Dataset, kind: str, options: Options = Options(), invert: bool = False) -> Calibration:
    return calibrate(model_of(kind, invert), None, data, options)


def times(z: np.ndarray, factor: float) -> np.ndarray:
    z = z.copy()
    z[:, :3] *= factor
    return z


@pytest.mark.parametrize(("kind", "invert"), [("position", False), ("pose", False), ("pose", True)])
def test_good_data_raise_no_doubt(kind: str, invert: bool) -> None:
    assert notes(good(kind, invert), kind, invert=invert) == ""


@pytest.mark.parametrize("kind", ["position", "pose"])
@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_metres_for_millimetres_are_refused(kind: str, factor: float) -> None:
    data = good(kind)
    with pytest.raises(RefusedError, match="not in the unit"):
        calibrated(replace(data, z=times(data.z, factor)), kind)


def degrees(q: np.ndarray) -> np.ndarray:
    return np.rad2deg(q)


def turned(q: np.ndarray) -> np.ndarray:
    return q * [1, 1, -1, 1, 1, 1]


def swapped(q: np.ndarray) -> np.ndarray:
    return q[:, [1, 0, 2, 3, 4, 5]]


@pytest.mark.parametrize("kind", ["position", "pose"])
@pytest.mark.parametrize(
    ("mistake", "cause"),
    [
        (degrees, "all revolute joints are in degrees, labelled as radians"),
        (turned, "joint 3 counts the other way round"),
        (swapped, "the columns of joint 1 and joint 2 are swapped"),
    ],
    ids=lambda f: getattr(f, "__name__", ""),
)
def test_wrong_joint_columns_are_refused_or_doubted_with_the_cause(
    kind: str, mistake: Callable[[np.ndarray], np.ndarray], cause: str
) -> None:
    data = good(kind)
    try:
        said = notes(replace(data, q=mistake(data.q)), kind)
    except RefusedError as error:
        said = str(error)
    assert cause in said


@pytest.mark.parametrize("kind", ["position", "pose"])
def test_a_slip_is_named_by_its_pose(kind: str) -> None:
    data = good(kind)
    z = data.z.copy()
    z[17, 1] += 5.0
    said = notes(replace(data, z=z, labels=tuple(f"no{i}" for i in range(45))), kind)
    assert (
        "1 training pose(s) have a position residual that the noise of the others does not explain (pose no17)" in said
    )
    assert "loss: auto" in said


def test_a_robust_fit_names_slips_without_advising_itself() -> None:
    data = good("position")
    z = data.z.copy()
    z[[3, 17]] += [[5.0, 0, 0], [0, -4.0, 0]]
    said = notes(replace(data, z=z), "position", Options(loss="huber"))
    assert "2 training pose(s)" in said
    assert "(pose 3, 17)" in said
    assert "loss:" not in said


def test_a_slip_shows_where_the_file_states_the_noise() -> None:
    data = good("position")
    z = data.z.copy()
    z[17, 1] += 5.0
    assert "(pose 17)" in notes(replace(data, z=z, sigma=np.full((45, 3), 0.05)), "position")


def test_a_turned_pose_is_an_orientation_slip() -> None:
    data = good("pose")
    z = data.z.copy()
    z[5, 3] += 0.05
    assert "orientation residual" in notes(replace(data, z=z), "pose")


def test_few_poses_are_said_to_be_few() -> None:
    said = notes(good("pose", False, 12), "pose")
    assert re.search(r"only \d+ degrees of freedom are left for \d+ parameters' worth", said)
    assert "(12 poses)" in said
    assert "cross-validated" in said


@pytest.mark.parametrize(("factor", "word"), [(0.3, "too small, or the model lacks something"), (3.0, "too large")])
def test_noise_that_does_not_fit_the_residuals_is_told(factor: float, word: str) -> None:
    said = notes(good("position"), "position", Options(sigma={"position": 0.05 * factor}))
    assert f"times the stated noise: the noise is stated {word}" in said


def test_absurd_corrections_are_named() -> None:
    model = model_of("pose")
    rng = np.random.default_rng(3)
    data = measure(model, {"theta_2": 0.35}, 45, rng, 0.05, 1e-4)
    said = notes(data, "pose")
    assert re.search(r"corrections of [^:]*theta_2\b[^:]* are more than 20 times their plausible scale", said)


def test_one_size_stated_far_too_small_does_not_hold_its_error_back() -> None:
    """An error of seventeen stated sizes among 22 that are as stated or less."""
    model = build_model(ARM, Task.of("position", frozenset(), {"P": (30.0, 20.0, 80.0)}, scales={"a_3": 0.04}))
    data = measure(model, {"a_3": 0.7}, 100, np.random.default_rng(4), 0.05)
    found = calibrate(model, None, data, Options())
    assert found.after.x[model.parameters.index("a_3")] == pytest.approx(0.7, abs=0.03)
    assert found.after.sigmas["position"] == pytest.approx(0.05, rel=0.1)


def test_a_fit_that_did_not_converge_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("symcal.fit.estimation.ROUNDS", 1)
    assert "the identification did not converge: stopped" in notes(good("pose"), "pose")


def test_wrong_noise_of_one_group_is_told_where_the_other_is_found() -> None:
    said = notes(good("pose"), "pose", Options(sigma={"position": 0.5}))
    assert re.search(r"position residuals are 0\.\d+ times the stated noise: the noise is stated too large", said)
    assert "orientation residuals" not in said
