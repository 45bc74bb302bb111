"""How small a change a check of these poses finds, at its rate of false alarms, with the calibration as well known as
it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.instruments.noise import Noise
from symcal.watch.directed import Law, added, information, whitening
from symcal.watch.reference import BASE, REST, Hypothesis, Linear, Reference, linear_at
from symcal.watch.shares import shares

Array = NDArray[np.float64]

_WIDE = 1e3  # plausible sizes: of a base that nothing is known of
_MOST = 1000  # times as many poses: as good as any number


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """What a check finds; made by `sensitivity`.

    laws: of its tests, by hypothesis, and of the sum of squares. seen: hypotheses that are tested: the smallest change
    found is below what is plausible. smallest: by hypothesis and unit, mm and rad: of a joint its offset; of a frame a
    shift and a turn, each alone, in the direction that is seen least.
    """

    laws: Mapping[str, Law]
    seen: tuple[Hypothesis, ...]
    smallest: Mapping[str, Mapping[str, float]]

    def offset(self, joint: Hypothesis) -> float:
        """Smallest offset of a joint that is found, rad or mm; infinite where it is not seen."""
        found = self.smallest.get(joint.name)
        return next(iter(found.values())) if found else np.inf


def undisturbed(reference: Reference, q: Array) -> Dataset:
    """What a check at these poses, shape (N, dof), would read if nothing had changed and there were no noise."""
    return simulate(reference.changed, {}, q, Noise("normal"), np.random.default_rng(0))


def sensitivity(
    reference: Reference,
    linear: Linear,
    alpha: float,
    offsets: Mapping[str, float],
    *,
    moved: bool,
    poses: float = 1.0,
) -> Sensitivity:
    """What readings linearised where nothing changed find.

    Args:
        alpha: probability of an alarm if nothing changed. offsets: wanted, by joint, rad and mm: alpha is shared so
            that they are found. poses: how many times as many such poses.
    """
    spread = linear.spread / np.sqrt(poses)
    mixing = whitening(linear.reference, reference.root, spread)
    base = reference.index(reference.named(BASE)) if moved else np.zeros(0, dtype=np.intp)
    given = added(np.zeros((len(spread), 0)), mixing @ linear.slopes[:, base])
    known: dict[str, tuple[int, Array]] = {}
    for h in reference.hypotheses:
        columns = mixing @ linear.slopes[:, reference.index(h)]
        directions = 0 if moved and h.name == BASE else added(given, columns).shape[1]
        if directions:
            known[h.name] = directions, information(given, columns)
    seen = [h for h in reference.hypotheses if h.name in known]
    while True:  # fewer that are seen: a larger share of each, with which no more are lost
        wanted = {h.name: offsets[h.name] ** 2 * float(known[h.name][1][0, 0]) for h in seen if h.joint is not None}
        of_joints, other = shares(alpha, len(seen) + 1, wanted, reference.dof)
        laws = {name: Law(reference.dof, of_joints.get(name, other)) for name in (*known, REST)}
        smallest = {h.name: _smallest(*known[h.name], h, laws[h.name]) for h in seen}
        kept = [h for h in seen if smallest[h.name]]
        if len(kept) == len(seen):
            return Sensitivity(laws, tuple(seen), smallest)
        seen = kept


def _smallest(directions: int, whole: Array, h: Hypothesis, law: Law) -> dict[str, float]:
    needed, out = law.needed(directions), {}
    for unit in dict.fromkeys(h.units):
        own = [i for i, each in enumerate(h.units) if each == unit]
        least = float(np.linalg.eigvalsh(whole[np.ix_(own, own)])[0])
        size = np.sqrt(needed / least) if least > 0 else np.inf
        if h.joint is None or size < h.scales[own[0]]:
            out[unit] = float(size)
    return out


def poses_needed(
    reference: Reference, linear: Linear, offsets: Mapping[str, float], alpha: float, *, moved: bool
) -> dict[str, int | None]:
    """How many such poses find the wanted offset (rad or mm) of every joint; None where no number does: the calibration
    itself does not know it so well, or the joint is not seen."""
    count, known = len(np.unique(linear.pose)), dict[int, Sensitivity]()

    def found(joint: Hypothesis, poses: int) -> bool:
        if poses not in known:
            known[poses] = sensitivity(reference, linear, alpha, offsets, moved=moved, poses=poses / count)
        return known[poses].offset(joint) <= offsets[joint.name]

    def needed(joint: Hypothesis) -> int | None:
        low, high = 1, _MOST * count
        if not found(joint, high):
            return None
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if found(joint, middle) else (middle, high)
        return high

    return {h.name: needed(h) for h in reference.joints}


def fewest(reference: Reference, *, moved: bool) -> int:
    """Poses without which no check can be judged: with one reading wrong, more numbers than the largest change has."""
    per_pose = min(part.size for part in reference.changed.measurement.parts)
    largest = max(len(h.parameters) for h in reference.hypotheses if not (moved and h.name == BASE))
    nuisance = len(reference.named(BASE).parameters) if moved else 0
    return ceil((largest + nuisance + 1) / per_pose) + 1


def plan_rows(reference: Reference, q: Array, *, moved: bool, joints: tuple[Hypothesis, ...]) -> Array:
    """Whitened rows [J L, base where it is not known, D] at every pose, shape (K, m, n); the last columns are D."""
    linear = linear_at(reference, undisturbed(reference, q), np.zeros(len(reference.changed.parameters)))
    base = reference.named(BASE)
    wide = linear.slopes[:, reference.index(base)] * base.scales * _WIDE if moved else np.zeros((len(linear.r), 0))
    offsets = [linear.slopes[:, reference.index(h)] * h.scales for h in joints]
    rows = np.hstack([linear.reference @ reference.root, wide, *offsets]) / linear.spread[:, None]
    _, count = np.unique(linear.pose, return_counts=True)
    whole = np.zeros((len(q), int(count.max(initial=1)), rows.shape[1]))
    at = np.concatenate([np.arange(n) for n in count]) if len(count) else np.zeros(0, dtype=np.intp)
    whole[linear.pose, at] = rows
    return whole
