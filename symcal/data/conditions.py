"""What a file says of every pose beside joint readings: how joints came to them, and what the arm carries.

Columns `q2_direction` or `<joint name>_direction` hold -1, 0 or 1 (0: not known), `payload_kg` the whole payload of a
pose; `Dataset.conditions` has what it is beyond that of the robot file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.documents.table import Table
from symcal.joints.backlash import direction_name
from symcal.joints.payload import PAYLOAD
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_PAYLOAD_COLUMN = "payload_kg"
_STILL = {True: 1e-6, False: 1e-4}
"""Change of a reading, rad of a revolute joint and mm of a prismatic one, up to which it did not move."""


def condition_columns(robot: Robot) -> dict[str, tuple[str, ...]]:
    """By condition, what its column may be called in a file."""
    names = [(direction_name(i), f"{joint.name}_direction") for i, joint in enumerate(robot.joints, start=1)]
    return {first: tuple(dict.fromkeys((first, other))) for first, other in names} | {PAYLOAD: (_PAYLOAD_COLUMN,)}


def read_conditions(table: Table, robot: Robot) -> dict[str, Array]:
    """The conditions that the file has columns for, by name, shape (rows,).

    Raises:
        InputError: with line and column: a direction that is none, a payload below zero, a cell that is no number, or
            two columns of one direction.
    """
    out = {}
    for name, columns in condition_columns(robot).items():
        given = [column for column in columns if column in table.columns]
        if len(given) > 1:
            message = f"columns '{given[0]}' and '{given[1]}' are the same direction twice: keep one"
            raise table.error(message)
        for column in given:
            values = table.numbers(column)
            if name == PAYLOAD:
                _check(table, column, values < 0, "a payload cannot be less than nothing", ())
                out[name] = values - robot.payload.kg
            else:
                message = "the direction in which a joint came to its reading is -1 or 1, or 0 where it is not known"
                _check(table, column, ~np.isin(values, (-1, 0, 1)), message, ("-1", "0", "1"))
                out[name] = values
    return out


def _check(table: Table, column: str, wrong: NDArray[np.bool_], message: str, allowed: Sequence[str]) -> None:
    for row in np.flatnonzero(wrong):
        cell = table.text(column)[row]
        raise table.error(message, row=row, column=column, found=cell, allowed=allowed)


def of_postures(
    table: Table,
    found: Mapping[str, Array],
    robot: Robot,
    labels: Sequence[str],
    place: NDArray[np.intp],
    firsts: NDArray[np.intp],
) -> dict[str, Array]:
    """The conditions of postures that several rows belong to, by name, shape (postures,).

    Args:
        place: the posture of every row; firsts: the first row of every posture.
    Raises:
        InputError: a row says otherwise than the first one of its posture.
    """
    for name, values in found.items():
        for row in np.flatnonzero(values != values[firsts][place]):
            column = next(c for c in condition_columns(robot)[name] if c in table.columns)
            first = table.said(firsts[place[row]])
            message = f"pose {labels[place[row]]!r} has another value of this here than in {first}"
            raise table.error(message, row=row, column=column, found=table.text(column)[row])
    return {name: values[firsts] for name, values in found.items()}


def written_conditions(data: Dataset, robot: Robot) -> dict[str, Array]:
    """Columns of a file for the conditions of poses, by the column's name, shape (N,)."""
    columns = condition_columns(robot)
    whole = {PAYLOAD: robot.payload.kg}
    return {names[0]: data.conditions[c] + whole.get(c, 0.0) for c, names in columns.items() if c in data.conditions}


def directions_from_order(data: Dataset, robot: Robot) -> Dataset:
    """The data with the direction of every joint where they say none: the sign of its change since the pose before.

    Poses were measured in the order of the data, each session by itself: what a label says before its last slash.
    Zero, not known, for the first one and where a joint has not moved.
    """
    still = np.array([_STILL[joint.revolute] for joint in robot.joints])
    sessions = [label.rpartition("/")[0] for label in data.labels]
    number = {session: i for i, session in enumerate(dict.fromkeys(sessions))}
    of = np.array([number[session] for session in sessions], dtype=np.intp)
    order = np.argsort(of, kind="stable")
    here, before = order[1:], order[:-1]
    change = data.q[here] - data.q[before]
    known = (of[here] == of[before])[:, None] & (np.abs(change) > still)
    sign = np.zeros_like(data.q)
    sign[here] = np.where(known, np.sign(change), 0.0)
    found = {direction_name(k): column for k, column in enumerate(sign.T, start=1)}
    return replace(data, conditions=found | dict(data.conditions))
