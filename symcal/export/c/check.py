"""An exported folder compiled for this machine and compared with the Python that it came from."""

from __future__ import annotations

import ctypes
import logging
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.compensation.targets import tool_pose
from symcal.export.c import CExport
from symcal.kernels.batch import batch_function
from symcal.kernels.compiler import VERSION_TIMEOUT_S, Compiler, CompilerError, compile_c, find_compiler, run
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

logger = logging.getLogger(__name__)

STATUSES = ("REACHED", "LIMIT", "CAP", "CLOSEST", "OUTSIDE")
"""How a compensation in C ends; the order is that of the header."""


@dataclass(frozen=True, slots=True)
class CCheck:
    """What a compiled export does at random readings, exact in single precision.

    compiler: its name and version. poses: how many readings. code_bytes: machine code of the library in double, and in
    float; None where the `size` program is missing.
    double_mm, float_mm: largest distance of the calibrated tool's position from Python's.
    uncompensated_mm, compensated_mm: largest distance of the calibrated tool from the nominal one's position, without
    and with compensation in double; compensated_mean_mm the mean. reached: share of readings that are compensated
    fully. status: how many ended how.
    """

    compiler: str
    poses: int
    code_bytes: tuple[int, int] | None
    double_mm: float
    float_mm: float
    uncompensated_mm: float
    compensated_mm: float
    compensated_mean_mm: float
    reached: float
    status: Mapping[str, int]


class CLibrary:
    """The functions of a compiled export over arrays of readings; ``real`` is the C type's NumPy twin."""

    def __init__(self, path: Path, export: CExport, robot: Robot, real: type[np.float64] | type[np.float32]) -> None:
        self._library = ctypes.CDLL(str(path))
        self._prefix, self._suffix = export.prefix, "" if real is np.float64 else "_f"
        self._dof, self._real = robot.dof, np.dtype(real)

    def _function(self, name: str) -> ctypes._NamedFuncPointer:
        return self._library[f"{self._prefix}_{name}{self._suffix}"]

    def evaluate(self, name: str, q: Array, size: int, given: Sequence[Array] = ()) -> Array:
        """A function of readings (N, dof), with further arguments that are the same for all; shape (N, size)."""
        inputs = np.ascontiguousarray(q, dtype=self._real)
        shared = [np.ascontiguousarray(value, dtype=self._real) for value in given]
        out = np.empty((len(q), size), dtype=self._real)
        call, between = self._function(name), [ctypes.c_void_p(value.ctypes.data) for value in shared]
        for start, end in zip(*(self._addresses(values) for values in (inputs, out)), strict=True):
            call(ctypes.c_void_p(start), *between, ctypes.c_void_p(end))
        return out.astype(np.float64)

    def compensate(self, name: str, q: Array, given: Sequence[Array] = ()) -> tuple[Array, Array, NDArray[np.int_]]:
        """Compensated readings (N, dof), residuals (N,) in mm, status (N,)."""
        inputs = np.ascontiguousarray(q, dtype=self._real)
        shared = [np.ascontiguousarray(value, dtype=self._real) for value in given]
        out, residual = np.empty_like(inputs), np.empty((len(q), 1), dtype=self._real)
        status = np.empty(len(q), dtype=np.int_)
        call, between = self._function(name), [ctypes.c_void_p(value.ctypes.data) for value in shared]
        rows = zip(*(self._addresses(values) for values in (inputs, out, residual)), strict=True)
        for i, (start, end, left) in enumerate(rows):
            status[i] = call(ctypes.c_void_p(start), *between, ctypes.c_void_p(end), ctypes.c_void_p(left))
        return out.astype(np.float64), residual[:, 0].astype(np.float64), status

    @staticmethod
    def _addresses(values: NDArray[np.generic]) -> range:
        first, stride = values.ctypes.data, values.strides[0]
        return range(first, first + stride * len(values), stride)


def build_library(
    export: CExport, robot: Robot, folder: Path, real: type[np.float64] | type[np.float32], flags: Sequence[str] = ()
) -> CLibrary:
    """Compile an export as a shared library into ``folder`` and load it.

    Args:
        flags: of the compiler, besides -std=c99 -O2.
    Raises:
        OSError: there is no C compiler, it refused (the message is its own), or it hung.
    """
    compiler = find_compiler()
    if compiler is None:
        raise OSError("no C compiler found (CC, cc, gcc, clang)")
    kind = "double" if real is np.float64 else "float"
    target = folder / f"{export.prefix}_{kind}.so"
    define = ["-DSYMCAL_FLOAT"] if kind == "float" else []
    source = export.folder / f"{export.prefix}_kinematics.c"
    compile_c(compiler, ["-std=c99", "-O2", "-fPIC", "-shared", *define, *flags, "-o", str(target), str(source), "-lm"])
    return CLibrary(target, export, robot, real)


def check_c(export: CExport, robot: Robot, rng: np.random.Generator, count: int = 2000) -> CCheck | None:
    """Compile and compare; None, with a log entry, where there is no working C compiler.

    Args:
        robot: what was exported. rng: for the readings. count: how many.
    """
    compiler = find_compiler()
    if compiler is None:
        logger.info("the exported C is not checked: no C compiler found (CC, cc, gcc, clang)")
        return None
    with tempfile.TemporaryDirectory(prefix="symcal", ignore_cleanup_errors=True) as scratch:
        try:
            double = build_library(export, robot, Path(scratch), np.float64)
            single = build_library(export, robot, Path(scratch), np.float32)
        except OSError as error:
            logger.warning("the exported C is not checked: %s", error)
            return None
        q = random_readings(robot, rng, count)
        (poses,) = batch_function(tool_pose(robot), evaluations=count)(q)
        (wanted,) = batch_function(tool_pose(robot.nominal()), evaluations=2 * count)(q)
        commands, _, status = double.compensate("compensate", q)
        (after,) = batch_function(tool_pose(robot), evaluations=count)(commands)

        def far(a: Array, b: Array) -> Array:
            return np.asarray(np.linalg.norm(a - b, axis=1))

        positions = poses[:, :3, 3]
        left = far(after[:, :3, 3], wanted[:, :3, 3])
        return CCheck(
            compiler=compiler.version.splitlines()[0],
            poses=count,
            code_bytes=_code_bytes(compiler, export, Path(scratch)),
            double_mm=float(far(double.evaluate("forward", q, 12)[:, 3::4], positions).max()),
            float_mm=float(far(single.evaluate("forward", q, 12)[:, 3::4], positions).max()),
            uncompensated_mm=float(far(positions, wanted[:, :3, 3]).max()),
            compensated_mm=float(left.max()),
            compensated_mean_mm=float(left.mean()),
            reached=float((status == 0).mean()),
            status={name: count for k, name in enumerate(STATUSES) if (count := int((status == k).sum()))},
        )


def random_readings(robot: Robot, rng: np.random.Generator, count: int) -> Array:
    """Readings uniform within the limits, or a turn or the reach where there are none; float32-exact, (N, dof)."""
    span = np.array([(np.pi if j.revolute else max(robot.reach, 100.0)) / abs(j.ratio) for j in robot.joints])
    lower = np.where(np.isfinite(robot.lower), robot.lower, -span)
    upper = np.where(np.isfinite(robot.upper), robot.upper, span)
    q: Array = rng.uniform(lower, upper, (count, robot.dof))
    return q.astype(np.float32).astype(np.float64)


def _code_bytes(compiler: Compiler, export: CExport, folder: Path) -> tuple[int, int] | None:
    size = shutil.which("size")
    if size is None:
        return None
    found = []
    for kind, define in (("double", []), ("float", ["-DSYMCAL_FLOAT"])):
        target = folder / f"{kind}.o"
        source = export.folder / f"{export.prefix}_kinematics.c"
        try:
            compile_c(compiler, ["-std=c99", "-O2", *define, "-c", "-o", str(target), str(source)])
            rows = run([size, str(target)], VERSION_TIMEOUT_S, keep="stdout").splitlines()
        except CompilerError:
            return None
        if len(rows) < 2 or not rows[1].split()[0].isdigit():
            return None
        found.append(int(rows[1].split()[0]))
    return found[0], found[1]
