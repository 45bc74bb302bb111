"""Page one of the paper's report: the verdict in plain words and the key table, ours beside the paper's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.paper.report.blocks import Block, at_least, figures, pair, percent, row, table
from symcal.words import fixed, listed, number, symbol

Content = Mapping[str, Any]

_FAR = 5.0
"""A parameter of Table V counts as far from the robot when it is off by so many plausible errors."""


def study_verdict(content: Content) -> list[str]:
    """Sentences, the most important first; each says only what this run's numbers say."""
    return [_main(content), _first(content), _second(content), _rank(content), _plans(content)]


def calibration_holds(content: Content) -> bool:
    """Whether all errors come back without noise, and the certified plan's medians are not above the paper's."""
    best = content["simulation_2"]["plans"]["certified"]["repetitions"]
    paper = content["simulation_2"]["paper"]["optimal"]["after"]
    return bool(
        content["simulation_1"]["iterations"] <= content["simulation_1"]["paper"]["iterations"]
        and content["simulation_1"]["largest_deviation"] < 5e-5
        and best["measured_mean_mm"]["median"] <= paper["mean_mm"]
        and best["measured_max_mm"]["median"] <= paper["max_mm"]
    )


def far_parameters(content: Content) -> list[str]:
    """Parameters of Table V that are off by several plausible errors."""
    true = {name: p["true_error"] for name, p in content["simulation_1"]["parameters"].items()}
    scales = content["choices"]["scales"]
    table_v = content["simulation_2"]["paper"]["optimal"]["parameters"]
    return [n for n in true if n in table_v and abs(table_v[n] - true[n]) > _FAR * scales[n]]


def _main(content: Content) -> str:
    faults = []
    if content["plans"]["paper_ga"]["beats_random_expected"] < 0.5:
        faults.append("its fitness, as we read it, chooses poses that are worse than random ones")
    if content["gauge"]["nominal"]["rank"] < content["gauge"]["nominal"]["parameters"]:
        faults.append("not all its parameters can be known from what it measures")
    start = (
        "The paper's calibration holds" if calibration_holds(content) else "The paper's calibration does not hold here"
    )
    return f"{start}{', but ' if faults and calibration_holds(content) else '; ' if faults else ''}{listed(faults)}."


def _first(content: Content) -> str:
    one = content["simulation_1"]
    return (
        f"Without noise all {len(one['parameters'])} errors come back in {one['iterations']} steps (paper: "
        f"{one['paper']['iterations']}), the largest deviation is {number(one['largest_deviation'], 2)} rad or mm."
    )


def _second(content: Content) -> str:
    two = content["simulation_2"]
    best, paper = two["plans"]["certified"]["repetitions"], two["paper"]["optimal"]["after"]
    return (
        f"With its noise the certified plan leaves {number(best['measured_mean_mm']['median'])} mm in the mean and "
        f"{number(best['measured_max_mm']['median'])} mm at most against noisy test data (median of "
        f"{two['repetitions']} repetitions; paper: {paper['mean_mm']} and {paper['max_mm']} mm), where a "
        f"perfect robot would show {number(two['noise']['mean_norm_mm'])} mm in the mean, the test data's own noise; "
        f"against truth the robot is off by {number(best['true_rms_mm']['median'])} mm rms."
    )


def _rank(content: Content) -> str:
    seen = content["gauge"]["nominal"]
    text = (
        f"Positions of one point determine {seen['rank']} combinations of the {seen['parameters']} error parameters, "
        "the other directions are unseen."
    )
    judged = content["simulation_2"]["paper"]["optimal"]["parameters_at_our_test_poses"]
    far = far_parameters(content)
    if judged and far:
        text += (
            f" The paper's Table V predicts positions and is wrong about {listed([symbol(n) for n in far])}: a robot "
            f"with its values is off by {number(judged['mean_mm'])} mm in the mean at our test poses, although "
            f"{symbol(far[0])} is off by {_off(content, far[0])}."
        )
    return text


def _off(content: Content, name: str) -> str:
    found = content["simulation_2"]["paper"]["optimal"]["parameters"][name]
    entry = content["simulation_1"]["parameters"][name]
    difference = abs(found - entry["true_error"])
    return f"{fixed(difference * 57.29577951308232, 1)}°" if entry["unit"] == "rad" else f"{number(difference)} mm"


def _plans(content: Content) -> str:
    found, random = content["plans"], content["simulation_2"]["random_expected_rms_mm"]
    paper, best = found["paper_ga"], found["certified"]
    return (
        f"The genetic algorithm with the paper's fitness, read in the way the experiment file says, finds poses that "
        f"predict {number(paper['expected_rms_mm'])} mm rms, better than {percent(paper['beats_random_expected'])} of "
        f"random plans (median {number(random['median'])} mm). The certified plan predicts "
        f"{number(best['expected_rms_mm'])} mm, carries at least "
        f"{at_least(best['d_efficiency_lower_bound']).removeprefix('≥ ')} of the "
        "best possible information, as far as it was searched, and wins in "
        f"{percent(content['wins']['certified']['new_random'])} of single draws "
        "against a new random plan: one draw, as in the paper, proves nothing."
    )


def key_table(content: Content) -> list[Block]:
    """Ours beside the paper's, and the two figures that sum the study up."""
    two, found = content["simulation_2"], content["plans"]
    names = ("certified", "ga", "paper_ga")
    paper = two["paper"]
    spreads = {name: two["plans"][name]["repetitions"] for name in names} | {"new_random": two["new_random"]}
    ours = (*names, "new_random")

    def line(label: str, optimal: str, values: list[str], random: str, strong: bool = False) -> dict[str, Any]:
        return row(label, optimal, *values[:3], random, values[3], strong=strong)

    before = pair(two["plans"]["certified"]["before_raw"])
    steps = {name: str(entry["iterations"]) for name, entry in content["simulation_1"]["plans"].items()}
    rows = [
        line(
            "before, mean / max against truth",
            pair(paper["optimal"]["before"]),
            [before] * 4,
            pair(paper["random"]["before"]),
        ),
        line(
            "Simulation I, steps",
            str(content["simulation_1"]["paper"]["iterations"]),
            [*(steps[name] for name in names), steps["random"]],
            "–",
        ),
        line(
            "after, mean against noisy data",
            f"{paper['optimal']['after']['mean_mm']}*",
            [number(spreads[n]["measured_mean_mm"]["median"]) for n in ours],
            f"{paper['random']['after']['mean_mm']}*",
            strong=True,
        ),
        line(
            "after, max against noisy data",
            f"{paper['optimal']['after']['max_mm']}*",
            [number(spreads[n]["measured_max_mm"]["median"]) for n in ours],
            f"{paper['random']['after']['max_mm']}*",
            strong=True,
        ),
        line(
            "after, rms against truth",
            "–",
            [number(spreads[n]["true_rms_mm"]["median"]) for n in ours],
            "–",
            strong=True,
        ),
        line("rms over its Cramér–Rao bound", "–", [number(content["over_cramer_rao"][n]) for n in ours], "–"),
        line(
            "D-efficiency, at least", "–", [*(at_least(found[n]["d_efficiency_lower_bound"]) for n in names), "–"], "–"
        ),
        line(
            "beats random plans in prediction",
            "–",
            [*(percent(found[n]["beats_random_expected"]) for n in names), "–"],
            "–",
        ),
        line(
            "wins against a new random plan",
            "one draw",
            [*(percent(content["wins"][n]["new_random"]) for n in names), "–"],
            "–",
        ),
    ]
    return [
        table(
            "key",
            "Ours and the paper's",
            f"Position errors in mm over {content['measurement']['poses']['test']} test poses; ours are medians over "
            f"{two['repetitions']} repetitions, the paper's one draw. * The paper does not say whether against truth "
            "or noisy measurement.",
            ["", "paper", "certified", "information", "paper's fitness", "paper", "ours"],
            rows,
            groups=[("", 1), ("planned trajectory", 4), ("random trajectory", 2)],
        ),
        figures("paper_measured", "paper_repetitions"),
    ]
