"""The search for a gross mistake between the robot file and a file of measurements.

Every hypothesis of a small finite set is tried with frames fitted anew (`rotation_fit`); one that explains the readings
`BETTER` times better than they are as given is named. Several may be the same to these data, as a sign of joint 1 and
a zero of joint 2 off by half a turn: they leave the same then, and the class of all of them is named. What a mistake
moves as a frame would is a gauge: the data as given are then as good, and nothing is said. The way is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.mistakes.breaks import broken
from symcal.calibration.mistakes.hypotheses import Hypothesis, joint_hypotheses
from symcal.calibration.mistakes.mistake import Mistake, mistake_of
from symcal.calibration.mistakes.points import otherwise_arranged
from symcal.calibration.mistakes.scene import AS_GIVEN, Looked, Scene, joints_tried, readings_tried, said, scene_of
from symcal.calibration.mistakes.units import of_another_size
from symcal.data.dataset import Dataset
from symcal.model.model import Model

Array = NDArray[np.float64]

BETTER = 4.0
"""Times that a hypothesis must explain the readings better than they are as given."""
_MOVED = 5.0  # the same of a break, which has more freedom
_BROKEN = 0.03  # of the spread: what frames leave of readings below is no break
_EXACT = 1e-9  # of the spread: rounding
_TRIGGER = 0.01  # of the spread: what frames leave of readings below needs no other explanation
_PLAUSIBLE = 0.1  # of the spread: robots are not further off by nominal kinematics
_PAIRED = 0.1  # of the spread: below, one mistake explains enough or none is there
_ALIKE = 2.0  # times the least misfit: hypotheses that the data do not tell apart
_PAIR_POSES = 40


def find_mistakes(model: Model, data: Dataset) -> tuple[Mistake, ...]:
    """The gross mistakes that explain these data far better than they are explained as given; empty without any.

    Args:
        data: all poses, in the order of their file.
    """
    scene = scene_of(model, data)
    if scene is None:
        return ()
    every = range(len(scene.sights))
    units = tuple(found for k in every for found in of_another_size(model.robot, scene, k))
    if units:
        return units
    given = joints_tried(scene, (AS_GIVEN,))
    apart = tuple(found for k in every for found in otherwise_arranged(scene, k))
    if not float(given.score[0]) > _TRIGGER:
        return apart
    joints = joints_tried(scene, joint_hypotheses(model.robot), above=_of_no_use(given))
    own = [readings_tried(scene, k, (AS_GIVEN,)) for k in every] if len(scene.sights) > 1 else [given]
    looked = [
        readings_tried(scene, k, sight.hypotheses, above=_of_no_use(own[k])) if sight.hypotheses else None
        for k, sight in enumerate(scene.sights)
    ]
    if len(scene.sights) == 1:
        one = [joints, *(each for each in looked if each is not None)]
        found = (
            _named(scene, one, given, BETTER) or _moved(scene, 0, own[0]) or _paired(scene, joints, looked[0], given)
        )
        return (*found, *apart)
    found = _named(scene, [joints], given, BETTER)
    if not found:
        for k, tried in enumerate(looked):
            found += (() if tried is None else _named(scene, [tried], own[k], BETTER)) or _moved(scene, k, own[k])
    return (*(found or _paired(scene, joints, None, given)), *apart)


def _of_no_use(given: Looked) -> float:
    """A score of no use, since it is not by so much better than that of the readings as they are."""
    return float(given.score[0]) / BETTER


def _named(scene: Scene, looked: Sequence[Looked], given: Looked, better: float) -> tuple[Mistake, ...]:
    before = float(given.score[0])
    best = min(float(each.score.min()) for each in looked)
    if not (before > _TRIGGER and best * better < before and best < _PLAUSIBLE):
        return ()
    limit = min(_ALIKE * best + _EXACT, before / better)
    kept = [
        (float(score), h, each, i)
        for each in looked
        for i, (score, h) in enumerate(zip(each.score, each.hypotheses, strict=True))
        if score <= limit
    ]
    _, first, source, i = min(kept, key=lambda item: item[0])
    texts = tuple(dict.fromkeys(said(scene, each, h) for _, h, each, _ in kept))
    sight = scene.sights[source.sight or 0]
    return (mistake_of(first.kind, texts, float(given.rms[0]), float(source.rms[i]), sight.unit),)


def _moved(scene: Scene, k: int, given: Looked) -> tuple[Mistake, ...]:
    """A break within the set: it has twice the unknowns, and poses that stand in two heaps bend to it, so more is asked
    of it."""
    if not float(given.score[0]) > _BROKEN:
        return ()
    found = broken(scene.sights[k], scene.q, scene.z[k], scene.rows, scene.labels)
    if found is None:
        return ()
    hypothesis, score, rms = found
    return _named(scene, [Looked((hypothesis,), k, np.array([score]), np.array([rms]))], given, _MOVED)


def _paired(scene: Scene, joints: Looked, read: Looked | None, given: Looked) -> tuple[Mistake, ...]:
    """Two mistakes at once, where no single one explains the data."""
    if not float(given.score[0]) > _PAIRED:
        return ()
    singles = [h for h in joints.hypotheses if not h.rows]
    both = [_both(a, b) for a, b in combinations(singles, 2)]
    tried = joints_tried(scene, both, _PAIR_POSES, _of_no_use(given)) if both else None
    looked = [] if tried is None else [tried]
    if read is not None:
        for h in joints.hypotheses:
            q, rows = scene.moved(h)
            of = readings_tried(replace(scene, rows=rows), 0, read.hypotheses, q, _PAIR_POSES, _of_no_use(given))
            named = tuple(
                replace(m, text=f"{h.text}, and {m.text}", kind=f"{h.kind} and {m.kind}") for m in read.hypotheses
            )
            looked.append(replace(of, hypotheses=named))
    return _named(scene, looked, given, BETTER) if looked else ()


def _both(a: Hypothesis, b: Hypothesis) -> Hypothesis:
    def change(q: Array) -> Array:
        first = q if a.readings is None else a.readings(q)
        return first if b.readings is None else b.readings(first)

    kind = a.kind if a.kind == b.kind else f"{a.kind} and {b.kind}"
    return Hypothesis(kind, f"{a.text}, and {b.text}", change)
