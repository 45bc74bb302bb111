"""The numbers that the paper prints, as data: what ours stand beside.

Source: [Ding2017] Tables I to VI and the text of section V. Angles in rad, lengths in mm, as printed.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

SIMULATION_1_ITERATIONS = 24
"""Steps after which the position error of Simulation I was below 1e-10 (text, Fig. 7)."""

TABLE_III: Mapping[str, float] = MappingProxyType(
    {
        "theta_1": 0.002638,
        "theta_4": 0.001455,
        "theta_5": -0.001361,
        "alpha_1": 0.003693,
        "alpha_2": -0.005797,
        "alpha_3": 0.005499,
        "alpha_4": 0.001450,
        "a_4": -0.0760,
        "a_5": 0.0240,
        "d_2": 0.0184,
        "d_3": 0.0240,
        "d_4": -0.0417,
        "d_5": 0.0530,
        "beta_1": 0.00123,
        "beta_3": 0.006221,
    }
)
"""The set values of the error parameters."""

TABLE_IV: Mapping[str, Mapping[str, Mapping[str, float]]] = MappingProxyType(
    {
        "optimal": {
            "before": {"mean_mm": 4.1723, "max_mm": 5.4600},
            "after": {"mean_mm": 0.1175, "max_mm": 0.2359},
        },
        "random": {
            "before": {"mean_mm": 4.1723, "max_mm": 5.4600},
            "after": {"mean_mm": 0.2066, "max_mm": 0.4123},
        },
    }
)
"""Position error before and after calibration on test data. Whether against truth or noisy positions is not said."""

TABLE_V: Mapping[str, float] = MappingProxyType(
    {
        "theta_1": 0.0024,
        "theta_4": 0.0212,
        "theta_5": -0.3719,
        "alpha_1": 0.0039,
        "alpha_2": -0.0061,
        "alpha_3": 0.0045,
        "alpha_4": -0.1709,
        "a_4": 0.3551,
        "a_5": 0.0474,
        "d_2": 0.3117,
        "d_3": 2.1625,
        "d_4": 2.3338,
        "d_5": 0.3835,
        "beta_1": 0.0008,
        "beta_3": 0.0075,
    }
)
"""Identification values with the optimal trajectory."""

TABLE_VI: Mapping[str, float] = MappingProxyType(
    {
        "theta_1": 0.0025,
        "theta_4": -0.1407,
        "theta_5": 0.4289,
        "alpha_1": 0.0045,
        "alpha_2": -0.0071,
        "alpha_3": -0.0009,
        "alpha_4": -0.2461,
        "a_4": -3.6901,
        "a_5": 0.0852,
        "d_2": 2.1045,
        "d_3": 3.5538,
        "d_4": 3.5716,
        "d_5": 0.4755,
        "beta_1": 0.0011,
        "beta_3": 0.0062,
    }
)
"""Identification values with the random trajectory."""

TABLES: Mapping[str, Mapping[str, float]] = MappingProxyType({"optimal": TABLE_V, "random": TABLE_VI})

TABLE_I: tuple[Mapping[str, float | str], ...] = (
    {"theta": "θ₁", "alpha": 0.0, "beta": 0.0},
    {"alpha": -90.0, "d": "d₂"},
    {"alpha": 0.0, "d": "d₃", "beta": 0.0},
    {"theta": "θ₄", "alpha": -90.0, "a": 0.0, "d": 300.0},
    {"theta": "θ₅", "alpha": 0.0, "a": 0.0, "d": 25.0},
)
"""Nominal parameters by link, deg and mm; a joint's variable is text."""

TABLE_II: tuple[tuple[float, float], ...] = (
    (-165.0, 165.0),
    (850.0, 1350.0),
    (0.0, 700.0),
    (0.0, 175.0),
    (-175.0, 175.0),
)
"""Ranges of the joint variables, deg and mm."""
