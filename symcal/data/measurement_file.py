"""CSV files of measurements, in and out.

One row per observation: `pose,q1_deg,...,point,x_mm,y_mm,z_mm` (position; or wide, `P1_x_mm,...`),
`x_m,y_m,z_m,qx,qy,qz,qw` or `roll_deg,pitch_deg,yaw_deg` (pose), `pose,q1_deg,...,point,u_px,v_px` (pixels). Optional
`sigma_*` and `split` columns.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.data.dataset import Dataset
from symcal.data.notes import notes, unread
from symcal.data.split import Split as Split
from symcal.data.split import splits
from symcal.documents.table import Table, joint_readings, read_table
from symcal.errors import InputError
from symcal.instruments.protocol import Kind, Quantity, Unit
from symcal.instruments.registry import KINDS, kind_named
from symcal.robot.robot import Robot
from symcal.units import ANGLE, LENGTH, PIXEL, split_unit

Array = NDArray[np.float64]

_UNITS: dict[Unit, Mapping[str, float]] = {"mm": LENGTH, "rad": ANGLE, "px": PIXEL}
_FRAME_ANGLES = ("roll", "pitch", "yaw")


def load_measurements(
    path: Path | str,
    robot: Robot,
    kind: str,
    *,
    point_names: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    split: Split | None = None,
    delimiter: str | None = None,
    decimal: str = ".",
) -> Dataset:
    """Read a CSV file of measurements.

    Args:
        point_names: the tool points expected (`position`, `pixels`); those of the file when empty.
        columns: canonical name -> name in the file. split: as the config says; a column called `split` is used when
            there is one.
    Raises:
        InputError: with line and column for everything that cannot be read; nothing is dropped silently.
    """
    table = read_table(path, columns, delimiter=delimiter, decimal=decimal)
    if not len(table):
        raise InputError("the file has a header but no rows", file=path)
    split, expected = split or Split(), tuple(point_names)
    reads = kind_named(kind)
    measured = _measured_stems(table, reads, expected)
    known = _known_stems(table, robot, split)
    for canonical in columns or {}:
        if split_unit(canonical)[0] not in known:
            message = "'columns' gives a column a name that means nothing here"
            raise InputError(message, file=path, key="columns", found=canonical, allowed=sorted(known))
    q = joint_readings(table, [(joint.name, joint.revolute) for joint in robot.joints], measured)
    poses: Sequence[object] = range(len(table))
    if not reads.reads_points:
        data = _read_pose(table, q, reads)
    elif measured:
        data, poses = _read_long(table, q, reads, expected), _pose_keys(table, q)
    else:
        data = _read_wide(table, q, reads, expected)
    data = replace(data, split=splits(table, poses, split), provenance=str(path))
    return replace(data, notes=(*notes(data, robot), *unread(table, known, expected)))


def _measured_stems(table: Table, kind: Kind, expected: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of the measurement that a joint may be called like; none in a wide file, where points have names."""
    stems = table.stems()
    names = tuple(name for name, _ in kind.columns)
    if not kind.reads_points:
        lengths = tuple(name for name, unit in kind.columns if unit is not None)
        return (*lengths, *(() if "qw" in stems or "qx" in stems else _FRAME_ANGLES))
    wide = _wide_points(table) if names == tuple("xyz") else ()
    return () if wide and ("x" not in stems or set(wide) & set(expected)) else names


def _wide_points(table: Table) -> tuple[str, ...]:
    return tuple(s.removesuffix("_x") for s in table.stems() if s.endswith("_x") and not s.startswith("sigma_"))


def _known_stems(table: Table, robot: Robot, split: Split) -> set[str]:
    """Every column stem that can mean something in this file."""
    every = [quantity for kind in KINDS.values() for quantity in kind.quantities]
    sigmas = {name for quantity in every for name in (quantity.sigma_column, *quantity.sigma_columns)}
    wide = {f"{name}_{c}" for name in _wide_points(table) for c in "xyz"}
    joints = {name for i, joint in enumerate(robot.joints, start=1) for name in (f"q{i}", joint.name)}
    measured = {name for kind in KINDS.values() for name, _ in kind.columns} | set(_FRAME_ANGLES)
    return {"pose", "point", split.column or "split"} | sigmas | wide | joints | measured


def _pose_keys(table: Table, q: Array) -> list[object]:
    if "pose" in table.columns:
        return list(table.text("pose"))
    if "point" in table.columns:
        return [tuple(row) for row in q.tolist()]
    return list(range(len(table)))


def _first_rows(table: Table, q: Array) -> NDArray[np.intp]:
    first: dict[object, int] = {}
    for i, key in enumerate(_pose_keys(table, q)):
        first.setdefault(key, i)
    return np.array(list(first.values()), dtype=np.intp)


def _labels(table: Table, rows: NDArray[np.intp]) -> tuple[str, ...]:
    if "pose" in table.columns:
        names = table.text("pose")
        return tuple(names[i] for i in rows)
    return tuple(str(i) for i in range(len(rows)))


def _read_long(table: Table, q: Array, kind: Kind, expected: tuple[str, ...]) -> Dataset:
    names, components, size = expected, [name for name, _ in kind.columns], len(kind.columns)
    (quantity,) = kind.quantities
    units = _UNITS[quantity.unit]
    points = table.text("point") if "point" in table.columns else None
    if points is None:
        names = names or ("P",)
        if len(names) != 1:
            message = f"the measurement has {len(names)} points, but the file has no 'point' column"
            raise InputError(message, file=table.path, line=table.head_line, allowed=names)
        points = [names[0]] * len(table)
    names = names or tuple(dict.fromkeys(points))
    keys = _pose_keys(table, q)
    place = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    firsts = _first_rows(table, q)
    values = np.column_stack([table.quantity(c, units, f"the measured {c}") for c in components])
    noise = _sigma(table, [quantity], units)
    z = np.full((len(place), size * len(names)), np.nan)
    sigma = np.full_like(z, np.nan)
    for row, (key, point) in enumerate(zip(keys, points, strict=True)):
        if point not in names:
            raise InputError(
                "no such point among those of the measurement",
                file=table.path,
                line=table.lines[row],
                column="point",
                found=point,
                allowed=names,
            )
        i, k = place[key], names.index(point)
        if not np.allclose(q[row], q[firsts[i]], rtol=0, atol=1e-9):
            message = f"pose {key!r} has other joint readings here than in line {table.lines[firsts[i]]}"
            raise InputError(message, file=table.path, line=table.lines[row], column="pose")
        if np.isfinite(z[i, size * k]):
            message = f"point '{point}' of pose '{key}' stands twice; give repeated measurements a pose of their own"
            raise InputError(message, file=table.path, line=table.lines[row], column="pose")
        z[i, size * k : size * (k + 1)] = values[row]
        if noise is not None:
            sigma[i, size * k : size * (k + 1)] = noise[row]
    return Dataset(kind.name, q[firsts], z, _labels(table, firsts), (), names, None if noise is None else sigma)


def _read_wide(table: Table, q: Array, kind: Kind, expected: tuple[str, ...]) -> Dataset:
    found = _wide_points(table)
    names = expected or found
    for name in names:
        if name not in found:
            raise InputError(
                "the file has no columns for this point of the measurement",
                file=table.path,
                line=table.head_line,
                found=name,
                allowed=found,
            )
    z = np.column_stack(
        [table.quantity(f"{n}_{c}", LENGTH, f"{c} of point '{n}'", empty=True) for n in names for c in "xyz"]
    )
    for row in range(len(z)):
        for k, name in enumerate(names):
            if 0 < np.isnan(z[row, 3 * k : 3 * k + 3]).sum() < 3:
                message = f"point '{name}' has one or two coordinates: leave all three empty when it was not seen"
                raise InputError(message, file=table.path, line=table.lines[row], column=f"{name}_x")
        if np.isnan(z[row]).all():
            raise InputError("no point was measured in this row: remove it", file=table.path, line=table.lines[row])
    sigma = _sigma(table, list(kind.quantities) * len(names), LENGTH)
    return Dataset(kind.name, q, z, _labels(table, np.arange(len(z))), (), names, sigma)


def _read_pose(table: Table, q: Array, kind: Kind) -> Dataset:
    stems = table.stems()
    xyz = np.column_stack([table.quantity(c, LENGTH, f"the measured {c}") for c in "xyz"])
    if "qw" in stems or "qx" in stems:
        for c in ("qx", "qy", "qz", "qw"):
            if c not in table.columns:
                raise InputError(
                    "a quaternion column is missing",
                    file=table.path,
                    line=table.head_line,
                    column=c,
                    allowed=table.columns,
                )
        quaternion = np.column_stack([table.numbers(c) for c in ("qx", "qy", "qz", "qw")])
        for row in np.flatnonzero(np.abs(np.linalg.norm(quaternion, axis=1) - 1) > 1e-3):
            norm = float(np.linalg.norm(quaternion[row]))
            raise InputError(
                "the quaternion is not of unit length", file=table.path, line=table.lines[row], found=f"{norm:.6g}"
            )
    else:
        angles = [table.quantity(c, ANGLE, f"the measured {c} (or qx, qy, qz, qw)") for c in _FRAME_ANGLES]
        quaternion = Rotation.from_matrix(spatial.rpy_matrix(np.column_stack(angles))).as_quat()
    parts = [_sigma(table, [quantity], _UNITS[quantity.unit]) for quantity in kind.quantities]
    sigma = None
    if any(part is not None for part in parts):
        blanks = [np.full((len(table), quantity.size), np.nan) for quantity in kind.quantities]
        sigma = np.hstack([blank if part is None else part for part, blank in zip(parts, blanks, strict=True)])
    z = np.hstack([xyz, quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)])
    return Dataset(kind.name, q, z, _labels(table, np.arange(len(z))), (), (), sigma)


def _sigma(table: Table, quantities: list[Quantity], units: Mapping[str, float]) -> Array | None:
    """Columns `sigma_x_mm`.. per component, or one `sigma_mm` (`sigma_rot_rad`) for all; None when there are none."""
    stems = table.stems()
    each = [name for quantity in quantities for name in quantity.sigma_columns]
    single = [quantity.sigma_column for quantity in quantities for _ in quantity.sigma_columns]
    wanted = each if any(stem in stems for stem in each) else single
    if not any(stem in stems for stem in wanted):
        return None
    out = [table.quantity(stem, units, f"the measurement's {stem}") for stem in wanted]
    values = np.column_stack(out)
    for row in np.flatnonzero((values <= 0).any(axis=1)):
        raise InputError("a sigma must be positive", file=table.path, line=table.lines[row], found=values[row].min())
    return values


def save_measurements(data: Dataset, robot: Robot, path: Path | str) -> None:
    """Write the canonical CSV (deg and mm) that `load_measurements` reads back."""
    units = ["deg" if joint.revolute else "mm" for joint in robot.joints]
    head = ["pose", *(f"q{i}_{unit}" for i, unit in enumerate(units, start=1))]
    q = np.where([joint.revolute for joint in robot.joints], np.rad2deg(data.q), data.q)
    rows: list[list[object]] = []
    kind = kind_named(data.kind)
    size, width = len(kind.columns), sum(quantity.size for quantity in kind.quantities)
    head += ["point"] if kind.reads_points else []
    head += [name if unit is None else f"{name}_{unit}" for name, unit in kind.columns]
    for i in range(len(data)):
        for k, name in enumerate(data.point_names or ("",)):
            own, errors = slice(size * k, size * (k + 1)), slice(width * k, width * (k + 1))
            if np.isfinite(data.z[i, own]).all():
                cells = [*data.z[i, own], *_sigma_cells(data, i, errors)]
                rows.append([data.labels[i], *q[i], *([name] if kind.reads_points else []), *cells, data.split[i]])
    if data.sigma is not None:
        head += [f"{name}_{quantity.unit}" for quantity in kind.quantities for name in quantity.sigma_columns]
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*head, "split"])
        writer.writerows([[repr(float(c)) if isinstance(c, float) else c for c in row] for row in rows])


def _sigma_cells(data: Dataset, row: int, columns: slice) -> list[float]:
    return [] if data.sigma is None else [float(v) for v in data.sigma[row, columns]]
