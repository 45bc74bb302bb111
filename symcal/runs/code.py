"""The C code in a run's folder, and what its results say about it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from symcal.export.delivery import deliver_c
from symcal.export.results import code_facts
from symcal.robot.robot import Robot
from symcal.runs.folder import CODE


def with_code(content: Mapping[str, Any], robot: Robot, folder: Path, seed: int) -> dict[str, Any]:
    """The content of results.json after the robot was written as C into the folder `CODE`, or was refused."""
    delivery = deliver_c(robot, folder / CODE, np.random.default_rng(seed))
    warnings = list(content["warnings"])
    if delivery.export is None:
        said = {reason["text"] for reason in content.get("decision", {}).get("reasons", ())}
        more = [doubt.text for doubt in delivery.doubts if doubt.text not in said]  # the decision says the others
        because = f": {'; '.join(more)}" if more else ", because the calibration is refused"
        warnings.append(f"no C code was written{because}")
    controller = {**content["controller"], "code": code_facts(delivery)}
    return {**content, "warnings": warnings, "controller": controller}
