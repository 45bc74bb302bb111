"""Tables of measurements, read: of CSV files, sheets, and what else `symcal.readers` makes a table of.

One row per observation: `pose,q1_deg,...,point,x_mm,y_mm,z_mm` (position; or wide, `P1_x_mm,...`),
`x_m,y_m,z_m,qx,qy,qz,qw` or `roll_deg,pitch_deg,yaw_deg` (pose), `pose,q1_deg,...,point,u_px,v_px` (pixels),
`pose,q1_deg,...,distance_mm`; in general the columns of the kind of instrument, none of a constraint. Optional
`sigma_*`, `split` and `session` columns, and those of `symcal.data.conditions`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.data.conditions import condition_columns, of_postures, read_conditions
from symcal.data.dataset import Dataset, Readings
from symcal.data.labels import labels_of, of_session, pose_keys, provenance_of
from symcal.data.layout import Layout
from symcal.data.notes import notes, refuse_more_joints, unread
from symcal.data.split import Split as Split
from symcal.data.split import splits
from symcal.documents.table import Table, joint_readings
from symcal.errors import InputError
from symcal.instruments import KINDS, Instrument, Quantity, kind_named
from symcal.parameters import Unit
from symcal.robot.given import STEMS, is_given, with_given_readings
from symcal.robot.robot import Robot
from symcal.units import ANGLE, LENGTH, PIXEL, split_unit

Array = NDArray[np.float64]

_UNITS: dict[Unit, Mapping[str, float]] = {"mm": LENGTH, "rad": ANGLE, "px": PIXEL, "1": {}}
_MOST = 10_000_000  # numbers of a file with every point of every pose in its place, measured or not: 80 MB
_FRAME_ANGLES = ("roll", "pitch", "yaw")


def load_measurements(
    path: Path | str | Sequence[Path],
    robot: Robot,
    kind: str | Instrument,
    *,
    point_names: Sequence[str] = (),
    columns: Mapping[str, str | Sequence[str]] | None = None,
    split: Split | None = None,
    delimiter: str | None = None,
    decimal: str | None = None,
    where: Mapping[str, str] | None = None,
    sheet: str | None = None,
    name: str = "",
) -> Dataset:
    """Read measurements by one instrument from a CSV, Excel or ODS file, or from several.

    Args:
        kind: the instrument, or the name of its kind. point_names: the points or axes expected; those of the file when
            empty. columns, where, delimiter, decimal, sheet: see `Layout`. split: as the config says; a column called
            `split` is used when there is one. name: of the observation; that of the kind when empty.
    Raises:
        InputError: with line and column for everything that cannot be read; nothing is dropped silently.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> sc.save_measurements(data, robot, "measurements.csv")
        >>> len(sc.load_measurements("measurements.csv", robot, "position"))
        40
    """
    layout = Layout(columns or {}, where or {}, delimiter, decimal, sheet)
    return measurements_in(layout.table(path), robot, kind, layout, point_names=point_names, split=split, name=name)


def measurements_in(
    whole: Table,
    robot: Robot,
    kind: str | Instrument,
    layout: Layout,
    *,
    point_names: Sequence[str] = (),
    split: Split | None = None,
    session: str | None = None,
    alone: bool = True,
    name: str = "",
) -> Dataset:
    """The measurements in a table by one instrument.

    Args:
        layout: how the table was read. session: only rows of this one, and poses are then called without it. alone:
            whether nothing else was measured, so that some of it must train. Others: as `load_measurements`.
    Raises:
        InputError: as `load_measurements`.
    """
    if is_given(robot) and "flange_x" in whole.stems():
        whole = with_given_readings(whole)
    whole = whole if session is None else whole.where({"session": session})
    table = whole if session is None else of_session(whole, session)
    split, expected = split or Split(), tuple(point_names)
    reads = kind_named(kind)() if isinstance(kind, str) else kind
    measured = _measured_stems(table, reads, expected)
    known = _known_stems(table, robot, split, reads)
    for canonical in layout.columns:
        if split_unit(canonical)[0] not in known:
            message = "'columns' gives a column a name that means nothing here"
            raise InputError(message, file=table.path, key="columns", found=canonical, allowed=sorted(known))
    q = joint_readings(table, [(joint.name, joint.revolute) for joint in robot.joints], measured)
    conditions = read_conditions(table, robot)
    poses: Sequence[object] = range(len(table))
    if reads.reads == "frame":
        data = replace(_read_pose(table, q, reads), conditions=conditions)
    elif measured or reads.constrains:
        poses = pose_keys(table, np.column_stack([q, *conditions.values()]))
        data, firsts, place = _read_long(table, q, poses, reads, expected)
        data = replace(data, conditions=of_postures(table, conditions, robot, data.labels, place, firsts))
    else:
        data = replace(_read_wide(table, q, reads, expected), conditions=conditions)
    data = replace(
        data, split=splits(whole, poses, split, alone=session is None and alone), provenance=provenance_of(table)
    )
    data = replace(data, of=(replace(data.only, name=name or reads.name),))
    if reads.constrains and "pose" not in table.columns:  # a posture touches one thing, and none here is called by name
        data = replace(data, labels=tuple(f"{data.only.name} {label}" for label in data.labels))
    passed = {*known, *layout.where, *(c for n in layout.columns.values() if not isinstance(n, str) for c in n)}
    more = refuse_more_joints(table, passed, robot)
    return replace(data, notes=(*notes(data, robot), *more, *unread(table, passed, expected)))


def _measured_stems(table: Table, kind: Instrument, expected: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of the measurement that a joint may be called like; none in a wide file, where points have names."""
    stems = table.stems()
    names = tuple(name for name, _ in kind.file_columns)
    if kind.reads == "frame":
        lengths = tuple(name for name, unit in kind.columns if unit is not None)
        return (*lengths, *(() if "qw" in stems or "qx" in stems else _FRAME_ANGLES))
    wide = _wide_points(table) if names == tuple("xyz") else ()
    return () if wide and ("x" not in stems or set(wide) & set(expected)) else names


def _wide_points(table: Table) -> tuple[str, ...]:
    return tuple(s.removesuffix("_x") for s in table.stems() if s.endswith("_x") and not s.startswith("sigma_"))


def _known_stems(table: Table, robot: Robot, split: Split, kind: Instrument) -> set[str]:
    """Every column stem that can mean something in this file."""
    every = [kind, *(other() for other in KINDS.values())]
    sigmas = {n for each in every for q in each.quantities for n in (q.sigma_column, *q.sigma_columns)}
    wide = {f"{name}_{c}" for name in _wide_points(table) for c in "xyz"}
    joints = {name for i, joint in enumerate(robot.joints, start=1) for name in (f"q{i}", joint.name)}
    measured = {name for each in every for name, _ in each.columns} | set(_FRAME_ANGLES)
    conditions = {name for names in condition_columns(robot).values() for name in names}
    own = set(STEMS) if is_given(robot) else set()
    names = {"pose", "point", "session", split.column or "split"}
    return names | sigmas | wide | joints | measured | conditions | own


def _values(table: Table, kind: Instrument) -> Array:
    """The numbers of every reading, shape (rows, columns); a component that was not measured is NaN where it may be."""
    if kind.constrains:
        return np.zeros((len(table), len(kind.columns)))
    empty = kind.componentwise
    values = np.column_stack(
        [
            table.numbers(_plain(table, name, kind))
            if unit is None
            else table.quantity(name, _UNITS[unit], f"the measured {name}", empty=empty)
            for name, unit in kind.columns
        ]
    )
    for row in np.flatnonzero(np.isnan(values).all(axis=1)):
        raise table.error("nothing was measured in this row: remove it", row=row)
    return values


def _plain(table: Table, name: str, kind: Instrument) -> str:
    if name not in table.columns:
        raise table.error(f"there is no column '{name}' of the measured {kind.label}", found=", ".join(table.columns))
    return name


def _read_long(
    table: Table, q: Array, keys: Sequence[object], kind: Instrument, expected: tuple[str, ...]
) -> tuple[Dataset, NDArray[np.intp], NDArray[np.intp]]:
    """The data, the first row of every posture, and the posture of every row; keys: what tells that."""
    names, size, width = expected, len(kind.columns), sum(quantity.size for quantity in kind.quantities)
    points = table.text("point") if "point" in table.columns else None
    if points is None:
        names = names or ("P",)
        if len(names) != 1:
            message = f"the measurement has {len(names)} points, but the file has no 'point' column"
            raise table.error(message, allowed=names)
        points = [names[0]] * len(table)
    names = names or tuple(dict.fromkeys(points))
    place = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    of_row = np.array([place[key] for key in keys], dtype=np.intp)
    firsts = np.unique(of_row, return_index=True)[1].astype(np.intp)
    labels = labels_of(table, firsts)
    values = _values(table, kind)
    noise = _sigmas(table, kind)
    if len(place) * len(names) * max(size, width) > _MOST:
        message = f"{len(place)} poses of {len(names)} points: are 'pose' and 'point' what tells them apart?"
        raise table.error(message)
    which = _of_points(table, points, names)
    more = np.flatnonzero(firsts[of_row] != np.arange(len(table)))
    moved = np.abs(q[more] - q[firsts[of_row[more]]]).max(axis=1, initial=0.0) > 1e-9
    for row in more[moved]:
        i = of_row[row]
        message = f"pose {labels[i]!r} has other joint readings here than in {table.said(firsts[i])}"
        raise table.error(message, row=row, column="pose")
    repeated = np.ones(len(table), dtype=np.bool_)
    repeated[np.unique(of_row * len(names) + which, return_index=True)[1]] = False
    for row in np.flatnonzero(repeated) if size else ():
        message = (
            f"point '{points[row]}' of pose '{labels[of_row[row]]}' stands twice; "
            "give repeated measurements a pose of their own"
        )
        raise table.error(message, row=row, column="pose")
    z = np.full((len(place), len(names) * size), np.nan)
    sigma = np.full((len(place), len(names) * width), np.nan)
    z.reshape(len(place), len(names), size)[of_row, which] = values
    if noise is not None:
        sigma.reshape(len(place), len(names), width)[of_row, which] = noise
    data = Dataset((Readings(kind, "", names),), q[firsts], z, labels, (), None if noise is None else sigma)
    return data, firsts, of_row


def _of_points(table: Table, points: Sequence[str], names: Sequence[str]) -> NDArray[np.intp]:
    """The number of the point of every row."""
    number = {name: k for k, name in enumerate(names)}
    for row, point in enumerate(points):
        if point not in number:
            raise table.error(
                "no such point among those of the measurement", row=row, column="point", found=point, allowed=names
            )
    return np.array([number[point] for point in points], dtype=np.intp)


def _read_wide(table: Table, q: Array, kind: Instrument, expected: tuple[str, ...]) -> Dataset:
    found = _wide_points(table)
    names = expected or found
    for name in names:
        if name not in found:
            raise table.error("the file has no columns for this point of the measurement", found=name, allowed=found)
    z = np.column_stack(
        [table.quantity(f"{n}_{c}", LENGTH, f"{c} of point '{n}'", empty=True) for n in names for c in "xyz"]
    )
    for row in range(len(z)):
        if np.isnan(z[row]).all():
            raise table.error("no point was measured in this row: remove it", row=row)
    sigma = _sigma(table, list(kind.quantities) * len(names), LENGTH)
    return Dataset((Readings(kind, "", names),), q, z, labels_of(table, np.arange(len(z))), (), sigma)


def _read_pose(table: Table, q: Array, kind: Instrument) -> Dataset:
    stems = table.stems()
    xyz = np.column_stack([table.quantity(c, LENGTH, f"the measured {c}") for c in "xyz"])
    if "qw" in stems or "qx" in stems:
        for c in ("qx", "qy", "qz", "qw"):
            if c not in table.columns:
                raise table.error("a quaternion column is missing", column=c, allowed=table.columns)
        quaternion = np.column_stack([table.numbers(c) for c in ("qx", "qy", "qz", "qw")])
        for row in np.flatnonzero(np.abs(np.linalg.norm(quaternion, axis=1) - 1) > 1e-3):
            norm = float(np.linalg.norm(quaternion[row]))
            raise table.error("the quaternion is not of unit length", row=row, found=f"{norm:.6g}")
    else:
        angles = [table.quantity(c, ANGLE, f"the measured {c} (or qx, qy, qz, qw)") for c in _FRAME_ANGLES]
        quaternion = spatial.matrix_quaternions(spatial.rpy_matrix(np.column_stack(angles)))
    sigma = _sigmas(table, kind)
    z = np.hstack([xyz, quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)])
    return Dataset((Readings(kind, ""),), q, z, labels_of(table, np.arange(len(z))), (), sigma)


def _sigmas(table: Table, kind: Instrument) -> Array | None:
    """Sigmas of all components of a feature, shape (rows, components), NaN where the file has none; None if nowhere."""
    parts = [_sigma(table, [quantity], _UNITS[quantity.unit]) for quantity in kind.quantities]
    if all(part is None for part in parts):
        return None
    blanks = [np.full((len(table), quantity.size), np.nan) for quantity in kind.quantities]
    return np.hstack([blank if part is None else part for part, blank in zip(parts, blanks, strict=True)])


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
        raise table.error("a sigma must be positive", row=row, found=values[row].min())
    return values
