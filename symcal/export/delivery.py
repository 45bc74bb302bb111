"""The C code of a run's result: written where the gate lets it pass, compiled, and compared with Python."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symcal.calibration.reasons import Reason
from symcal.export.c import CExport, export_c
from symcal.export.c.check import CCheck, check_c
from symcal.export.gate import doubts
from symcal.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Delivery:
    """What became of an export that nobody forced.

    doubts: why there is none. export: what was written; None where there are doubts. check: None also where there is no
        working C compiler.
    """

    doubts: tuple[Reason, ...]
    export: CExport | None = None
    check: CCheck | None = None


def deliver_c(robot: Robot, folder: Path, rng: np.random.Generator) -> Delivery:
    """Write a calibrated robot as C into a folder and check it; nothing is written where its numbers are in doubt.

    Args:
        rng: for the readings at which C and Python are compared.
    Raises:
        InputError: the folder cannot be written. RefusedError: the numbers do not fit into single precision.
    """
    found = doubts(robot)
    if robot.remainder is not None:  # refused by `export_c` too, whoever forces it
        text = f"C cannot carry its smooth remainder of {len(robot.remainder.centres)} centres"
        found = (*found, Reason("remainder", text))
    if found:
        return Delivery(found)
    export = export_c(robot, folder, force=True)  # nothing is left to force
    return Delivery((), export, check_c(export, robot, rng))


def example(prefix: str) -> tuple[str, ...]:
    """How the code is called: six lines of C."""
    capital = prefix.upper()
    return (
        f'#include "{prefix}_kinematics.h"',
        f"{prefix}_real q[{capital}_DOF];  /* planned readings, rad and mm */",
        f"{prefix}_real left;  /* mm that the calibrated model stays away */",
        f"if ({prefix}_compensate(q, q, &left) != {capital}_OUTSIDE) {{",
        "    command(q);  /* in place of the planned readings */",
        "}",
    )
