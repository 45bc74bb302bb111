"""Header and source of an exported robot as text."""

from __future__ import annotations

import hashlib
import json
import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from symcal.compensation.compensate import LEVER, REACHED, joint_caps
from symcal.export.c.expressions import portable
from symcal.export.c.names import identifiers, printable
from symcal.export.carries import LeftOut
from symcal.kernels.instructions import Program, c_constant, c_statements, scalar_definitions
from symcal.model.parameter_set import parameter_set
from symcal.robot.robot import Robot
from symcal.words import listed

Array = NDArray[np.float64]

FLOAT_REACHED = 1e-6
"""Residual that counts as none in single precision, as a share of the reach: some ten times its rounding."""

_UNLIMITED = 3e38  # in place of a limit that is not there
_WIDTH = 116  # of a line of a comment
_WHOLE = 100_000  # characters: nothing of a sentence is cut
_SIGNATURE = 72  # arguments that are longer go to lines of their own


@dataclass(frozen=True, slots=True)
class CModel:
    """What the texts need to know of a robot. left_out: what of its joint terms is not in the code."""

    robot: Robot
    prefix: str
    iterations: int
    programs: Mapping[str, Program]
    left_out: LeftOut | None = None

    @property
    def parameters(self) -> tuple[str, ...]:
        return parameter_set(self.robot).names

    @property
    def errors(self) -> Array:
        record = self.robot.record
        return parameter_set(self.robot).vector(
            {} if record is None else {name: record.errors.get(name, 0.0) for name in self.parameters}
        )

    @property
    def oriented(self) -> bool:
        """Whether the arm can be compensated in orientation too."""
        return "step_pose" in self.programs

    @property
    def functions(self) -> tuple[str, ...]:
        """The public functions, without prefix."""
        pose = ("compensate_pose", "compensate_pose_with") if self.oriented else ()
        return (
            "forward",
            "forward_nominal",
            "jacobian",
            "compensate",
            "forward_with",
            "jacobian_with",
            "compensate_with",
            *pose,
        )


TABLES = ("lower", "upper", "cap", "errors", "identity", "tool", "tool_nominal")


def fill(template: str, values: Mapping[str, object]) -> str:
    """The template of this name with every `@key@` replaced, once: values are not searched again."""
    text = files("symcal.export.c").joinpath("templates", template).read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda match: str(values[match[1]]), text)


def model_hash(robot: Robot) -> str:
    """SHA-256 of what determines the exported numbers: convention, joints and their terms, parameters, tool, before and
    after."""

    def numbers(one: Robot) -> dict[str, object]:
        joints: list[object] = [[j.kind, j.lower, j.upper, j.sign, j.ratio, j.offset] for j in one.joints]
        found: dict[str, object] = {
            "convention": one.convention,
            "joints": joints,
            "parameters": one.parameters,
            "tool": one.tool[:3].tolist(),
        }
        if one.terms:
            found["terms"] = [[term.kind, term.joint, term.entry()] for term in one.terms]
            found["gravity"] = [one.down, [[m.on, m.kg, m.at] for m in one.masses], [one.payload.kg, one.payload.at]]
        return found

    text = json.dumps([numbers(robot), numbers(robot.nominal())], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def header(model: CModel) -> str:
    names = [*model.functions, *TABLES]
    values = _common(model) | {
        "lever": f"{LEVER:g}",
        "state": "calibrated" if model.robot.record is not None else "nominal: never calibrated",
        "hash": model_hash(model.robot),
        "iterations": model.iterations,
        "renames": "\n".join(f"#define {model.prefix}_{name} {model.prefix}_{name}_f" for name in names),
        "joints": "\n".join(_joint_line(model.robot, i) for i in range(model.robot.dof)),
        "jacobian": 6 * model.robot.dof,
        "reached_double": repr(REACHED),
        "reached_float": f"{FLOAT_REACHED * max(model.robot.reach, 1.0):.2e}",
        "enumeration": ",\n".join(
            f"  {model.prefix.upper()}_JOINT_{name.upper()} = {i}"
            for i, name in enumerate(identifiers((j.name for j in model.robot.joints), "joint"))
        ),
        "of_terms": " and of the numbers of joint terms" if model.robot.terms else "",
        "parameter_list": _parameter_lines(model.parameters),
        "terms": "".join(f"\n * {line}" for line in _wrapped(term_sentences(model))),
        "only": "" if model.oriented else " only,\n * whatever its orientation",
    }
    real = f"{model.prefix}_real"
    values |= {
        name: signature(model, name, real) for name in model.functions if "_with" in name or "compensate" in name
    }
    for name in ("compensate_pose", "compensate_pose_with"):
        values[name] = (
            fill("compensate_pose.h", values | {"name": name, "signature": values[name]}) if model.oriented else ""
        )
    return fill("header.h", values)


def source(model: CModel) -> str:
    robot = model.robot
    limits = [
        np.where(np.isfinite(v), v, math.copysign(_UNLIMITED, s)) for v, s in ((robot.lower, -1), (robot.upper, 1))
    ]
    values = _common(model) | {
        "definitions": scalar_definitions(model.programs.values()),
        "lower": table(limits[0]),
        "upper": table(limits[1]),
        "cap": table(joint_caps(robot)),
        "errors": table(model.errors if len(model.errors) else np.zeros(1)),
        "identity": table(np.eye(4)[:3], 4),
        "tool": table(robot.tool[:3], 4),
        "tool_nominal": table(robot.nominal().tool[:3], 4),
        "functions": "\n".join(_function(model, name, program) for name, program in model.programs.items()),
        "compensations": "\n".join(_compensation(model, name) for name in model.functions if "compensate" in name),
    }
    return fill("source.c", values)


def signature(model: CModel, name: str, real: str) -> str:
    """Arguments of a public function."""
    n = model.robot.dof
    arguments = [f"const {real} q[{n}]"]
    if name.endswith("_with"):
        arguments.append(f"const {real} x[{_common(model)['space']}]")
        arguments += [] if "compensate" in name else [f"const {real} base[12]"]
        arguments.append(f"const {real} tool[12]")
    if "compensate" in name:
        arguments += [f"{real} q_out[{n}]", f"{real} *residual"]
    else:
        arguments.append(f"{real} jacobian[{6 * n}]" if "jacobian" in name else f"{real} pose[12]")
    text = ", ".join(arguments)
    return text if len(text) < _SIGNATURE else "\n    " + ",\n    ".join(arguments)


def table(values: Array, columns: int = 6) -> str:
    """A C initialiser; numbers read back exactly in double."""
    texts = [c_constant(portable(float(v))) for v in np.ravel(values)]
    rows = [", ".join(texts[k : k + columns]) for k in range(0, len(texts), columns)]
    return "{\n  " + ",\n  ".join(rows) + "\n}"


def _common(model: CModel) -> dict[str, object]:
    return {
        "robot": printable(model.robot.name),
        "prefix": model.prefix,
        "PREFIX": model.prefix.upper(),
        "dof": model.robot.dof,
        "parameters": len(model.parameters),
        "space": max(len(model.parameters), 1),  # C has no empty arrays
    }


def term_sentences(model: CModel) -> tuple[str, ...]:
    """What is said of joint terms: those that are built in, and what of them stays at nominal."""
    if not model.robot.terms:
        return ()
    names = [joint.name for joint in model.robot.joints]
    terms = listed([term.words(names) for term in model.robot.terms])
    said = [f"Joint terms are built in, as the robot file defines them: {terms}."]
    said += [] if model.left_out is None else [f"{model.left_out.text}."]
    return tuple(printable(sentence, _WHOLE) for sentence in said)


def _wrapped(sentences: Iterable[str]) -> list[str]:
    return [line for sentence in sentences for line in textwrap.wrap(sentence, _WIDTH)]


def _joint_line(robot: Robot, i: int) -> str:
    joint = robot.joints[i]
    limits = "no limits"
    if math.isfinite(joint.lower):
        limits = f"{joint.lower:.6g} to {joint.upper:.6g}"
    return f" *   q[{i}]  {'rad' if joint.revolute else 'mm '}  {limits}  {printable(joint.name)}"


def _parameter_lines(names: Sequence[str]) -> str:
    texts = [f"{i}: {name}" for i, name in enumerate(names)]
    return "\n".join(" *   " + ", ".join(texts[k : k + 6]) for k in range(0, len(texts), 6)) or " *   (none)"


def _function(model: CModel, name: str, program: Program) -> str:
    """A program as a C function: public ones as the header declares them, the others static."""
    inputs, outputs = [port.name for port in program.inputs], [port.name for port in program.outputs]
    if name in model.functions:
        head = f"void {model.prefix}_{name}({signature(model, name, 'real')})"
    else:
        arguments = [*(f"const real *{i}" for i in inputs), *(f"real *{o}" for o in outputs)]
        head = f"static void {name}({', '.join(arguments)})"
    return f"{head}\n{{\n{_indented(c_statements(program, inputs, outputs))}\n}}\n"


def _compensation(model: CModel, name: str) -> str:
    pose, given = "pose" in name, name.endswith("_with")
    squares = [f"error[{i}] * error[{i}]" for i in range(6 if pose else 3)]
    size = " + ".join(squares[:3])
    if pose:
        size += f"\n      + {c_constant(LEVER**2)} * ({' + '.join(squares[3:])})"
    return fill(
        "compensate.c",
        _common(model)
        | {
            "name": name,
            "signature": signature(model, name, "real"),
            "target": 12 if pose else 3,
            "errors": 6 if pose else 3,
            "goal": f"{model.prefix}_forward_nominal" if pose else "target_position",
            "kind": ("pose" if pose else "position") + ("_with" if given else ""),
            "given": " x, tool," if given else "",
            "size": size,
        },
    )


def _indented(lines: Iterable[str]) -> str:
    return "\n".join(f"  {line}" for line in lines)
