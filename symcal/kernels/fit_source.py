"""The C source of an identification of many problems at once: `fit.h` with the expressions of one measurement.

A value is computed as seldom as what it depends on allows: once per call, per pose, per reading (pose and problem),
per trial of errors (problem), or per pose and trial. The sine of a sum of a joint reading and an error is made of
those of its terms, so no sine is left in the innermost part of most robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Literal

from symcal.kernels.instructions import (
    Constant,
    Load,
    Operation,
    Program,
    Store,
    c_constant,
    c_expression,
)
from symcal.kernels.vector import scalar_text

ENTRY = "symcal_fit"

Given = Literal["shared", "pose", "reading"]
"""How an array is given: once for all, by pose, or by problem and pose."""

_BLOCK = 16_000  # bytes of a block of rows, which goes through the nearest cache many times
_POSE, _PROBLEM, _TRIAL = 1, 2, 4  # what a value changes with
_PORTS = ("q", "x", "setup", "z", "w")


@dataclass(frozen=True, slots=True)
class Layout:
    """The free errors are ``free`` of all, and the arrays are given so; z always is by problem and pose.

    weights: None where there are none: all rows are in units of one noise, and all were measured.
    """

    free: tuple[int, ...]
    q: Given
    setup: Given
    weights: Given | None

    def changes(self, port: int) -> int:
        """With what an element of a port changes."""
        given = {0: self.q, 2: self.setup, 3: "reading", 4: self.weights or "shared"}
        if port == 1:
            return _TRIAL | _PROBLEM
        return {"shared": 0, "pose": _POSE, "reading": _POSE | _PROBLEM}[given[port]]


@dataclass(slots=True)
class _Stage:
    """Code that runs equally often; values for later stages go to its table."""

    changes: int
    letter: str
    table: str
    lines: list[str] = field(default_factory=list)
    slots: dict[str, int] = field(default_factory=dict)
    fetched: set[str] = field(default_factory=set)

    @property
    def vector(self) -> bool:
        return bool(self.changes & _PROBLEM)

    @property
    def number(self) -> str:
        return "V" if self.vector else "double"


def fit_source(program: Program, layout: Layout, known: Program | None = None, *, portable: bool = False) -> str:
    """C source of `int symcal_fit(const Job *)`, see `fit.h`.

    Args:
        program: (q, x, setup, z) -> r, shape (m,), and J by the free errors, shape (m, n). known: (x, setup) -> the
            same of what is known between things, whitened, if there is any. portable: sines of values outside of the
            lanes are our own too.
    """
    ports = program.inputs
    rows, free = program.outputs[0].size, len(layout.free)
    # with two reflections at a time; columns a multiple of 4096 bytes apart would be in each other's way in the cache
    height = max(_BLOCK // (32 * (free + 1)), rows, 8) // rows * rows
    stages = _stages(program, layout)
    once, pose, reading, trial, row = stages
    sizes = {
        "NX": ports[1].size,
        "NF": free,
        "NC": free + 1,
        "ROWS": rows,
        "K": height,
        "SHARED": len(once.slots),
        "BY_POSE": len(pose.slots),
        "BY_READING": len(reading.slots),
        "BY_ERROR": len(trial.slots),
        "SYMCAL_FIT": ENTRY,
    }
    weights = [_weight(stages, k) for k in range(rows)] if layout.weights else []
    absent = " | ".join(f"(M)({weight} == v_all(0.0))" for weight in weights)
    here = "const double *by_pose, const V *by_reading"
    return "\n".join(
        [
            _header("lanes.h"),
            "#include <stdlib.h>",
            *(f"#define {name} {value}" for name, value in sizes.items()),
            f"static const int FREE[NF] = {{{', '.join(map(str, layout.free))}}};",
            scalar_text([program] if known is None else [program, known], portable=portable),
            _header("householder.h"),
            _header("fit.h"),
            *_function("void shared_values(const Job *job, double *shared)", once.lines),
            *_function(
                "void pose_values(const Job *job, ptrdiff_t i, const double *shared, double *by_pose)", pose.lines
            ),
            *_function(
                "void reading_values(const Job *job, const ptrdiff_t *who, ptrdiff_t i, const double *shared, "
                "const double *by_pose, V *by_reading)",
                reading.lines,
            ),
            *_function("void error_values(const V *x, const double *shared, V *by_error)", trial.lines),
            *_function(
                "void pose_rows(const double *restrict shared, const double *restrict by_pose, const V *restrict "
                "by_reading, const V *restrict by_error, V *restrict block)",
                row.lines,
            ),
            *_function(
                f"int has_missing({here})",
                [f"return m_any({absent});" if absent else "return 0;"],
            ),
            *_function(
                f"void without_missing({here}, V *block)",
                [
                    f"for (int c = 0; c < NC; c++) block[c * K + {k}] = "
                    f"(V)((M)block[c * K + {k}] & (M)({weight} != v_all(0.0)));"
                    for k, weight in enumerate(weights)
                ],
            ),
            *_known(known, layout),
            "",
        ]
    )


def _header(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _function(signature: str, lines: Sequence[str]) -> list[str]:
    return [f"static {signature} {{", *(f"  {line}" for line in lines), "}"]


class _Writer:
    """Puts every instruction where it runs as seldom as possible; lives only while a source is written."""

    def __init__(self, stages: Sequence[_Stage]) -> None:
        self.stages = {stage.changes: stage for stage in stages}
        self.where: dict[str, _Stage] = {}  # C name -> stage that computes it
        self.constants: dict[str, float] = {}
        self.sums: dict[str, tuple[str, str, str]] = {}  # name -> its terms a, b and the sign between: angle sums
        self.paired: set[str] = set()  # names whose sine and cosine are there
        self.fresh = 0

    def constant(self, value: float) -> str:
        text = c_constant(value)
        self.constants[text] = value
        return text

    def changes(self, names: Sequence[str]) -> int:
        found = 0
        for name in names:
            found |= 0 if name in self.constants else self.where[name].changes
        return found

    def define(self, changes: int, text: str, name: str = "") -> str:
        """A new value of a stage."""
        stage = self.stages[changes]
        if not name:
            self.fresh += 1
            name = f"{stage.letter}{self.fresh}"
        stage.lines.append(f"const {stage.number} {name} = {text};")
        self.where[name] = stage
        return name

    def use(self, name: str, changes: int) -> str:
        """How a stage writes a value, fetched from an earlier stage's table if it must be."""
        stage = self.stages[changes]
        if name in self.constants:
            return c_constant(self.constants[name], "v_") if stage.vector else name
        source = self.where[name]
        if source is stage:
            return name
        if name not in source.slots:
            source.slots[name] = len(source.slots)
            source.lines.append(f"{source.table}[{source.slots[name]}] = {name};")
        fetched = f"{name}_"
        if name not in stage.fetched:
            stage.fetched.add(name)
            element = f"{source.table}[{source.slots[name]}]"
            spread = stage.vector and not source.vector
            stage.lines.append(f"const {stage.number} {fetched} = {f'v_all({element})' if spread else element};")
        return fetched

    def operation(self, op: str, operands: Sequence[str]) -> str:
        if op in ("sin", "cos") and operands[0] not in self.constants:
            return self.sine(op, operands[0])
        changes = self.changes(operands)
        prefix = "v_" if self.stages[changes].vector else "real_"
        name = self.define(changes, c_expression(op, [self.use(each, changes) for each in operands], prefix))
        if op in ("add", "sub") and changes == _POSE | _PROBLEM | _TRIAL:
            self.sums[name] = (operands[0], operands[1], "+" if op == "add" else "-")
        return name

    def sine(self, op: str, angle: str) -> str:
        """sin and cos of one angle together; of a sum by those of its terms, where these change less often."""
        changes = self.where[angle].changes
        if angle in self.paired:
            return f"{angle}{op}"
        self.paired.add(angle)
        a, b, sign = self.sums.get(angle, ("", "", ""))
        if a and all(each in self.constants or self.where[each].changes != changes for each in (a, b)):
            sa, ca, sb, cb = (self.use(self.operation(f, [t]), changes) for t in (a, b) for f in ("sin", "cos"))
            self.define(changes, f"{sa} * {cb} {sign} {ca} * {sb}", f"{angle}sin")
            self.define(changes, f"{ca} * {cb} {'-' if sign == '+' else '+'} {sa} * {sb}", f"{angle}cos")
        elif self.stages[changes].vector:
            self.stages[changes].lines.append(f"V {angle}sin, {angle}cos; v_sincos({angle}, &{angle}sin, &{angle}cos);")
        else:
            self.stages[changes].lines += [
                f"const double {angle}{f} = {c_expression(f, [angle])};" for f in ("sin", "cos")
            ]
        self.where[f"{angle}sin"] = self.where[f"{angle}cos"] = self.stages[changes]
        return f"{angle}{op}"


def _stages(program: Program, layout: Layout) -> tuple[_Stage, ...]:
    """The code of every stage; the last writes weighted rows of J and r into a block."""
    everything = _POSE | _PROBLEM | _TRIAL
    stages = (
        _Stage(0, "c", "shared"),
        _Stage(_POSE, "p", "by_pose"),
        _Stage(_POSE | _PROBLEM, "g", "by_reading"),
        _Stage(_PROBLEM | _TRIAL, "x", "by_error"),
        _Stage(everything, "t", ""),
    )
    row, writer = stages[-1], _Writer(stages)
    count, free = program.outputs[0].size, len(layout.free)
    weights = [_load(writer, program, layout, 4, k) for k in range(count)] if layout.weights else []
    for weight in weights:
        writer.use(weight, everything)
    names: dict[int, str] = {}  # work index -> C name
    for i in program.instructions:
        match i:
            case Constant(work, value):
                names[work] = writer.constant(value)
            case Load(work, port, element):
                names[work] = _load(writer, program, layout, port, element)
            case Operation(work, op, args):
                names[work] = writer.operation(op, [names[a] for a in args])
            case Store(work, port, element):
                k, c = (element, free) if port == 0 else divmod(element, free)
                text = writer.use(names[work], everything)
                weight = f" * {writer.use(weights[k], everything)}" if weights else ""
                row.lines.append(f"block[{c} * K + {k}] = {text}{weight};")
    return stages


def _load(writer: _Writer, program: Program, layout: Layout, port: int, element: int) -> str:
    """An element of an array, in the stage that it belongs to."""
    changes = layout.changes(port)
    name = f"{writer.stages[changes].letter}_{_PORTS[port]}{element}"
    if name in writer.where:
        return name
    if port == 1:
        return writer.define(changes, f"x[{element}]", name)
    size = program.outputs[0].size if port == 4 else program.inputs[port].size
    array = f"job->{_PORTS[port]}"
    text = {
        0: f"{array}[{element}]",
        _POSE: f"{array}[i * {size} + {element}]",
        _POSE | _PROBLEM: f"LANE_BY_LANE({array}, {size}, {element})",
    }[changes]
    return writer.define(changes, text, name)


def _weight(stages: Sequence[_Stage], k: int) -> str:
    """The weight of a row of a pose, from the table where it is."""
    for stage in stages:
        slot = stage.slots.get(f"{stage.letter}_w{k}")
        if slot is not None:
            return f"{stage.table}[{slot}]" if stage.vector else f"v_all({stage.table}[{slot}])"
    raise AssertionError("every weight is used")


def _known(known: Program | None, layout: Layout) -> list[str]:
    """Rows of what is known between things: whitened, of errors and setup alone."""
    signature = "void known_rows(const Job *job, const V *x, V *triangle, V *block, V *squares)"
    if known is None:
        return _function(signature, ["(void)job, (void)x, (void)triangle, (void)block, (void)squares;"])
    free, count = len(layout.free), known.outputs[0].size
    names: dict[int, str] = {}
    lines = [f"V rows[{count} * NC];"]
    for index, i in enumerate(known.instructions):
        match i:
            case Constant(work, value):
                names[work] = c_constant(value, "v_")
            case Load(work, port, element):
                names[work] = f"x[{element}]" if port == 0 else f"v_all(job->setup[{element}])"
            case Operation(work, "sin" | "cos" as op, args):
                lines.append(f"V s{index}, c{index}; v_sincos({names[args[0]]}, &s{index}, &c{index});")
                names[work] = f"{op[0]}{index}"
            case Operation(work, op, args):
                lines.append(f"const V k{index} = {c_expression(op, [names[a] for a in args], 'v_')};")
                names[work] = f"k{index}"
            case Store(work, port, element):
                k, c = (element, free) if port == 0 else divmod(element, free)
                lines.append(f"rows[{k} * NC + {c}] = {names[work]};")
    return _function(
        signature,
        [
            *lines,
            f"for (int first = 0; first < {count}; first += K) {{",
            f"  const int count = {count} - first < K ? {count} - first : K;",
            "  for (int c = 0; c < NC; c++)",
            "    for (int i = 0; i < count; i++) block[c * K + i] = rows[(first + i) * NC + c] * v_all(job->unit);",
            "  *squares += sum_of_products(block + NF * K, block + NF * K, count);",
            "  absorb(triangle, block, count);",
            "}",
        ],
    )
