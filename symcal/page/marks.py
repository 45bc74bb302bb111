"""What was read, one by one: a row of the page's table and a point of its picture each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors, evaluate_each
from symcal.data.dataset import Dataset, evenly, unseen

Array = NDArray[np.float64]
Comparison = Mapping[str, Mapping[str, Errors]]

MOST = 1000
"""Rows; a page with more is slow to draw and read by nobody."""

_LARGEST = 20  # of held-out errors, kept whatever else is left out
_MANY = 12  # points of a target, beyond which people want to see poses


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """A reading, or a pose that shows many points.

    pose: its row among the poses. instrument: who read it. feature: number of its point. point: its name, or how many
    points there are. before, after: components of the errors in ``unit``, called ``names``. sizes: their norms (rms
    over many points). turns: of an attitude, deg; None where none was read. held_out: its error by a robot that was
    identified without it; None where there is none. largest: of the errors that the row stands for, held out where they
    were; None where they do not judge. directed: whether components are those of a vector in world, mm.
    """

    pose: int
    part: str
    instrument: str
    feature: int
    point: str
    unit: str
    names: tuple[str, ...]
    before: Array
    after: Array
    sizes: tuple[float, float]
    turns: tuple[float, float] | None
    held_out: float | None
    largest: float | None
    directed: bool

    @property
    def rank(self) -> tuple[bool, float]:
        """Held-out errors before others, then by size."""
        return self.held_out is not None, -1.0 if self.largest is None else self.largest


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Marks with the poses that they are of. of: how many there were before some were chosen."""

    poses: Dataset
    rows: tuple[Mark, ...]
    of: int

    @property
    def worst(self) -> int | None:
        """The row with the largest held-out error, that of any training pose where nothing was held out; the one that
        the results call the worst."""
        at = max(range(len(self.rows)), key=lambda i: self.rows[i].rank, default=None)
        return None if at is None or self.rows[at].largest is None else at


def marks(calibration: Calibration, data: Dataset, errors: Comparison) -> Marks:
    """Every reading of the training and test poses, before and after the identification.

    Args:
        errors: by part and state, as an identification has them; where no pose was kept for a test, those of its
            `cross_validation` are held out.
    """
    judges = {o.name for o in calibration.model.task.judged_by}
    rows: list[Mark] = []
    for part in ("train", "test"):
        if part not in data.split:
            continue
        at = np.flatnonzero([split == part for split in data.split])
        before, after = (evaluate_each(calibration.states[state], data.part(part)) for state in ("before", "after"))
        for name in after:
            features = next(each.features for each in data.of if each.name == name)
            own = before[name], after[name]
            rows += _rows(part, name, features, at, *own, judges=name in judges, held_out=part == "test")
    rows.sort(key=lambda row: row.pose)
    found = errors.get("cross_validation", {}).get("after")
    if found is not None and "test" not in errors:
        rows = _cross_validated(rows, judges, data, found)
    return _chosen(data, rows)


def judged_marks(calibration: Calibration, data: Dataset, errors: Comparison, test: Array, what: str) -> Marks:
    """The same where errors are against a truth that only they know: image points of the training poses in pixels, and
    the errors at training poses and at unseen ones.

    Args:
        test: joint readings of the unseen poses, shape (k, dof). what: the errors are of, in place of an instrument.
    """
    bare = marks(calibration, data, {})
    labels = (*data.labels, *unseen(len(test)))
    poses = replace(
        data,
        q=np.vstack([data.q, test]),
        z=np.vstack([data.z, np.full((len(test), data.z.shape[1]), np.nan)]),
        labels=labels,
        split=(*data.split, *("test" for _ in test)),
        sigma=None,
        covariance=None,
        conditions={},
    )
    rows = list(bare.rows) if bare.of == len(bare.rows) else []
    for part, first in (("train", 0), ("test", len(data))):
        before, after = errors[part]["before"], errors[part]["after"]
        at = np.arange(first, first + int(after.pose.max()) + 1)
        rows += _rows(part, what, (), at, before, after, judges=True, held_out=part == "test")
    rows.sort(key=lambda row: row.pose)
    return _chosen(poses, rows)


def _rows(
    part: str,
    name: str,
    features: tuple[str, ...],
    at: NDArray[np.intp],
    before: Errors,
    after: Errors,
    *,
    judges: bool,
    held_out: bool,
) -> Iterator[Mark]:
    directed = after.unit == "mm" and after.vectors.shape[1] == 3 and after.axes == "world"
    many = int(np.bincount(after.pose).max(initial=0)) > _MANY
    each = np.arange(len(after.pose))
    groups = [each[after.pose == k] for k in np.unique(after.pose)] if many else list(each[:, None])
    for own in groups:
        k = int(own[0])
        sizes = [float(np.sqrt(np.mean(errors.size[own] ** 2))) for errors in (before, after)]
        turns = None if before.turns is None or after.turns is None else (before.turns[own], after.turns[own])
        angles = None if turns is None else [float(np.rad2deg(np.sqrt(np.mean(turn**2)))) for turn in turns]
        feature = int(after.point[k])
        yield Mark(
            pose=int(at[after.pose[k]]),
            part=part,
            instrument=name,
            feature=0 if many else feature,
            point=f"{len(own)} points" if many else features[feature] if features else "",
            unit=after.unit,
            names=after.names,
            before=before.vectors[own].mean(axis=0),
            after=after.vectors[own].mean(axis=0),
            sizes=(sizes[0], sizes[1]),
            turns=(angles[0], angles[1]) if angles is not None and np.isfinite(angles).all() else None,
            held_out=sizes[1] if judges and held_out else None,
            largest=float(after.size[own].max()) if judges else None,
            directed=directed and not many,
        )


def _cross_validated(rows: list[Mark], judges: set[str], data: Dataset, found: Errors) -> list[Mark]:
    """Rows with the errors that they had while they were held out. Both are in the order of the poses, and of one pose
    in the order of instruments and points."""
    used = np.flatnonzero([split != "unused" for split in data.split])
    used = used if len(used) == int(found.pose.max()) + 1 else used[evenly(len(used))]
    order = np.argsort(found.pose, kind="stable")
    sizes: dict[int, list[float]] = {}
    for pose, size in zip(used[found.pose[order]].tolist(), found.size[order].tolist(), strict=True):
        sizes.setdefault(pose, []).append(size)
    own: dict[int, int] = {}
    for row in rows:
        if row.instrument in judges:
            own[row.pose] = own.get(row.pose, 0) + 1
    out = []
    for row in rows:
        held = sizes.get(row.pose)
        if row.instrument not in judges or held is None:
            out.append(row)
        elif len(held) == own[row.pose]:
            whole = held.copy()
            sizes[row.pose] = [*whole[1:], whole[0]]
            out.append(replace(row, held_out=whole[0], largest=whole[0]))
        else:
            out.append(replace(row, held_out=float(np.sqrt(np.mean(np.square(held)))), largest=max(held)))
    return out


def _chosen(data: Dataset, rows: list[Mark]) -> Marks:
    """At most `MOST` rows with their poses: test poses before training ones, evenly among each, and the largest."""
    count = len(rows)
    if count > MOST:
        kept = set(sorted(range(count), key=lambda i: rows[i].rank, reverse=True)[:_LARGEST])
        for part, most in (("test", MOST // 2), ("train", MOST - _LARGEST)):
            own = [i for i, row in enumerate(rows) if row.part == part]
            room = min(len(own), most if part == "test" else most - len(kept))
            kept |= {own[i] for i in evenly(len(own), room).tolist()}
        rows = [rows[i] for i in sorted(kept)]
    poses = sorted({row.pose for row in rows})
    place = {pose: i for i, pose in enumerate(poses)}
    return Marks(data.take(np.array(poses, dtype=np.intp)), tuple(replace(r, pose=place[r.pose]) for r in rows), count)
