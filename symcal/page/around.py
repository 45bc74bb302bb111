"""What stands around the arm of a plan, as lines, patches and marks that the page's script draws."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.model.model import Model
from symcal.model.symbols import places_of
from symcal.planning.plan_study import PlanStudy
from symcal.planning.surroundings import EDGES, boxes, field_of_view, planes
from symcal.plots.touched import things

Array = NDArray[np.float64]

_MOST = 12  # things of a kind that are drawn
_ROOM = 0.15  # about the scene, of its size, where planes are drawn
_SAME = 1.0  # mm: what is nearer to the camera is the camera


def around(found: PlanStudy, model: Model, scene: Array) -> list[dict[str, Any]]:
    """Keep-out boxes and planes, the camera, and instruments, targets and what is touched where the file says a place.

    Args:
        scene: points that are drawn anyway, shape (k, 3), mm, world.
    """
    problem, out = found.problem, []
    for box in boxes(found.file)[:_MOST]:
        lines = [point for edge in EDGES for point in (*box.corners[list(edge)], None)]
        out.append(_thing(box.name, "keep out", lines))
    low, high = scene.min(axis=0), scene.max(axis=0)
    for wall in planes(found.file)[:_MOST]:
        room = _ROOM * (high - low) * np.abs(wall.normal)
        patch = wall.patch(low - room, high + room)
        if patch is not None:
            out.append(_thing(wall.name, "plane", list(patch)))
    if problem.view is not None:
        field = field_of_view(problem.view, problem.arm.motion(found.planned.plan.poses)[0])
        corners, eye = list(field[:4]), field[4]
        lines = [p for corner in corners for p in (eye, corner, None)] + [*corners, corners[0]]
        out.append(_thing("camera", "camera", lines))
    if problem.touches is not None:
        touched = things(problem.info.measurement, problem.info.setup)
        out += [_thing(thing.name, "place", [thing.place]) for thing in touched[:_MOST]]
    boards = {o.target.name: o.target.board for o in model.task.observations if o.target.board is not None}
    for name, place in list(places_of(model.task.everything).items())[:_MOST]:
        if place.moves or place.frame is None:
            continue
        frame = model.setup.places[name]
        frame = model.setup.base @ frame if place.on == "base" else frame
        if name in boards:
            out.append(_thing(name, "board", _outline(boards[name], frame)))
        elif problem.view is None or np.linalg.norm(frame[:3, 3] - problem.view.T_world_camera[:3, 3]) > _SAME:
            out.append(_thing(name, "place", [frame[:3, 3]]))
    return out


def _outline(board: Board, frame: Array) -> list[Any]:
    """The rectangle around the points of a board that stands at a frame."""
    points = np.asarray(board.points)
    (a, b), (c, d) = points.min(axis=0), points.max(axis=0)
    flat = np.array([[a, b, 0], [c, b, 0], [c, d, 0], [a, d, 0], [a, b, 0]])
    return list(flat @ frame[:3, :3].T + frame[:3, 3])


def _thing(name: str, kind: str, points: list[Any]) -> dict[str, Any]:
    return {"name": name, "kind": kind, "points": [None if p is None else np.round(p, 1).tolist() for p in points]}
