"""Lists of corners: image points of known points, view by view, from a CSV file instead of images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.documents.csv_file import read_table
from symcal.documents.table import Table
from symcal.errors import InputError
from symcal.units import LENGTH, PIXEL
from symcal.vision.board import BoardDetection, Refusal

Float = NDArray[np.float64]

_LEAST_FLAT, _LEAST_SOLID = 4, 6
_SMALLEST_MM, _LARGEST_MM = 1.0, 20_000.0  # extent of a target; what is beyond has the wrong unit
_BESIDE_PX = 1.0  # beyond the image's border: pixels are counted from their centres or from their corners
_NAMED = 3


@dataclass(frozen=True, slots=True)
class CornerList:
    """Image points of the points of any target, flat or solid.

    Attributes:
        points: of the target, shape (n, 3), mm; ids: their names.
        size: of the image (width, height), px.
        views: those that can be used; of every one the points that it shows. refusals: the others, and why.
        note: what was assumed, for people; empty if nothing.
    """

    points: Float
    ids: tuple[str, ...]
    size: tuple[int, int]
    views: tuple[BoardDetection, ...]
    refusals: tuple[Refusal, ...] = ()
    note: str = ""

    def __str__(self) -> str:
        return f"a list of corners of {len(self.ids)} points"


def load_corners(path: Path | str, size: tuple[int, int]) -> CornerList:
    """Read a list of corners: columns view, id, X, Y, u, v, and Z for a target that is not flat.

    Lengths are in the unit of the column's name (X_mm, X_m), and in mm where it has none; u and v are in px. All are
    rounded to single precision, as OpenCV takes them: 3e-5 px at 500 px, and the same numbers come out to all digits.

    Args:
        size: (width, height) of the image, px: the list does not tell it.
    Raises:
        InputError: a column is missing or has the wrong unit, a cell is no number, a view has an id twice, an id has
        different coordinates in two views, an image point lies outside the image, or the target is too small or large.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> x, y = (each.ravel() for each in np.meshgrid(30.0 * np.arange(9), 30.0 * np.arange(6)))
        >>> view, number = np.zeros(54), np.arange(54)
        >>> table = np.c_[view, number, x, y, 2 * x + 50, 2 * y + 50]
        >>> np.savetxt("corners.csv", table, "%g", ",", header="view,id,X_mm,Y_mm,u_px,v_px", comments="")
        >>> corners = sc.load_corners("corners.csv", size=(640, 480))
        >>> len(corners.views)
        1
    """
    if min(size) < 1:
        raise InputError("the image's size must be positive", key="size", found=f"{size[0]}x{size[1]}")
    table = read_table(path)
    if not len(table):
        raise InputError("the file has a header but no rows", file=table.path)
    views, names = _labels(table, "view"), _labels(table, "id")
    xyz, plain = _lengths(table)
    pixels = np.column_stack([_numbers(table, name, PIXEL, "image points") for name in ("u", "v")])
    _require_inside(table, pixels, size)
    first: dict[str, int] = {}
    rows: dict[str, dict[str, int]] = {}
    for i, name in enumerate(names):
        first.setdefault(name, i)
    start = np.array([first[name] for name in names])
    for i in np.flatnonzero(~np.isclose(xyz, xyz[start], rtol=1e-9, atol=1e-9).all(axis=1)).tolist():
        line = table.lines[start[i]]
        message = f"id '{names[i]}' has other coordinates here than in line {line}: a point has one place"
        raise InputError(message, file=table.path, line=table.lines[i], found=_place(xyz[i]))
    for i, (view, name) in enumerate(zip(views, names, strict=True)):
        before = rows.setdefault(view, {}).setdefault(name, i)
        if before != i:
            message = f"view '{view}' has id '{name}' twice, first in line {table.lines[before]}: keep one row"
            raise InputError(message, file=table.path, line=table.lines[i])
    points = xyz[list(first.values())]
    _require_size(table, points)
    number = {name: k for k, name in enumerate(first)}
    used: list[BoardDetection] = []
    refusals: list[Refusal] = []
    for view, own in rows.items():
        chosen = list(own.values())
        indices = np.array([number[name] for name in own], dtype=np.intp)
        reason = _unusable(xyz[chosen], pixels[chosen])
        if reason:
            refusals.append(Refusal(view, "no board", reason))
        else:
            used.append(BoardDetection(view, size, indices, pixels[chosen], None, float("nan"), "list"))
    note = "The points have no unit and were taken as mm; the camera's numbers do not depend on it." if plain else ""
    return CornerList(points, tuple(first), size, tuple(used), tuple(refusals), note)


def _labels(table: Table, column: str) -> list[str]:
    if column not in table.columns:
        message = f"there is no column '{column}': a list of corners has view, id, X, Y, u, v, and Z if it is not flat"
        raise InputError(message, file=table.path, line=table.head_line, found=", ".join(table.columns))
    cells = table.text(column)
    if "" in cells:
        raise InputError("an empty cell", file=table.path, line=table.lines[cells.index("")], column=column)
    return cells


def _lengths(table: Table) -> tuple[Float, bool]:
    """Coordinates of every row, shape (n, 3), mm; and whether they have no unit."""
    stems = table.stems()
    found = [stem for name in "XYZ" for stem in (name, name.lower()) if stem in stems]
    units = {stems[stem][1] for stem in found}
    if None in units and len(units) > 1:
        message = "some of X, Y, Z have a unit and some have none: name all of them with their units"
        raise InputError(message, file=table.path, line=table.head_line, found=", ".join(table.columns))
    columns = [_numbers(table, name, LENGTH, "the target's points") for name in "XY"]
    if {"Z", "z"} & set(stems):
        columns.append(_numbers(table, "Z", LENGTH, "the target's points"))
    else:
        columns.append(np.zeros(len(table)))
    return np.column_stack(columns), None in units


def _numbers(table: Table, name: str, kinds: dict[str, float], what: str) -> Float:
    """A column with or without its unit, in upper or lower case."""
    stems = table.stems()
    given = [stem for stem in dict.fromkeys((name, name.lower())) if stem in stems]
    if len(given) > 1:
        message = f"columns '{stems[given[0]][0]}' and '{stems[given[1]][0]}' are the same quantity twice"
        raise InputError(message, file=table.path, line=table.head_line)
    if not given:
        raise table.missing(f"'{name}' of {what}", [name], kinds)
    column, unit = stems[given[0]]
    if unit is not None and unit not in kinds:
        return table.quantity(given[0], kinds, f"'{name}' of {what}")  # says so
    return table.numbers(column).astype(np.float32).astype(np.float64) * (1.0 if unit is None else kinds[unit])


def _require_inside(table: Table, pixels: Float, size: tuple[int, int]) -> None:
    low, high = -0.5 - _BESIDE_PX, np.array(size) - 0.5 + _BESIDE_PX
    outside = np.flatnonzero(np.any((pixels < low) | (pixels > high), axis=1))
    if not len(outside):
        return
    swapped = bool(np.all((pixels[:, ::-1] >= low) & (pixels[:, ::-1] <= high)))
    advice = "u and v look swapped" if swapped else "is its size another one, or are u and v swapped?"
    more = ", ".join(str(table.lines[i]) for i in outside[1:_NAMED]) + (", ..." if len(outside) > _NAMED else "")
    message = f"(u, v) lies outside the image of {size[0]} x {size[1]} px{f' (also in line {more})' if more else ''}"
    u, v = pixels[outside[0]]
    raise InputError(f"{message}: {advice}", file=table.path, line=table.lines[outside[0]], found=f"({u:g}, {v:g})")


def _require_size(table: Table, points: Float) -> None:
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    units = {unit for stem, (_, unit) in table.stems().items() if stem in "XYZxyz"}
    if (extent >= _SMALLEST_MM or "um" in units) and extent <= _LARGEST_MM:
        return
    advice = "are they in m? then name them X_m, Y_m" if extent < _SMALLEST_MM else "are they in mm? then name them so"
    message = f"the target's points span {extent:.3g} mm in all, too {'little' if extent < _SMALLEST_MM else 'much'}"
    raise InputError(f"{message}: {advice}", file=table.path, line=table.head_line)


def _unusable(points: Float, pixels: Float) -> str:
    """Why a view's points do not determine its pose; empty if they do."""
    count = len(points)
    flat = is_flat(points)
    least = _LEAST_FLAT if flat else _LEAST_SOLID
    if count < least:
        return f"it has {count} point{'s' if count > 1 else ''}: at least {least} are needed"
    for what, places in (("points", points), ("image points", pixels)):
        if _on_a_line(places):
            return f"its {count} {what} lie on one line"
    if flat and _all_but_one_on_a_line(points):
        return f"all but one of its {count} points lie on one line"
    return ""


def is_flat(points: Float) -> bool:
    """Whether points, shape (n, 3), lie in one plane."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(len(points) < 4 or spread[2] <= 1e-7 * spread[0])


def normal_of(points: Float) -> Float:
    """Normal of a flat target, shape (3,); the z axis of a solid one."""
    if not is_flat(points) or not np.any(points[:, 2]):
        return np.array([0.0, 0.0, 1.0])
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2])


def _on_a_line(places: Float) -> bool:
    spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= 1e-6 * spread[0])


def _all_but_one_on_a_line(points: Float) -> bool:
    """Whether the points of a plane lie on one line once one of them is left out: they have no homography."""
    centred = points - points.mean(axis=0)
    plane = centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    count = len(plane)
    left = plane.T @ plane - count / (count - 1) * np.einsum("ni,nj->nij", plane, plane)
    return bool(np.any(np.linalg.det(left) <= 1e-12 * np.trace(left, axis1=1, axis2=2) ** 2))


def _place(point: Float) -> str:
    return f"({', '.join(f'{value:g}' for value in point)}) mm"
