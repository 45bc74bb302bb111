"""What the paper could not see: its fitness, the readings of it side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from symcal.paper.report.blocks import Block, at_least, figures, heading, paragraph, percent, row, table
from symcal.paper.report.plans import PLAN_LABELS
from symcal.words import number, plural

Content = Mapping[str, Any]


def fitness(content: Content) -> list[Block]:
    """The readings of the paper's fitness side by side."""
    readings, found = content["readings"], content["plans"]
    two = content["simulation_2"]
    random = two["random_expected_rms_mm"]
    losing = [r for r in readings if r["beats_random_expected"] < 0.5]
    main = next((r for r in readings if r["main"]), readings[0])
    scores = main["scores"]
    weights = content["choices"]["weights"]
    rows = [
        row(
            entry["text"] + (" (the experiment's)" if entry["main"] else ""),
            number(entry["expected_rms_mm"]),
            percent(entry["beats_random_expected"], 1),
            at_least(entry["d_efficiency_lower_bound"]),
            str(entry["distinct_poses"]),
            strong=entry["main"],
        )
        for entry in readings
    ]
    rows += [
        row(
            f"ours: {PLAN_LABELS[name]}",
            number(found[name]["expected_rms_mm"]),
            percent(found[name]["beats_random_expected"], 1),
            at_least(found[name]["d_efficiency_lower_bound"]),
            "",
            rule=name == "ga",
        )
        for name in ("ga", "certified")
    ]
    searched = (
        f"It is not the search that fails: by its own fitness the plan found has {number(scores['paper_ga'])}, the "
        f"certified plan {number(scores['certified'])}, the random one {number(scores['random'])} (smaller is better). "
        if scores["paper_ga"] <= min(scores.values())
        else ""
    )
    return [
        heading("What the paper could not see: its fitness"),
        paragraph(
            "Equations 10 to 12 leave open whether a condition number is of one pose or of the whole trajectory, "
            "which columns it runs over and in which units, and the weights. We tried several readings with c₁ = "
            f"{number(weights['observability'], 2)}, c₂ = {number(weights['angle'], 2)} per rad and c₃ = "
            f"{number(weights['area'], 2)} per px² (ours), all over the identifiable columns: over all of them, that "
            f"of a whole trajectory at nominal is infinite. {len(losing)} of {plural(len(readings), 'reading')} lead "
            f"to plans that predict larger errors than the median random plan ({number(random['median'])} mm). "
            f"{searched}The fitness asks for the wrong thing: a condition number near one means that all directions "
            "are known equally well, or equally badly. Taken per pose, nothing is better than the one best-conditioned "
            "pose "
            f"{content['measurement']['poses']['train']} times over; taken over the trajectory, what is easily known "
            f"is given up to balance what is hard to know.{_whitened(readings)} In fairness: the paper does not give "
            "its weights, camera or trajectory, its own reading may have been a better one, and its comparison with "
            "random points came out in its favour."
        ),
        table(
            "readings",
            "Readings of the paper's fitness",
            "Each searched by the same genetic algorithm. Predicted: rms position error over the test poses after an "
            f"identification, mm. Random plans: {two['random_plans']}. Distinct: poses that differ by more than a "
            "hundredth of the working area from each other.",
            ["reading", "predicted", "beats random", "D-efficiency", "distinct"],
            rows,
        ),
        figures("paper_readings"),
    ]


def _whitened(readings: Sequence[Mapping[str, Any]]) -> str:
    """The reading that asks for the right thing, if it was tried."""
    found = next((entry for entry in readings if entry["key"] == "whitened"), None)
    if found is None:
        return ""
    return (
        " Asked for relative to what an average pose of the working area tells, the condition number leads to a plan "
        f"that beats {percent(found['beats_random_expected'])} of random plans."
    )
