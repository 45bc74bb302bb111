"""What the paper could not see: chance. Distributions over repetitions, how often which plan wins, by how much."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from symcal.paper.report.blocks import Block, heading, paragraph, percent, row, span, table
from symcal.paper.report.plans import PLAN_LABELS
from symcal.words import number

Content = Mapping[str, Any]


def chance(content: Content) -> list[Block]:
    """Distributions over repetitions: how often which plan wins, and by how much."""
    two, wins = content["simulation_2"], content["wins"]
    names = (*PLAN_LABELS, "new_random")
    labels = {**PLAN_LABELS, "random": "one random plan", "new_random": "a new random plan"}
    rows = []
    for name in names:
        again = two["new_random"] if name == "new_random" else two["plans"][name]["repetitions"]
        rows.append(
            row(
                labels[name],
                span(again["measured_mean_mm"]),
                span(again["true_rms_mm"]),
                number(content["cramer_rao_rms_mm"][name]),
                number(content["over_cramer_rao"][name]),
                *("–" if other == name else percent(wins[name][other], 0) for other in ("paper_ga", "new_random")),
                strong=name == "certified",
            )
        )
    best, other = two["plans"]["certified"]["repetitions"], two["new_random"]
    true = 1 - best["true_rms_mm"]["median"] / other["true_rms_mm"]["median"]
    seen = 1 - best["measured_mean_mm"]["median"] / other["measured_mean_mm"]["median"]
    poses, rank = content["measurement"]["poses"]["train"], content["gauge"]["nominal"]["rank"]
    ratios = list(content["over_cramer_rao"].values())
    floor = two["noise"]["sigma_mm"] * math.sqrt(rank / poses)
    return [
        heading("What the paper could not see: chance"),
        paragraph(
            f"The paper shows one draw of the noise on one random trajectory. Over {two['repetitions']} draws the "
            f"certified plan's error against truth is {percent(true, 0)} smaller than a new random plan's in the "
            f"median, which against noisy test data looks like {percent(seen, 1)}; it wins in "
            f"{percent(wins['certified']['new_random'])} of the draws and loses in the others. With plausible "
            "sizes as prior the rms error over the repetitions is "
            f"{number(min(ratios))} to {number(max(ratios))} times its Cramér–Rao bound on every plan: what is left "
            "between them is the plans, not the solver. At the training poses themselves that bound is σ √(n / N) = "
            f"{number(floor)} mm for n = {rank} directions and N = {poses} poses, whatever the plan; plans differ in "
            "what it becomes elsewhere."
        ),
        table(
            "repetitions",
            f"{two['repetitions']} repetitions",
            "Median and 5 to 95 %, mm. Bound: least rms error over the test poses that any unbiased identification of "
            "the seen directions can have, sqrt of the mean of tr(J C Jᵀ). Wins: share of the repetitions with the "
            "smaller error against truth than the plan by the paper's fitness (p) or a new random plan (r).",
            ["plan", "mean, measured", "rms, truth", "bound", "rms over bound", "wins p", "wins r"],
            rows,
        ),
    ]
