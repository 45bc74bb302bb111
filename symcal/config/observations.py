"""Instruments and targets of an experiment file as observations, in mm and rad."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board, parse_board
from symcal.camera.files import read_camera, read_target
from symcal.camera.target import Target as Marks
from symcal.config.experiment import ExperimentFile
from symcal.config.measurements import RESERVED, NearConfig, ObservationConfig, PlaceConfig
from symcal.config.sources import existing, sessions_of
from symcal.documents.document import Document, Key
from symcal.errors import InputError
from symcal.instruments import KINDS, Edge, Instrument
from symcal.model.observation import Observation, Place, Point, Target
from symcal.model.task import Scene, Task, pixels_task

Array = NDArray[np.float64]


def observed(file: ExperimentFile, document: Document) -> Task:
    """What an experiment measures, without its priors and sizes.

    Raises:
        InputError: with file, line and key, for what is missing, unknown or makes no sense together.
    """
    return _in_short(file, document) if file.measurement is not None else _at_length(file, document)


# ------------------------------------------------------------------------------------------------- measurement in short


def _in_short(file: ExperimentFile, document: Document) -> Task:
    m = file.measurement
    assert m is not None
    kind, length = KINDS[m.type], file.units.factor("mm")
    if m.points and kind.reads != "points":
        message = f"a {m.type} measurement has no points: give the tool frame in the robot file"
        raise document.error(message, ("measurement", "points"))
    for name, xyz in m.points.items():
        if xyz is None and "points" not in m.estimate:
            message = "this point has no coordinates: give them, or add 'points' to 'estimate'"
            raise document.error(message, ("measurement", "points", name))
    try:
        if m.is_camera:
            task = pixels_task(_scene(file, document), m.estimate)
        else:
            points: dict[str, Point | None] = {name: _triple(xyz, length) for name, xyz in m.points.items()}
            task = Task.of(m.type, m.estimate, points or None, invert=m.invert)
    except InputError as error:
        raise document.error(error.message, _key(error), found=error.found, allowed=error.allowed) from None
    noise = {name: value * _factor(file, kind(), name) for name, value in m.noise.items()}
    return task.observed(replace(o, noise=noise) for o in task.observations)


def _key(error: InputError) -> Key:
    return tuple((error.key or "measurement").split("."))


def _triple(xyz: Sequence[float] | None, length: float) -> Point:
    return (0.0, 0.0, 0.0) if xyz is None else (xyz[0] * length, xyz[1] * length, xyz[2] * length)


def _factor(file: ExperimentFile, kind: Instrument, quantity: str) -> float:
    """mm, rad or px per unit of the file, of a quantity; 1 if the kind has none of this name."""
    units = {q.noise: q.unit for q in kind.quantities}
    return file.units.factor(units.get(quantity, "px"))


def _scene(file: ExperimentFile, document: Document) -> Scene:
    """Camera, target and rough camera pose of a pixel measurement."""
    m = file.measurement
    assert m is not None
    camera = read_camera(existing(document, str(m.camera), ("measurement", "camera"), "camera file"))
    target = read_target(existing(document, str(m.target), ("measurement", "target"), "target file"))
    if m.camera_pose is None:
        return Scene(camera, target)
    return Scene(camera, target, _frame(m.camera_pose, file, document, ("measurement", "camera_pose")))


def _frame(given: Any, file: ExperimentFile, document: Document, key: Key) -> Array:
    try:
        return np.asarray(given.matrix(file.units.factor("mm"), file.units.factor("rad")))
    except InputError as error:
        raise document.error(error.message, key, found=error.found) from None


# ----------------------------------------------------------------------------------------------- measurements at length


def _at_length(file: ExperimentFile, document: Document) -> Task:
    observations: list[Observation] = []
    for section, names in (("targets", file.targets), ("measurements", file.measurements)):
        for name in names:
            if name in RESERVED:
                raise document.error(f"'{name}' is a name of the robot's own", (section, name), found=name)
            if section == "measurements" and name in file.targets:
                message = f"a target and an instrument are both called '{name}'"
                raise document.error(message, (section, name), found=name)
    for name, entry in file.measurements.items():
        if entry.value is None:
            observations += _entry(name, entry, file, document)
    for name, entry in file.measurements.items():
        if entry.value is not None:
            observations += _values(name, entry, observations, file, document)
    read = {entry.target for entry in file.measurements.values() if isinstance(entry.target, str)}
    for name in file.targets:
        if name not in read:
            raise document.error("no instrument reads this target", ("targets", name), found=name)
    return Task(tuple(observations), file.base == "unknown", file.tool == "unknown")


def _values(
    name: str, entry: ObservationConfig, observations: Sequence[Observation], file: ExperimentFile, document: Document
) -> list[Observation]:
    """What is known between two things: one observation, or one for each session that both have."""
    key: Key = ("measurements", name)
    instrument = _instrument(name, entry, file, document)
    noise = {q: value * _factor(file, instrument, q) for q, value in entry.noise.sizes().items()}
    units = [unit for _, unit in instrument.columns]
    given = entry.value if isinstance(entry.value, list) else [entry.value]
    if len(given) != len(units):
        columns = ", ".join(column for column, _ in instrument.columns)
        raise document.error("a value is a number for each column", (*key, "value"), found=given, allowed=columns)
    value = tuple(
        float(v) * file.units.factor(unit or "px") for v, unit in zip(given, units, strict=True) if v is not None
    )
    ends = [_things(name, part, observations, file, document) for part in ("at", "target")]
    per = [set(found) for found in ends if "" not in found]
    sessions = [s for found in ends for s in found if all(s in each for each in per)] if per else [""]
    if not sessions:
        raise document.error("no session has both of these", key)
    out = []
    for session in dict.fromkeys(sessions):
        label = f"{name}_{_plain(session)}" if session else name
        (place_name, at), (target_name, on) = (found.get(session) or found[""] for found in ends)
        points: dict[str, Point | None] = {"O": (0.0, 0.0, 0.0)}
        target = Target(target_name, on, points if instrument.reads == "points" else {})
        out.append(
            Observation(
                instrument,
                label,
                at,
                target,
                entry=name,
                session=session,
                noise=noise,
                place_name=place_name,
                value=value,
            )
        )
    return out


def _things(
    name: str, part: str, observations: Sequence[Observation], file: ExperimentFile, document: Document
) -> dict[str, tuple[str, Place]]:
    """What a value is between, by session ("" where there are none): the place of an entry of `measurements`, or of one
    session's, or a place of its own."""
    key: Key = ("measurements", name, part)
    config = getattr(file.measurements[name], part)
    if not isinstance(config, str):
        return {"": (f"{name}_{part}", _place(config, file, document, key))}
    found = {o.session if o.name != o.of else "": (o.place, o.at) for o in observations if o.of == config}
    for o in observations if not found else ():
        if o.name == config:
            found[""] = (o.place, o.at)
    if not found:
        message = "there is no entry of this name whose place this could be"
        raise document.error(message, key, found=config, allowed=[o.name for o in observations])
    return found


def _entry(name: str, entry: ObservationConfig, file: ExperimentFile, document: Document) -> list[Observation]:
    """The observations of an entry: one, or one per session of its data."""
    key: Key = ("measurements", name)
    instrument = _instrument(name, entry, file, document)
    at, place_name, own = _instrument_place(name, entry, file, document)
    target = _target(name, entry, instrument, file, document)
    noise = {q: value * _factor(file, instrument, q) for q, value in entry.noise.sizes().items()}
    per_axis = entry.noise.per == "axis"
    if per_axis:
        instrument = instrument.by_axis(observed=entry.reports == "instrument")
    observation = Observation(
        instrument, name, at, target, entry.reports, entry.session, name, noise, per_axis, place_name
    )
    target_config = file.targets.get(entry.target) if isinstance(entry.target, str) else entry.target
    per = [config for config in (own, target_config) if config is not None and config.per == "session"]
    if not per:
        return [observation]
    if entry.session:
        message = "'per: session' takes the sessions from the data: leave 'session' out"
        raise document.error(message, (*key, "session"), found=entry.session)
    sessions = sessions_of(name, entry, document)
    found = []
    for session in sessions:
        label = f"{name}_{_plain(session)}"
        there = replace(observation, name=label, session=session, place_name=place_name)
        if own.per == "session":
            there = replace(there, place_name=f"{place_name}_{_plain(session)}")
        if target_config is not None and target_config.per == "session":
            there = replace(there, target=replace(target, name=f"{target.name}_{_plain(session)}"))
        found.append(there)
    if not found:
        raise document.error("no session is in the data", (*key, "data"))
    return found


def _plain(session: str) -> str:
    """A session's name as part of a parameter's."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in session)


def _instrument(name: str, entry: ObservationConfig, file: ExperimentFile, document: Document) -> Instrument:
    kind = KINDS[entry.instrument]
    own = {key: getattr(entry, key) for key in kind.Config.model_fields}
    edge = Edge(
        file.units.factor("mm"),
        file.units.factor("rad"),
        lambda path, key: existing(document, path, ("measurements", name, key), "file"),
    )
    try:
        return kind.configured(kind.Config.model_validate(own), edge)
    except InputError as error:
        if error.file is not None:
            raise
        raise document.error(error.message, ("measurements", name), found=error.found) from None


def _instrument_place(
    name: str, entry: ObservationConfig, file: ExperimentFile, document: Document
) -> tuple[Place, str, PlaceConfig]:
    """Where an instrument stands, what its place is called, and what the file says of it."""
    key: Key = ("measurements", name, "at")
    seen = [name]
    while isinstance(entry.at, str):
        other = entry.at
        if other not in file.measurements or other in seen:
            message = "no such instrument to stand at" if other not in seen else "instruments stand at each other"
            raise document.error(message, key, found=other, allowed=[n for n in file.measurements if n != name])
        seen.append(other)
        entry = file.measurements[other]
    return _place(entry.at, file, document, key), seen[-1], entry.at


def _place(config: PlaceConfig, file: ExperimentFile, document: Document, key: Key) -> Place:
    unknown = config.place == "unknown"
    given = config.near if unknown else config.place
    frame = None if given is None else _frame(given, file, document, (*key, "near" if unknown else "place"))
    return Place(config.on, frame, unknown)


def _target(
    name: str, entry: ObservationConfig, instrument: Instrument, file: ExperimentFile, document: Document
) -> Target:
    key: Key = ("measurements", name, "target")
    config, called = entry.target, f"{name}_target"
    if isinstance(config, str):
        called = config
        if called not in file.targets:
            raise document.error("no such target", key, found=called, allowed=file.targets)
        key, config = ("targets", called), file.targets[called]
    length = file.units.factor("mm")
    place = _place(config, file, document, key)
    points: dict[str, Point | None] = {
        n: _triple(xyz, length) if isinstance(xyz, list) else None for n, xyz in config.points.items()
    }
    near = {n: _triple(xyz.near, length) for n, xyz in config.points.items() if isinstance(xyz, NearConfig)}
    axes = {n: (v[0], v[1], v[2]) for n, v in config.axes.items()}
    marks: Marks | None = None
    if config.file is not None:
        marks = read_target(existing(document, config.file, (*key, "file"), "target file"))
        points = {**marks.by_name}
    board = None if config.board is None else board_of(config.board, document, (*key, "board"))
    if instrument.reads == "points" and not points and not axes and board is None:
        points = {"P": (0.0, 0.0, 0.0)}  # the origin of the place itself
    if instrument.reads == "axes" and not axes and not points:
        axes = {"z": (0.0, 0.0, 1.0)}
    incidence = None if config.incidence is None else config.incidence * file.units.factor("rad")
    made = Target(called, place, points, axes, marks, near=near, board=board, incidence=incidence)
    if config.seen is None:
        return made
    if config.seen != "whole" and config.seen > len(made.points):
        message = f"the target has {len(made.points)} points"
        raise document.error(message, (*key, "seen"), found=config.seen)
    return replace(made, least=len(made.points) if config.seen == "whole" else config.seen)


def board_of(text: str, document: Document, key: Key) -> Board:
    """The board of a text in the file."""
    try:
        return parse_board(text)
    except InputError as error:
        raise document.error(error.message, key, found=error.found, allowed=error.allowed) from None
