"""Pose of the tool in world, or of the world in the tool frame (an eye-in-hand camera that looks at a fixed board).

    r_p = p - p_z (mm),        r_w = log(R_z^T R) (rad)

so the sign of a measured quaternion does not matter. With ``invert`` the instrument rides on the tool and reports
T_tool_world: the residual
is then taken on T^-1, where the instrument's noise lives, and the accuracy on T, which is what the user asks about.
"""

from __future__ import annotations

import casadi as ca

from symcal import kinematics, spatial
from symcal.kinematics import Chain
from symcal.measurements.model import Group, Measurement, setup_symbol

SX = ca.SX


def pose(chain: Chain, *, invert: bool = False) -> Measurement:
    """The `pose` measurement: z = (x, y, z, qx, qy, qz, qw), mm, as the instrument gives it."""
    setup, _ = setup_symbol(chain, 0)
    r, p = chain.tool[:3, :3], chain.tool[:3, 3]
    omega = kinematics.omegas(chain.parameter_screws)
    if invert:
        # T^-1 = (R^T, -R^T p); with dp = v + omega x p its position moves by -R^T v, its attitude by -R^T omega
        v = ca.horzcat(*(screw.v for screw in chain.parameter_screws))
        seen_r, seen_p = r.T, -(r.T @ p)
        position_jacobian, body_omega = -(r.T @ v), -omega
    else:
        seen_r, seen_p = r, p
        position_jacobian, body_omega = kinematics.stack(chain.parameter_screws, p), r.T @ omega
    z = SX.sym("z", 7)
    z_r, z_p = spatial.quaternion_matrix(z[3:]), z[:3]
    rotation_error = spatial.log_rotation(z_r.T @ seen_r)
    residual = ca.vertcat(seen_p - z_p, rotation_error)
    jacobian = ca.vertcat(position_jacobian, spatial.right_jacobian_inverse(rotation_error) @ body_omega)
    # the measured tool pose in world, whatever the instrument's side
    tool_r, tool_p = (z_r.T, -(z_r.T @ z_p)) if invert else (z_r, z_p)
    error = ca.vertcat(p - tool_p, spatial.log_rotation(tool_r.T @ r))
    state = {"q": chain.q, "x": chain.x, "setup": setup}
    return Measurement(
        kind="pose",
        chain=chain,
        point_names=(),
        groups=(Group("position", "mm", (0, 1, 2), 3), Group("orientation", "rad", (3, 4, 5), 3)),
        predict=kinematics.function("pose", state, {"h": ca.vertcat(seen_p, _quaternion(seen_r))}),
        residual=kinematics.function("pose_residual", state | {"z": z}, {"r": residual, "J": jacobian}),
        jacobian=kinematics.function("pose_jacobian", state, {"J": ca.vertcat(position_jacobian, body_omega)}),
        accuracy=kinematics.function("pose_accuracy", state | {"z": z}, {"e": error}),
    )


def _quaternion(rotation: SX) -> SX:
    """Unit quaternion (x, y, z, w) of a rotation matrix, through its rotation vector; shape (4,)."""
    v = spatial.log_rotation(rotation)
    angle2 = ca.dot(v, v)
    small = angle2 < 1e-16
    angle = ca.sqrt(ca.if_else(small, 1.0, angle2))
    return ca.vertcat(ca.if_else(small, 0.5, ca.sin(angle / 2) / angle) * v, ca.if_else(small, 1.0, ca.cos(angle / 2)))
