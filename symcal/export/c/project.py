"""What surrounds the source of an exported robot: build files, README, self-test with its vectors."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from symcal.compensation.compensate import LEVER, joint_caps
from symcal.export.c.names import identifiers, printable
from symcal.export.c.source import FLOAT_REACHED, CModel, fill, model_hash, table, term_sentences
from symcal.export.c.terms import slope_rounding
from symcal.export.c.vectors import Vectors
from symcal.kernels.instructions import Operation, Program

Array = NDArray[np.float64]

_WIDTH = 120  # of a line of text
_LIBM = {"sin", "cos", "sqrt", "atan2"}


def project_files(model: CModel, vectors: Vectors) -> dict[str, str]:
    """Path -> text of everything but header and source."""
    robot, n = model.robot, model.robot.dof
    reach = max(robot.reach, 1.0)
    common = {
        "prefix": model.prefix,
        "PREFIX": model.prefix.upper(),
        "robot": printable(robot.name),
        "dof": n,
        "reach": f"{reach:.6g}",
    }
    rounding = 2 * slope_rounding(robot)
    scale = np.array([abs(joint.ratio) for joint in robot.joints])
    test = common | {
        "length_double": repr(1e-12 * reach),
        "length_float": repr(5e-7 * reach),
        "slope_double": repr((1e-12 + rounding * 2**-52) * reach),
        "slope_float": repr((5e-7 + rounding * 2**-23) * reach),
        "spin_double": repr(2e-12 + rounding * 2**-52),
        "spin_float": repr(2e-6 + rounding * 2**-23),
        "lever": f"{LEVER:g}",
        "half_lever2": repr(LEVER**2 / 2),
        "pose_test": fill("selftest_pose.c", common) if model.oriented else "",
    }
    arrays = common | {
        "count": len(vectors.q),
        "scale": table(scale),
        "jacobian_size": 6 * n,
        "q": _rows(vectors.q),
        "nominal": _rows(vectors.nominal[:, :3].reshape(-1, 12)),
        "calibrated": _rows(vectors.calibrated[:, :3].reshape(-1, 12)),
        "jacobian": _rows(vectors.jacobian.reshape(-1, 6 * n)),
        "reached": _flags(vectors.reached),
        "reached_pose": f"static const int vector_reached_pose[VECTORS] = {_flags(vectors.reached_pose)};\n"
        if model.oriented
        else "",
    }
    return {
        "Makefile": fill("Makefile", common),
        "CMakeLists.txt": fill("CMakeLists.txt", common),
        "README.md": fill("README.md", common | _readme(model, vectors)),
        "test/selftest.c": fill("selftest.c", test),
        "test/vectors.h": fill("vectors.h", arrays),
    }


def operations(program: Program) -> tuple[int, int]:
    """Number of operations, and of those among them that call libm."""
    counts = Counter(i.op for i in program.instructions if isinstance(i, Operation))
    return sum(counts.values()), sum(counts[name] for name in _LIBM)


def cost(model: CModel, function: str) -> tuple[int, int]:
    """Operations of one call of a public function, and of those among them that call libm."""
    if "compensate" not in function:
        return operations(model.programs[function])
    kind = "pose" if "pose" in function else "position"
    given = "_with" if function.endswith("_with") else ""
    goal = model.programs["forward_nominal" if kind == "pose" else "target_position"]
    (goals, goal_libm), (steps, step_libm), (misses, miss_libm) = (
        operations(program)
        for program in (goal, model.programs[f"step_{kind}{given}"], model.programs[f"miss_{kind}{given}"])
    )
    return goals + model.iterations * steps + misses, goal_libm + model.iterations * step_libm + miss_libm


_WHAT = {
    "forward": "pose of the tool, calibrated",
    "forward_nominal": "pose of the tool, nominal",
    "jacobian": "Jacobian, calibrated: velocity of the tool's origin and angular velocity per unit of each reading",
    "compensate": "readings with which the calibrated tool's position is the nominal one's",
    "compensate_pose": "the same for position and orientation",
    "forward_with": "pose with parameter errors, base and tool of your own",
    "jacobian_with": "its Jacobian",
    "compensate_with": "compensation of the position with parameter errors and tool of your own",
    "compensate_pose_with": "the same for position and orientation",
}


def _readme(model: CModel, vectors: Vectors) -> dict[str, object]:
    robot = model.robot
    if robot.record is not None:
        state = "The calibrated numbers are built in as constants; the nominal ones too."
    else:
        state = "This robot was never calibrated: both models are the nominal one, and compensation changes nothing."
    names = identifiers((joint.name for joint in robot.joints), "joint")
    rows = []
    for i, (joint, name) in enumerate(zip(robot.joints, names, strict=True)):
        limits = f"{joint.lower:.6g} to {joint.upper:.6g}" if math.isfinite(joint.lower) else "none"
        constant = f"`{model.prefix.upper()}_JOINT_{name.upper()}`"
        rows.append(
            f"| {i} | {constant} | `{printable(joint.name)}` | {'rad' if joint.revolute else 'mm'} | {limits} |"
        )
    functions = []
    for name in model.functions:
        total, libm = cost(model, name)
        functions.append(f"| `{name}` | {_WHAT[name]} | {total} ({libm}) |")
    if model.oriented:
        orientation = (
            "`compensate` looks at the position alone and lets the orientation follow; `compensate_pose` does both."
        )
    else:
        orientation = (
            "The position is compensated, the orientation is not: an arm with fewer than six joints cannot choose both."
        )
    caps = joint_caps(robot) * np.abs([joint.ratio for joint in robot.joints])
    return {
        "state_sentence": state,
        "version": version("symcal"),
        "hash": model_hash(robot),
        "example": ", ".join(f"{value:g}" for value in vectors.q[0].round(2)),
        "function_rows": "\n".join(functions),
        "iterations": model.iterations,
        "caps": " and ".join(
            f"{max(cap for cap, j in zip(caps, robot.joints, strict=True) if j.revolute is kind):.3g} {unit}"
            for kind, unit in ((True, "rad"), (False, "mm"))
            if any(j.revolute is kind for j in robot.joints)
        )
        + " of the joint",
        "orientation": orientation,
        "reached_float": f"{FLOAT_REACHED * max(robot.reach, 1.0):.2g}",
        "joint_rows": "\n".join(rows),
        "terms": "".join(f"\n\n{textwrap.fill(sentence, _WIDTH)}" for sentence in term_sentences(model)),
        "of_terms": ", and numbers of joint terms," if robot.terms else "",
        "count": len(vectors.q),
    }


def _rows(values: Array) -> str:
    return "{\n" + ",\n".join(table(row, 4) for row in values) + "\n}"


def _flags(values: NDArray[np.bool_]) -> str:
    return "{" + ", ".join(str(int(v)) for v in values) + "}"
