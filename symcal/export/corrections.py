"""What a calibration changed, in the units and signs in which a controller asks for it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symcal.export.urdf import roll_pitch_yaw
from symcal.joints import Term
from symcal.parameters import Unit, frame_names, link_name
from symcal.robot.robot import Joint, Record, Robot, is_angle
from symcal.units import ANGLE, unit_factor

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

QUANTITY = {
    "theta": "angle about the joint axis",
    "d": "offset along the joint axis",
    "a": "link length",
    "alpha": "twist",
    "beta": "twist about y (Hayati)",
}
ZERO = "zero offset"

COLUMNS = ("joint", "quantity", "parameter", "unit", "nominal", "correction", "corrected", "sigma")


def corrections(robot: Robot) -> pd.DataFrame:
    """`correction_rows` as a table with the columns `COLUMNS`."""
    import pandas as pd  # half a second of start-up

    return pd.DataFrame(correction_rows(robot), columns=list(COLUMNS))


def correction_rows(robot: Robot) -> list[dict[str, Any]]:
    """The corrections of a calibrated robot, one per row, in deg and mm; empty if it was never calibrated.

    The zero offset of a joint is in units of its reading, error / (sign * ratio): what has to be *added to the reading*
    to get the one that the nominal model needs (a controller that subtracts its offset wants the opposite sign). Other
    rows are the link parameters of the robot's convention, the numbers of joint terms (a controller that has no such
    terms loses them: `carries.left_out` says what that costs), and the tool frame as x, y, z and roll, pitch, yaw at
    the flange. Where the instrument saw the base is not a correction of the robot and is left out.

    Returns:
        columns `joint`, `quantity`, `parameter`, `unit` (of joint terms also 1, deg/Nmm and so on), `nominal`,
        `correction`, `corrected`, and `sigma`, the standard deviation after the data; it is NaN where the parameter was
        held, and for the tool's angles.
    """
    rows: list[dict[str, Any]] = []
    if robot.record is not None:
        errors, sigmas = robot.record.errors, robot.record.sigmas
        for i, link in enumerate(robot.links, start=1):
            for kind in QUANTITY:
                name = link_name(kind, i)
                if kind in link.parameters and name in errors:
                    rows.append(_row(link.joint, kind, name, link.parameters[kind], errors[name], sigmas.get(name)))
        rows += [row for term in robot.terms for row in _term_rows(robot.joints[term.joint - 1], term, robot.record)]
        rows += _tool_rows(robot)
    return rows


def _row(joint: Joint, kind: str, name: str, value: float, error: float, sigma: float | None) -> dict[str, Any]:
    zero = kind == ("theta" if joint.revolute else "d")
    unit, factor = ("deg", math.degrees(1)) if is_angle(kind) else ("mm", 1.0)
    nominal = (value - error) * factor
    if zero:
        factor, nominal = factor / (joint.sign * joint.ratio), 0.0
    return {
        "joint": joint.name,
        "quantity": ZERO if zero else QUANTITY[kind],
        "parameter": name,
        "unit": unit,
        "nominal": nominal,
        "correction": error * factor,
        "corrected": nominal + error * factor,
        "sigma": math.nan if sigma is None else sigma * abs(factor),
    }


def _term_rows(joint: Joint, term: Term, record: Record) -> list[dict[str, Any]]:
    """Numbers of a joint term as they enter its definition: of the joint, behind sign and ratio."""
    rows = []
    for label, p in zip(term.labels, term.parameters, strict=True):
        if p.name in record.errors:
            unit, factor = _shown(p.unit)
            error, sigma = record.errors[p.name], record.sigmas.get(p.name)
            rows.append(
                {
                    "joint": joint.name,
                    "quantity": label.replace("_", " "),
                    "parameter": p.name,
                    "unit": unit,
                    "nominal": (p.value - error) * factor,
                    "correction": error * factor,
                    "corrected": p.value * factor,
                    "sigma": math.nan if sigma is None else sigma * factor,
                }
            )
    return rows


def _shown(unit: Unit) -> tuple[str, float]:
    """A unit with deg in place of rad, and how many of it are one of the program's."""
    return unit.replace("rad", "deg"), 1 / unit_factor(unit, 1.0, ANGLE["deg"])


def _tool_rows(robot: Robot) -> list[dict[str, Any]]:
    """The tool frame in the flange's; the sigma of its position is turned from the axes of the nominal tool into the
    flange's."""
    record = robot.record
    if record is None or not any(name in record.errors for name in frame_names("tool")):
        return []
    names = list(record.errors)
    sigma = [math.nan] * 6
    axes = frame_names("tool")[:3]
    if all(record.sigmas.get(axis) is not None for axis in axes):
        place = [names.index(axis) for axis in axes]
        turn = record.nominal_tool[:3, :3]
        spread = turn @ record.covariance[np.ix_(place, place)] @ turn.T
        sigma[:3] = np.sqrt(np.maximum(np.diag(spread), 0.0)).tolist()
    nominal, corrected = (
        np.concatenate([frame[:3, 3], np.degrees(roll_pitch_yaw(frame[:3, :3]))])
        for frame in (record.nominal_tool, robot.tool)
    )
    change = corrected - nominal
    change[3:] = (change[3:] + 180) % 360 - 180
    labels = ("x", "y", "z", "roll", "pitch", "yaw")
    return [
        {
            "joint": "tool",
            "quantity": f"tool {label}",
            "parameter": "tool frame",
            "unit": "mm" if k < 3 else "deg",
            "nominal": nominal[k],
            "correction": change[k],
            "corrected": corrected[k],
            "sigma": sigma[k],
        }
        for k, label in enumerate(labels)
    ]
