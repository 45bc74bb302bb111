"""The page of a plan: what it promises, and the way through it as a tour that one can play, stop and touch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from symcal.model.model import Model
from symcal.outputs.whole_file import write_whole
from symcal.page.around import around
from symcal.page.assembled import assembled
from symcal.page.body import COLORS, joints
from symcal.page.stops import Stops, stops, stops_data, stops_table
from symcal.page.tour import tour, tour_data
from symcal.planning.plan_study import PlanStudy
from symcal.report.plan import plan_text
from symcal.report.plan_verdict import efficiencies, percent
from symcal.report.render import Picture
from symcal.words import number, plural

Content = Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class PlanShown:
    """What a page shows of a plan. model: what is to be identified, whose nominal arm is drawn."""

    content: Content
    found: PlanStudy
    model: Model
    pictures: Sequence[Picture] = ()


def write_plan_page(shown: PlanShown, path: Path | str) -> None:
    """Write the page as one file that asks for nothing else.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, plan_page(shown))


def plan_page(shown: PlanShown) -> str:
    """The page as HTML."""
    return assembled("plan", partial(_given, shown), shown.pictures)


def _given(shown: PlanShown) -> dict[str, Any]:
    """What the template shows, but for the figures."""
    own, content = stops(shown.found), shown.content
    return {
        "text": plan_text(content),
        "headline": plan_headline(content),
        "forecast": forecast(content),
        "poses": stops_table(own),
        "timed": shown.found.planned.timed,
        "aligned": content["aligned"],
        "region": content["region"],
        "rank": content["plan"]["rank"],
        "scene": _scene(shown, own),
    }


def _scene(shown: PlanShown, own: Stops) -> dict[str, Any]:
    found, model = shown.found, shown.model
    drawn = tour_data(model, tour(found.planned, len(own)))
    nodes = np.array(drawn["tour"]["nodes"], dtype=np.float64).reshape(-1, 3)
    return {
        "colors": COLORS,
        "robot": model.robot.name,
        "joints": joints(model.robot),
        **drawn,
        "poses": stops_data(own),
        "around": around(found, model, nodes),
        "mean": found.planned.plan.prediction.mean_pose_rms_mm,
        "rank": found.planned.plan.rank,
        "best": own.best,
        "timed": found.planned.timed,
    }


def plan_headline(content: Content) -> dict[str, Any]:
    """The error that the plan foretells, with what bounds it from below and what chance gives; and the verdict."""
    plan, conflicts = content["plan"], content["order"]["conflicts"]
    _, bound_d, how = efficiencies(content)
    of, same = plural(plan["poses"], "pose"), _same_number(content)
    beside = [["at its worst pose", f"{number(plan['worst_pose_rms_mm'])} mm", "rms, the largest over the region"]]
    if same is not None:
        beside.append(
            ["no plan below", f"{number(same['bound_mean_mm'])} mm", f"rms of any {of}, as far as was searched"]
        )
        low, high = same["random_mean_low_mm"], same["random_mean_high_mm"]
        if low is not None and high is not None:
            beside.append(["random plans", f"{number(low, 2)} to {number(high, 2)} mm", f"nine in ten, of {of}"])
    beside.append(["D-efficiency", f"≥ {percent(bound_d)}", how])
    first, *others = plan_text(content)["verdict"]
    decision = {"accepted": True, "title": first, "lines": others}
    if conflicts:
        lines = [*conflicts, first, *others]
        decision = {"accepted": False, "title": "The way through these poses breaks constraints", "lines": lines}
    return {
        "value": number(plan["mean_pose_rms_mm"]),
        "unit": "mm",
        "words": f"foretold rms error of the tool over {content['region']}"
        f"{', after one rigid alignment' if content['aligned'] else ''}, once {of} are measured",
        "beside": beside,
        "decision": decision,
    }


def forecast(content: Content) -> list[dict[str, Any]]:
    """Rows of what fewer and more poses promise; none where the poses are chosen from a finite set."""
    promise = content["promise"]
    if promise is None:
        return []
    keys = (
        *("best_mean_mm", "best_worst_mm", "bound_mean_mm", "bound_worst_mm"),
        *("random_mean_low_mm", "random_mean_mm", "random_mean_high_mm"),
    )
    return [
        {
            "cells": [str(row["poses"]), *("–" if row[key] is None else number(row[key]) for key in keys)],
            "own": row["poses"] == content["plan"]["poses"],
        }
        for row in promise["table"]
    ]


def _same_number(content: Content) -> Mapping[str, Any] | None:
    """What is foretold of plans of as many poses; None where nothing is."""
    table = [] if content["promise"] is None else content["promise"]["table"]
    return next((row for row in table if row["poses"] == content["plan"]["poses"]), None)
