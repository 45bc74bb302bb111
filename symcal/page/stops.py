"""The poses of a plan, one by one: where the arm stops, how it comes there, and what it is expected to tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.page.body import five_digits, in_hundredths, shown
from symcal.page.points import decimals, joint_heads, number_cell, text_cell
from symcal.planning.plan_study import PlanStudy
from symcal.planning.pose_worth import PoseWorth, pose_worth
from symcal.words import number, symbol

Array = NDArray[np.float64]

MOST = 1000
"""Rows; the way of a longer plan is shown so far, and the file of poses has the rest."""

_TELLS = 3  # parameters that a pose is said to tell of
_NOTICED = 0.005  # by which a standard deviation must grow for that


@dataclass(frozen=True, slots=True, eq=False)
class Stops:
    """The first poses of a plan. tool: T_world_tool, shape (N, 4, 4), mm. errors: foretold rms error of the tool there,
    mm, shape (N,). touches: what each touches, None where nothing is touched."""

    found: PlanStudy
    tool: Array
    errors: Array
    worth: PoseWorth
    touches: tuple[str, ...] | None

    def __len__(self) -> int:
        return len(self.tool)

    @property
    def q(self) -> Array:
        return self.found.planned.plan.poses[: len(self)]

    @property
    def lost(self) -> Array:
        """By which share the foretold rms over the region grows where a pose is left out, shape (N,)."""
        return self.worth.mean_mm / self.found.planned.plan.prediction.mean_pose_rms_mm - 1

    @property
    def best(self) -> int:
        """The pose that tells most."""
        return int(np.argmax(self.worth.mean_mm[: len(self)]))


def stops(found: PlanStudy) -> Stops:
    """Everything about the poses of a plan that their rows say."""
    problem, poses = found.problem, found.planned.plan.poses
    first = poses[:MOST]
    return Stops(
        found,
        problem.arm.tool(first),
        found.accuracy.at(first, problem.info.posterior(poses)),
        pose_worth(problem.info, found.accuracy, poses),
        None if problem.touches is None else problem.touches(first),
    )


def stops_table(own: Stops) -> dict[str, Any]:
    """Head and rows, every cell with its text and what it is sorted by."""
    planned, robot = own.found.planned, own.found.problem.robot
    must, timed = bool(planned.required.any()), planned.timed
    head = ["pose"] + ["required"] * must + ["touches"] * (own.touches is not None)
    head += ["worth / %", "foretold / mm", *joint_heads(robot), "x / mm", "y / mm", "z / mm", "way"] + ["s"] * timed
    q, places, worth = shown(robot, own.q), decimals(own.errors), 100 * own.lost
    rows = []
    for i, segment in enumerate(planned.motion.segments[: len(own)]):
        cells = [text_cell(planned.names[i])] + [text_cell("required" if planned.required[i] else "")] * must
        cells += [text_cell(own.touches[i])] if own.touches is not None else []
        cells += [number_cell(float(worth[i]), decimals(worth)), number_cell(float(own.errors[i]), places)]
        cells += [number_cell(round(float(value), 2), 2) for value in q[i]]
        cells += [number_cell(round(float(value), 1), 1) for value in own.tool[i, :3, 3]]
        cells += [text_cell(_KINDS[segment.kind])] + [number_cell(segment.time, 2)] * timed
        rows.append({"number": i, "cells": cells, "best": i == own.best})
    return {"head": head, "rows": rows, "of": len(planned.plan)}


_KINDS = {"line": "straight", "joint": "joints"}


def stops_data(own: Stops) -> dict[str, Any]:
    """The same for the page's script, with what the rows have no room for."""
    planned, robot = own.found.planned, own.found.problem.robot
    segments = planned.motion.segments[: len(own)]
    return {
        "label": list(planned.names[: len(own)]),
        "required": [bool(must) for must in planned.required[: len(own)]],
        "touches": None if own.touches is None else list(own.touches),
        "q": shown(robot, own.q).round(3).tolist(),
        "tool": own.tool[:, :3, 3].round(1).tolist(),
        "axis": in_hundredths(own.tool[:, :3, 2]),
        "foretold": five_digits(own.errors),
        "without": five_digits(own.worth.mean_mm[: len(own)]),
        "worth": five_digits(100 * own.lost),
        "directions": five_digits(own.worth.directions[: len(own)]),
        "tells": [_tells(own, i) for i in range(len(own))],
        "way": [_KINDS[segment.kind] for segment in segments],
        "why": [segment.why for segment in segments],
        "time": [round(segment.time, 2) for segment in segments] if planned.timed else None,
    }


def _tells(own: Stops, i: int) -> list[list[str]]:
    """The parameters whose standard deviation grows most without a pose, and by how much."""
    growth = own.worth.growth[i] - 1
    most = np.argsort(-growth, kind="stable")[:_TELLS]
    names = own.found.problem.info.names
    return [[symbol(names[k]), f"{number(100 * float(growth[k]), 2)} %"] for k in most if growth[k] > _NOTICED]
