"""Where things came to stand and what is known between them, as plain data for results.json."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from symcal import spatial
from symcal.calibration.calibrate import Calibration
from symcal.calibration.held_out_places import HeldOutPlaces
from symcal.calibration.length import unseen_length
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.parameters import coordinate_names, frame_names
from symcal.units import SHOWN


def frame_facts(model: Model, setup: Setup, unknown: Collection[str] = ()) -> dict[str, Any]:
    """Base, tool, points, and places of instruments and targets, as found, in mm and deg.

    Args:
        unknown: parameters of what nothing tells: such places and points are left out.
    """

    def frame(matrix: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, list[float]]:
        return {
            "xyz_mm": matrix[:3, 3].tolist(),
            "rpy_deg": np.rad2deg(spatial.matrix_rpy(matrix[:3, :3])).tolist(),
        }

    read = {o.target.qualified(point) for o in model.task.observations for point in o.target.points}
    points = dict(zip(model.measurement.points_called, setup.points.tolist(), strict=True))
    return {
        "base": frame(setup.base),
        "tool": frame(setup.tool),
        **{name: frame(place) for name, place in setup.places.items() if not _among(frame_names(name), unknown)},
        "points_mm": {
            name.removeprefix("tool_"): xyz
            for name, xyz in points.items()
            if name in read and not _among(coordinate_names(name), unknown)
        },
    }


def _among(names: Iterable[str], others: Collection[str]) -> bool:
    return any(name in others for name in names)


def settled_facts(model: Model, found: HeldOutPlaces) -> dict[str, Any]:
    """What no training pose tells: names of places and points that were settled on the held-out poses, numbers of
    instruments that were, and the parameters that nothing tells."""
    things = {name: frame_names(name) for name in found.state.setup.places}
    things |= {name: coordinate_names(name) for name in model.measurement.points_called}
    return {
        "things": [name for name, parameters in things.items() if _among(parameters, found.settled)],
        "numbers": {
            name: {"value": value * _in_unit(p.unit)[1], "unit": _in_unit(p.unit)[0]}
            for name, (value, p) in found.numbers.items()
        },
        "unknown": list(found.unknown),
    }


def known_facts(calibration: Calibration, found: HeldOutPlaces) -> dict[str, dict[str, Any]]:
    """What is known between things, and what it came out as.

    used: whether it took part in the identification; of what only held-out poses place it did not, and is a check.
    value, sigma, found: a number for each column; found is None of what nothing places, and of kinds whose residual is
    no difference of readings.
    """
    unplaced = calibration.states["after"].unplaced
    out: dict[str, dict[str, Any]] = {}
    for o, residual, _ in calibration.model.measurement.known_rows(found.state.x, found.state.setup):
        kind = o.instrument
        assert o.value is not None
        sigma = np.concatenate([np.full(q.size, o.noise[q.noise]) for q in kind.quantities])
        came_out = None
        if kind.componentwise and not _among(o.names, found.unknown):
            came_out = residual * sigma + np.array(o.value)
        unit, factor = _in_unit(kind.quantities[0].unit)
        out[o.name] = {
            "between": [o.place, o.target.name],
            "type": kind.name,
            "reads": kind.label,
            "unit": unit,
            "value": [factor * v for v in o.value],
            "sigma": (factor * sigma).tolist(),
            "found": None if came_out is None else (factor * came_out).tolist(),
            "used": not _among(o.names, unplaced),
        }
    return out


def _in_unit(unit: str) -> tuple[str, float]:
    """The unit that people are shown, and how many of it one has."""
    return SHOWN[unit]


def length_facts(calibration: Calibration) -> dict[str, Any] | None:
    """The growth of all lengths, as a share, where nothing that is read sees it; None elsewhere."""
    found = unseen_length(calibration.model, calibration.after)
    return None if found is None else asdict(found)
