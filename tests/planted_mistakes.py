"""Mistakes planted in good sets: what a person does wrong, written here by itself, on files of joint readings (rad, mm)
and readings (mm, quaternions x, y, z, w)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from symcal.data.dataset import Dataset
from symcal.robot.robot import Robot

Plant = Callable[[Dataset], Dataset]


@dataclass(frozen=True)
class Planted:
    """kind: of mistake that it belongs to. told: a text by which it can be told in the named class."""

    kind: str
    told: str
    plant: Plant


def joints(change: Callable[[np.ndarray], np.ndarray]) -> Plant:
    return lambda data: replace(data, q=change(data.q.copy()))


def readings(change: Callable[[np.ndarray], np.ndarray]) -> Plant:
    return lambda data: replace(data, z=change(data.z.copy()))


def column(j: int, change: Callable[[np.ndarray], np.ndarray]) -> Plant:
    def do(q: np.ndarray) -> np.ndarray:
        q[:, j] = change(q[:, j])
        return q

    return joints(do)


def swap(i: int, j: int) -> Plant:
    def do(q: np.ndarray) -> np.ndarray:
        q[:, [i, j]] = q[:, [j, i]]
        return q

    return joints(do)


def shifted(k: int) -> Plant:
    """Readings of row i stand in row i + k; the ends are cut off."""

    def do(data: Dataset) -> Dataset:
        n = len(data)
        own = np.arange(max(k, 0), n + min(k, 0))
        return replace(data.take(own), q=data.q[own - k])

    return do


def points_end(z: np.ndarray) -> int:
    return 3 if z.shape[1] == 7 else z.shape[1]


def axes(matrix: np.ndarray) -> Plant:
    """Positions in axes turned or mirrored by a matrix; orientations as they are."""

    def do(z: np.ndarray) -> np.ndarray:
        end = points_end(z)
        z[:, :end] = (z[:, :end].reshape(len(z), -1, 3) @ matrix.T).reshape(len(z), -1)
        return z

    return readings(do)


def points_times(factor: float) -> Plant:
    def do(z: np.ndarray) -> np.ndarray:
        z[:, : points_end(z)] *= factor
        return z

    return readings(do)


def turned(change: Callable[[Rotation], Rotation]) -> Plant:
    def do(z: np.ndarray) -> np.ndarray:
        z[:, 3:7] = change(Rotation.from_quat(z[:, 3:7])).as_quat()
        return z

    return readings(do)


def quaternion(order: list[int]) -> Plant:
    def do(z: np.ndarray) -> np.ndarray:
        z[:, 3:7] = z[:, [3 + i for i in order]]
        return z

    return readings(do)


def inverse_pose(z: np.ndarray) -> np.ndarray:
    r = Rotation.from_quat(z[:, 3:7]).inv()
    return np.hstack([-r.apply(z[:, :3]), r.as_quat()])


def left_handed(data: Dataset) -> Dataset:
    """Unity's axes: y is negated, and turns count accordingly."""
    data = axes(np.diag([1.0, -1.0, 1.0]))(data)
    if data.z.shape[1] == 7:
        data.z[:, [3, 5]] *= -1
    return data


def relocated(after: int) -> Plant:
    """The instrument is kicked: it stands 80 mm off and turned by 7 deg from a row on."""

    def do(z: np.ndarray) -> np.ndarray:
        r = Rotation.from_rotvec(np.deg2rad(7.0) * np.array([0.6, 0.64, 0.48]))
        end = points_end(z)
        points = z[after:, :end].reshape(-1, 3)
        middle = points.mean(axis=0)
        z[after:, :end] = (r.apply(points - middle) + middle + [50.0, -40.0, 48.0]).reshape(-1, end)
        if z.shape[1] == 7:
            z[after:, 3:] = (r * Rotation.from_quat(z[after:, 3:])).as_quat()
        return z

    return readings(do)


def planted(robot: Robot, kind: str) -> list[Planted]:
    """What goes wrong with joint columns and with positions or poses."""
    turning = [i for i, joint in enumerate(robot.joints) if joint.revolute]
    own = np.array([joint.revolute for joint in robot.joints])
    out = []
    for j in turning:
        out.append(Planted("joint sign", f"joint {j + 1} counts the other way", column(j, lambda v: -v)))
        out.append(Planted("joint zero", f"zero of joint {j + 1} is off by 90", column(j, lambda v: v - np.pi / 2)))
        out.append(Planted("joint zero", f"zero of joint {j + 1} is off by 180", column(j, lambda v: v + np.pi)))
        out.append(Planted("joint unit", f"joint {j + 1} is in radians", column(j, np.deg2rad)))
    out.append(
        Planted("joint unit", "all revolute joints are in radians", joints(lambda q: np.where(own, np.deg2rad(q), q)))
    )
    out.append(
        Planted("joint unit", "all revolute joints are in degrees", joints(lambda q: np.where(own, np.rad2deg(q), q)))
    )
    for j in range(robot.dof - 1):
        if robot.joints[j].revolute == robot.joints[j + 1].revolute:
            out.append(Planted("joint order", f"joint {j + 1} and joint {j + 2} are swapped", swap(j, j + 1)))
    if robot.dof > 2 and all(own == own[::-1]):
        out.append(Planted("joint order", "reversed order", joints(lambda q: q[:, ::-1].copy())))
    out += [Planted("row shift", "a row", shifted(k)) for k in (1, -1)]
    out += [
        Planted("unit", "metres, labelled as millimetres", points_times(1e-3)),
        Planted("unit", "millimetres, labelled as metres", points_times(1e3)),
        Planted("unit", "inches", points_times(1 / 25.4)),
        Planted("unit", "centimetres, labelled as millimetres", points_times(0.1)),
        Planted("left-handed", "left-handed", left_handed),
    ]
    if kind == "pose":
        out += [
            Planted("quaternion", "are w, x, y, z", quaternion([3, 0, 1, 2])),
            Planted("quaternion", "w stands first", quaternion([1, 2, 3, 0])),
            Planted("orientation", "inverse", turned(lambda r: r.inv())),
            Planted("inverse pose", "poses are inverse", readings(inverse_pose)),
            Planted("axes", "file's y, x, z", axes(np.eye(3)[[1, 0, 2]])),
            Planted("axes", "file's x, -y, z", axes(np.diag([1.0, -1.0, 1.0]))),
            Planted(
                "angles",
                "about z, y, x",
                turned(lambda r: Rotation.from_euler("xyz", r.as_euler("zyx")[:, ::-1])),
            ),
            Planted("angles", "rotation vector", turned(lambda r: Rotation.from_euler("xyz", r.as_rotvec()))),
        ]
    else:
        out += [
            Planted("left-handed", "left-handed", axes(np.eye(3)[[1, 0, 2]])),
            Planted("left-handed", "left-handed", axes(np.diag([-1.0, 1.0, 1.0]))),
        ]
    return out
