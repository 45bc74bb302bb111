"""Readings that are no accident at the noise of the others: which, how far off, and what changes without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.evaluate import without_rigid_motion
from symcal.data.dataset import Dataset, evenly
from symcal.errors import RefusedError
from symcal.fit.deletion import Judged, Pile, Readings, judged, readings_at, without
from symcal.fit.estimation import Fit, Options, fit
from symcal.fit.noise import known_sigma, spread_of
from symcal.fit.residual_rows import rows_of
from symcal.fit.variance_components import compressed
from symcal.fit.whitened import Whitened, whitened
from symcal.model.measurement import Group, Part
from symcal.model.model import Model
from symcal.units import DEGREES, SHOWN_UNITS

Array = NDArray[np.float64]

_CROWD = 0.2  # share of the poses from which they may be too many to be slips
_STANDS_OUT = 4.0  # medians: a residual larger than this is one slip that spoils the others
_DRAGGING = 4  # poses at most that may draw an estimate away from the others
_LINEAR = 1.2  # times what linear rows promise of the others' rms without the outliers


@dataclass(frozen=True, slots=True)
class Outlier:
    """One reading.

    pose: its label. instrument, quantity, group: what read what, and the noise that it was judged by. point: which
    point or axis, empty where there is one. off: distance from where all good readings put it, in ``unit``; noises: the
    same over their noise per axis.
    weight: with which it counted. parameter, sigmas: of what the estimate would be without it, the parameter that
    changes most for its standard deviation, and by how many; tool_mm: rms change of the tool over the training poses.
    split: of which poses it is.
    """

    pose: str
    instrument: str
    quantity: str
    group: str
    point: str
    off: float
    unit: str
    noises: float
    weight: float
    parameter: str
    sigmas: float
    tool_mm: float
    split: str = "train"


@dataclass(frozen=True, slots=True)
class Crowd:
    """So many poses of a group stand out, about equally, that they are no slips. of: poses that were read."""

    group: str
    poses: int
    of: int


@dataclass(frozen=True, slots=True)
class StandingOut:
    """listed: outliers, the furthest first, group by group. crowds: where there are too many of them.

    scales: rms of the other readings over their noise, by group. dragged: outliers have drawn the estimate so far that
    others had to be judged beside an estimate without them.
    """

    listed: tuple[Outlier, ...] = ()
    crowds: tuple[Crowd, ...] = ()
    scales: Mapping[str, float] = field(default_factory=dict)
    dragged: bool = False


def outliers(model: Model, data: Dataset, after: Fit, prior_mean: Array) -> StandingOut:
    """Readings of training data that the noise of the others does not explain.

    What changes without one is by linear algebra: all variances, and the weights of the others, as they are.

    Args:
        data: what the fit was of. prior_mean: as the fit had it.
    """
    free = set(after.free)
    rows = rows_of(
        model.measurement, data, after.setup, model.residuals, [name for name in model.placement if name not in free]
    ).decorrelated()
    system = whitened(rows, after.free, np.zeros(len(after.x)), prior_mean)
    known = known_sigma(rows, {name: s for name, s in after.sigmas.items() if name not in after.estimated})
    there, every, dragged = _judged_where_linear(system, known, after)
    sigmas = {p.group.name: float(after.sigmas.get(p.group.name, 1.0)) for p in there.piles}
    listed: list[Outlier] = []
    crowds: list[Crowd] = []
    spread = spread_of(rows, known, after.sigmas, after.weights)
    changes = _changes(model, data, after, system, spread) if any(found.bad.any() for found in every) else None
    for k, (pile, found) in enumerate(zip(there.piles, every, strict=True)):
        crowd = _crowd(pile, found, sigmas[pile.group.name])
        if crowd is not None:
            crowds.append(crowd)
        elif changes is not None:
            worst = np.flatnonzero(found.bad)[np.argsort(-found.test[found.bad], kind="stable")]
            listed += [_outlier(changes, there, k, found, int(i)) for i in worst]
    scales = {pile.group.name: found.scale for pile, found in zip(there.piles, every, strict=True)}
    return StandingOut(tuple(listed), tuple(crowds), scales, dragged)


def _judged_where_linear(system: Whitened, known: Array, after: Fit) -> tuple[Readings, tuple[Judged, ...], bool]:
    """The readings of every group as judged by the good ones where their rows are linear: about the estimate, else
    about that without the furthest poses. And whether the estimate had to be left.

    A gross outlier draws an estimate of known noise so far off that its rows say nothing of the others any more.
    """
    sigmas = {name: float(sigma) for name, sigma in after.sigmas.items()}

    def at(x: Array) -> tuple[Readings, tuple[Judged, ...]]:
        there = readings_at(system, x, known)
        own = {p.group.name: sigmas.get(p.group.name, 1.0) for p in there.piles}
        return there, judged(there, system.known_rows(x, after.every_factor), own, after.loss)

    there, every = at(after.x)
    first, x, nominal = (there, every), after.x, np.zeros_like(after.x)
    gone: list[int] = []
    while any(found.bad.any() for found in every):
        if not _many(there.piles, every) and _linear(known, there, every):
            return there, every, bool(gone)
        if len(gone) >= _DRAGGING or (not gone and not _dominated(there.piles, every)):
            return (*first, False)
        left = [
            (float(found.test[i]), int(pile.pose[i]))
            for pile, found in zip(there.piles, every, strict=True)
            for i in np.flatnonzero(found.bad)
            if pile.pose[i] not in gone
        ]
        if not left:
            return (*first, False)
        gone.append(max(left)[1])
        seen = system.rows.seen.copy()
        seen[gone] = False
        given = {name: sigma for name, sigma in sigmas.items() if name not in after.estimated}
        options = Options(sigma=given)
        rows = replace(system.rows, seen=seen)
        try:
            x = fit(rows, after.free, options, prior_mean=system.prior_mean, nested=(nominal,)).x
        except RefusedError:  # too few poses are left to judge any by
            return (*first, False)
        there, every = at(x)
    return there, every, bool(gone)


def _many(there: Sequence[Pile], every: Sequence[Judged]) -> bool:
    """Whether more poses stand out than are slips."""
    bad = {int(i) for pile, found in zip(there, every, strict=True) for i in pile.pose[found.bad]}
    return len(bad) > _CROWD * len({int(i) for pile in there for i in pile.pose[pile.there]})


def _dominated(there: Sequence[Pile], every: Sequence[Judged]) -> bool:
    """Whether one reading is so far off that it may have drawn the estimate away from all others."""
    return any(
        float(found.test.max()) >= _STANDS_OUT**2 * float(np.median(found.test[pile.there]))
        for pile, found in zip(there, every, strict=True)
    )


def _linear(known: Array, there: Readings, every: Sequence[Judged]) -> bool:
    """Whether the good readings are left as their rows promise when the bad ones are left out."""
    system, step = there.system, every[0].y
    moved = there.x.copy()
    moved[system.index] += system.scales * step
    again = readings_at(system, moved, known)
    return _squares(again, every, np.zeros_like(step)) <= _LINEAR**2 * _squares(there, every, step)


def _squares(given: Readings, every: Sequence[Judged], y: Array) -> float:
    """Squares of the good readings over their noise, at a step from where their rows are."""
    total, at = 0.0, np.append(y, 1.0)
    inverse = [pile.inverse(found.sigma) for pile, found in zip(given.piles, every, strict=True)]
    for piece in given.pieces():
        for (own, rows), scale, found in zip(piece, inverse, every, strict=True):
            total += float(np.sum(((rows * scale[own, :, None])[~found.bad[own]] @ at) ** 2))
    return total


def _crowd(pile: Pile, found: Judged, sigma: float) -> Crowd | None:
    """Where many poses stand out and none of them by far."""
    norms = np.linalg.norm(pile.white(sigma), axis=1)
    by_pose = np.zeros(pile.pose.max() + 1)
    np.maximum.at(by_pose, pile.pose, norms)
    poses, of = len(set(pile.pose[found.bad].tolist())), len(set(pile.pose[pile.there].tolist()))
    if poses <= _CROWD * of or by_pose.max() >= _STANDS_OUT * np.median(by_pose[by_pose > 0]):
        return None
    return Crowd(pile.group.name, poses, of)


@dataclass(frozen=True, slots=True)
class _Changes:
    """What an estimate is asked about when a reading is left out.

    spread: with robust weights, shape (N, m). triangle: of all whitened rows, shape (k, n + 1). of_tool: that of how
    the tool (or its points) depends on the free parameters over the poses, or so many of them as stand for all, shape
    (k, n), mm; points: of so many points.
    """

    model: Model
    data: Dataset
    after: Fit
    system: Whitened
    spread: Array
    triangle: Array
    of_tool: Array
    points: int

    def without(self, there: Readings, k: int, i: int) -> Array:
        """Errors of the free parameters without a reading, less those with it, shape (n,), mm and rad."""
        pile = there.piles[k]
        columns = list(pile.group.columns)[pile.place[i] * pile.group.block :][: pile.group.block]
        own = self.spread[pile.pose[i], columns]
        rows = there.rows(k, i) * (np.isfinite(own) / np.where(np.isfinite(own), own, 1.0))[:, None]
        return np.asarray(self.system.scales * without(self.triangle, rows))

    def tool(self, change: Array) -> float:
        """Rms change of the tool (or of its points) over the training poses, mm."""
        return float(np.linalg.norm(self.of_tool @ change) / np.sqrt(self.points))


def _changes(model: Model, data: Dataset, after: Fit, system: Whitened, spread: Array) -> _Changes:
    stacked = system.rows_at(after.x, spread, after.every_factor)
    at, slopes = model.points(data.q[evenly(len(data))], after.x, after.setup.vector)
    if model.measurement.adrift:
        slopes = without_rigid_motion(at.reshape(-1, 3), slopes)
    of_tool = slopes[:, :, system.index].reshape(-1, len(system.index))
    return _Changes(model, data, after, system, spread, compressed(stacked), compressed(of_tool), len(of_tool) // 3)


def _outlier(changes: _Changes, there: Readings, k: int, found: Judged, i: int) -> Outlier:
    pile, after = there.piles[k], changes.after
    group = pile.group
    change = changes.without(there, k, i)
    in_sigmas = change / after.posterior.sigmas
    most = int(np.abs(in_sigmas).argmax()) if len(change) else 0
    spread = np.where(np.isfinite(pile.known[i]), pile.known[i], found.sigma)
    off = found.off[i] if changes.system.rows.mixing is None else found.off[i] / spread
    part, point, first = where_read(changes.model, group, int(pile.place[i]))
    return Outlier(
        pose=changes.data.labels[pile.pose[i]],
        instrument=part.observation.name,
        quantity=group.quantity,
        group=group.name,
        point=point,
        off=float(np.linalg.norm(off)) * (DEGREES if group.unit == "rad" else 1.0),
        unit=SHOWN_UNITS[group.unit],
        noises=float(np.linalg.norm(np.where(pile.seen[i], found.off[i] / spread, 0.0))),
        weight=float(after.weights[pile.pose[i], first]),
        parameter=after.free[most] if len(change) else "",
        sigmas=float(in_sigmas[most]) if len(change) else 0.0,
        tool_mm=changes.tool(change),
    )


def where_read(model: Model, group: Group, place: int) -> tuple[Part, str, int]:
    """What has read a group's reading, its point (empty where there is one alone), and its first component."""
    first = group.columns[place * group.block]  # sessions of an entry share a group
    part = next(p for p in model.measurement.parts if p.components.start <= first < p.components.stop)
    features = part.observation.features
    point = features[(first - part.components.start) * part.features // part.size] if len(features) > 1 else ""
    return part, point, first


def outlier_facts(found: Sequence[Outlier]) -> list[dict[str, Any]]:
    """Outliers as plain data (results.json)."""
    return [asdict(each) for each in found]
