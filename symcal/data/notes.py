"""What looks wrong in measurements but can be meant: said, not refused."""

from __future__ import annotations

import re
from collections.abc import Collection
from difflib import get_close_matches

import numpy as np

from symcal.data.dataset import Dataset
from symcal.documents.table import Table
from symcal.robot.robot import Robot
from symcal.units import split_unit
from symcal.words import plural

_MANY = 12  # points of a target, of which poses are expected to show a part
_SHOWN = 5  # poses named one by one
_SMALL = np.deg2rad(7.0)  # a robot in radians, read as degrees, stays within +-pi/2 to pi of them
_TURNS = 4 * np.pi


def notes(data: Dataset, robot: Robot) -> tuple[str, ...]:
    """Units, joints that never move, repeated poses, points that were not seen, poses of no split."""
    return (*_limits(data, robot), *_small_angles(data, robot), *_still(data, robot), *_twins(data), *_left_out(data))


def _limits(data: Dataset, robot: Robot) -> list[str]:
    found = []
    for i, joint in enumerate(robot.joints):
        values = data.q[:, i]
        shown, unit = (np.rad2deg(values), "deg") if joint.revolute else (values, "mm")
        slack = 0.02 * (joint.upper - joint.lower) if np.isfinite(joint.upper - joint.lower) else 0.0
        outside = int(np.sum((values < joint.lower - slack) | (values > joint.upper + slack)))
        if outside:
            found.append(
                f"joint {i + 1} '{joint.name}' is outside its limits in {outside} of {plural(len(data), 'pose')} "
                f"(readings {shown.min():.6g} to {shown.max():.6g} {unit}): is the column in the unit of its name?"
            )
        elif joint.revolute and np.abs(values).max() > _TURNS:
            found.append(
                f"joint {i + 1} '{joint.name}' turns by up to {np.abs(shown).max():.6g} deg: is the column in the "
                "unit of its name?"
            )
    return found


def _small_angles(data: Dataset, robot: Robot) -> list[str]:
    revolute = [i for i, joint in enumerate(robot.joints) if joint.revolute]
    if len(data) < 5 or not revolute:
        return []
    largest = float(np.abs(data.q[:, revolute]).max())
    if not 0 < largest < _SMALL:
        return []
    return [f"no revolute joint moves beyond {np.rad2deg(largest):.3g} deg: are angles in radians given as degrees?"]


def _still(data: Dataset, robot: Robot) -> list[str]:
    if len(data) < 2:
        return []
    still = [f"'{joint.name}'" for joint, span in zip(robot.joints, np.ptp(data.q, axis=0), strict=True) if span == 0]
    if not still:
        return []
    return [f"the reading of joint {', '.join(still)} is the same in all poses: its errors cannot be told from others"]


def _twins(data: Dataset) -> list[str]:
    postures = np.column_stack([data.q, *data.conditions.values()]).T
    order = np.lexsort(postures)  # keeps the order of equal ones
    again = np.zeros(len(data), dtype=np.bool_)
    again[1:] = np.all([row[order[1:]] == row[order[:-1]] for row in postures], axis=0)
    first = np.empty(len(data), dtype=np.intp)
    first[order] = order[np.maximum.accumulate(np.where(again, 0, np.arange(len(data))))]
    twins = np.sort(order[again])
    if not len(twins):
        return []
    pairs = [f"{data.labels[first[i]]} and {data.labels[i]}" for i in twins[:_SHOWN]]
    shown = ", ".join(pairs) + (", ..." if len(twins) > _SHOWN else "")
    verb = "repeats" if len(twins) == 1 else "repeat"
    return [f"{plural(len(twins), 'pose')} {verb} the joint readings of another ({shown}): taken as measured again"]


def _left_out(data: Dataset) -> list[str]:
    found = []
    missing = int(np.isnan(data.z).any(axis=1).sum())
    count, width = len(data.only.features), len(data.only.instrument.columns)
    if missing and count > _MANY:
        seen = np.isfinite(data.z).reshape(len(data), count, width).all(axis=2).sum(axis=1)
        found.append(f"poses show {seen.min()} to {seen.max()} of {count} points, {np.median(seen):.0f} in the median")
    elif missing:
        found.append(f"in {plural(missing, 'pose')} at least one point was not seen")
    unused = data.split.count("unused")
    if unused:
        found.append(f"{plural(unused, 'pose')} with a split label that is neither train nor test: not used")
    return found


def refuse_more_joints(table: Table, known: Collection[str], robot: Robot) -> list[str]:
    """What is said of joint columns `q7_deg` beyond the robot's last joint that never move.

    Raises:
        InputError: one that moves: the file is of another robot, or the robot file lacks a joint.
    """
    found = []
    for column in table.columns:
        stem = split_unit(column)[0]
        if stem in known or not re.fullmatch(r"q\d+", stem) or int(stem[1:]) <= robot.dof:
            continue
        if len(set(table.text(column))) > 1:
            message = (
                f"the robot has {plural(robot.dof, 'joint')}, and this is a column of another one, which moves: the "
                "file is of another robot, or the robot file lacks a joint; rename the column if it is none"
            )
            raise table.error(message, column=column)
        found.append(f"column '{column}' is not read: the robot has {plural(robot.dof, 'joint')}, and it never changes")
    return found


def unread(table: Table, known: Collection[str], points: Collection[str]) -> tuple[str, ...]:
    """What is passed over: columns whose name comes near one that would be read, points not asked for, comments."""
    present = {stem for stem, _ in map(split_unit, table.columns)}
    found = []
    for column in table.columns:
        stem = split_unit(column)[0]
        near = get_close_matches(stem.lower(), set(known) - present, n=1, cutoff=0.8)
        if stem not in known and (near or stem.lower().startswith("sigma")):
            found.append(f"column '{column}' is not read" + (f": is it '{near[0]}'?" if near else ""))
    wide = [s.removesuffix("_x") for s in sorted(present) if s.endswith("_x") and not s.startswith("sigma_")]
    unasked = [name for name in wide if points and name not in points]
    if unasked and set(wide) & set(points):
        found.append(f"the file has points that the measurement does not name: {', '.join(unasked)} (not used)")
    if table.hidden:
        found.append(f"{plural(table.hidden, 'row')} commented out with '#'")
    return (*table.notes, *found)
