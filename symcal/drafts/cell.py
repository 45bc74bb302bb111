"""What a first experiment guesses of an arm's cell: how far joints may go, and where instruments and targets are.

All of it is rounded, so that it looks like the guess it is, and stands in the file to be changed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.camera.board import Board, parse_board
from symcal.drafts.instrument import Draft
from symcal.drafts.posture import Posture, posture
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

BOARD = "charuco:9x6:28mm:20mm:DICT_4X4_50"
"""Fits on A4."""

_CAMERA = spatial.transform(np.eye(3), np.array([0.0, -60.0, 40.0]))  # T_tool_camera of the templates
_AWAY = {"down": 400.0, "outward": 700.0}  # mm: of the board from the camera
_BALL = np.array([0.0, 0.0, 120.0])  # of the templates, in the tool frame
_OFF_AXIS, _TILT = np.deg2rad(12.0), np.deg2rad(25.0)  # of a board, by one joint
_NEARER = 0.25  # or farther, the same, as a share
_STEPS = np.linspace(0.0, np.pi / 2, 91)  # by which joints are moved, rad, to see where a board stays in view
_FLAT = np.deg2rad(15.0)  # a board that is nearer to level than this is laid flat
_APART = 150.0  # mm, of the sockets


@dataclass(frozen=True, slots=True)
class Cell:
    """posture: that the arm is measured around. area: lower and upper readings, shape (dof, 2), in deg and mm.

    places: numbers of the template, as text by placeholder.
    """

    posture: Posture
    area: Array
    places: Mapping[str, str]


def cell(robot: Robot, draft: Draft) -> Cell:
    """The guesses for an arm and an instrument."""
    if draft.turn is None:
        height = _AWAY["down"] + _CAMERA[2, 3] if draft.facing == "down" else None  # with the board on the table
        home = posture(robot, draft.facing, height)
        places, view = _seen(home, draft, parse_board(BOARD))
        return Cell(home, _in_view(robot, home, view), places)
    home = posture(robot, draft.facing)
    return Cell(home, _around(robot, home, np.deg2rad(draft.turn)), _PLACES.get(draft.name, _nothing)(home))


# ---------------------------------------------------------------------------------------------------- joint ranges


def _around(robot: Robot, home: Posture, turn: float) -> Array:
    """Joint readings within a turn of the posture, and whole strokes."""
    turns = np.array([joint.revolute for joint in robot.joints])
    reach = np.where(turns, turn, np.inf)
    return _rounded(robot, home, home.q - reach, home.q + reach)


def _rounded(robot: Robot, home: Posture, lower: Array, upper: Array) -> Array:
    """Ranges within the limits, rounded; deg and mm."""
    turns = np.array([joint.revolute for joint in robot.joints])

    def shown(q: Array) -> Array:
        return np.asarray(np.round(np.where(turns, np.rad2deg(q), q), 9))

    least, most = np.ceil(shown(home.lower) * 10.0) / 10.0, np.floor(shown(home.upper) * 10.0) / 10.0
    low, high = (np.round(shown(q) / 5.0) * 5.0 for q in (np.maximum(lower, -1e6), np.minimum(upper, 1e6)))
    return np.column_stack([np.maximum(low, least), np.minimum(high, most)])


def _in_view(robot: Robot, home: Posture, view: Callable[[Array], Array]) -> Array:
    """How far each joint alone may move before a board, T_camera_board of postures (N, dof), leaves the view."""
    first = view(home.q[None])[0]
    ends = []
    for sign in (-1.0, 1.0):
        reach = home.q.copy()
        for i, joint in enumerate(robot.joints):
            q = np.tile(home.q, (len(_STEPS), 1))
            q[:, i] += sign * _STEPS * (1.0 if joint.revolute else 500.0)
            inside = (q[:, i] >= home.lower[i] - 1e-9) & (q[:, i] <= home.upper[i] + 1e-9)
            good = inside & _kept(view(q), first)
            reach[i] = q[len(good) - 1 if good.all() else max(int(np.argmin(good)) - 1, 0), i]
        ends.append(reach)
    least = np.array([np.deg2rad(5.0) if joint.revolute else 20.0 for joint in robot.joints])
    return _rounded(robot, home, np.minimum(ends[0], home.q - least), np.maximum(ends[1], home.q + least))


def _kept(seen: Array, first: Array) -> Array:
    """Whether a board, T_camera_board (N, 4, 4) of its centre, is about as much in view as at first."""
    centre, depth = seen[:, :3, 3], first[2, 3]
    off = np.arctan2(np.hypot(centre[:, 0], centre[:, 1]), centre[:, 2])
    tilt = np.arccos(np.clip(seen[:, 2, 2], -1.0, 1.0))
    return np.asarray((off < _OFF_AXIS) & (tilt < _TILT) & (np.abs(centre[:, 2] / depth - 1.0) < _NEARER))


# --------------------------------------------------------------------------------------------------------------- places


def _seen(home: Posture, draft: Draft, board: Board) -> tuple[dict[str, str], Callable[[Array], Array]]:
    """The places of camera and board, and T_camera_centre of the board's centre by postures."""
    middle = spatial.transform(np.eye(3), np.array([board.columns, board.rows, 0.0]) * board.square / 2)
    ahead = spatial.transform(np.eye(3), np.array([0.0, 0.0, _AWAY[draft.facing]]))
    if draft.facing == "down":  # the camera rides on the tool
        place = _round_frame(_level(home.tool() @ _CAMERA @ ahead) @ spatial.inverse(middle))

        def from_hand(q: Array) -> Array:
            return np.asarray(np.linalg.inv(home.arm.tool(q) @ _CAMERA) @ place @ middle)

        return {"board": BOARD, "place": frame_text(place)}, from_hand
    turned = spatial.rpy_matrix(np.array([np.pi, 0.0, 0.0]))
    mount = spatial.transform(turned, np.round([-middle[0, 3], middle[1, 3], 20.0]))
    camera = _round_frame(home.tool() @ mount @ middle @ spatial.inverse(ahead))

    def from_stand(q: Array) -> Array:
        return np.asarray(np.linalg.inv(camera) @ home.arm.tool(q) @ mount @ middle)

    places = {"board": BOARD, "place": frame_text(camera), "mount": numbers_text(mount[:3, 3])}
    return places, from_stand


def _wire(home: Posture) -> dict[str, str]:
    """Beside the arm, on the table: off every axis, so that no turn of a joint is unseen."""
    x, y = home.tool()[:2, 3]
    angle = np.arctan2(y, x) + np.deg2rad(50.0)
    anchor = home.reach * np.array([np.cos(angle), np.sin(angle), 0.0])
    return {"anchor": numbers_text(_round(anchor))}


def _gauge(home: Posture) -> dict[str, str]:
    ball = _ball(home)
    return {"table": numbers_text(_round(np.array([ball[0], ball[1], 0.0])))}


def _sockets(home: Posture) -> dict[str, str]:
    ball = _round(_ball(home))
    beside = _sideways(ball) * _APART / 2
    return {"left": numbers_text(np.round(ball + beside)), "right": numbers_text(np.round(ball - beside))}


def _plates(home: Posture) -> dict[str, str]:
    """Three plates through the same region, whose normals are 40 deg apart from the upright one."""
    ball = _round(_ball(home))
    beside = _round(_sideways(ball) * 100.0)
    return {
        "floor": f"{{xyz: {numbers_text(ball)}}}",
        "ramp": f"{{xyz: {numbers_text(ball + beside)}, rpy: [40, 0, 0]}}",
        "side": f"{{xyz: {numbers_text(ball - beside)}, rpy: [0, 40, 0]}}",
    }


def _nothing(_: Posture) -> dict[str, str]:
    return {}


_PLACES: Mapping[str, Callable[[Posture], dict[str, str]]] = {
    "wire": _wire,
    "gauge": _gauge,
    "socket": _sockets,
    "plate": _plates,
}


def _ball(home: Posture) -> Array:
    tool = home.tool()
    return np.asarray(tool[:3, :3] @ _BALL + tool[:3, 3])


def _sideways(point: Array) -> Array:
    """Level, and across the way to a point."""
    return np.array([-point[1], point[0], 0.0]) / max(float(np.hypot(point[0], point[1])), 1.0)


def _round(xyz: Array) -> Array:
    return np.asarray(np.round(xyz / 10.0) * 10.0)


def _level(frame: Array) -> Array:
    """With z straight down where it is nearly so: boards lie flat."""
    if np.arccos(np.clip(-frame[2, 2], -1.0, 1.0)) > _FLAT:
        return frame
    yaw = np.arctan2(frame[1, 0], frame[0, 0])
    return spatial.transform(spatial.rpy_matrix(np.array([np.pi, 0.0, yaw])), frame[:3, 3])


def _round_frame(frame: Array) -> Array:
    """To 10 mm and 5 deg."""
    rpy = np.deg2rad(np.round(np.rad2deg(spatial.matrix_rpy(frame[:3, :3])) / 5.0) * 5.0)
    return spatial.transform(spatial.rpy_matrix(rpy), _round(frame[:3, 3]))


def numbers_text(values: NDArray[np.floating[Any]]) -> str:
    """Numbers as a list in YAML; whole ones without a point."""
    return f"[{', '.join(f'{value + 0.0:.12g}' for value in np.round(values, 9))}]"


def frame_text(frame: Array) -> str:
    """A frame in YAML, mm and deg."""
    rpy = np.rad2deg(spatial.matrix_rpy(frame[:3, :3]))
    rpy = np.where(rpy < -180.0 + 1e-6, 180.0, rpy)
    return f"{{xyz: {numbers_text(frame[:3, 3])}, rpy: {numbers_text(np.round(rpy, 6))}}}"
