"""Image points in CSV files: there and back, and what is said about those that are wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camera_scenes import ROBOT

from symcal.data.dataset import Dataset, readings
from symcal.data.measurement_file import load_measurements
from symcal.data.saved_measurements import save_measurements
from symcal.errors import InputError

NAMES = ("P1", "P2", "P3")
HEAD = "pose,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg,point,u_px,v_px"


def dataset(sigma=None):
    rng = np.random.default_rng(0)
    q = rng.uniform(ROBOT.lower, ROBOT.upper, (4, ROBOT.dof))
    z = rng.uniform(0, 2000, (4, 6))
    z[1, 2:4] = np.nan
    return Dataset(readings("pixels", NAMES), q, z, ("a", "b", "c", "d"), ("train",) * 4, sigma)


@pytest.mark.parametrize("noisy", [False, True])
def test_round_trip(tmp_path, noisy):
    data = dataset(np.full((4, 6), 0.02) if noisy else None)
    save_measurements(data, ROBOT, tmp_path / "pixels.csv")
    found = load_measurements(tmp_path / "pixels.csv", ROBOT, "pixels", point_names=NAMES)
    np.testing.assert_allclose(found.q, data.q, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.z, data.z)
    assert (found.only.kind, found.labels, found.only.features) == ("pixels", data.labels, NAMES)
    if noisy:
        np.testing.assert_array_equal(found.sigma[np.isfinite(data.z)], 0.02)
    else:
        assert found.sigma is None


def test_one_sigma_for_both_axes(tmp_path):
    file = tmp_path / "pixels.csv"
    file.write_text(f"{HEAD},sigma_px\n1,0,900,10,20,30,P1,10,20,0.05\n")
    found = load_measurements(file, ROBOT, "pixels")
    np.testing.assert_array_equal(found.sigma, [[0.05, 0.05]])


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,0,900,10,20,30,P9,10,20", "point"),
        ("1,0,900,10,20,30,P1,,20", "empty"),
        ("1,0,900,10,20,30,P1,1,2,3", "cells"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path, row, message):
    file = tmp_path / "pixels.csv"
    file.write_text(f"{HEAD}\n{row}\n")
    with pytest.raises(InputError, match=message) as caught:
        load_measurements(file, ROBOT, "pixels", point_names=NAMES)
    assert caught.value.line == 2


def test_a_column_without_unit_is_refused(tmp_path):
    file = tmp_path / "pixels.csv"
    file.write_text("pose,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg,point,u,v\n1,0,900,10,20,30,P1,1,2\n")
    with pytest.raises(InputError, match="px"):
        load_measurements(file, ROBOT, "pixels", point_names=NAMES)


def test_splits_stay(tmp_path):
    data = replace(dataset(), split=("train", "test", "train", "test"))
    save_measurements(data, ROBOT, tmp_path / "pixels.csv")
    assert load_measurements(tmp_path / "pixels.csv", ROBOT, "pixels").split == data.split
