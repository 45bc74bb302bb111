"""What measured, as plain data in calibrated.yaml: what a later validation needs to know of instruments and targets."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.camera.board import parse_board
from symcal.camera.files import camera_from_dict, target_from_dict, target_to_dict
from symcal.errors import InputError
from symcal.instruments import KINDS
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.model.observation import Observation, Place, Point, Target
from symcal.model.task import Scene, Task, pixels_task

Array = NDArray[np.float64]
State = Literal["before", "after"]

_KEY = "calibration.provenance"


def measurement_record(model: Model, nominal: Setup, found: Setup, errors: Mapping[str, float]) -> dict[str, Any]:
    """Every observation with its places, points and numbers before and after, mm, poses as x, y, z and a quaternion.

    Args:
        nominal: the frames fitted with nominal kinematics. found: the identified ones. errors: of all parameters.
    """
    return {o.name: _observation(model, o, nominal, found, errors) for o in model.task.observations}


def _observation(
    model: Model, o: Observation, nominal: Setup, found: Setup, errors: Mapping[str, float]
) -> dict[str, Any]:
    called = model.measurement.points_called
    states = {}
    for state, setup, own in (("before", nominal, {}), ("after", found, o.own_errors(errors))):
        shifts = {
            n: nominal.own[f"{o.prefix}{n}"] - v for n, v in zip(o.instrument.own, o.instrument.numbers, strict=True)
        }
        instrument = o.instrument.corrected({n: shifts[n] + own.get(n, 0.0) for n in o.instrument.own})
        at = _points_at(o, setup, called)
        states[state] = {
            "settings": instrument.record(),
            "points_mm": at,
            "places": {n: _pose(setup.places[n]) for n in dict.fromkeys((o.place, o.target.name)) if n in setup.places},
        }
    target: dict[str, Any] = _limits(o.target) | {
        "name": o.target.name,
        "on": o.target.at.on,
        "axes": {k: list(v) for k, v in o.target.axes.items()},
    }
    if o.target.marks is not None:
        target["marks"] = {k: v for k, v in target_to_dict(o.target.marks).items() if k != "mount"}
    return {
        "instrument": o.instrument.name,
        "on": o.at.on,
        "reports": o.reports,
        "session": o.session,
        "entry": o.of,
        "names": {"place": o.place, "prefix": o.prefix},
        "unknown": {"place": o.at.unknown, "target": o.target.at.unknown, "points": list(o.target.unknown_points)},
        "target": target,
        **states,
    }


def _points_at(o: Observation, setup: Setup, called: tuple[str, ...]) -> dict[str, list[float]]:
    """Where the points of a target are in its frame, mm; those of a board are in its name."""
    if o.target.board is not None:
        return {}
    if o.target.rigid:
        return dict(zip(o.target.points, o.target.nominal.tolist(), strict=True))
    return {n: setup.points[called.index(o.target.qualified(n))].tolist() for n in o.target.points}


def _limits(target: Target) -> dict[str, Any]:
    """What is said of a target that cameras see."""
    said = {"board": None if target.board is None else str(target.board), "incidence_rad": target.incidence}
    return {name: value for name, value in (said | {"least": target.least}).items() if value is not None}


def recorded_task(provenance: Mapping[str, Any], state: State, file: Path) -> Task:
    """The task of a calibration with everything known, as it was before or after.

    Raises:
        InputError: the file was changed by hand into something that is no calibration.
    """
    record = provenance.get("measurements")
    if record is None:
        return _earlier(provenance.get("measurement"), state, file)
    try:
        return Task(tuple(_recorded(name, each, state, file) for name, each in record.items()))
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError("the calibration does not say how it was measured", file=file, key=_KEY) from None


def _recorded(name: str, record: Mapping[str, Any], state: State, file: Path) -> Observation:
    own, target, names = record[state], record["target"], record["names"]
    places = {n: spatial.pose_matrix(np.array(pose, dtype=float)) for n, pose in own["places"].items()}
    if record["instrument"] not in KINDS:
        message = "this was measured by a kind of instrument that is not registered"
        raise InputError(message, file=file, key=_KEY, found=record["instrument"], allowed=KINDS)
    marks = target.get("marks")
    return Observation(
        KINDS[record["instrument"]].recalled(own["settings"], file),
        name,
        at=Place(record["on"], places.get(names["place"])),
        target=Target(
            target["name"],
            Place(target["on"], places.get(target["name"])),
            _points(own["points_mm"]),
            {k: (float(x), float(y), float(z)) for k, (x, y, z) in target["axes"].items()},
            None if marks is None else target_from_dict(marks, file),
            board=None if "board" not in target else parse_board(target["board"]),
            incidence=target.get("incidence_rad"),
            least=target.get("least"),
        ),
        reports=record["reports"],
        session=record["session"],
        entry=record["entry"],
        place_name=names["place"],
        own_prefix=names["prefix"],
    )


def _earlier(found: Any, state: State, file: Path) -> Task:
    """The task of a calibrated.yaml of before there were several instruments."""
    if not isinstance(found, dict) or found.get("type") not in KINDS:
        raise InputError("the calibration does not say how it was measured", file=file, key=_KEY)
    if "scene" in found:
        own = found["scene"][state]
        pose = spatial.pose_matrix(np.array(own["T_world_camera"], dtype=float))
        camera = camera_from_dict(own["camera"], file)
        return pixels_task(Scene(camera, target_from_dict(found["scene"]["target"], file), pose), ())
    points = _points(found.get("points_mm") or {}) or None
    return Task.of(found["type"], (), points, invert=bool(found.get("invert", False)))


def _points(found: Mapping[str, Any]) -> dict[str, Point | None]:
    return {name: (float(x), float(y), float(z)) for name, (x, y, z) in found.items()}


def _pose(frame: Array) -> list[float]:
    """x, y, z in mm and a quaternion x, y, z, w."""
    return [float(v) for v in spatial.matrix_pose(frame)]
