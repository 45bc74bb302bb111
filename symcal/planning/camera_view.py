"""What a fixed camera sees of a target on the tool, at many poses."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.camera.camera import Camera, project_points
from symcal.camera.target import Target
from symcal.kernels import BatchFunction, batch_function
from symcal.kinematics import Chain
from symcal.model.measurement import Setup
from symcal.spatial import look_at as look_at

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CameraView:
    """A camera in the world, a target on the tool, and the arm between them at its nominal parameters.

    T_world_camera, T_tool_target: shape (4, 4), mm; made by `camera_view`.
    """

    camera: Camera
    T_world_camera: Array
    target: Target
    T_tool_target: Array
    chain: Chain
    setup: Setup
    _observe: BatchFunction

    @property
    def tool_points(self) -> Array:
        """The target's points in the tool frame, shape (k, 3), mm."""
        return np.asarray(self.target.points @ self.T_tool_target[:3, :3].T + self.T_tool_target[:3, 3])

    def observe(self, poses: Array) -> tuple[Array, Array]:
        """The target's points in the camera frame, shape (N, k, 3), mm, and the cosine of their incidence, (N, k).

        The incidence of a point is the angle between the target's normal and the ray from the point to the camera: zero
        when it is seen from straight ahead, above 90 degrees when only its back is seen.
        """
        T_camera_world = spatial.inverse(self.T_world_camera)
        normal = self.T_tool_target[:3, :3] @ np.asarray(self.target.normal)
        points, cosines = self._observe(poses, self.setup.vector[:24], T_camera_world, self.tool_points, normal)
        return points.reshape(len(poses), -1, 3), cosines

    def points(self, poses: Array) -> Array:
        """The target's points in the camera frame, shape (N, k, 3), mm, of poses (N, dof)."""
        return self.observe(poses)[0]

    def pixels(self, poses: Array) -> Array:
        """Their images, shape (N, k, 2), px; NaN for a point that the camera cannot see (`project_points`)."""
        return project_points(self.camera, self.points(poses))


def camera_view(
    chain: Chain, setup: Setup, camera: Camera, T_world_camera: Array, target: Target, T_tool_target: Array
) -> CameraView:
    """A `CameraView` of the arm's nominal kinematics.

    Args:
        T_world_camera, T_tool_target: pose of the camera (z along its view, y down) and of the target, (4, 4), mm.
    """
    # camera and target are arguments, so that moving them does not make another kernel
    T_camera_world, offsets, normal = (
        ca.SX.sym("camera", 4, 4),
        ca.SX.sym("points", len(target.names), 3),
        ca.SX.sym("n", 3),
    )
    turn, shift = T_camera_world[:3, :3], T_camera_world[:3, 3]
    rotation, origin = turn @ chain.tool[:3, :3], turn @ chain.tool[:3, 3] + shift
    points = [origin + rotation @ offsets[k, :].T for k in range(len(target.names))]
    cosines = [-ca.dot(rotation @ normal, point) / ca.norm_2(point) for point in points]
    nominal = (chain.q, np.zeros(len(chain.parameters)), chain.frames)
    at_nominal = ca.Function(
        "seen", [chain.q, chain.x, chain.frames, T_camera_world, offsets, normal], [*points, *cosines]
    )
    (*seen,) = at_nominal(*nominal, T_camera_world, offsets, normal)
    count = len(points)
    outputs = [ca.cse(ca.densify(ca.simplify(ca.vertcat(*part)))) for part in (seen[:count], seen[count:])]
    observe = ca.Function("observe", [chain.q, chain.frames, T_camera_world, offsets, normal], outputs)
    return CameraView(
        camera=camera,
        T_world_camera=np.asarray(T_world_camera, dtype=np.float64),
        target=target,
        T_tool_target=np.asarray(T_tool_target, dtype=np.float64),
        chain=chain,
        setup=setup,
        _observe=batch_function(observe),
    )


def axis_angles(points: Array) -> Array:
    """Angles (rad, 0 to pi) between the rays to points in the camera frame, shape (..., 3), and the optical axis."""
    return np.asarray(np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2]))


def triangle_area(pixels: Array) -> Array:
    """S = |u1 v2 + u2 v3 + u3 v1 - u1 v3 - u2 v1 - u3 v2|, px^2: twice the area of an image triangle, shape (..., 3,
    2).

    Source: [Ding2017] eq. 11.
    """
    a, b = pixels[..., 1, :] - pixels[..., 0, :], pixels[..., 2, :] - pixels[..., 0, :]
    return np.asarray(np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]))
