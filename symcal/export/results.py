"""What goes to the controller as plain dictionaries (results.json): corrections, compensation, C code."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from symcal.calibration.evaluate import Errors
from symcal.calibration.results import accuracy_facts
from symcal.export.corrections import correction_rows
from symcal.export.gate import doubts
from symcal.robot.robot import Robot

if TYPE_CHECKING:
    from symcal.calibration.compensation_check import Handover
    from symcal.export.delivery import Delivery


def correction_facts(robot: Robot) -> dict[str, Any]:
    """The corrections in a controller's units and signs, and what speaks against using them.

    A number that is not known is None. `left_out` is there where offsets and lengths alone lose joint terms.
    """
    rows = correction_rows(robot)
    plain = [{k: None if isinstance(v, float) and math.isnan(v) else v for k, v in row.items()} for row in rows]
    facts = {"corrections": plain, "doubts": [doubt.text for doubt in doubts(robot)]}
    if not robot.terms:
        return facts
    from symcal.export.carries import left_out

    left = left_out(robot, "table")
    return facts if left is None else facts | {"left_out": left.text}


def handover_facts(handover: Handover) -> dict[str, Any]:
    """Errors against truth in the base frame: before, after a calibration without compensation, and with it.

    `after_reached` are those poses alone at which the calibrated model reaches the target; `residual_mm` is the largest
    distance that the model keeps there. None where there are no such poses.
    """
    reached = handover.reached
    states = {"before": handover.before, "without": handover.before, "after": handover.after}
    inside = _some(handover.after, reached)
    return {
        "poses": len(reached),
        "against": "truth",
        "frame": "base",
        "aligned": handover.aligned,
        "orientation_compensated": handover.compensation.pose,
        **accuracy_facts(states),
        "after_reached": accuracy_facts({"reached": inside})["reached"] if reached.any() else None,
        "residual_mm": float(handover.compensation.residual_mm[reached].max()) if reached.any() else None,
        "worse": int(handover.worse.sum()),
        "status": dict(handover.statuses),
    }


def _some(errors: Errors, which: np.ndarray[Any, np.dtype[np.bool_]]) -> Errors:
    rotations = None if errors.rotations is None else errors.rotations[which]
    return Errors(errors.vectors[which], errors.pose[which], errors.point[which], rotations)


def code_facts(delivery: Delivery) -> dict[str, Any]:
    """The exported C: files and sizes, operations, agreement with Python; or the reasons why there is none."""
    from symcal.export.delivery import example

    export, check = delivery.export, delivery.check
    if export is None:
        return {"written": False, "doubts": [doubt.text for doubt in delivery.doubts]}
    facts: dict[str, Any] = {
        "written": True,
        "folder": export.folder.name,
        "prefix": export.prefix,
        "model_hash": export.model_hash,
        "files_bytes": dict(export.files),
        "operations": {name: {"total": total, "libm": export.libm[name]} for name, total in export.operations.items()},
        "example": list(example(export.prefix)),
        "check": None,
    }
    if check is not None:
        facts["check"] = {
            "compiler": check.compiler,
            "poses": check.poses,
            "code_bytes": _code_bytes(check.code_bytes),
            "double_mm": check.double_mm,
            "float_mm": check.float_mm,
            "uncompensated_mm": check.uncompensated_mm,
            "compensated_mm": check.compensated_mm,
            "compensated_mean_mm": check.compensated_mean_mm,
            "reached_share": check.reached,
            "status": {name.lower(): count for name, count in check.status.items()},
        }
    return facts


def _code_bytes(sizes: tuple[int, int] | None) -> Mapping[str, int] | None:
    return None if sizes is None else {"double": sizes[0], "float": sizes[1]}
