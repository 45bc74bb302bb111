"""The way through a plan as pictures of the arm: so many that it runs, so few that the page stays small."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.model.model import Model
from symcal.page.arm import Postures, postures
from symcal.page.body import body
from symcal.planning.drive_plan import Planned

Array = NDArray[np.float64]

FRAMES = 600
"""Pictures of the whole way; one more for every pose that comes too quickly for one."""

_PACE = 1.0  # s for a pose in the middle, where no speeds are known
_FEATURES = 8  # points of a pose that are drawn


@dataclass(frozen=True, slots=True, eq=False)
class Tour:
    """F pictures along the segments to the first poses of a plan.

    q: joint readings, shape (F, dof). times: of the pictures, s; at some pace where the plan knows no speeds.
    segments: which pose each is on the way to, from 0; the first picture is the start. reached: the picture at which
    each pose is.
    """

    q: Array
    times: Array
    segments: NDArray[np.intp]
    reached: NDArray[np.intp]


def tour(planned: Planned, most: int) -> Tour:
    """Pictures at even times along the waypoints, joints moving linearly between these; every pose has its own.

    Args:
        most: poses that are driven to; the way ends there.
    """
    segments = planned.motion.segments[:most]
    whole = sum(segment.time for segment in segments)
    pace = 1.0 if planned.timed else _PACE * len(segments) / max(whole, 1e-12)
    q, times, of, clock = [planned.start[None]], [np.zeros(1)], [np.zeros(1, dtype=np.intp)], 0.0
    for i, segment in enumerate(segments):
        pieces = max(1, round(FRAMES * segment.time / max(whole, 1e-12)))
        at = segment.time * np.arange(1, pieces + 1) / pieces
        own = [np.interp(at, segment.times, readings) for readings in segment.waypoints.T]
        q.append(np.stack(own, axis=1) if segment.time else segment.waypoints[-1:])
        times.append(pace * (clock + at))
        of.append(np.full(pieces, i))
        clock += segment.time
    reached = np.cumsum([len(own) for own in of])[1:] - 1
    return Tour(np.concatenate(q), np.concatenate(times), np.concatenate(of), reached)


def moved(model: Model, found: Tour) -> Postures:
    """The nominal arm at the pictures of a tour, in world."""
    count, none = len(found.q), np.zeros(len(model.parameters))
    arm = postures(model, model.setup, none, Dataset((), found.q, np.zeros((count, 0)), ("",) * count, ("",) * count))
    base = model.setup.base
    turn, shift = base[:3, :3].T, base[:3, 3]
    return replace(
        arm,
        nodes=arm.nodes @ turn + shift,
        axes=arm.axes @ turn,
        pointers=arm.pointers @ turn,
        measured={name: points @ turn + shift for name, points in arm.measured.items()},
    )


def tour_data(model: Model, found: Tour) -> dict[str, Any]:
    """The tour as the page's script plays it: `read`, what is read of the arm, where it is not the tool itself."""
    arm = moved(model, found)
    tool = arm.nodes[:, -1:]
    points = [p for p in arm.measured.values() if np.linalg.norm(p - tool, axis=2).max(initial=0.0) > 1.0]
    read = np.concatenate(points, axis=1)[:, :_FEATURES] if points else np.zeros((len(found.q), 0, 3))
    return {
        "through": list(arm.joints),
        "tour": {
            **body(model.robot, arm, found.q),
            "read": np.rint(read).astype(int).tolist() if read.size else None,
            "at": found.times.round(3).tolist(),
            "segment": found.segments.tolist(),
            "reached": found.reached.tolist(),
        },
    }
