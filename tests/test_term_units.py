"""Numbers of joint terms before people: their units in tables and figures, and room for many of them."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from cases import ARM
from matplotlib.backends.backend_agg import FigureCanvasAgg
from term_law import MASSES, SETS, identified, measured

from symcal import plots
from symcal.calibration.calibrate import Calibration
from symcal.calibration.results import identification_facts
from symcal.config.experiment import Units
from symcal.model.model import build_model
from symcal.model.task import Task
from symcal.parameters import Unit
from symcal.report.learnt import learnt_and_assumed
from symcal.report.parameter_table import parameter_table
from symcal.units import SHOWN, in_mrad, unit_factor
from symcal.words import is_term_number, symbol


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    """Of an arm with 40 numbers of every kind on revolute joints."""
    terms = tuple(term for each in SETS.values() for term in each)
    robot = replace(ARM, terms=terms, masses=MASSES)
    model, rng = build_model(robot, Task.of("pose", {"base"})), np.random.default_rng(1)
    truth = {name: p.scale for name, p in robot.term_parameters.items()}
    q = rng.uniform(ARM.lower, ARM.upper, (70, 6))
    given = {n: 5.0 * rng.integers(0, 2, 70) if n == "payload" else rng.choice([-1.0, 1], 70) for n in robot.conditions}
    return identified(model, measured(robot, truth, q, rng, given))


def test_every_unit_of_a_parameter_is_shown() -> None:
    assert set(SHOWN) == set(get_args(Unit))
    # by hand: 1 rad/(N mm) is 1e6 urad per 1e-3 N m; 1 rad/mm is 1e3 mrad per 1e-3 m; 1 mm/N is 1e3 um/N
    assert SHOWN["rad/Nmm"] == ("µrad/(N m)", pytest.approx(1e9))
    assert SHOWN["rad/mm"] == ("mrad/m", pytest.approx(1e6))
    assert SHOWN["mm/N"] == ("µm/N", pytest.approx(1e3))
    assert SHOWN["rad"] == ("deg", pytest.approx(180 / np.pi))
    assert in_mrad("rad") == ("mrad", 1e3)


def test_units_of_experiments_reach_those_of_terms() -> None:
    units = Units(length="m", angle="deg")
    degree = np.pi / 180
    wanted = {"mm": 1000, "rad": degree, "1": 1, "px": 1, "rad/mm": degree / 1000, "mm/rad": 1000 / degree}
    wanted |= {"rad/Nmm": degree / 1000, "mm/N": 1000}
    assert {unit: units.factor(unit) for unit in get_args(Unit)} == pytest.approx(wanted)
    assert unit_factor("rad/Nmm", 1000.0, 1.0) == pytest.approx(1e-3)


def test_names_as_they_are_printed() -> None:
    assert [symbol(n) for n in ("q2_sin_1", "q12_gravity_flange", "q6_by_q5")] == [
        "q₂ sin 1",
        "q₁₂ gravity flange",
        "q₆ by q5",
    ]
    assert not any(is_term_number(name) for name in ("theta_1", "tool_q1_x", "q_1", "base_x"))


def test_the_table_has_their_units(calibration: Calibration) -> None:
    facts = identification_facts(calibration.after, calibration.model.measurement)["parameters"]
    table = parameter_table(facts)
    rows = {row["name"]: row for row in table["rows"]}
    units = {name: rows[name]["unit"] for name in ("q1_sin_1", "q2_ratio", "q5_by_q4", "q2_gravity_x", "q2_compliance")}
    assert list(units.values()) == ["deg", "1", "1", "deg", "µrad/(N m)"]
    # 2e-8 rad/(N mm) is 20 urad/(N m)
    shown, sigma = rows["q3_compliance"]["identified"], facts["q3_compliance"]["sigma"] * 1e9
    assert abs(float(shown.replace("\N{MINUS SIGN}", "-")) - 20) < 5 * sigma + 0.1
    kinds = [row["kind"] for row in table["rows"]]
    at = [i for i, kind in enumerate(kinds) if kind == "term"]
    assert at == list(range(at[0], at[-1] + 1))  # one block after the links
    assert not any("frames and points are increments" in note for note in table["notes"])
    count = len(calibration.model.robot.parameters)
    assert f"{count} free parameters of links and joint terms" in learnt_and_assumed(facts) or (
        f"Every free parameter of links and joint terms ({count} in all)" in learnt_and_assumed(facts)
    )


def shown(figure: Any) -> list[list[str]]:
    """Names under the axes of every panel."""
    return [[text.get_text() for text in axes.get_xticklabels()] for axes in figure.axes]


def test_figures_hold_links_first_then_terms_by_group(calibration: Calibration) -> None:
    robot = calibration.model.robot
    names = [symbol(name) for name in robot.parameters]
    illustration = plots.what_was_learnt(calibration)
    panels = shown(illustration.figure)
    assert sorted(itertools.chain(*panels)) == sorted(names)
    assert panels[0] == [symbol(name) for name in robot.link_parameters]
    group = {symbol(name): p.group for name, p in robot.term_parameters.items()}
    for panel in panels[1:]:
        order = [group[name] for name in panel]
        assert order == sorted(order, key=order.index)  # a group's numbers stand together
        assert len(panel) <= 40
    corrections = plots.parameter_corrections(calibration)
    assert sorted(itertools.chain(*shown(corrections.figure))) == sorted(names)
    labels = [axes.get_ylabel() for axes in corrections.figure.axes]
    for label in ("mrad", "mm", "10⁻³", "µrad/(N m)"):
        assert f"correction / {label}" in labels
    assert "of links and joint terms" in corrections.caption


def test_labels_of_terms_do_not_overlap(calibration: Calibration) -> None:
    for make in (plots.what_was_learnt, plots.parameter_corrections):
        figure = make(calibration).figure
        renderer = FigureCanvasAgg(figure).get_renderer()
        for axes in figure.axes:
            boxes = [text.get_window_extent(renderer) for text in axes.get_xticklabels()]
            assert all(one.x1 <= other.x0 + 0.5 for one, other in itertools.pairwise(boxes))
