"""Numbers and names for people."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from symcal.words import chance, fixed, is_link_parameter, listed, number, p_value, percent, plural, symbol


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (3.8350074, "3.84"),
        (0.0301, "0.0301"),
        (0.5, "0.500"),
        (-12.345, "−12.3"),
        (12345.6, "12346"),
        (123456, "1.23 × 10⁵"),
        (2.14e-9, "2.14 × 10⁻⁹"),
        (0.0, "0"),
        (math.nan, "undefined"),
        (-math.inf, "−infinite"),
    ],
)
def test_number(value: float, text: str) -> None:
    assert number(value) == text


@given(st.floats(min_value=1e-4, max_value=9e4), st.integers(2, 6))
def test_number_keeps_its_digits(value: float, digits: int) -> None:
    assert float(number(value, digits)) == pytest.approx(value, rel=0.5 * 10.0 ** (1 - digits) * (1 + 1e-9), abs=0.5)


def test_fixed_has_no_minus_before_a_zero() -> None:
    assert fixed(-0.0004, 3) == "0.000"
    assert fixed(-0.0006, 3) == "−0.001"


def test_symbols() -> None:
    assert [symbol(n) for n in ("theta_12", "alpha_3", "beta_1", "a_4", "d_5")] == ["θ₁₂", "α₃", "β₁", "a₄", "d₅"]
    assert symbol("tool_a_1_x") == "tool a 1 x"
    assert symbol("a_b") == "a b"


def test_link_parameters_are_told_from_frames() -> None:
    assert all(is_link_parameter(name) for name in ("theta_12", "beta_1", "a_4", "d_5"))
    assert not any(is_link_parameter(name) for name in ("base_x", "tool_a_1_x", "a_b", "camera_fx", "a_²"))


@given(st.floats(0.0, 1.0))
def test_percent_is_never_rounded_up(share: float) -> None:
    shown = int(percent(share).removesuffix("\u00a0%"))
    assert 100 * share - 1 < shown <= 100 * share + 1e-3


def test_sentences() -> None:
    assert plural(1, "pose") == "1 pose"
    assert plural(0, "pose") == "0 poses"
    assert [listed(list("abc")[:n]) for n in (1, 2, 3)] == ["a", "a and b", "a, b and c"]


def test_probabilities() -> None:
    assert [chance(p) for p in (1.0, 0.694, 0.0012, 0.00051, 2e-10)] == ["1.0", "0.69", "0.0012", "0.0005", "2 × 10⁻¹⁰"]
    assert [p_value(p) for p in (0.5, 1e-13, 0.0)] == ["p = 0.50", "p < 1 × 10⁻¹²", "p < 1 × 10⁻¹²"]
