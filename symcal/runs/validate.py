"""A calibrated robot judged on measurements that it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from symcal.calibration import results
from symcal.calibration.again import Again
from symcal.calibration.calibrate import place
from symcal.calibration.evaluate import Errors, evaluate
from symcal.calibration.judgement import decide_validation
from symcal.calibration.mistakes.mistake import mistake_facts
from symcal.calibration.mistakes.moved import moved_between
from symcal.calibration.record import recorded_task
from symcal.calibration.tolerance import Tolerance
from symcal.data.dataset import Dataset, merged
from symcal.data.layout import Layout
from symcal.data.measurement_file import measurements_in
from symcal.errors import InputError
from symcal.fit.estimation import Options
from symcal.model.model import Model, State, build_model
from symcal.model.observation import Observation
from symcal.model.task import Task
from symcal.outputs.csv_text import Rows
from symcal.readers.sheets import is_sheets
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot
from symcal.runs.folder import require_replaceable, run_folder, write_json, write_table
from symcal.runs.second import with_second
from symcal.words import plural


def validate_robot(
    calibrated: Path,
    data: Path,
    out: Path | None = None,
    refit: tuple[str, ...] = (),
    instrument: str | None = None,
    progress: Callable[[str], None] = lambda _: None,
    tolerance: Tolerance | None = None,
) -> dict[str, Any]:
    """Errors of a calibrated robot on new measurements of the kind it was calibrated with.

    `before` is nominal kinematics with the frames that were fitted on the training data, `after` the calibrated robot.

    A calibration from the new measurements alone is compared with the recorded one (`halves`), where they are enough;
    a folder has the map of where they differ.

    The file may have the canonical columns or those that the calibration was read from.

    Args:
        instrument: whose measurements they are, where several measured. refit: frames to fit to the new data first, for
            both (the instrument or the tool was moved in between). What is then left says how well the kinematics carry
            over, not where the robot stands.
        tolerance: what the robot is accepted or refused against by these measurements alone; None: it must be better
            than the nominal robot by more than chance.
    Raises:
        InputError: a robot that was never calibrated, unreadable data, or parts that cannot be fitted.
    """
    if out is not None:
        require_replaceable(out, (calibrated, data))
    robot = load_robot(calibrated)
    if robot.record is None:
        message = "this robot has no 'calibration': validate takes the calibrated.yaml of a run"
        raise InputError(message, file=calibrated)
    task = recorded_task(robot.record.provenance, "after", calibrated)
    entries = tuple(dict.fromkeys(o.of for o in task.observations))
    if instrument is None and len(entries) == 1:
        instrument = entries[0]
    if instrument not in entries:
        message = "several instruments measured: say with --instrument whose measurements these are"
        raise InputError(message, key="--instrument", found=instrument, allowed=entries)
    own = [o for o in task.observations if o.of == instrument]
    _check_refit(refit, own)
    progress("reading the measurements")
    new, sessions = _measurements(robot, data, own, refit)
    names = [each.name for each in new.of]
    _check_placed(robot, names, refit)
    errors: dict[str, Errors] = {}
    judged: dict[str, State] = {}
    tasks: dict[str, Task] = {}
    states: tuple[tuple[Literal["before", "after"], Robot], ...] = (("before", robot.nominal()), ("after", robot))
    for name, subject in states:
        progress(f"evaluating: {name}")
        recorded = recorded_task(robot.record.provenance, name, calibrated)
        tasks[name] = _of_these(recorded, instrument, names, sessions)
        model = build_model(subject, _loosened(tasks[name], refit))
        judged[name] = _state(model, subject, new, refit)
        found = evaluate(judged[name], new)
        errors[name] = replace(found, fitted=len(model.placement)) if refit else found
    moved = () if refit else moved_between(judged["after"], new)
    task = tasks["after"]
    content = {
        **results.header(robot.name, f"Validation of {robot.name}", 0, (calibrated, data), Path.cwd()),
        "robot": results.robot_facts(robot),
        "measurement": results.measurement_facts(task, {"test": len(new)})
        | {"refit": list(refit), "estimate": _found_in_training(robot)},
        "mistakes": mistake_facts(moved),
        "warnings": [*(each.text for each in moved), *new.notes],
        "accuracy": {"test": results.accuracy_facts(errors, new.labels)},
        "against": results.against(task),
    }
    progress("calibrating again from these alone")
    second = with_second(content, robot, tasks["before"], new, refit, sessions, judged["after"].setup)
    content["decision"] = decide_validation(robot, judged["before"], errors, new.q, content, tolerance).facts
    if out is not None:
        with run_folder(out, (calibrated, data)) as folder:
            write_json(folder / "results.json", content)
            (folder / "tables").mkdir()
            write_table(folder / "tables" / "errors.csv", _table(errors, new.labels))
            if second is not None:
                progress("drawing")
                _draw(second, folder / "figures")
    return content


def _measurements(
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
    sets = [_read(robot, data, known.get(session) or _stranger(one, session), layout, session) for session in sessions]
    found = merged(sets, sessions)
    return replace(found, split=("test",) * len(found)), tuple(new)


def _stranger(like: Observation, session: str) -> Observation:
    """The same instrument in a session that the calibration does not know."""
    name = f"{like.of}_{session}"
    return replace(like, name=name, session=session, place_name=name, at=replace(like.at, frame=np.eye(4)))


def _of_these(task: Task, instrument: str, names: Sequence[str], sessions: Sequence[str]) -> Task:
    """The task of what has read the new data, in its order, unknown sessions among it."""
    own = [o for o in task.observations if o.of == instrument]
    known = {o.name: o for o in (*own, *(_stranger(own[0], session) for session in sessions))}
    return task.observed([known[name] for name in names])


def _check_placed(robot: Robot, names: Sequence[str], refit: tuple[str, ...]) -> None:
    """Refuse to judge by places that the calibration does not know.

    Raises:
        InputError: no training pose told where something stands, and it is not fitted to the new data.
    """
    assert robot.record is not None
    record = robot.record.provenance.get("measurements", {})
    for name in names:
        own = record.get(name, {})
        for thing in dict.fromkeys(parameter.rpartition("_")[0] for parameter in own.get("unplaced", [])):
            point = thing not in (own["names"]["place"], own["target"]["name"])
            if not {thing, own["entry"], *(["points"] if point else [])} & set(refit):
                wanted = "points" if point else own["entry"]
                message = (
                    f"where '{thing}' stands no training pose told: fit it to these measurements with "
                    f"'--refit {wanted}', which then judge the kinematics and not where the robot stands"
                )
                raise InputError(message, key="--refit")


def _found_in_training(robot: Robot) -> list[str]:
    """Places and targets that were to be found in the calibration."""
    assert robot.record is not None
    found = []
    for each in robot.record.provenance.get("measurements", {}).values():
        unknown = each.get("unknown", {})
        found += [each["names"]["place"]] * bool(unknown.get("place"))
        found += [each["target"]["name"]] * bool(unknown.get("target"))
    return list(dict.fromkeys(found))


def _read(robot: Robot, data: Path, o: Observation, layout: Layout, session: str | None) -> Dataset:
    table = layout.table(data)
    return measurements_in(
        table, robot, o.instrument, layout, point_names=o.features, session=session, alone=False, name=o.name
    )


def _check_refit(parts: tuple[str, ...], own: Sequence[Observation]) -> None:
    """Refuse what is no part of this instrument's measurement.

    Raises:
        InputError: there is no such part.
    """
    places = [name for o in own for name in (o.of, o.place, o.target.name) if name not in ("world", "tool")]
    allowed = tuple(dict.fromkeys(("base", "tool", "points", *places)))
    for part in parts:
        if part not in allowed:
            raise InputError("no such part to fit", key="--refit", found=part, allowed=allowed)


def _loosened(task: Task, refit: tuple[str, ...]) -> Task:
    """The task with these parts unknown."""
    observations = [
        replace(
            o,
            at=replace(o.at, unknown=o.place in refit or (o.at.frame is not None and o.of in refit)),
            target=replace(
                o.target,
                unknown="points" in refit and o.instrument.reads == "points",
                at=replace(o.target.at, unknown=o.target.name in refit and o.target.name != "tool"),
            ),
        )
        for o in task.observations
    ]
    return replace(task.observed(observations), base="base" in refit, tool="tool" in refit)


def _state(model: Model, robot: Robot, data: Any, refit: tuple[str, ...]) -> State:
    start = replace(model, setup=replace(model.setup, base=robot.base, tool=robot.tool))
    setup = place(start, data, Options()) if refit else start.setup
    return State(start, setup, np.zeros(len(model.parameters)))


def _draw(second: Again, folder: Path) -> None:
    from symcal.plots.halves import halves_map
    from symcal.plots.save import save_figures

    what = f"the recorded calibration and one from the {plural(second.poses, 'new pose')} alone"
    save_figures([halves_map(second.apart, what, "Two calibrations")], folder)


def _table(errors: dict[str, Errors], labels: tuple[str, ...]) -> Rows:
    return [
        {"state": state, "pose": labels[found.pose[k]], found.key: norm}
        for state, found in errors.items()
        for k, norm in enumerate(found.size)
    ]
