r"""Any serial chain as a table of link parameters, and one table as another.

A chain is written here as constant placements between joints that move along or about the z axis of the frame they
are in:

    T(q) = A_0 J_1(q_1) A_1 J_2(q_2) ... J_n(q_n) A_n

Two facts do all the work: a screw along z commutes with the joint, so its part of a placement may be moved past the
joint; and past a prismatic joint any translation may.

Source: the common normal is [Denavit1955], proximal order [Craig2005] sec. 3.4, the (nearly) parallel case
[Hayati1985]. What to do with prismatic axes and with the first and last placement is ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.errors import RefusedError
from symcal.joints.arm import Payload
from symcal.joints.gravity import FLANGE, Gravity
from symcal.joints.payload import PAYLOAD
from symcal.parameters import link_name
from symcal.robot.robot import ELEMENTS, Convention, Joint, Link, Robot, is_angle
from symcal.robot.terms import Physics
from symcal.words import listed

Array = NDArray[np.float64]

PARALLEL = math.radians(5.0)
"""Neighbouring axes closer than this are described with beta: their common normal is ill-determined ([Hayati1985])."""

_LENGTH_ZERO = 1e-11  # mm
_ANGLE_ZERO = 1e-14  # rad: both are rounding errors of a placement's product, far below what any robot could show


def element(kind: str, axis: int, value: float) -> Array:
    """Motion of a link parameter, shape (4, 4): about the axis for an angle (rad), along it for a length (mm)."""
    t = np.eye(4)
    if is_angle(kind):
        c, s = math.cos(value), math.sin(value)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        t[i, i], t[j, j], t[j, i], t[i, j] = c, c, s, -s
    else:
        t[axis, 3] = value
    return t


def placements(robot: Robot) -> tuple[Array, ...]:
    """The constant placements A_0 ... A_n between the joints of a robot, base frame to tool; shape (4, 4) each, mm.

    Joint offsets are inside, joint terms are not; what is left of a joint is J_i = a motion of
    ``sign * ratio * reading`` along or about z.
    """
    out, current = [], np.eye(4)
    for link in robot.links:
        moved = "theta" if link.joint.revolute else "d"
        for kind, axis in ELEMENTS[robot.convention]:
            value = link.parameters.get(kind, 0.0) + (link.joint.offset if kind == moved else 0.0)
            if value != 0:
                current = current @ element(kind, axis, value)
            if kind == moved:
                out.append(current)
                current = np.eye(4)
    return (*out, current @ robot.tool)


def joint_frames(robot: Robot) -> tuple[Array, ...]:
    """T_world_i of the frames behind the joints' own motions, all readings zero and without joint terms; (4, 4), mm."""
    out, current = [], robot.base
    for link in robot.links:
        moved = "theta" if link.joint.revolute else "d"
        at = current
        for kind, axis in ELEMENTS[robot.convention]:
            value = link.parameters.get(kind, 0.0) + (link.joint.offset if kind == moved else 0.0)
            current = current @ element(kind, axis, value)
            if axis == 2:
                at = current
        out.append(at)
    return tuple(out)


def craig_robot(name: str, joints: Sequence[Joint], placements: Sequence[Array]) -> Robot:
    """The robot, in the proximal (`craig`) convention, that moves exactly as a chain of placements and joints.

    Listed are the parameters that the general model of such a chain needs: theta, d, a, alpha between axes; theta, a,
    alpha, beta where neighbouring axes are (nearly) parallel, with the redundant d zero; a direction alone towards a
    prismatic axis, whose place means nothing. The zero offset of every joint is listed unless it is redundant for
    that reason. The base frame stays what it was when the first axis meets its x axis; otherwise it takes the first
    placement. The tool takes what is left behind the last joint.

    Args:
        joints: n joints that move by sign * ratio * reading + offset along or about z.
        placements: n + 1 rigid transforms, shape (4, 4), mm.
    """
    values: list[dict[str, float]] = [{} for _ in joints]
    base, rest = _first(placements[0], joints[0], values[0])
    for i in range(1, len(joints)):
        rest = _between(rest @ placements[i], joints[i], values[i - 1], joints[i - 1], values[i])
    values[-1]["theta" if joints[-1].revolute else "d"] = 0.0
    links = tuple(Link(joint, entries) for joint, entries in zip(joints, values, strict=True))
    return Robot(name=name, convention="craig", links=links, base=base, tool=rest @ placements[-1])


def _first(a: Array, joint: Joint, link: dict[str, float]) -> tuple[Array, Array]:
    """Base frame and what of A_0 = base X(alpha, a, beta) rest passes the first joint."""
    u, p = a[:3, 2], a[:3, 3]
    s2 = u[1] ** 2 + u[2] ** 2
    if s2 < 1e-6:  # along the base's x axis: neither alpha nor d are determined
        return a, np.eye(4)
    length = 0.0 if not joint.revolute else p[0] - u[0] * (p[1] * u[1] + p[2] * u[2]) / s2
    entries = {"alpha": math.atan2(-u[1], u[2]), "a": length, "beta": math.asin(np.clip(u[0], -1, 1))}
    entries = {kind: _clean(kind, value) for kind, value in entries.items()}
    rest = spatial.inverse(_proximal(entries)) @ a
    if joint.revolute and math.hypot(rest[0, 3], rest[1, 3]) > 10 * _LENGTH_ZERO:
        return a, np.eye(4)
    link.update({kind: value for kind, value in entries.items() if value != 0})
    return np.eye(4), rest


def _between(a: Array, joint: Joint, before: dict[str, float], joint_before: Joint, link: dict[str, float]) -> Array:
    """Split a placement: theta, d of the link before; alpha, a, beta of this one; what passes this joint (returned)."""
    u, p = a[:3, 2], a[:3, 3]
    theta, d = 0.0, 0.0
    sine = math.hypot(u[0], u[1])
    if sine < math.sin(PARALLEL):
        entries = {"alpha": 0.0, "beta": 0.0}
        if joint.revolute:
            pierced = p[:2] - u[:2] * p[2] / u[2]  # where this axis meets the plane z = 0 of the one before
            theta, entries["a"] = _direction(pierced)
        x, y = u[0] * math.cos(theta) + u[1] * math.sin(theta), u[1] * math.cos(theta) - u[0] * math.sin(theta)
        entries["alpha"], entries["beta"] = math.atan2(-y, u[2]), math.asin(x)
        listed = {"theta"} if joint.revolute or joint_before.revolute else set()
    else:
        theta, signed = _direction(np.array([-u[1], u[0]]))
        entries = {"alpha": math.atan2(signed, u[2])}
        listed = {"theta"} | (set() if joint_before.revolute else {"d"})
        if joint.revolute:
            normal = np.array([math.cos(theta), math.sin(theta), 0.0])
            entries["a"] = float(normal @ p)
            d = p[2] - u[2] * float(p[:2] @ u[:2]) / sine**2
            listed.add("d")
    entries = {kind: _clean(kind, value) for kind, value in entries.items()}
    for kind, value in (("theta", _clean("theta", theta)), ("d", _clean("d", d))):
        if kind in listed:
            before[kind] = value
    link.update(entries)
    screw = element("theta", 2, before.get("theta", 0.0)) @ element("d", 2, before.get("d", 0.0))
    return spatial.inverse(screw @ _proximal(entries)) @ a


def _direction(v: Array) -> tuple[float, float]:
    """Angle in (-90, 90] deg and signed length of a plane vector; the angle of a vanishing one is 0."""
    size = float(np.hypot(*v))
    if size < _LENGTH_ZERO:
        return 0.0, 0.0
    forward = v[0] > 0 if abs(v[0]) > 1e-12 * size else v[1] > 0
    sign = 1.0 if forward else -1.0
    return _clean("theta", math.atan2(sign * v[1], sign * v[0])), sign * size


def _clean(kind: str, value: float) -> float:
    return 0.0 if abs(value) < (_ANGLE_ZERO if is_angle(kind) else _LENGTH_ZERO) else float(value)


def _proximal(entries: dict[str, float]) -> Array:
    t = np.eye(4)
    for kind, axis in (("alpha", 0), ("a", 0), ("beta", 1)):
        t = t @ element(kind, axis, entries.get(kind, 0.0))
    return t


def convert(robot: Robot, convention: Convention) -> Robot:
    """The same robot in another link convention, exactly, by moving rows of its table.

    The rows a, alpha, beta stand behind joint i in `standard` and before joint i + 1 in `craig`; what has no joint to
    go to joins the nominal tool (last row, standard to craig) or base (first row, craig to standard), where it is no
    longer a parameter of its own.

    Joint terms live in the frames behind the joints' own motions, which are the same in both. With a row the flange
    moves along the tool, and the base frame turns: masses on the flange, the payload and the direction of gravity keep
    their places.

    Raises:
        RefusedError: such a row was identified: the calibration record cannot say its error and variance as a frame's;
            or a joint's gravity has a weight at the flange, and the row moves the flange.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> sc.convert(robot, "craig").convention
        'craig'
    """
    if convention == robot.convention:
        return robot
    step, lost = (1, robot.dof) if convention == "craig" else (-1, 1)
    place = {"theta": 0, "d": 0, "a": step, "alpha": step, "beta": step}
    rows: list[dict[str, float]] = [{} for _ in robot.links]
    frame: dict[str, float] = {}
    renamed: dict[str, str] = {}
    for i, link in enumerate(robot.links, start=1):
        for kind, value in link.parameters.items():
            if place[kind] and i == lost:
                frame[kind] = value
            else:
                rows[i + place[kind] - 1][kind] = value
                renamed[link_name(kind, i)] = link_name(kind, i + place[kind])
    links = tuple(replace(link, parameters=row) for link, row in zip(robot.links, rows, strict=True))
    moved = _proximal(frame)
    physics = _carried_over(robot, convention, moved)
    base, tool = (robot.base, moved @ robot.tool) if convention == "craig" else (robot.base @ moved, robot.tool)
    record = robot.record
    if record is not None:
        gone = [name for kind in frame if (name := link_name(kind, lost)) in record.errors]
        if convention == "standard" and frame:  # increments stand behind the base frame, where the row now is
            gone += [name for name in record.errors if name.startswith("base_")]
        if gone:
            frame_name = "tool" if convention == "craig" else "base"
            raise RefusedError(
                f"{robot.name} cannot be written in the {convention} convention with its calibration record: "
                f"{', '.join(gone)} would have to be said of a {frame_name} frame that takes a row of the table; "
                "convert the nominal robot and identify that"
            )
        record = replace(
            record,
            errors={renamed.get(name, name): value for name, value in record.errors.items()},
            sigmas={renamed.get(name, name): value for name, value in record.sigmas.items()},
            nominal_base=record.nominal_base @ (np.eye(4) if convention == "craig" else moved),
            nominal_tool=(moved if convention == "craig" else np.eye(4)) @ record.nominal_tool,
        )
    kept = {name: name for name in robot.term_parameters} | renamed
    scales = {kept[name]: value for name, value in robot.scales.items() if name in kept}
    remainder = robot.remainder
    if remainder is not None and convention == "standard":  # along the axes of the base, which has turned
        remainder = replace(remainder, weights=remainder.weights @ moved[:3, :3])
    return replace(
        robot,
        convention=convention,
        links=links,
        base=base,
        tool=tool,
        scales=scales,
        record=record,
        down=physics.down,
        masses=physics.masses,
        payload=physics.payload,
        remainder=remainder,
    )


def _carried_over(robot: Robot, convention: Convention, moved: Array) -> Physics:
    """Gravity and what it pulls at, where the frames that they are said in move by a row of the table."""
    if convention == "standard":  # the base frame takes the row
        turned = not (moved[:3, :3] == np.eye(3)).all()
        down = _triple(moved[:3, :3].T @ np.array(robot.down)) if turned else robot.down
        return Physics(robot.terms, down, robot.masses, robot.payload)
    at_flange = [term for term in robot.terms if isinstance(term, Gravity) and FLANGE in term.points]
    if at_flange and moved[:3, 3].any():
        names = [joint.name for joint in robot.joints]
        raise RefusedError(
            f"{robot.name} cannot be written in the craig convention: {listed([t.words(names) for t in at_flange])} "
            f"would have to be said of a point that is no frame's origin, since the flange moves by {moved[0, 3]:g} mm "
            f"to the axis of {names[-1]}; use weights at other points, or state masses and a compliance"
        )

    def carried(at: tuple[float, float, float]) -> tuple[float, float, float]:
        return _triple(moved[:3, :3] @ np.array(at) + moved[:3, 3])

    flange = robot.dof + 1
    masses = tuple(replace(m, at=carried(m.at)) if m.on == flange else m for m in robot.masses)
    empty = robot.payload == Payload() and PAYLOAD not in robot.conditions
    payload = robot.payload if empty else replace(robot.payload, at=carried(robot.payload.at))
    return Physics(robot.terms, robot.down, masses, payload)


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z
