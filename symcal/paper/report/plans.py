"""The plans: the paper's optimal trajectory (Figs. 4 to 6), ours, and how good each is at least."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.paper.report.blocks import Block, at_least, figures, heading, paragraph, percent, row, table
from symcal.words import number, plural

Content = Mapping[str, Any]

_GENERATIONS = 200
"""Of the paper's genetic algorithm."""

PLAN_LABELS = {
    "certified": "certified",
    "ga": "GA, information",
    "paper_ga": "GA, paper's fitness",
    "random": "random",
}


def plans(content: Content) -> list[Block]:
    """Four plans of as many poses, their tours and certificates."""
    found, two = content["plans"], content["simulation_2"]
    poses = content["measurement"]["poses"]["train"]
    search = content["choices"]["search"]
    rows = [
        row(
            PLAN_LABELS[name],
            at_least(found[name]["d_efficiency_lower_bound"]),
            percent(found[name]["g_efficiency"]),
            number(found[name]["expected_rms_mm"]),
            percent(found[name]["beats_random_expected"]),
            number(found[name]["condition_number"]),
            percent(found[name]["visible_share"], 0),
            number(found[name]["tour_s"]),
            number(found[name]["search_s"], 2) if found[name]["search_s"] else "–",
            strong=name == "certified",
        )
        for name in PLAN_LABELS
    ]
    random = two["random_expected_rms_mm"]
    smaller = found["paper_ga"]["condition_number"] < found["certified"]["condition_number"]
    as_paper = " as in the paper" if search["generations"] == _GENERATIONS else f" (paper: {_GENERATIONS})"
    return [
        heading("The optimal trajectory"),
        paragraph(
            f"Four plans of {plural(poses, 'pose')} are compared. The paper's: a genetic algorithm ({search['coding']} "
            f"coding of {search['bits']} bits per joint, {search['generations']} generations{as_paper}, "
            f"{search['population']} plans, ours) that minimises the paper's eq. 12. The same algorithm with the "
            "information of the whole plan in place of the condition numbers. A certified plan: exchange of poses "
            "until none helps, with a bound of how much better any plan could be. And a random one. Each is "
            "driven as the shortest tour found from the paper's initial pose, along straight lines of the tool where "
            "the arm can follow them ([@paper_trajectory], [@paper_joint_motion]). The paper's Fig. 4, a flow chart of "
            "the genetic algorithm, is no result; how the searches went is in [@paper_readings]b."
        ),
        table(
            "certificates",
            "What each plan is worth before anything is measured",
            "D-efficiency: information about all identifiable parameters relative to the best possible plan, a lower "
            "bound, searched; G-efficiency: the same for the worst pose of the working area. Predicted: rms position "
            f"error over the test poses after an identification, mm; {two['random_plans']} random plans predict "
            f"{number(random['p05'])} to {number(random['p95'])} mm (5 to 95 %). Cond.: condition number of the "
            "scaled, identifiable Jacobian. Seen: poses at which the camera of [@paper_vision] sees the whole target; "
            "identification here uses positions, as the paper's simulation does, and does not ask for it.",
            ["plan", "D-efficiency", "G-eff.", "predicted", "beats random", "cond.", "seen", "tour / s", "search / s"],
            rows,
        ),
        paragraph(
            (
                "The plan by the paper's fitness has the smaller condition number and the larger error: a condition "
                "number compares directions with each other and does not ask how much is known of any. "
                if smaller and found["paper_ga"]["expected_rms_mm"] > found["certified"]["expected_rms_mm"]
                else ""
            )
            + f"The certified plan has {percent(content['readings_at_limits']['certified'], 0)} of its joint readings "
            "at the end of their ranges, the plan by the paper's fitness "
            f"{percent(content['readings_at_limits']['paper_ga'], 0)}."
        ),
        figures("paper_trajectory", "paper_joint_motion"),
    ]
