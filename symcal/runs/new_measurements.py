"""New measurements of an instrument that a calibrated robot was measured by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from symcal.data.dataset import Dataset, merged
from symcal.data.layout import Layout
from symcal.data.measurement_file import measurements_in
from symcal.errors import InputError
from symcal.model.observation import Observation
from symcal.model.task import Task
from symcal.readers.sheets import is_sheets
from symcal.robot.robot import Robot


def chosen_instrument(task: Task, instrument: str | None) -> tuple[Observation, ...]:
    """The observations of the instrument whose measurements are new, one for each of its sessions.

    Raises:
        InputError: there is no such instrument, or several and none is named.
    """
    entries = tuple(dict.fromkeys(o.of for o in task.observations))
    if instrument is None and len(entries) == 1:
        instrument = entries[0]
    if instrument not in entries:
        message = "several instruments measured: say with --instrument whose measurements these are"
        raise InputError(message, key="--instrument", found=instrument, allowed=entries)
    return tuple(o for o in task.observations if o.of == instrument)


def new_measurements(
    robot: Robot, data: Path, own: Sequence[Observation], refit: tuple[str, ...]
) -> tuple[Dataset, tuple[str, ...]]:
    """New measurements of an instrument with the canonical columns, or those that the calibration was read from; by
    session where it has a place of its own in each. Then the sessions that the calibration does not know."""
    assert robot.record is not None
    record = robot.record.provenance.get("layout", {})
    record = record.get(own[0].of, record)
    sheets = is_sheets(data)
    delimiter, decimal = (None, None) if sheets else (record.get("delimiter"), record.get("decimal", "."))
    sheet, per_file = record.get("sheet") if sheets else None, record.get("session") == "file"
    plain = Layout(delimiter=delimiter, decimal=decimal, sheet=sheet, session_per_file=per_file)
    header = plain.table(data).columns
    named = {c: n for c, n in record.get("columns", {}).items() if set([n] if isinstance(n, str) else n) <= set(header)}
    where = {column: str(cell) for column, cell in record.get("where", {}).items() if column in header}
    layout = replace(plain, columns=named, where=where)
    if len(own) == 1:
        found = _read(robot, data, own[0], layout, None)
        return replace(found, split=("test",) * len(found)), ()
    table, known = layout.table(data), {o.session: o for o in own}
    if "session" not in table.columns:
        message = "this instrument has a place of its own in each session: the measurements need a column 'session'"
        raise InputError(message, file=data, line=table.head_line, allowed=known)
    sessions = list(dict.fromkeys(table.text("session")))
    new = [session for session in sessions if session not in known]
    one = own[0]
    if new and (one.of not in refit or any(o.target.name != one.target.name for o in own)):
        message = "the calibration knows no such session: where the instrument stood in it is not known"
        if one.of not in refit:
            message += f"; '--refit {one.of}' fits its place to these measurements"
        raise InputError(message, file=data, column="session", found=new[0], allowed=known)
    sets = [_read(robot, data, known.get(session) or stranger(one, session), layout, session) for session in sessions]
    found = merged(sets, sessions)
    return replace(found, split=("test",) * len(found)), tuple(new)


def stranger(like: Observation, session: str) -> Observation:
    """The same instrument in a session that the calibration does not know."""
    name = f"{like.of}_{session}"
    return replace(like, name=name, session=session, place_name=name, at=replace(like.at, frame=np.eye(4)))


def _read(robot: Robot, data: Path, o: Observation, layout: Layout, session: str | None) -> Dataset:
    table = layout.table(data)
    return measurements_in(
        table, robot, o.instrument, layout, point_names=o.features, session=session, alone=False, name=o.name
    )
