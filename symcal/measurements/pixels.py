r"""Image points of a target on the tool, as a fixed camera sees them.

    (u, v)_k = project(T_world_camera^-1 T_world_tool t_k)

With w_k = p + R t_k the point in world, y_k = R_c^T (w_k - p_c) in the camera frame, and P_k = d(u, v)/dy the
derivative of the projection, shape (2, 3),

    d(u, v)_k/dx = P_k R_c^T (v_x + omega_x x w_k)         for whatever moves the tool (`symcal.measurements.position`)
    d(u, v)_k/dt = -P_k R_c^T R_0                          for the camera's position,
    d(u, v)_k/dr = P_k [y_k]x J_r(r)                       for its rotation, J_r the right Jacobian of SO(3),

T_world_camera being its nominal value (R_0, p_0) times the increment (t, r). Intrinsics enter (u, v) directly.
"""

from __future__ import annotations

import casadi as ca

from symcal import spatial
from symcal.camera.camera import INTRINSIC_NAMES, distort, distortion_slopes
from symcal.kinematics import Chain, function
from symcal.measurements.model import Group, Measurement
from symcal.measurements.position import world_points
from symcal.parameters import frame_names

SX = ca.SX


def pixels(chain: Chain, point_names: tuple[str, ...]) -> Measurement:
    """The `pixels` measurement: z holds u, v in px of every target point in the order of ``point_names``."""
    count = len(point_names)
    coordinates, camera, intrinsics = SX.sym("points", 3 * count), SX.sym("camera", 12), SX.sym("intrinsics", 9)
    setup = ca.vertcat(chain.frames, coordinates, camera, intrinsics)
    nominal = [coordinates[3 * k : 3 * k + 3] for k in range(count)]
    points, by_tool = world_points(chain, nominal, point_names)
    x = dict(zip(chain.parameters.names, ca.vertsplit(chain.x), strict=True)) if len(chain.parameters) else {}
    turn, origin, shift, turn_slope = _camera_frame(camera, x)
    numbers = [intrinsics[i] + x.get(name, 0) for i, name in enumerate(INTRINSIC_NAMES)]
    place = {name: i for i, name in enumerate(chain.parameters.names)}
    images, jacobians, across = [], [], []
    for world, motion in zip(points, by_tool, strict=True):
        seen = turn.T @ (world - origin)
        by_point, image, by_intrinsics = _project(seen, numbers)
        jacobian = by_point @ (turn.T @ motion)
        by_camera = ca.horzcat(-by_point @ (turn.T @ shift), by_point @ spatial.skew(seen) @ turn_slope)
        for i, name in enumerate(frame_names("camera")):
            if name in place:
                jacobian[:, place[name]] = by_camera[:, i]
        for i, name in enumerate(INTRINSIC_NAMES):
            if name in place:
                jacobian[:, place[name]] = by_intrinsics[:, i]
        images.append(image)
        jacobians.append(jacobian)
        across.append(turn @ by_point.T @ ca.inv(by_point @ by_point.T))
    h, jacobian = ca.vertcat(*images), ca.vertcat(*jacobians)
    z = SX.sym("z", 2 * count)
    residual = h - z
    lateral = ca.vertcat(*(back @ residual[2 * k : 2 * k + 2] for k, back in enumerate(across)))
    state = {"q": chain.q, "x": chain.x, "setup": setup}
    return Measurement(
        kind="pixels",
        chain=chain,
        point_names=point_names,
        groups=(Group("image", "px", tuple(range(2 * count)), 2),),
        predict=function("pixels", state, {"h": h}),
        residual=function("pixels_residual", state | {"z": z}, {"r": residual, "J": jacobian}),
        jacobian=function("pixels_jacobian", state, {"J": jacobian}),
        accuracy=function("pixels_accuracy", state | {"z": z}, {"e": lateral}),
        points=function("pixels_points", state, {"p": ca.vertcat(*points), "J": ca.vertcat(*by_tool)}),
    )


def _camera_frame(nominal: SX, x: dict[str, SX]) -> tuple[SX, SX, SX, SX]:
    """R_c, p_c, and how they move with the increments: dp_c = R_0 dt, and J_r(r) of the body rates J_r(r) dr."""
    upper = ca.reshape(nominal, 3, 4)
    rotation, origin = upper[:, :3], upper[:, 3]
    names = frame_names("camera")
    t, r = (ca.vertcat(*(x.get(name, 0) for name in half)) for half in (names[:3], names[3:]))
    return rotation @ spatial.exp_rotation(r), origin + rotation @ t, rotation, spatial.left_jacobian(-r)


def _project(point: SX, intrinsics: list[SX]) -> tuple[SX, SX, SX]:
    """Derivative of the image point by the point in the camera frame (2, 3), the image point, and its derivative by
    the nine intrinsics (2, 9)."""
    fx, fy, cx, cy, *dist = intrinsics
    x, y, depth = point[0] / point[2], point[1] / point[2], point[2]
    xd, yd = distort(x, y, dist)
    (xx, yx), (xy, yy) = distortion_slopes(x, y, dist)
    by_point = ca.vertcat(
        fx / depth * ca.horzcat(xx, xy, -(xx * x + xy * y)), fy / depth * ca.horzcat(yx, yy, -(yx * x + yy * y))
    )
    r2 = x * x + y * y
    radial = [r2, r2**2, r2**3]
    by_u = [xd, 0, 1, 0, fx * x * radial[0], fx * x * radial[1], 2 * fx * x * y, fx * (r2 + 2 * x * x)]
    by_v = [0, yd, 0, 1, fy * y * radial[0], fy * y * radial[1], fy * (r2 + 2 * y * y), 2 * fy * x * y]
    by_intrinsics = ca.vertcat(ca.horzcat(*by_u, fx * x * radial[2]), ca.horzcat(*by_v, fy * y * radial[2]))
    return by_point, ca.vertcat(fx * xd + cx, fy * yd + cy), by_intrinsics
