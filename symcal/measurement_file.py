"""CSV files of measurements, in and out.

One row per observation: `pose,q1_deg,...,point,x_mm,y_mm,z_mm` (position; or wide, `P1_x_mm,...`),
`x_m,y_m,z_m,qx,qy,qz,qw` or `roll_deg,pitch_deg,yaw_deg` (pose). Optional `sigma_*` and `split` columns.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.dataset import Dataset, Kind
from symcal.errors import InputError
from symcal.robot import Robot
from symcal.table import ANGLE, LENGTH, Table, joint_readings, read_table

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Split:
    """How poses fall into training and test.

    By the labels of a column, or by a random share; all train without either.
    """

    column: str | None = None
    train: tuple[str, ...] = ("train",)
    test: tuple[str, ...] = ("test",)
    test_fraction: float | None = None


def load_measurements(
    path: Path | str,
    robot: Robot,
    kind: Kind,
    *,
    point_names: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    split: Split | None = None,
    delimiter: str | None = None,
    decimal: str = ".",
) -> Dataset:
    """Read a CSV file of measurements.

    Args:
        point_names: the tool points expected (`position`); those of the file when empty.
        columns: canonical name -> name in the file. split: as the config says; a column called `split` is used when
            there is one.
    Raises:
        InputError: with line and column for everything that cannot be read; nothing is dropped silently.
    """
    table = read_table(path, columns, delimiter=delimiter, decimal=decimal)
    if not len(table):
        raise InputError("the file has a header but no rows", file=path)
    q = joint_readings(table, [(joint.name, joint.revolute) for joint in robot.joints])
    read = _read_position if kind == "position" else _read_pose
    data = read(table, q, tuple(point_names))
    firsts = _first_rows(table, q) if kind == "position" else np.arange(len(table))
    data = replace(data, split=_splits(table, firsts, split or Split()), provenance=str(path))
    return replace(data, notes=_notes(data, robot))


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


def _read_position(table: Table, q: Array, expected: tuple[str, ...]) -> Dataset:
    stems = table.stems()
    wide = [stem.removesuffix("_x") for stem in stems if stem.endswith("_x") and not stem.startswith("sigma_")]
    if wide and "x" not in stems:
        return _read_wide(table, q, expected, tuple(wide))
    names = expected
    points = table.text("point") if "point" in table.columns else None
    if points is None:
        names = names or ("P",)
        if len(names) != 1:
            message = f"the measurement has {len(names)} points, but the file has no 'point' column"
            raise InputError(message, file=table.path, line=1, allowed=names)
        points = [names[0]] * len(table)
    names = names or tuple(dict.fromkeys(points))
    keys = _pose_keys(table, q)
    place = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    firsts = _first_rows(table, q)
    xyz = np.column_stack([table.quantity(c, LENGTH, f"the measured {c}") for c in "xyz"])
    noise = _sigma(table, [("x", "y", "z")], LENGTH, "")
    z = np.full((len(place), 3 * len(names)), np.nan)
    sigma = np.full_like(z, np.nan)
    for row, (key, point) in enumerate(zip(keys, points, strict=True)):
        if point not in names:
            raise InputError(
                "no such point", file=table.path, line=table.lines[row], key="point", found=point, allowed=names
            )
        i, k = place[key], names.index(point)
        if not np.allclose(q[row], q[firsts[i]], rtol=0, atol=1e-9):
            message = f"pose {key!r} has other joint readings here than in line {table.lines[firsts[i]]}"
            raise InputError(message, file=table.path, line=table.lines[row], key="pose")
        if np.isfinite(z[i, 3 * k]):
            message = f"point '{point}' of pose '{key}' stands twice; give repeated measurements a pose of their own"
            raise InputError(message, file=table.path, line=table.lines[row], key="pose")
        z[i, 3 * k : 3 * k + 3] = xyz[row]
        if noise is not None:
            sigma[i, 3 * k : 3 * k + 3] = noise[row]
    return Dataset("position", q[firsts], z, _labels(table, firsts), (), names, None if noise is None else sigma)


def _read_wide(table: Table, q: Array, expected: tuple[str, ...], found: tuple[str, ...]) -> Dataset:
    names = expected or found
    for name in names:
        if name not in found:
            raise InputError("there are no columns for this point", file=table.path, line=1, found=name, allowed=found)
    z = np.column_stack(
        [table.quantity(f"{n}_{c}", LENGTH, f"{c} of point '{n}'", empty=True) for n in names for c in "xyz"]
    )
    for row in range(len(z)):
        for k, name in enumerate(names):
            if 0 < np.isnan(z[row, 3 * k : 3 * k + 3]).sum() < 3:
                message = f"point '{name}' has one or two coordinates: leave all three empty when it was not seen"
                raise InputError(message, file=table.path, line=table.lines[row], key=f"{name}_x")
        if np.isnan(z[row]).all():
            raise InputError("no point was measured in this row: remove it", file=table.path, line=table.lines[row])
    sigma = _sigma(table, [("x", "y", "z")] * len(names), LENGTH, "")
    return Dataset("position", q, z, _labels(table, np.arange(len(z))), (), names, sigma)


def _read_pose(table: Table, q: Array, _: tuple[str, ...]) -> Dataset:
    stems = table.stems()
    xyz = np.column_stack([table.quantity(c, LENGTH, f"the measured {c}") for c in "xyz"])
    if "qw" in stems or "qx" in stems:
        for c in ("qx", "qy", "qz", "qw"):
            if c not in table.columns:
                raise InputError(
                    "a quaternion column is missing", file=table.path, line=1, key=c, allowed=table.columns
                )
        quaternion = np.column_stack([table.numbers(c) for c in ("qx", "qy", "qz", "qw")])
        for row in np.flatnonzero(np.abs(np.linalg.norm(quaternion, axis=1) - 1) > 1e-3):
            norm = float(np.linalg.norm(quaternion[row]))
            raise InputError(
                "the quaternion is not of unit length", file=table.path, line=table.lines[row], found=f"{norm:.6g}"
            )
    else:
        angles = [table.quantity(c, ANGLE, f"the measured {c} (or qx, qy, qz, qw)") for c in ("roll", "pitch", "yaw")]
        quaternion = Rotation.from_matrix(spatial.rpy_matrix(np.column_stack(angles))).as_quat()
    length = _sigma(table, [("x", "y", "z")], LENGTH, "")
    angle = _sigma(table, [("rx", "ry", "rz")], ANGLE, "rot")
    sigma = None
    if length is not None or angle is not None:
        blank = np.full((len(table), 3), np.nan)
        sigma = np.hstack([blank if length is None else length, blank if angle is None else angle])
    z = np.hstack([xyz, quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)])
    return Dataset("pose", q, z, _labels(table, np.arange(len(z))), (), (), sigma)


def _sigma(table: Table, blocks: list[tuple[str, ...]], units: Mapping[str, float], suffix: str) -> Array | None:
    """Columns `sigma_x_mm`.. per component, or one `sigma_mm` (`sigma_rot_rad`) for all; None when there are none."""
    stems = table.stems()
    single = f"sigma_{suffix}" if suffix else "sigma"
    out = []
    for components in blocks:
        for c in components:
            stem = f"sigma_{c}" if f"sigma_{c}" in stems else single
            if stem not in stems:
                return None
            out.append(table.quantity(stem, units, "the sigma of the measurement"))
    values = np.column_stack(out)
    for row in np.flatnonzero((values <= 0).any(axis=1)):
        raise InputError("a sigma must be positive", file=table.path, line=table.lines[row], found=values[row].min())
    return values


def _splits(table: Table, rows: NDArray[np.intp], split: Split) -> tuple[str, ...]:
    column = split.column or ("split" if "split" in table.columns else None)
    if column is None:
        return ("train",) * len(rows)
    if column not in table.columns:
        raise InputError("there is no such column", file=table.path, line=1, found=column, allowed=table.columns)
    cells = table.text(column)
    named = {**dict.fromkeys(split.train, "train"), **dict.fromkeys(split.test, "test")}
    out = []
    for i in rows:
        if cells[i] not in named and split.column is None:
            message = "this label is neither 'train' nor 'test': say under 'data.split' which labels are which"
            raise InputError(message, file=table.path, line=table.lines[i], key=column, found=cells[i], allowed=named)
        out.append(named.get(cells[i], "unused"))
    return tuple(out)


def _notes(data: Dataset, robot: Robot) -> tuple[str, ...]:
    """What looks wrong but can be meant."""
    notes = []
    for i, joint in enumerate(robot.joints):
        values = data.q[:, i]
        shown = np.rad2deg(values) if joint.revolute else values
        unit = "deg" if joint.revolute else "mm"
        slack = 0.02 * (joint.upper - joint.lower) if np.isfinite(joint.upper - joint.lower) else 0.0
        outside = int(np.sum((values < joint.lower - slack) | (values > joint.upper + slack)))
        if outside:
            notes.append(
                f"joint {i + 1} '{joint.name}' is outside its limits in {outside} of {len(data)} poses "
                f"(readings {shown.min():.6g} to {shown.max():.6g} {unit}): is the column in the unit of its name?"
            )
        elif joint.revolute and np.abs(values).max() > 4 * np.pi:
            notes.append(
                f"joint {i + 1} '{joint.name}' turns by up to {shown.max():.6g} deg: is the column in the unit of "
                f"its name?"
            )
    revolute = [i for i, joint in enumerate(robot.joints) if joint.revolute]
    if len(data) >= 5 and revolute and np.abs(data.q[:, revolute]).max() < np.deg2rad(7):
        largest = float(np.rad2deg(np.abs(data.q[:, revolute]).max()))
        notes.append(f"no revolute joint moves beyond {largest:.3g} deg: are angles in radians given as degrees?")
    same: dict[tuple[float, ...], str] = {}
    twins = []
    for label, row in zip(data.labels, data.q.tolist(), strict=True):
        if tuple(row) in same:
            twins.append(f"{same[tuple(row)]} and {label}")
        same.setdefault(tuple(row), label)
    if twins:
        shown_twins = ", ".join(twins[:5]) + (", ..." if len(twins) > 5 else "")
        notes.append(
            f"{len(twins)} poses repeat the joint readings of another ({shown_twins}): they count as repeated "
            f"measurements"
        )
    missing = int(np.isnan(data.z).any(axis=1).sum())
    if missing:
        notes.append(f"{missing} poses lack at least one point")
    unused = data.split.count("unused")
    if unused:
        notes.append(f"{unused} poses have a split label that is neither train nor test and are not used")
    return tuple(notes)


def save_measurements(data: Dataset, robot: Robot, path: Path | str) -> None:
    """Write the canonical CSV (deg and mm) that `load_measurements` reads back."""
    units = ["deg" if joint.revolute else "mm" for joint in robot.joints]
    head = ["pose", *(f"q{i}_{unit}" for i, unit in enumerate(units, start=1))]
    q = np.where([joint.revolute for joint in robot.joints], np.rad2deg(data.q), data.q)
    rows: list[list[object]] = []
    if data.kind == "position":
        head += ["point", "x_mm", "y_mm", "z_mm"]
        for i in range(len(data)):
            for k, name in enumerate(data.point_names):
                xyz = data.z[i, 3 * k : 3 * k + 3]
                if np.isfinite(xyz).all():
                    rows.append(
                        [
                            data.labels[i],
                            *q[i],
                            name,
                            *xyz,
                            *_sigma_cells(data, i, slice(3 * k, 3 * k + 3)),
                            data.split[i],
                        ]
                    )
        head += [] if data.sigma is None else [f"sigma_{c}_mm" for c in "xyz"]
    else:
        head += ["x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"]
        rows = [
            [data.labels[i], *q[i], *data.z[i], *_sigma_cells(data, i, slice(0, 6)), data.split[i]]
            for i in range(len(data))
        ]
        head += [] if data.sigma is None else [f"sigma_{c}_mm" for c in "xyz"] + [f"sigma_r{c}_rad" for c in "xyz"]
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*head, "split"])
        writer.writerows([[repr(float(c)) if isinstance(c, float) else c for c in row] for row in rows])


def _sigma_cells(data: Dataset, row: int, columns: slice) -> list[float]:
    return [] if data.sigma is None else [float(v) for v in data.sigma[row, columns]]
