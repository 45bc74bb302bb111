"""Measurements whose spread the arm cannot have made, though frames explain them: an arm without lengths between its
axes explains points of any size, if its target only stands where they shrink to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.mistakes.hypotheses import Hypothesis
from symcal.calibration.mistakes.mistake import Mistake
from symcal.calibration.mistakes.scene import AS_GIVEN, POSES, Scene, readings_tried, said, some
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_SMALL = 0.01  # of what the joints can move: measured spreads below are no chance
_LARGE = 30.0  # arm's lengths: spreads beyond are none
_LIKELY = (0.03, 3.0)  # of that: what spreads are in the right unit
_LEAST = 0.05  # of the spread: frames that leave less explain well enough


@dataclass(frozen=True, slots=True)
class Reach:
    """length: of the arm with its tool, mm. motion: rms distance that joint readings may move a point by, mm: turns by
    that length, and strokes."""

    length: float
    motion: float

    def likely(self, spread: float) -> float | None:
        """What a spread should be about, mm; None where it is plausible as it is."""
        if 0 < spread < _SMALL * self.motion:
            return self.motion
        return self.length if spread > _LARGE * max(self.length, 1.0) else None


def reach_of(robot: Robot, q: Array) -> Reach:
    """What an arm reaches with joint readings (N, dof), rad and mm."""
    about = q - q.mean(axis=0)
    turning = np.array([joint.revolute for joint in robot.joints], dtype=bool)
    turn = min(float(np.sqrt(np.mean(np.sum(about[:, turning] ** 2, axis=1)))), 1.0)
    stroke = float(np.sqrt(np.mean(np.sum(about[:, ~turning] ** 2, axis=1))))
    length = robot.length_with_tool(q)
    return Reach(length, length * turn + stroke)


def of_another_size(robot: Robot, scene: Scene, k: int) -> tuple[Mistake, ...]:
    """Readings in another unit that frames explain as well: told by what the joints can move."""
    sight = scene.sights[k]
    if sight.constrains or sight.reads == "axes":
        return ()
    at = some(scene.rows, POSES)
    q, z, everything = scene.q[at], scene.z[k][at], np.ones(len(at), dtype=bool)
    read = sight.sums(sight.chain(q), z, everything)
    spread = float(sight.spread([(of.sum(axis=0), located) for of, located in read]))
    wanted = reach_of(robot, q).likely(spread)
    if wanted is None:
        return ()
    units = [h for h in sight.hypotheses if h.kind == "unit"]
    tried, given = readings_tried(scene, k, units), readings_tried(scene, k, (AS_GIVEN,))
    factors = np.array([_size_of(h) for h in units])
    share = spread * factors / wanted
    good = tried.score <= _LEAST  # a target on the axis of a turntable spreads by its noise alone
    chosen = np.flatnonzero(good & (share >= _LIKELY[0]) & (share <= _LIKELY[1]))
    if not len(chosen):
        return ()
    texts = tuple(said(scene, tried, units[i]) for i in chosen[np.argsort(tried.score[chosen], kind="stable")])
    text = (
        f"the measured points spread over {spread:.3g} mm, while these joint readings move the arm by about "
        f"{wanted:.3g} mm: the measurements are not in the unit that their columns name; {'; or '.join(texts)}"
    )
    best = int(chosen[np.argmin(tried.score[chosen])])
    return (
        Mistake("unit", texts, text, float(given.rms[0]), float(tried.rms[best] / factors[best]), "mm", fatal=True),
    )


def _size_of(hypothesis: Hypothesis) -> float:
    assert hypothesis.measured is not None
    return float(hypothesis.measured(np.array([[1.0, 0, 0, 0, 0, 0, 1.0]]))[0, 0])
