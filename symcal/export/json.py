"""A robot with everything that its calibration knows, as JSON; mm and rad throughout."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from symcal.export.carries import check_carries, left_out
from symcal.export.corrections import correction_rows
from symcal.export.gate import check_exportable
from symcal.joints import Term
from symcal.joints.payload import PAYLOAD
from symcal.outputs.whole_file import write_whole
from symcal.robot.files import frame_entry
from symcal.robot.robot import Joint, Robot

SCHEMA = "symcal/robot-json/2"
"""With joint terms: who knows only version 1 would lose them without a word."""

TRANSFORM = {
    "standard": "T_i = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
    "craig": "T_i = Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)",
}

COORDINATE = (
    "u_i = sign_i ratio_i q_i + offset_i + delta_i adds to theta_i (revolute) or d_i (prismatic); q_i is the reading, "
    "delta_i the sum of the terms of joint i, each a sum over its numbers as its definition says"
)
_FRAMES = (
    "In the base frame, with delta 0 in all joints: the frame of joint i is T_1 ... T_(i-1) and of T_i the motions up "
    "to and with theta and d, that of the flange T_1 ... T_n; o_i is its origin, z_i its third axis. "
    "m_i = sign_i ratio_i q_i. L_i(p) = z_i . ((p - o_i) x down) of a revolute joint, z_i . down of a prismatic one"
)
_CONDITIONS = {PAYLOAD: "kg that the tool carries beyond payload.kg"}


def robot_json(robot: Robot) -> dict[str, Any]:
    """The robot as plain data, ready for `json.dumps`.

    `links` hold the identified numbers. `parameters` say of each number (with base, tool and tool points, if they were
    identified) its nominal value, error, identified value and sigma, null where the data do not determine it;
    `covariance` is of the errors in the order of its `parameters`. `corrections` is the table for the controller, in
    deg and mm. `terms` are the joint terms with their definitions in words and their numbers as they are now;
    `gravity`, `masses`, `payload` and `conditions` are what they ask for.
    """
    record = robot.record
    frames = {"base": frame_entry(robot.base), "tool": frame_entry(robot.tool)}
    if record is not None:
        frames |= {"nominal_base": frame_entry(record.nominal_base), "nominal_tool": frame_entry(record.nominal_tool)}
    left = left_out(robot, "table")
    return {
        "schema": SCHEMA,
        "name": robot.name,
        "convention": robot.convention,
        "transform": f"{TRANSFORM[robot.convention]}; {COORDINATE}",
        "units": {"length": "mm", "angle": "rad", "corrections": "mm and deg"},
        "joints": [_joint(joint) for joint in robot.joints],
        "terms": [_term(robot, term) for term in robot.terms],
        **_physics(robot),
        "links": [{kind: float(value) for kind, value in link.parameters.items()} for link in robot.links],
        "frames": frames,
        "parameters": _parameters(robot),
        "covariance": None
        if record is None
        else {"parameters": list(record.errors), "matrix": record.covariance.tolist()},
        "corrections": _known(correction_rows(robot)),
        "corrections_leave_out": None if left is None else left.text,
        "provenance": {} if record is None else dict(record.provenance),
    }


def save_json(robot: Robot, path: Path | str, *, force: bool = False) -> None:
    """Write `json_text`.

    Args:
        force: whether also a calibration that was refused or never judged (`symcal.export.gate`).
    Raises:
        InputError: the file cannot be written. RefusedError: the calibration was refused; the robot has a remainder.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> sc.save_json(robot, "robot.json")
    """
    check_exportable(robot, force)
    write_whole(path, json_text(robot))


def json_text(robot: Robot) -> str:
    """`robot_json` as text.

    Raises:
        RefusedError: the robot has a remainder.
    """
    check_carries(robot, "json")
    return json.dumps(robot_json(robot), indent=2, ensure_ascii=False, allow_nan=False, default=str) + "\n"


def _joint(joint: Joint) -> dict[str, Any]:
    finite = math.isfinite(joint.upper)
    return {
        "name": joint.name,
        "kind": joint.kind,
        "limits": [joint.lower, joint.upper] if finite else None,
        "sign": joint.sign,
        "ratio": joint.ratio,
        "offset": joint.offset,
        "speed": joint.speed,
    }


def _term(robot: Robot, term: Term) -> dict[str, Any]:
    names = [joint.name for joint in robot.joints]
    own = {key: list(value) if isinstance(value, tuple) else value for key, value in term.entry().items()}
    return {
        "kind": term.kind,
        "joint": names[term.joint - 1],
        "i": term.joint,
        "delta_i": term.definition,
        **own,
        "numbers": {
            label: {"value": p.value, "unit": p.unit, "parameter": p.name}
            for label, p in zip(term.labels, term.parameters, strict=True)
        },
    }


def _physics(robot: Robot) -> dict[str, Any]:
    """What joint terms ask for beside readings."""
    conditions = {
        name: _CONDITIONS.get(name, "-1 or 1: the direction in which the joint came to its reading; 0: not known")
        for name in robot.conditions
    }
    return {
        "joint_frames": _FRAMES,
        "gravity": {"down": list(robot.down), "frame": "base"},
        "masses": [{"i": m.on, "of": _carrier(robot, m.on), "kg": m.kg, "at": list(m.at)} for m in robot.masses],
        "payload": {"of": "flange", "kg": robot.payload.kg, "at": list(robot.payload.at)},
        "conditions": {name: {"meaning": words, "nominal": 0.0} for name, words in conditions.items()},
    }


def _carrier(robot: Robot, on: int) -> str:
    """In whose frame a mass stands."""
    return "flange" if on > robot.dof else robot.joints[on - 1].name


def _parameters(robot: Robot) -> dict[str, dict[str, Any]]:
    record = robot.record
    errors = {} if record is None else record.errors
    sigmas = {} if record is None else record.sigmas
    links, units = robot.parameters, {p.name: p.unit for p in robot.described}
    out: dict[str, dict[str, Any]] = {}
    for name in (*links, *(name for name in errors if name not in links)):
        error = float(errors.get(name, 0.0))
        identified = float(links[name]) if name in links else error
        sigma = sigmas.get(name)
        out[name] = {
            "nominal": identified - error,
            "error": error,
            "identified": identified,
            "sigma": None if sigma is None else float(sigma),
            "unit": units.get(name) or _unit(name),
        }
    return out


def _unit(name: str) -> str:
    """`rad` or `mm`, of a frame's increment (`tool_rx`) or a tool point's coordinate."""
    kind, _, last = name.rpartition("_")
    return "rad" if kind in ("base", "tool") and last in ("rx", "ry", "rz") else "mm"


def _known(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{k: None if v != v else v for k, v in row.items()} for row in rows]
