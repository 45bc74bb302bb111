"""Programs for controllers: URScript, RAPID, KRL, and a table for all others.

Each moves all joints together to a pose, stands still, says that it is time to measure, and goes on. Numbers have nine
digits behind the point (of deg, mm and rad), names of poses stand in comments and messages. Cartesian targets are not
written: they would go through the controller's own kinematics, which is what is being calibrated.

Sources: Universal Robots, "The URScript Programming Language"; ABB, "Technical reference manual: RAPID Instructions,
Functions and Data types" (3HAC050917); KUKA, "KUKA System Software 8.3, Operating and Programming Instructions for
System Integrators" (KSS 8.3 SI). RAPID is checked with rapidchecker in the tests; of KRL and URScript there is no
independent parser.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.outputs.csv_text import csv_text
from symcal.programs.visits import Visits

Array = NDArray[np.float64]

_LONGEST = {"urscript": 60, "rapid": 32, "krl": 24, "csv": 60}
"""Letters of a program's name."""
_UNKNOWN_SPEED = math.radians(90)  # rad/s, of a joint whose file says nothing
_ACCELERATION = 1.0  # rad/s^2: gentle
WRITTEN = "written by symcal"


def program_files(to: str, name: str, visits: Visits) -> dict[str, str]:
    """The files of a program by name.

    Raises:
        InputError: no name that the language allows. RefusedError: a robot that the language does not know.
    """
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) or len(name) > _LONGEST[to]:
        raise InputError(
            "no name of a program: letters, digits and '_', a letter first",
            key="--name",
            found=name,
            allowed=[f"at most {_LONGEST[to]} letters"],
        )
    if to != "csv":
        _require_arm(visits, to)
    return LANGUAGES[to](name, visits)


def _urscript(name: str, visits: Visits) -> dict[str, str]:
    speeds = [_UNKNOWN_SPEED if joint.speed is None else joint.speed for joint in visits.robot.joints]
    speed = min(speeds) * visits.percent / 100
    motion = f"a={_ACCELERATION:g}, v={speed:.4f}"
    lines = [f"def {name}():", f"  # {len(visits.names)} poses, joints in rad, {WRITTEN}"]
    before = visits.before
    for i, pose in enumerate(visits.names):
        if before is not None:
            lines.append(f"  movej([{_numbers(before[i])}], {motion})")
        lines.append(f"  movej([{_numbers(visits.at[i])}], {motion})")
        lines.append(f"  sleep({visits.settle:g})")
        lines.append(f'  textmsg("MEASURE {_plain(pose)}")  # MEASURE')
        if visits.wait:
            lines.append(f'  popup("measure {_plain(pose)}, then continue", blocking=True)')
    return {f"{name}.script": "\n".join([*lines, "end", name + "()", ""])}


def _rapid(name: str, visits: Visits) -> dict[str, str]:
    joints, before = visits.shown, visits.shown_before
    targets, moves = [], []
    for i, pose in enumerate(visits.names):
        if before is not None:
            targets.append(f"  CONST jointtarget b{i + 1}:={_jointtarget(before[i])};")
            moves.append(f"    MoveAbsJ b{i + 1}\\NoEOffs,v1000,fine,tool0;")
        targets.append(f"  CONST jointtarget p{i + 1}:={_jointtarget(joints[i])};")
        moves += [
            f"    MoveAbsJ p{i + 1}\\NoEOffs,v1000,fine,tool0;",
            f"    WaitTime {visits.settle:g};",
            f'    TPWrite "MEASURE {_plain(pose)}";',
            *(["    Stop;"] if visits.wait else []),
        ]
    lines = [
        f"MODULE {name}",
        f"  ! {len(visits.names)} poses, joints in degrees, {WRITTEN}",
        *targets,
        "",
        f"  PROC run_{name}()",
        f"    VelSet {visits.percent:g},5000;",
        *moves,
        "    VelSet 100,5000;",
        "  ENDPROC",
        "ENDMODULE",
        "",
    ]
    return {f"{name}.mod": "\n".join(lines)}


def _krl(name: str, visits: Visits) -> dict[str, str]:
    joints, before = visits.shown, visits.shown_before
    lines = [
        "&ACCESS RVP",
        f"DEF {name}( )",
        f"; {len(visits.names)} poses, axes in degrees, {WRITTEN}",
        "BAS (#INITMOV,0)",
        f"BAS (#VEL_PTP,{visits.percent:g})",
    ]
    for i, pose in enumerate(visits.names):
        if before is not None:
            lines.append(f"PTP {{{_axes(before[i])}}}")
        lines += [f"PTP {{{_axes(joints[i])}}}", f"WAIT SEC {visits.settle:g}", f"; MEASURE {_plain(pose)}"]
        if visits.wait:
            lines.append("HALT")
    return {f"{name}.src": "\n".join([*lines, "END", ""])}


def _table(name: str, visits: Visits) -> dict[str, str]:
    """One row per motion."""
    heads = [f"q{i}_{'deg' if joint.revolute else 'mm'}" for i, joint in enumerate(visits.robot.joints, start=1)]
    rows, before = [], visits.shown_before
    for i, pose in enumerate(visits.names):
        moves = [("measure", visits.shown[i])]
        if before is not None:
            moves.insert(0, ("approach", before[i]))
        for do, joints in moves:
            cells = dict(zip(heads, joints.tolist(), strict=True))
            settle = visits.settle if do == "measure" else 0.0
            rows.append({"pose": pose, "do": do, **cells, "speed_percent": visits.percent, "settle_s": settle})
    return {f"{name}.csv": csv_text(rows, ["pose", "do", *heads, "speed_percent", "settle_s"])}


LANGUAGES: Mapping[str, Callable[[str, Visits], dict[str, str]]] = {
    "urscript": _urscript,
    "rapid": _rapid,
    "krl": _krl,
    "csv": _table,
}


def _require_arm(visits: Visits, to: str) -> None:
    robot = visits.robot
    if robot.dof > 6 or not all(joint.revolute for joint in robot.joints):
        raise RefusedError(
            f"{robot.name} is not an arm of up to six revolute joints: where another joint stands in a target of "
            f"{to} is the cell's own choice. Write csv, and let a program of yours read it"
        )
    if to == "urscript" and robot.dof != 6:
        raise RefusedError(f"URScript moves six joints, {robot.name} has {robot.dof}")


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:.9f}" for value in values + 0.0)


def _jointtarget(joints: Array) -> str:
    axes = [f"{value:.9f}" for value in joints + 0.0] + ["0"] * (6 - len(joints))
    return f"[[{','.join(axes)}],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def _axes(joints: Array) -> str:
    return ", ".join(f"A{i} {value:.9f}" for i, value in enumerate(joints + 0.0, start=1))


def _plain(name: str) -> str:
    """A pose's name inside a comment or a text: what could end either is replaced."""
    return re.sub(r'[^\x20-\x7e]|["\\;#!{}]', "_", name)[:40]
