"""Points of a target that are not where the file of the experiment says: two swapped, another unit, mirrored.

Where each of them is on the moving end comes from the fit with free points; how they lie to each other needs no frame,
and where the target's frame is known as well, they must lie there.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.mistakes.mistake import Mistake, mistake_of
from symcal.calibration.mistakes.rotation_fit import Channel
from symcal.calibration.mistakes.scene import POSES, Scene, some
from symcal.placing.registration import rigid_fit

Array = NDArray[np.float64]

_BETTER = 4.0  # times that another arrangement must agree better
_ALIKE = 1.3
_EXPLAINED = 0.1  # of the spread: the readings themselves must go with the robot
_UNTOLD = 2.0  # times what is left of readings: points that are less off may be where they are said
_LEAST = 3.0  # mm
_UNITS = (
    (1000.0, "metres, given as millimetres"),
    (1e-3, "millimetres, given as metres"),
    (25.4, "inches, given as millimetres"),
    (10.0, "centimetres, given as millimetres"),
)


def found_points(rotation: Array, position: Array, channels: list[Channel], m: Array) -> Array:
    """Where every channel's point is on the moving end, shape (K, 3), mm, with M known; see `rotation_fit`."""
    rows, right = [], []
    for k, c in enumerate(channels):
        own = np.flatnonzero(c.seen)
        block = np.zeros((len(own), 3, 3 + 3 * len(channels)))
        block[:, :, :3] = -np.eye(3)
        block[:, :, 3 + 3 * k : 6 + 3 * k] = rotation[own]
        rows.append(block.reshape(-1, block.shape[2]))
        right.append((c.read[own] @ m.T - position[own]).ravel())
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=1e-9)[0]
    return np.asarray(solution[3:].reshape(-1, 3))


def arrangements(names: tuple[str, ...], stated: Array) -> list[tuple[str, Array]]:
    """What the points may be instead of what is stated, each with its text."""
    out = []
    for i, j in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[i], order[j] = j, i
        out.append((f"the points '{names[i]}' and '{names[j]}' are swapped", stated[order]))
    out += [(f"the target's points are in {said}", stated * factor) for factor, said in _UNITS]
    out.append(("the target's points are given in left-handed axes", stated * [1.0, 1.0, -1.0]))
    return out


def apart(stated: Array, found: Array, known: Array | None = None) -> float:
    """Rms distance between points after the best rigid motion, or a known one, shape (4, 4), mm."""
    t = rigid_fit(stated, found) if known is None else known
    return float(np.sqrt(np.mean(np.sum((stated @ t[:3, :3].T + t[:3, 3] - found) ** 2, axis=1))))


def otherwise_arranged(scene: Scene, k: int) -> tuple[Mistake, ...]:
    """Known points of a target that lie to each other in another way than is said."""
    sight = scene.sights[k]
    o = sight.part.observation
    if sight.reads != "points" or sight.constrains or o.target.unknown_points or len(sight.features) < 2:
        return ()
    at = some(scene.rows, POSES)
    chain, everything = sight.chain(scene.q[at]), np.ones((1, len(at)), dtype=bool)
    fitted = sight.misfit(chain[None], scene.z[k][None, at], everything)
    if not float(fitted.score[0]) < _EXPLAINED or sight.ends.reversed:
        return ()
    channels = sight.channels(scene.z[k][at], everything[0])
    found = found_points(chain[:, :3, :3], chain[:, :3, 3], channels, fitted.rotation[0])
    stated = o.target.nominal[list(sight.features)]
    placed = o.target.at.unknown or (o.target.at.on == "tool" and sight.ends.model.task.tool)
    known = None if placed else sight.ends.registration(sight.ends.model.setup).tool
    before = apart(stated, found, known)
    tried = [
        (apart(points, found, known), text)
        for text, points in arrangements(tuple(o.features[i] for i in sight.features), stated)
    ]
    best = min(off for off, _ in tried)
    if not (best * _BETTER < before and before > max(_UNTOLD * float(fitted.rms[0]), _LEAST)):
        return ()
    texts = tuple(text for off, text in tried if off <= min(_ALIKE * best + 1e-9, before / _BETTER))
    return (mistake_of("points", texts, before, best, "mm"),)
