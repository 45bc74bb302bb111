"""Joint readings and measurements that were recorded side by side, matched by time into a table of measurements.

Two rules, of which a file says which holds. `still`: a pose is where the robot stands still (`symcal.readers.still`);
its readings are the means of both recordings over that time, without its beginning, in which arm and filter settle, and
without as much of its end as the clocks may differ. `nearest`: every measurement is a pose, with the joint readings
nearest in time. Both are ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.documents.table import LARGEST, Table
from symcal.errors import InputError
from symcal.readers.still import still_intervals
from symcal.readers.time_shift import found_shift
from symcal.words import plural

Array = NDArray[np.float64]

Joints = Sequence[tuple[str, bool]]
"""Name of every joint of a robot, and whether it is revolute."""


@dataclass(frozen=True, slots=True)
class Stream:
    """What was recorded under one name.

    part: of the file, as an error names it. t: times in s, ascending, shape (N,). values: shape (N, k); of joints rad
    and mm, of measurements x, y, z in m, or a pose with quaternion qx, qy, qz, qw. notes: what is to be said of it.
    """

    path: Path
    part: str
    t: Array
    values: Array
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Matching:
    """How two recordings are matched.

    tolerance: s, by which their clocks may differ. still: s, the shortest time that counts as standing still; settle:
    s of its beginning that are left out. band_angle, band_length: rad and mm within which a reading stands still.
    shift: s, by which the measurements are late, as far as that is known.
    """

    by: Literal["still", "nearest"] = "still"
    tolerance: float = 0.02
    still: float = 0.5
    settle: float = 0.2
    band_angle: float = 1e-3
    band_length: float = 0.1
    shift: float = 0.0


def stream(
    path: Path, part: str, t: Array, values: Array, notes: tuple[str, ...] = (), *, measured: bool = False
) -> Stream:
    """A recording in the order of its times, checked.

    Raises:
        InputError: it is empty, or something in it is not finite or no unit quaternion.
    """
    if not len(t):
        raise InputError("nothing was recorded here", file=path, part=part or None)
    for row in np.flatnonzero(~(np.abs(np.column_stack([t, values])) <= LARGEST).all(axis=1)):
        message = f"a number that is not finite, or larger than {LARGEST:g}, in message {row + 1}"
        raise InputError(message, file=path, part=part or None)
    if measured and values.shape[1] == 7:
        norm = np.linalg.norm(values[:, 3:], axis=1)
        for row in np.flatnonzero(np.abs(norm - 1) > 1e-3):
            message = f"the quaternion of message {row + 1} is not of unit length"
            raise InputError(message, file=path, part=part or None, found=f"{norm[row]:.6g}")
    order = np.argsort(t, kind="stable")
    return Stream(path, part, t[order], values[order], notes)


def matched(joints: Stream, measured: Stream, of: Joints, how: Matching) -> Table:
    """The table of measurements of two recordings: `pose`, `q1_rad` or `q1_mm`.., `x_m`.., and `qx`.. of poses.

    Raises:
        InputError: they have no time in common, the robot never stands still, or nothing fits within the tolerance.
    """
    measured = replace(measured, t=measured.t - how.shift)
    notes = [*joints.notes, *measured.notes]
    if how.shift:
        notes.append(f"times of the measurements are taken {how.shift:g} s earlier, as said")
    notes += _shifted(joints, measured, of, how)
    if joints.t[-1] < measured.t[0] or measured.t[-1] < joints.t[0]:
        message = "joint readings and measurements have no time in common: is it one clock? (see 'time_shift_s')"
        raise InputError(message, file=measured.path, found=f"{_span(joints)} and {_span(measured)}")
    rows, said = (_where_still if how.by == "still" else _nearest)(joints, measured, of, how)
    columns = [f"q{i}_{'rad' if revolute else 'mm'}" for i, (_, revolute) in enumerate(of, start=1)]
    columns += ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"][: measured.values.shape[1]]
    cells = [[str(i) for i in range(len(rows))], *([repr(cell) for cell in column] for column in rows.T.tolist())]
    return Table(
        measured.path,
        ("pose", *columns),
        tuple(("\n".join(column),) for column in cells),
        range(1, len(rows) + 1),
        None,
        part=measured.part,
        notes=(*notes, said),
    )


def _where_still(joints: Stream, measured: Stream, of: Joints, how: Matching) -> tuple[Array, str]:
    band = np.array([how.band_angle if revolute else how.band_length for _, revolute in of])
    found = still_intervals(joints.t, joints.values, band, how.still)
    if not found:
        message = (
            f"the robot never stands still for {how.still:g} s ({_band(how)}): say 'still_s', 'still_rad' and "
            "'still_mm' as they are, or 'match: nearest'"
        )
        raise InputError(message, file=joints.path, part=joints.part or None)
    rows, counts, alone = [], [], 0
    for first, behind in found:
        begin, end = joints.t[first] + how.settle, joints.t[behind - 1] - how.tolerance
        read = joints.values[(joints.t >= begin) & (joints.t <= end)]
        seen = measured.values[(measured.t >= begin) & (measured.t <= end)]
        if not len(read) or not len(seen):
            alone += 1
            continue
        rows.append(np.concatenate([read.mean(axis=0), _mean(seen)]))
        counts.append((len(read), len(seen)))
    if not rows:
        message = f"nothing was measured in any of the {plural(len(found), 'time')} that the robot stands still"
        raise InputError(message, file=measured.path, part=measured.part or None)
    many = np.median(counts, axis=0)
    text = (
        f"{plural(len(rows), 'pose')} where the robot stands still for {how.still:g} s or more ({_band(how)}): means, "
        f"in the median of {many[0]:.0f} joint readings and {many[1]:.0f} measurements, without the first "
        f"{how.settle:g} s and the last {how.tolerance:g} s"
    )
    return np.array(rows), text + (f"; {plural(alone, 'more')} in which nothing was measured" if alone else "")


def _band(how: Matching) -> str:
    return f"readings within {how.band_angle:g} rad, {how.band_length:g} mm"


def _nearest(joints: Stream, measured: Stream, of: Joints, how: Matching) -> tuple[Array, str]:  # noqa: ARG001
    after = (
        np.clip(np.searchsorted(joints.t, measured.t), 1, len(joints.t) - 1)
        if len(joints.t) > 1
        else np.zeros(len(measured.t), dtype=np.intp)
    )
    before = np.maximum(after - 1, 0)
    near = np.where(np.abs(joints.t[after] - measured.t) < np.abs(joints.t[before] - measured.t), after, before)
    apart = np.abs(joints.t[near] - measured.t)
    kept = np.flatnonzero(apart <= how.tolerance)
    if not len(kept):
        message = (
            f"no measurement is within {how.tolerance:g} s of a joint reading: say 'tolerance_s' or 'time_shift_s'"
        )
        raise InputError(message, file=measured.path, part=measured.part or None, found=f"{apart.min():.6g} s")
    text = (
        f"{plural(len(kept), 'pose')}, each with the joint readings nearest in time, at most {how.tolerance:g} s away "
        f"(median {np.median(apart[kept]):.3g} s)"
    )
    left = len(measured.t) - len(kept)
    rows = np.hstack([joints.values[near[kept]], measured.values[kept]])
    return rows, text + (f"; {plural(left, 'measurement')} without such readings left out" if left else "")


def _mean(seen: Array) -> Array:
    """The mean of positions, or of poses."""
    if seen.shape[1] == 3:
        return np.asarray(seen.mean(axis=0))
    rotation = spatial.mean_rotation(spatial.quaternion_matrices(seen[:, 3:]))
    return np.concatenate([seen[:, :3].mean(axis=0), spatial.matrix_quaternions(rotation[None])[0]])


def _shifted(joints: Stream, measured: Stream, of: Joints, how: Matching) -> list[str]:
    """What is said of a shift of the clocks beyond the tolerance."""
    size = np.array([1.0 if revolute else 1e-3 for _, revolute in of])
    found = found_shift(*_speed(joints.t, joints.values * size), *_speed(measured.t, measured.values))
    if found is None or abs(found.seconds) <= how.tolerance:
        return []
    late = "later" if found.seconds > 0 else "earlier"
    return [
        f"measurements come {abs(found.seconds):.3f} s {late} than the joint readings that they belong to, by the "
        f"speeds in both (correlation {found.correlation:.2f}, without {found.without:.2f}): if so, say "
        f"'time_shift_s: {found.seconds + how.shift:.3f}'"
    ]


def _speed(t: Array, values: Array) -> tuple[Array, Array]:
    """How fast numbers change, and when, shape (M,) each; the two signs of a quaternion are one rotation."""
    apart = np.flatnonzero(np.diff(t, prepend=-np.inf) > 1e-6)
    t, values = t[apart], values[apart]
    change = np.diff(values, axis=0)
    if values.shape[1] == 7:
        turn = 2 * np.minimum(
            np.linalg.norm(change[:, 3:], axis=1), np.linalg.norm(values[1:, 3:] + values[:-1, 3:], axis=1)
        )
        size = np.hypot(np.linalg.norm(change[:, :3], axis=1), turn)
    else:
        size = np.linalg.norm(change, axis=1)
    return (t[1:] + t[:-1]) / 2, size / np.diff(t)


def _span(recorded: Stream) -> str:
    return f"{recorded.t[0]:.3f} to {recorded.t[-1]:.3f} s"
