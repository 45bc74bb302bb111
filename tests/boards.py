"""An arm with a camera in its hand, or two cameras around it, and a printed board: shared by tests of boards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from cases import ARM
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import symcal as sc
from symcal.camera.camera import Camera
from symcal.data.dataset import Dataset
from symcal.instruments import seen_by
from symcal.model.measurement import Setup
from symcal.model.model import Model, build_model
from symcal.spatial import inverse, look_at, transform

Array = NDArray[np.float64]

ROBOT = replace(
    ARM, links=tuple(replace(x, joint=replace(x.joint, name=f"j{i}")) for i, x in enumerate(ARM.links, start=1))
)
CAMERA = Camera(
    2448,
    2048,
    2300.0,
    2301.0,
    1223.5,
    1023.5,
    (-0.1, 0.08, 0.0002, -0.0003, 0.0),
    np.diag(np.square([0.5, 0.5, 0.5, 0.5, 1e-3, 3e-3, 1e-4, 1e-4, 3e-3])),
)
LARGE = sc.parse_board("charuco:12x9:30mm:22mm:DICT_4X4_100")
SMALL = sc.parse_board("charuco:4x3:60mm:44mm:DICT_4X4_50")
MOUNT = transform(Rotation.from_euler("xyz", [0.2, -0.1, 0.5]).as_matrix(), np.array([60.0, -20.0, 80.0]))
LYING = transform(Rotation.from_euler("xyz", [np.pi + 0.1, 0.05, 0.3]).as_matrix(), np.array([500.0, 100.0, 50.0]))
"""T_flange_camera, and T_world_board: its printed side is up."""


def lying(which: sc.Board) -> Array:
    """T_world_board with the printed side up, whichever that is."""
    return LYING if which.facing < 0 else LYING @ transform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))


def eye_in_hand(target: sc.Target, *, guess: bool = True, calibrate: bool = True) -> sc.Task:
    """A camera on the flange; where it and the target stand is unknown, with the truth as a guess or none."""
    eye = seen_by(CAMERA, calibrate=calibrate)
    at = sc.Place("flange", MOUNT if guess else None, True)
    place = LYING if target.board is None else lying(target.board)
    there = replace(target, at=sc.Place("world", place if guess else None, True))
    return sc.Task((sc.Observation(eye, "eye", at=at, target=there),))


def board(which: sc.Board = LARGE) -> sc.Target:
    return sc.Target("board", board=which)


def written_out(which: sc.Board) -> sc.Target:
    """The corners of a small board as points one by one."""
    return sc.Target("board", points={str(i): tuple(p) for i, p in enumerate(which.points.tolist())})


@cache
def built(which: sc.Board = LARGE, guess: bool = True) -> Model:
    return build_model(ROBOT, eye_in_hand(board(which), guess=guess))


def errors(rng: np.random.Generator, size: float = 1.0) -> dict[str, float]:
    return {n: float(rng.normal() * size * (0.3 if n[:2] in ("a_", "d_") else 0.002)) for n in ROBOT.parameters}


def flange_of(model: Model) -> Callable[[Array], Array]:
    setup = Setup(model.setup.base, np.eye(4)).vector
    return lambda q: np.asarray(model.flange(q, np.zeros(len(model.parameters)), setup)[0])


def postures(which: sc.Board, count: int, rng: np.random.Generator, spread: float = 1.0) -> Array:
    """Joint readings from which the camera in the hand looks at a board; views turn and move by so much of the most."""
    flange, found = flange_of(built(which)), []
    place = lying(which)
    centre = place[:3, :3] @ which.points.mean(axis=0) + place[:3, 3]
    while len(found) < count:
        away = -LYING[:3, 2] + spread * 0.8 * rng.normal(size=3)
        eye = centre + away / np.linalg.norm(away) * (500.0 + spread * rng.uniform(-120.0, 150.0))
        view = look_at(eye, centre + 40.0 * spread * rng.normal(size=3))
        roll = Rotation.from_rotvec([0.0, 0.0, spread * rng.uniform(-np.pi, np.pi)]).as_matrix()
        wanted = view @ transform(roll, np.zeros(3)) @ inverse(MOUNT)

        def off(q: Array, wanted: Array = wanted) -> Array:
            t = flange(q[None])[0]
            return np.concatenate([(t[:3, 3] - wanted[:3, 3]) / 100, (t[:3, :3] - wanted[:3, :3]).ravel()])

        tried = least_squares(off, rng.uniform(-2, 2, ROBOT.dof))
        if tried.cost < 1e-10:
            found.append((tried.x + np.pi) % (2 * np.pi) - np.pi)
    return np.array(found)


def measured(which: sc.Board, q: Array, truth: dict[str, float], sigma: float, rng: np.random.Generator) -> Dataset:
    """Image points with noise, of the corners that are seen."""
    return sc.simulate(built(which), truth, q, sc.Noise(image=sigma), rng)
