"""The rows of a fit by pose, and how a reading that is displaced would change them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.fit.residual_rows import Rows
from symcal.model.measurement import Group, Part
from symcal.model.staged_kernel import Twists
from symcal.parameters import Unit

Array = NDArray[np.float64]

_AXES: dict[int, tuple[str, ...]] = {1: ("",), 2: ("u", "v"), 3: ("x", "y", "z")}


@dataclass(frozen=True, slots=True)
class Displacement:
    """What a displacement of all readings of one noise group (of a board: of the whole board) changes.

    what: of the group. axes: names of the directions. unit: of a displacement. columns: whitened rows by displacement,
    shape (k, d).
    """

    what: str
    axes: tuple[str, ...]
    unit: Unit
    columns: Array


@dataclass(frozen=True, slots=True)
class PoseRows:
    """Whitened rows of the measurements, of a pose one after the other; made by `pose_rows`.

    Many points of a rigid target come as the few rows of their pose that say all of it (`Twists.packed`), without the
    one that no parameter changes.

    jacobian: by all parameters, per mm, rad, px, shape (k, n). r: shape (k,). pose, group: of which pose and noise
    group, shape (k,).
    """

    jacobian: Array
    r: Array
    pose: NDArray[np.intp]
    group: NDArray[np.intp]
    displacements: tuple[Displacement, ...]

    def by_pose(self, values: Array) -> Array:
        """Rows (k, ...) as poses (N, h, ...), filled up with zeros."""
        count = np.bincount(self.pose, minlength=1)
        place = np.arange(len(self.pose)) - np.concatenate([[0], np.cumsum(count)[:-1]])[self.pose]
        out = np.zeros((len(count), int(count.max()), *values.shape[1:]))
        out[self.pose, place] = values
        return out


def pose_rows(rows: Rows, x: Array, spread: Array) -> PoseRows:
    """The rows linearised at x, sorted by pose.

    Args:
        spread: standard deviation of every component, shape (N, m); infinite where it does not count.
    """
    pieces: list[tuple[Array, NDArray[np.intp], NDArray[np.intp]]] = []
    moves: list[tuple[int, Displacement]] = []
    linear = rows.at(x)
    for i, (columns, poses, slopes) in enumerate(linear.slopes):
        if isinstance(slopes, Twists):
            own, pose, moved = _packed(rows, i, slopes, spread[poses][:, columns], poses)
            group = np.full(len(own), _groups_of(rows, rows.measurement.parts[i])[0])
            moves.append((i, moved))
        else:
            own, pose, group, found = _written(rows, columns, poses, slopes, linear.r, spread)
            moves += [(i, each) for each in found]
        pieces.append((own, pose, group))
    stacked = np.vstack([own for own, _, _ in pieces])
    pose = np.concatenate([pose for _, pose, _ in pieces])
    order = np.argsort(pose, kind="stable")
    starts = np.concatenate([[0], np.cumsum([len(own) for own, _, _ in pieces])])
    displaced = []
    for i, each in moves:
        whole = np.zeros((len(stacked), each.columns.shape[1]))
        whole[starts[i] : starts[i + 1]] = each.columns
        displaced.append(replace(each, columns=whole[order]))
    return PoseRows(
        stacked[order, :-1],
        stacked[order, -1],
        pose[order],
        np.concatenate([group for _, _, group in pieces])[order],
        tuple(displaced),
    )


def _groups_of(rows: Rows, part: Part) -> list[int]:
    """The noise groups of an observation, by number."""
    return [i for i, g in enumerate(rows.measurement.groups) if g.columns[0] in range(*part.components.indices(10**9))]


def _packed(
    rows: Rows, number: int, twists: Twists, spread: Array, poses: NDArray[np.intp]
) -> tuple[Array, NDArray[np.intp], Displacement]:
    """Rows of a target in one piece; it may be displaced as a whole."""
    n = twists.screws.shape[2]
    rigid = np.broadcast_to(np.eye(6), (len(poses), 6, 6))
    whole = replace(twists, screws=np.concatenate([twists.screws, rigid], axis=2))
    packed = whole.packed(spread, np.arange(n + 6))[:, : 6 + len(twists.columns)]
    flat, pose = packed.reshape(-1, n + 7), np.repeat(poses, packed.shape[1])
    told = np.flatnonzero(flat.any(axis=1))
    flat, name = flat[told], rows.measurement.parts[number].observation.target.name
    moved = Displacement(name, _AXES[3], "mm", flat[:, n + 3 : n + 6])
    return np.column_stack([flat[:, :n], flat[:, -1]]), pose[told], moved


def _written(
    rows: Rows, columns: slice, poses: NDArray[np.intp], jacobian: Array, residual: Array, spread: Array
) -> tuple[Array, NDArray[np.intp], NDArray[np.intp], list[Displacement]]:
    """Rows that are written out component by component."""
    wide = np.arange(spread.shape[1])[columns]
    own = spread[np.ix_(poses, wide)]
    which, component = np.nonzero(np.isfinite(own))
    weight = 1 / own[which, component]
    r = residual[np.ix_(poses, wide)]
    flat = np.column_stack([jacobian[which, component], r[which, component]]) * weight[:, None]
    of = np.zeros(spread.shape[1], dtype=np.intp)
    moves = []
    for number, (each, raw) in enumerate(_directions(rows)):
        of[list(each.columns)] = number
        if set(each.columns) & set(wide.tolist()):
            picked = raw[poses[which] if len(raw) > 1 else 0, wide[component]] * weight[:, None]
            moves.append(Displacement(each.name, _AXES.get(each.block, ("",) * each.block), each.unit, picked))
    return flat, poses[which], of[wide[component]], moves


def _directions(rows: Rows) -> Iterator[tuple[Group, Array]]:
    """Every noise group with what one unit along each of its axes is among the components, (1 or N, m, block)."""
    for group in rows.measurement.groups:
        along = np.zeros((rows.measurement.rows, group.block))
        along[list(group.columns)] = np.tile(np.eye(group.block), (len(group.columns) // group.block, 1))
        yield group, along[None] if rows.mixing is None else rows.mixing @ along
