r"""An instrument reads a target: the symbolic measurement of a kind on a robot.

With T_world_instrument = (R_i, o_i), a feature of the target at w in world with axes R_t, and the screws of every
parameter of both,

    R = R_i^T R_t,   p = R_i^T (w - o_i),      omega = R_i^T (omega_t - omega_i),   v = R_i^T (v_t(w) - v_i(w))

so the kind alone says what is read, and how that changes with a twist of the feature; the Jacobian is the chain rule.
A point's own coordinates move it by the columns of R_t. The instrument rides on the tool, and the feature is world's
frame, where measurements are inverted.
"""

from __future__ import annotations

import casadi as ca

from symcal import kinematics
from symcal.instruments.measurement import Group, Measurement
from symcal.instruments.protocol import Kind
from symcal.kinematics import Chain, Screw
from symcal.parameters import point_names

SX = ca.SX


def observe(chain: Chain, kind: Kind, points: tuple[str, ...] = (), *, riding: bool = False) -> Measurement:
    """The measurement of a kind: z holds one reading after another, one per point or that of the tool's frame.

    Args:
        points: names of the tool points that are read. riding: the instrument is on the tool.
    """
    coordinates = SX.sym("points", 3 * len(points))
    frame, numbers = SX.sym("place", 12 if kind.place else 0), SX.sym("own", len(kind.own))
    setup = ca.vertcat(chain.frames, coordinates, frame, numbers)
    x = dict(zip(chain.parameters.names, ca.vertsplit(chain.x), strict=True)) if len(chain.parameters) else {}
    place = {name: i for i, name in enumerate(chain.parameters.names)}
    own = ca.vertcat(*(numbers[i] + x.get(name, 0) for i, name in enumerate(kind.own)))
    still = tuple(Screw(SX(3, 1), SX(3, 1), SX(3, 1)) for _ in chain.parameters.names)
    tool = (chain.tool[:3, :3], chain.tool[:3, 3], chain.parameter_screws)
    world = (SX.eye(3), SX(3, 1), still)
    if kind.place:
        rotation, origin, carried = kinematics.placed(frame, kind.place[0].rpartition("_")[0], x)
        screws = tuple(carried.get(name, screw) for name, screw in zip(chain.parameters.names, still, strict=True))
        instrument = (rotation, origin, screws)
    else:
        instrument = tool if riding else world
    r_i, o_i, screws_i = instrument
    r_tool, o_tool, screws_tool = tool
    r_t, _, screws_t = world if riding else tool
    readings: list[SX] = []
    residuals: list[SX] = []
    jacobians: list[SX] = []
    planned: list[SX] = []
    errors: list[SX] = []
    attitudes: list[SX] = []
    where: list[SX] = []
    motions: list[SX] = []
    z = SX.sym("z", len(kind.columns) * max(len(points), 1))
    for k in range(max(len(points), 1)):
        reading = z[len(kind.columns) * k : len(kind.columns) * (k + 1)]
        at, motion = o_tool, SX(3, len(chain.parameters))
        if points:
            names = point_names(points[k])
            offset = ca.vertcat(*(x.get(name, 0) for name in names))
            at = o_tool + r_tool @ (coordinates[3 * k : 3 * k + 3] + offset)
            for axis, name in enumerate(names):
                if name in place:
                    motion[:, place[name]] = r_tool[:, axis]
        motion = motion + kinematics.stack(screws_tool, at)
        where.append(at)
        motions.append(motion)
        feature, moving = (SX(3, 1), kinematics.stack(still, at)) if riding else (at, motion)
        turn = kinematics.omegas(screws_t)
        r, p = r_i.T @ r_t, r_i.T @ (feature - o_i)
        twist = ca.vertcat(
            r_i.T @ (turn - kinematics.omegas(screws_i)), r_i.T @ (moving - kinematics.stack(screws_i, feature))
        )
        for measured, into in ((reading, jacobians), (None, planned)):
            by_twist, by_own = kind.slopes(r, p, measured, own)
            jacobian = by_twist @ twist
            for i, name in enumerate(kind.own):
                if name in place:
                    jacobian[:, place[name]] = by_own[:, i]
            into.append(jacobian)
        shift, attitude = kind.error(r, p, reading, own, riding=riding)
        readings.append(kind.predict(r, p, own))
        residuals.append(kind.residual(r, p, reading, own))
        errors.append(shift if riding else r_i @ shift)
        attitudes.append(attitude)
    state = {"q": chain.q, "x": chain.x, "setup": setup}
    function = kinematics.function
    return Measurement(
        kind=kind,
        chain=chain,
        point_names=points,
        groups=_groups(kind, max(len(points), 1)),
        predict=function(kind.name, state, {"h": ca.vertcat(*readings)}),
        residual=function(
            f"{kind.name}_residual", state | {"z": z}, {"r": ca.vertcat(*residuals), "J": ca.vertcat(*jacobians)}
        ),
        jacobian=function(f"{kind.name}_jacobian", state, {"J": ca.vertcat(*planned)}),
        accuracy=function(f"{kind.name}_accuracy", state | {"z": z}, {"e": ca.vertcat(*errors, *attitudes)}),
        points=function(f"{kind.name}_points", state, {"p": ca.vertcat(*where), "J": ca.vertcat(*motions)}),
    )


def _groups(kind: Kind, features: int) -> tuple[Group, ...]:
    """Components that share a noise sigma, over all features."""
    rows = sum(quantity.size for quantity in kind.quantities)
    groups, first = [], 0
    for quantity in kind.quantities:
        columns = tuple(rows * k + first + i for k in range(features) for i in range(quantity.size))
        groups.append(Group(quantity.noise, quantity.unit, columns, quantity.size, quantity.floor, quantity.alike))
        first += quantity.size
    return tuple(groups)
