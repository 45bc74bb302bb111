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
from symcal.errors import RefusedError
from symcal.planning.area import halton
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
View = Callable[[Array], Array]
"""T_camera_board of a board's centre, (N, 4, 4), mm, by postures (N, dof)."""

BOARD = "charuco:9x6:28mm:20mm:DICT_4X4_50"
"""Fits on A4."""

_CAMERA = np.array([0.0, -60.0, 40.0])  # from the tool, where its z axis points out of the flange
_AWAY = {"down": 400.0, "outward": 700.0}  # mm: of the board from the camera
_NEAREST = 300.0  # mm: of the same, where the arm cannot lift the camera so high above its base
_BALL = np.array([0.0, 0.0, 120.0])  # as the camera
_POINT, _HIGH = (
    np.array([60.0, 0.0, 40.0]),
    np.array([60.0, 0.0, 80.0]),
)  # as the camera: of reflector or hook; of a gauge
_OFF_AXIS, _TILT = np.deg2rad(12.0), np.deg2rad(25.0)  # of a board, by one joint: its direction, its tilt
_VIEW = np.array([600.0, 320.0]) / 925.0  # x/z and y/z of the camera in first files, 40 px from its border
_SHARE, _EVEN, _LESS = (
    0.15,
    2000,
    0.9,
)  # least share of an area that sees all of a board, of so many postures; shrinking
_QUARTER = np.pi / 2  # rad: turns of a joint beyond that are for nobody's cable
_ASKEW = np.pi / 4  # rad: a tool that misses its direction by more points elsewhere
_NEARER = 0.25  # or farther by this share of its distance
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
    """The guesses for an arm and an instrument.

    Raises:
        RefusedError: the instrument needs a tool that points where this arm's cannot.
    """
    if draft.view is None:
        home = posture(robot, draft.facing)
        return Cell(
            home, _around(robot, home, np.deg2rad(draft.turn)), _held(home) | _PLACES.get(draft.name, _nothing)(home)
        )
    height = _AWAY["down"] + _CAMERA[2] if draft.facing == "down" else None  # with the board on the table
    home = posture(robot, draft.facing, height)
    if draft.facing == "outward" and home.missed > _ASKEW:
        raise RefusedError(
            f"the tool of '{robot.name}' cannot point level and away from the arm, and a board on it would not face a "
            "camera that stands there: '--instrument board' has the camera in the hand"
        )
    board = parse_board(BOARD)
    places, view = _seen(home, draft, board)
    return Cell(home, _in_view(robot, home, view, board, draft.view), places)


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


def _in_view(robot: Robot, home: Posture, view: View, board: Board, times: float) -> Array:
    """How far each joint alone may move before a board leaves the view; and up to ``times`` as far, if the whole board
    is still seen in a fair share of such an area."""
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
        ends.append(np.abs(reach - home.q))
    turns = np.array([joint.revolute for joint in robot.joints])
    least, most = np.where(turns, np.deg2rad(5.0), 20.0), np.where(turns, _QUARTER, np.inf)
    even = halton(_EVEN, robot.dof)
    while True:
        below, above = (np.minimum(times * np.maximum(end, least), most) for end in ends)
        area = _rounded(robot, home, home.q - below, home.q + above)
        lower, upper = np.where(turns, np.deg2rad(area.T), area.T)
        if times <= 1.0 or np.mean(_whole(view(lower + even * (upper - lower)), board)) >= _SHARE:
            return area
        times *= _LESS


def _whole(seen: Array, board: Board) -> NDArray[np.bool_]:
    """Whether all inner corners of a board, T_camera_board (N, 4, 4) of its centre, are in the image."""
    x, y = np.array([board.columns - 2, board.rows - 2]) * board.square / 2
    corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [-x, y, 0.0], [x, y, 0.0]])
    points = corners @ seen[:, :3, :3].swapaxes(1, 2) + seen[:, None, :3, 3]
    return np.asarray((np.abs(points[:, :, :2]) < _VIEW * points[:, :, 2:]).all(axis=(1, 2)))


def _kept(seen: Array, first: Array) -> Array:
    """Whether a board, T_camera_board (N, 4, 4) of its centre, is about as much in view as at first."""
    centre, depth = seen[:, :3, 3], first[2, 3]
    off = np.arctan2(np.hypot(centre[:, 0], centre[:, 1]), centre[:, 2])
    tilt = np.arccos(np.clip(seen[:, 2, 2], -1.0, 1.0))
    return np.asarray((off < _OFF_AXIS) & (tilt < _TILT) & (np.abs(centre[:, 2] / depth - 1.0) < _NEARER))


# --------------------------------------------------------------------------------------------------------------- places


def _held(home: Posture) -> dict[str, str]:
    """What is on the tool, in the tool frame or one that is turned out of the flange."""
    out = np.array([1.0, 1.0, home.outward])
    turned = (
        ""
        if home.outward > 0
        else "\n    place: {rpy: [180, 0, 0]}    # turned, so that its z points out of the flange"
    )
    return {"point": numbers_text(out * _POINT), "high": numbers_text(out * _HIGH), "turned": turned}


def _seen(home: Posture, draft: Draft, board: Board) -> tuple[dict[str, str], View]:
    """The places of camera and board, and T_camera_centre of the board's centre by postures."""
    middle = spatial.transform(np.eye(3), np.array([board.columns, board.rows, 0.0]) * board.square / 2)
    if draft.facing == "down":  # the camera rides on the tool
        flange = spatial.rpy_matrix(np.array([0.0 if home.outward > 0 else np.pi, 0.0, 0.0]))
        hand = spatial.transform(flange, flange @ _CAMERA)
        first = home.tool() @ hand
        away = float(np.clip(first[2, 3], _NEAREST, _AWAY["down"]))
        place = _round_frame(_level(first @ _ahead(away)) @ spatial.inverse(middle))

        def from_hand(q: Array) -> Array:
            return np.asarray(np.linalg.inv(home.arm.tool(q) @ hand) @ (place @ middle))

        return {"board": BOARD, "place": frame_text(place), "hand": frame_text(hand)}, from_hand
    turned = spatial.rpy_matrix(np.array([np.pi, 0.0, 0.0]))
    mount = spatial.transform(turned, np.round([-middle[0, 3], middle[1, 3], 20.0]))
    camera = _round_frame(_upright(home.tool() @ mount @ middle @ spatial.inverse(_ahead(_AWAY["outward"]))))

    def from_stand(q: Array) -> Array:
        return np.asarray(np.linalg.inv(camera) @ home.arm.tool(q) @ mount @ middle)

    places = {"board": BOARD, "place": frame_text(camera), "mount": numbers_text(mount[:3, 3])}
    return places, from_stand


def _ahead(away: float) -> Array:
    return spatial.transform(np.eye(3), np.array([0.0, 0.0, away]))


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
    return np.asarray(home.outward * tool[:3, :3] @ _BALL + tool[:3, 3])


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


def _upright(camera: Array) -> Array:
    """Turned about its axis until y, down in its images, is down; as it is where it looks straight up or down."""
    z = camera[:3, 2]
    x = np.cross([0.0, 0.0, -1.0], z)
    if np.linalg.norm(x) < np.sin(_FLAT):
        return camera
    x = x / np.linalg.norm(x)
    return spatial.transform(np.column_stack([x, np.cross(z, x), z]), camera[:3, 3])


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
