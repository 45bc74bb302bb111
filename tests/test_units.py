"""Unit factors and column suffixes."""

from __future__ import annotations

import math
from typing import get_args

import pytest

from symcal.units import ANGLE, LENGTH, AngleUnit, LengthUnit, split_unit


def test_factors_of_known_lengths_and_angles():
    # the same physical size in every unit
    inch = {"mm": 25.4, "m": 0.0254, "um": 25400, "cm": 2.54, "in": 1}
    turn = {"rad": 2 * math.pi, "deg": 360, "mrad": 2000 * math.pi}
    assert {u: pytest.approx(25.4 / v, rel=1e-15) for u, v in inch.items()} == LENGTH
    assert {u: pytest.approx(2 * math.pi / v, rel=1e-15) for u, v in turn.items()} == ANGLE


def test_every_unit_that_a_file_may_name_has_a_factor():
    assert set(get_args(LengthUnit)) == set(LENGTH)
    assert set(get_args(AngleUnit)) == set(ANGLE)


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        ("q1_deg", ("q1", "deg")),
        ("cam_x_m", ("cam_x", "m")),
        ("torso_lift_m", ("torso_lift", "m")),
        ("u_px", ("u", "px")),
        ("sigma_x_mm", ("sigma_x", "mm")),
        ("pose", ("pose", None)),
        ("mm", ("mm", None)),
        ("_mm", ("_mm", None)),
        ("q1_DEG", ("q1_DEG", None)),
        ("q1_degrees", ("q1_degrees", None)),
        ("", ("", None)),
    ],
)
def test_split_unit(column, expected):
    assert split_unit(column) == expected
