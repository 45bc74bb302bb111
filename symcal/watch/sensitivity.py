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
from symcal.watch.reference import BASE, Hypothesis, Linear, Reference, linear_at

Array = NDArray[np.float64]

_WIDE = 1e3  # plausible sizes: of a base that nothing is known of
_MOST = 1000  # times as many poses: as good as any number


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """What a check finds; made by `sensitivity`.

    law: of its tests. seen: hypotheses that are tested: the smallest change found is below what is plausible. smallest:
    by hypothesis in its units, mm and rad: of a joint its offset; of a frame with shifts (`..._mm`) and turns
    (`..._rad`) each alone, in the direction that is seen least. absent where nothing of it is seen.
    """

    law: Law
    seen: tuple[Hypothesis, ...]
    smallest: Mapping[str, Mapping[str, float]]

    def offset(self, joint: Hypothesis) -> float:
        """Smallest offset of a joint that is found, rad or mm; infinite where it is not seen."""
        found = self.smallest.get(joint.name)
        return next(iter(found.values())) if found else np.inf


def undisturbed(reference: Reference, q: Array) -> Dataset:
    """What a check at these poses, shape (N, dof), would read if nothing had changed and there were no noise."""
    return simulate(reference.changed, {}, q, Noise("normal"), np.random.default_rng(0))


def sensitivity(reference: Reference, linear: Linear, alpha: float, *, moved: bool, poses: float = 1.0) -> Sensitivity:
    """What readings linearised where nothing changed find.

    Args:
        alpha: probability of an alarm if nothing changed. poses: how many times as many such poses.
    """
    asked = [h for h in reference.hypotheses if not (moved and h.name == BASE)]
    spread = linear.spread / np.sqrt(poses)
    mixing = whitening(linear.reference, reference.root, spread)
    base = reference.index(reference.named(BASE)) if moved else np.zeros(0, dtype=np.intp)
    given = added(np.zeros((len(spread), 0)), mixing @ linear.slopes[:, base])
    tests = len(asked) + 1
    while True:  # fewer that are seen: a lower limit of each, with which no more are lost
        law = Law(reference.dof, alpha / tests)
        smallest = {}
        for h in asked:
            found = _smallest(given, mixing @ linear.slopes[:, reference.index(h)], h, law)
            if found:
                smallest[h.name] = found
        seen = tuple(h for h in asked if h.name in smallest)
        if len(seen) + 1 == tests:
            return Sensitivity(law, seen, smallest)
        asked, tests = list(seen), len(seen) + 1


def _smallest(given: Array, columns: Array, h: Hypothesis, law: Law) -> dict[str, float]:
    directions = added(given, columns).shape[1]
    if not directions:
        return {}
    whole, scales, out = information(given, columns), np.array(h.scales), {}
    needed = law.needed(directions)
    for unit in dict.fromkeys(h.units):
        own = [i for i, each in enumerate(h.units) if each == unit]
        least = float(np.linalg.eigvalsh(whole[np.ix_(own, own)])[0])
        size = np.sqrt(needed / least) if least > 0 else np.inf
        if h.joint is None or size < scales[own[0]]:
            out[unit] = float(size)
    return out


def poses_needed(
    reference: Reference, linear: Linear, joint: Hypothesis, offset: float, alpha: float, *, moved: bool
) -> int | None:
    """How many such poses find an offset (rad or mm) of a joint; None where no number does: the calibration itself does
    not know it so well."""
    count = len(np.unique(linear.pose))

    def found(poses: int) -> bool:
        whole = sensitivity(reference, linear, alpha, moved=moved, poses=poses / count)
        return whole.offset(joint) <= offset

    low, high = 1, _MOST * count
    if not found(high):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if found(middle) else (middle, high)
    return high


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
