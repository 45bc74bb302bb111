"""A robot with everything that its calibration knows, as JSON; mm and rad throughout."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pandas as pd

from symcal.errors import InputError
from symcal.export.corrections import corrections
from symcal.export.remainder import refuse_remainder
from symcal.robot.robot import Joint, Robot, frame_entry, is_angle

SCHEMA = "symcal/robot-json/1"

TRANSFORM = {
    "standard": "T_i = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
    "craig": "T_i = Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)",
}


def robot_json(robot: Robot) -> dict[str, Any]:
    """The robot as plain data, ready for `json.dumps`.

    `links` hold the identified numbers. `parameters` say of each number (with base, tool and tool points, if they were
    identified) its nominal value, error, identified value and sigma, null where the data do not determine it;
    `covariance` is of the errors in the order of its `parameters`. `corrections` is the table for the controller, in
    deg and mm.
    """
    record = robot.record
    frames = {"base": frame_entry(robot.base), "tool": frame_entry(robot.tool)}
    if record is not None:
        frames |= {"nominal_base": frame_entry(record.nominal_base), "nominal_tool": frame_entry(record.nominal_tool)}
    return {
        "schema": SCHEMA,
        "name": robot.name,
        "convention": robot.convention,
        "transform": f"{TRANSFORM[robot.convention]}; q_model = sign * ratio * reading + offset adds to theta or d",
        "units": {"length": "mm", "angle": "rad", "corrections": "mm and deg"},
        "joints": [_joint(joint) for joint in robot.joints],
        "links": [{kind: float(value) for kind, value in link.parameters.items()} for link in robot.links],
        "frames": frames,
        "parameters": _parameters(robot),
        "covariance": None
        if record is None
        else {"parameters": list(record.errors), "matrix": record.covariance.tolist()},
        "corrections": _records(corrections(robot)),
        "provenance": {} if record is None else dict(record.provenance),
    }


def save_json(robot: Robot, path: Path | str) -> None:
    """Write `robot_json`.

    Raises:
        InputError: the file cannot be written. RefusedError: the robot has a remainder.
    """
    refuse_remainder(robot, "JSON")
    text = json.dumps(robot_json(robot), indent=2, ensure_ascii=False, allow_nan=False, default=str)
    try:
        Path(path).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"the file cannot be written: {error.strerror}", file=path) from None


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


def _parameters(robot: Robot) -> dict[str, dict[str, Any]]:
    record = robot.record
    errors = {} if record is None else record.errors
    sigmas = {} if record is None else record.sigmas
    links = robot.parameters
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
            "unit": parameter_unit(name),
        }
    return out


def parameter_unit(name: str) -> str:
    """`rad` or `mm`, of a link parameter (`alpha_2`), a frame's increment (`tool_rx`) or a tool point's coordinate."""
    kind, _, last = name.rpartition("_")
    return "rad" if is_angle(kind) or (kind in ("base", "tool") and last in ("rx", "ry", "rz")) else "mm"


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(k): None if v != v else v for k, v in row.items()} for row in table.to_dict("records")]
