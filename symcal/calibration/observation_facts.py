"""What is measured and what is unknown, as plain dictionaries and words."""

from __future__ import annotations

from typing import Any

from symcal.model.observation import Observation
from symcal.model.task import Task


def observation_facts(o: Observation) -> dict[str, Any]:
    """One instrument and what it reads, in words and names."""
    return {
        "name": o.name,
        "entry": o.of,
        "type": o.instrument.name,
        "on": o.at.on,
        "target": o.target.name,
        "target_on": o.target.at.on,
        "features": list(o.features),
        "reads": o.instrument.label,
        "constrains": o.instrument.constrains,
        "reports": o.reports,
        "session": o.session,
        "quantities": [{"noise": q.noise, "unit": q.unit, "size": q.size} for q in o.instrument.quantities],
        "unknown": [
            *(f"{o.place}_{axis}" for axis in o.place_axes),
            *(f"{o.target.name}_{axis}" for axis in o.target_axes),
            *(o.target.qualified(point) for point in o.target.unknown_points if o.instrument.reads == "points"),
            *(item.name for item in o.instrument.unknowns(o.prefix)[0]),
        ],
    }


def unknown_words(task: Task) -> list[str]:
    """What of base, tool, points and instruments is estimated."""
    cameras = any(o.instrument.camera is not None for o in task.observations)
    found = {
        "base": task.base,
        "tool": task.tool,
        "points": any(o.target.unknown_points for o in task.observations if o.instrument.reads == "points"),
        "camera": cameras and any(o.at.unknown for o in task.observations if o.instrument.camera is not None),
        "intrinsics": cameras and any(o.instrument.has_unknowns for o in task.observations),
    }
    places = sorted(
        {o.place for o in task.observations if o.at.unknown and o.instrument.camera is None}
        | {o.target.name for o in task.observations if o.target.at.unknown}
    )
    return [*sorted(name for name, is_unknown in found.items() if is_unknown), *places]
