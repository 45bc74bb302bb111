"""Positions of one or more tool points in world: laser tracker, motion capture, probing.

    h_k(q, x) = p + R (t_k + dt_k),        dh_k/dx = v_x + omega_x x h_k      (+ R for the point's own coordinates)

with T_world_tool = (R, p), t_k the point in the tool frame and (omega_x, v_x) the screw of a parameter.
"""

from __future__ import annotations

import casadi as ca

from symcal import kinematics
from symcal.kinematics import Chain
from symcal.measurements.model import Group, Measurement, setup_symbol
from symcal.parameters import point_names

SX = ca.SX


def world_points(chain: Chain, nominal: list[SX], names: tuple[str, ...]) -> tuple[list[SX], list[SX]]:
    """Tool points in world, shape (3,) each, and their Jacobians by parameters, shape (3, n) each."""
    rotation, origin = chain.tool[:3, :3], chain.tool[:3, 3]
    place = {name: i for i, name in enumerate(chain.parameters.names)}
    points, jacobians = [], []
    for name, point in zip(names, nominal, strict=True):
        own = [place.get(c) for c in point_names(name)]
        offset = ca.vertcat(*(0 if i is None else chain.x[i] for i in own))
        world = origin + rotation @ (point + offset)
        jacobian = kinematics.stack(chain.parameter_screws, world)
        for axis, i in enumerate(own):
            if i is not None:
                jacobian[:, i] = rotation[:, axis]
        points.append(world)
        jacobians.append(jacobian)
    return points, jacobians


def position(chain: Chain, point_names: tuple[str, ...]) -> Measurement:
    """The `position` measurement: z holds x, y, z in mm of every point in the order of ``point_names``."""
    setup, nominal = setup_symbol(chain, len(point_names))
    points, jacobians = world_points(chain, nominal, point_names)
    h, jacobian = ca.vertcat(*points), ca.vertcat(*jacobians)
    z = SX.sym("z", 3 * len(point_names))
    state = {"q": chain.q, "x": chain.x, "setup": setup}
    return Measurement(
        kind="position",
        chain=chain,
        point_names=point_names,
        groups=(Group("position", "mm", tuple(range(3 * len(point_names))), 3),),
        predict=kinematics.function("position", state, {"h": h}),
        residual=kinematics.function("position_residual", state | {"z": z}, {"r": h - z, "J": jacobian}),
        jacobian=kinematics.function("position_jacobian", state, {"J": jacobian}),
        accuracy=kinematics.function("position_accuracy", state | {"z": z}, {"e": h - z}),
    )
