"""Which parameters a model has: links, then base, tool, tool points, camera and its intrinsics."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np

from symcal.camera.camera import INTRINSIC_NAMES, Camera
from symcal.parameters import SCALE, JointPrior, Parameter, ParameterSet, Unit, frame_names, point_names
from symcal.robot.robot import Robot, is_angle

_FOCAL = 0.01  # plausible error of focal length and principal point, as a share of focal length and image width
_DISTORTION = 0.1  # of a distortion coefficient
_PRIOR_SIGMAS = 10.0  # a joint prior determines what it is about: scales of at least so many of its sigmas


def parameter_set(
    robot: Robot,
    *,
    base: bool = False,
    tool: Literal["frame", "position"] | None = None,
    points: Iterable[str] = (),
    camera: bool = False,
    intrinsics: Camera | None = None,
) -> ParameterSet:
    """All parameters that a model of this robot has.

    Args:
        robot: gives the link parameters, their nominal values and the scales that its file states.
        base: six increments `base_x`..`base_rz` on the nominal base frame (rotation vector, applied on the right).
        tool: the same for the tool frame, or its position alone.
        points: names of tool points whose coordinates are parameters (`tool_P1_x`, ...).
        camera: six increments `camera_x`..`camera_rz` on the nominal pose of a camera in world.
        intrinsics: a camera whose numbers (`fx`, .., `k3`) are parameters; its covariance is their prior, and what its
            calibration held is no parameter. Without a covariance all nine are, without a prior.
    """
    entries: list[tuple[str, Unit, float]] = [
        (name, "rad" if is_angle(name.rpartition("_")[0]) else "mm", value) for name, value in robot.parameters.items()
    ]
    if base:
        entries += _frame("base", 6)
    if tool:
        entries += _frame("tool", 6 if tool == "frame" else 3)
    entries += [(name, "mm", 0.0) for point in points for name in point_names(point)]
    if camera:
        entries += _frame("camera", 6)
    links = robot.parameters
    items = [
        Parameter(name, unit, value, robot.scales.get(name, SCALE[unit]), unknown=name not in links)
        for name, unit, value in entries
    ]
    if intrinsics is None:
        return ParameterSet(tuple(items))
    free, priors = _intrinsics(intrinsics)
    return ParameterSet((*items, *free), priors)


def _intrinsics(camera: Camera) -> tuple[list[Parameter], tuple[JointPrior, ...]]:
    covariance = camera.covariance
    variance = np.ones(len(INTRINSIC_NAMES)) if covariance is None else np.diag(covariance)
    free = np.flatnonzero(variance > 0)
    items = []
    for i in free:
        name = INTRINSIC_NAMES[i]
        unit: Unit = "px" if i < 4 else "1"
        size = _FOCAL * (camera.fx, camera.fy, camera.width, camera.width)[i] if i < 4 else _DISTORTION
        scale = size if covariance is None else max(size, _PRIOR_SIGMAS * float(np.sqrt(variance[i])))
        items.append(Parameter(name, unit, float(camera.intrinsics[i]), scale, unknown=True))
    if covariance is None or not free.size:
        return items, ()
    return items, (JointPrior(tuple(p.name for p in items), covariance[np.ix_(free, free)]),)


def _frame(name: str, count: int) -> list[tuple[str, Unit, float]]:
    return [(name, "mm" if i < 3 else "rad", 0.0) for i, name in enumerate(frame_names(name)[:count])]
