"""Both simulations: Tables III to VI, Figs. 7 to 9."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.paper import published
from symcal.paper.report.blocks import Block, Row, figures, heading, paragraph, percent, row, span, table
from symcal.paper.report.plans import PLAN_LABELS
from symcal.words import fixed, listed, number, symbol

Content = Mapping[str, Any]

_PLACES = {"rad": 4, "mm": 4}


def simulation_1(content: Content) -> list[Block]:
    """Without noise."""
    one = content["simulation_1"]
    config, draws = content["choices"]["simulation_1"], one["draws"]
    luck = (
        f" On {draws['count']} random plans it never takes more than {draws['most_iterations']} steps and never "
        f"deviates by more than {number(draws['largest_deviation'], 2)} rad or mm; {draws['mirrored'] or 'none'} of "
        "them ended at the mirror root (a₅ → −a₅ with θ₅ turned by an odd multiple of π, the same positions), which is "
        "put back."
        if draws
        else ""
    )
    return [
        heading("Simulation I: exact positions"),
        paragraph(
            f"All errors start at {config['start']}, the damping at {number(config['damping'], 2)} with D = I, divided "
            f"by {number(config['factor'], 2)} at every success (ours; the paper does not say how it changes), until "
            "the mean position error over the poses is below 10⁻¹⁰ mm. On the plan by the paper's fitness that takes "
            f"{one['iterations']} steps, in the paper {one['paper']['iterations']} ([@paper_convergence]); the "
            f"number of steps follows from how the damping falls.{luck} That all parameters come back is no sign that "
            f"they can be measured: {_faint(content)}"
        ),
        table(
            "table_3",
            "Error parameters set and recovered (paper: Table III)",
            f"Recovered from exact positions at the plan by the paper's fitness. Largest deviation "
            f"{number(one['largest_deviation'], 2)}; the paper compares four digits.",
            [
                "",
                "unit",
                "set (paper)",
                "recovered",
                "deviation",
                "",
                "",
                "unit",
                "set (paper)",
                "recovered",
                "deviation",
            ],
            _two_columns(_recovered(one["parameters"])),
            left=(0, 1, 6, 7),
            wide=(2, 3, 4, 8, 9, 10),
        ),
        figures("paper_convergence", "paper_test_data"),
    ]


def _faint(content: Content) -> str:
    """How little the unseen directions show at the true errors."""
    truth = content["gauge"]["truth"]
    values, rank = truth["singular_values"], truth["rank"]
    if rank == len(values):
        return "at the true errors every direction is seen."
    return (
        f"at the true errors the unseen directions show by {number(values[-1] / values[0], 1)} to "
        f"{number(values[rank] / values[0], 1)} of what the best seen one does ([@paper_spectra]), enough for exact "
        "numbers alone."
    )


def _recovered(parameters: Mapping[str, Any]) -> list[list[str]]:
    cells = []
    for name, p in parameters.items():
        places = 6 if p["unit"] == "rad" else 4
        printed = published.TABLE_III.get(name)
        differs = printed is not None and abs(printed - p["true_error"]) > 1e-12
        true = fixed(p["true_error"], places) + (f" ({fixed(printed or 0.0, places)})" if differs else "")
        deviation = p["error"] - p["true_error"]
        cells.append([symbol(name), p["unit"], true, fixed(p["error"], places), number(deviation, 1)])
    return cells


def _two_columns(cells: list[list[str]]) -> list[Row]:
    half = (len(cells) + 1) // 2
    blank = [""] * len(cells[0])
    return [row(*cells[i], "\u2003", *(cells[half + i] if half + i < len(cells) else blank)) for i in range(half)]


def simulation_2(content: Content) -> list[Block]:
    """With noise."""
    two = content["simulation_2"]
    noise = two["noise"]
    wide = "uniform in ±" if noise["distribution"] == "uniform" else "normal with standard deviation "
    return [
        heading("Simulation II: noisy positions"),
        paragraph(
            f"Every coordinate is measured with noise {wide}{number(noise['half_width_mm'], 2)} mm. An error against a "
            f"noisy position therefore has an expected mean of at least {number(noise['mean_norm_mm'])} mm, even of a "
            "perfect robot, and hides what the calibration is worth; the paper does not say against which its Table IV "
            "is. Both are in [@table_4] and [@paper_test_errors]. One draw of the noise is shown here, as in the "
            "paper; what holds beyond it is in [@repetitions]."
        ),
        table(
            "table_4",
            "Position error on the test data (paper: Table IV)",
            "Mean and largest error, mm. One draw: the same noise on the test data for all plans. The median column is "
            f"over {two['repetitions']} repetitions, with its 5 to 95 % range.",
            ["path", "", "before", "after, measured", "after, truth", "median, measured", "median, truth"],
            _table_4(content),
            left=(0, 1),
            floats=True,
        ),
        *_deviation(content),
        figures("paper_test_errors"),
        _identified(content, "optimal", "certified", "table_5", "Table V", "planned"),
        _identified(content, "random", "random", "table_6", "Table VI", "random"),
    ]


def _table_4(content: Content) -> list[Row]:
    two = content["simulation_2"]
    rows = []
    for key, label in (("optimal", "paper, optimal"), ("random", "paper, random")):
        entry = two["paper"][key]
        for which, words in (("mean_mm", "mean"), ("max_mm", "max")):
            first = which == "mean_mm"
            after = f"{entry['after'][which]} (not said)"
            rows.append(
                row(
                    label if first else "",
                    words,
                    str(entry["before"][which]),
                    after,
                    "",
                    "",
                    "",
                    rule=first and key != "optimal",
                )
            )
    for name in PLAN_LABELS:
        entry = two["plans"][name]
        again = entry["repetitions"]
        for which, words in (("mean", "mean"), ("max", "max")):
            first = which == "mean"
            rows.append(
                row(
                    f"ours, {PLAN_LABELS[name]}" if first else "",
                    words,
                    number(entry["before_raw"][f"{which}_mm"]),
                    number(entry["after_measured"][f"{which}_mm"]),
                    number(entry["after_true"][f"{which}_mm"]),
                    span(again[f"measured_{which}_mm"]),
                    span(again[f"true_{which}_mm"]),
                    rule=first,
                )
            )
    return rows


def _deviation(content: Content) -> list[Block]:
    """Why ours are not the paper's numbers."""
    two = content["simulation_2"]
    before, paper = two["plans"]["certified"]["before_raw"], two["paper"]
    text = (
        f"Before calibration ours are {number(before['mean_mm'])} and {number(before['max_mm'])} mm, the paper's "
        f"{number(paper['optimal']['before']['mean_mm'])} and {number(paper['optimal']['before']['max_mm'])}: the same "
        "model on other test poses. "
    )
    judged = {key: paper[key]["parameters_at_our_test_poses"] for key in ("optimal", "random")}
    if all(judged.values()):
        rounding = content["printed"]["optimal"]["rounding_mm"]
        text += (
            "A check that needs nothing but the paper: robots with the values of its Tables V and VI are off by "
            f"{number(judged['optimal']['mean_mm'])} and {number(judged['random']['mean_mm'])} mm in the mean at our "
            f"test poses against truth, where its Table IV says {paper['optimal']['after']['mean_mm']} and "
            f"{paper['random']['after']['mean_mm']}; rounding to four decimals alone makes {number(rounding, 2)} mm "
            "rms. So the paper's model is ours, and its Table IV is nearer to errors against truth than against "
            "measurement. "
        )
    again, fitness = two["new_random"]["measured_mean_mm"], two["plans"]["paper_ga"]["repetitions"]["measured_mean_mm"]
    text += (
        f"Its random trajectory, with {paper['random']['after']['mean_mm']} mm, is far worse than random poses of the "
        f"working area: 95 % of our repetitions stay below {number(again['p95'])} mm. How many points it had, and from "
        f"where, is not said.{_worst_seen(content)} "
    )
    if fitness["p05"] <= paper["optimal"]["after"]["mean_mm"] <= fitness["p95"]:
        text += (
            f"Its optimal trajectory, with {paper['optimal']['after']['mean_mm']} mm, is what the plan by its fitness "
            f"gives here ({span(fitness)} mm), not what a good plan gives."
        )
    return [paragraph(text, lead="Deviations explained.")]


def _worst_seen(content: Content) -> str:
    """The parameter that the data can see and the paper's random trajectory determined worst."""
    if "random" not in content["printed"]:
        return ""
    reduced, scales = content["printed"]["random"]["reduced"], content["choices"]["scales"]
    true = {n: p["true_error"] for n, p in content["simulation_1"]["parameters"].items()}
    seen = [n for n in true if n not in _hidden(content)]
    worst = max(seen, key=lambda n: abs(reduced[n] - true[n]) / scales[n])
    entry = content["simulation_1"]["parameters"][worst]
    off, spread = abs(reduced[worst] - true[worst]), content["gauge"]["methods"]["posterior"]["sd"][worst]
    return (
        f" It left {symbol(worst)}, which can be seen, off by {number(off, 2)} {entry['unit']}; the certified plan "
        f"determines it to {number(spread, 2)} {entry['unit']}."
    )


def _identified(content: Content, key: str, plan: str, name: str, number_of: str, words: str) -> Block:
    two = content["simulation_2"]
    ours, paper, reduced = two["plans"][plan], two["paper"][key]["parameters"], content["printed"].get(key)
    rows = []
    for parameter, p in ours["parameters"].items():
        places = _PLACES[p["unit"]]
        cells = [
            fixed(p["true_error"], places),
            fixed(paper[parameter], places) if parameter in paper else "–",
            fixed(reduced["reduced"][parameter], places) if reduced else "–",
            fixed(p["error"], places),
            fixed(ours["unregularised"][parameter]["error"], places),
        ]
        rows.append(row(symbol(parameter), p["unit"], *cells, faint=parameter in _hidden(content)))
    hidden = listed([symbol(p) for p in _hidden(content)])
    return table(
        name,
        f"Identified with the {words} trajectory (paper: {number_of})",
        f"Ours: {PLAN_LABELS[plan]} plan, one draw of the noise. Reduced: what is left of the paper's values when the "
        f"part that positions cannot see is taken away (ours). Grey: {hidden} take part in unseen directions; their "
        "values with a prior are those nearest to nominal and no finding."
        + (
            f" With all parameters free the error against truth is {_free(content, plan)}."
            if plan == "certified"
            else ""
        ),
        ["", "unit", "true", "as printed", "reduced", "with prior", "all free"],
        rows,
        groups=[("", 3), ("paper", 2), ("ours", 2)],
        left=(0, 1),
        wide=(2, 3, 4, 5, 6),
        floats=True,
    )


def _hidden(content: Content) -> list[str]:
    unseen = {name for entry in content["gauge"]["nominal"]["unseen"] for name in entry["direction"]}
    return [name for name in content["simulation_1"]["parameters"] if name in unseen]


def _free(content: Content, plan: str) -> str:
    entry = content["simulation_2"]["plans"][plan]
    ratio = entry["unregularised_true"]["rms_mm"] / entry["after_true"]["rms_mm"]
    return f"{number(entry['unregularised_true']['rms_mm'])} mm rms, {percent(ratio, 0)} of that with the prior"
