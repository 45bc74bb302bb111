"""What is searched for a mistake: everything that was read, with the joint readings in the order of their file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.mistakes.hypotheses import Hypothesis
from symcal.calibration.mistakes.sight import Misfit, Sight, sights
from symcal.data.dataset import Dataset
from symcal.model.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

POSES = 120
"""Poses that are looked at."""
_CHUNK = 64


@dataclass(frozen=True, slots=True)
class Looked:
    """Hypotheses with their misfits; sight: whose readings they are about, None of the joints'."""

    hypotheses: tuple[Hypothesis, ...]
    sight: int | None
    score: Array
    rms: Array


@dataclass(frozen=True, slots=True)
class Scene:
    """What is searched: sights, joint readings (N, dof) in the order of their file, what was read by sight (N, w).

    rows: poses that count, shape (N,). groups: of poses that follow each other, one number each, shape (N,).
    """

    sights: tuple[Sight, ...]
    q: Array
    z: tuple[Array, ...]
    rows: Mask
    groups: NDArray[np.intp]
    labels: tuple[str, ...]

    def moved(self, hypothesis: Hypothesis) -> tuple[Array, Mask]:
        """Joint readings as a hypothesis has them, and the rows that then count."""
        q, rows = joint_readings(self.q, self.groups, hypothesis)
        return q, self.rows & rows


AS_GIVEN = Hypothesis("", "")


def joint_readings(q: Array, groups: NDArray[np.intp], hypothesis: Hypothesis) -> tuple[Array, Mask]:
    """Joint readings (N, dof) as a hypothesis has them, and the rows that then have any; groups: see `Scene`."""
    rows, k = np.ones(len(q), dtype=bool), hypothesis.rows
    if k:
        at = np.arange(len(q)) - k
        inside = (at >= 0) & (at < len(q))
        at = np.clip(at, 0, len(q) - 1)
        rows = inside & (groups[at] == groups)
        q = q[at]
    return (q if hypothesis.readings is None else hypothesis.readings(q)), rows


def sessions_of(labels: Sequence[str]) -> NDArray[np.intp]:
    """Groups of poses that follow each other, by label: one number each session."""
    sessions = [label.rpartition("/")[0] for label in labels]
    number = {name: i for i, name in enumerate(dict.fromkeys(sessions))}
    return np.array([number[name] for name in sessions], dtype=np.intp)


def scene_of(model: Model, data: Dataset) -> Scene | None:
    """What of the data can be searched; None where nothing can."""
    wanted = [(o.instrument.name, o.features) for o in model.task.observations]
    if [(each.kind, each.features) for each in data.of] != wanted:  # refused elsewhere
        return None
    found = sights(model, data)
    rows = np.array([split != "unused" for split in data.split])
    found = tuple(s for s in found if s.features and s.enough(s.read(data.z), rows))
    if not found:
        return None
    groups = sessions_of(data.labels)
    return Scene(found, data.q, tuple(s.read(data.z) for s in found), rows, groups, data.labels)


def some(rows: Mask, count: int) -> NDArray[np.intp]:
    """At most so many of the rows that count, evenly."""
    there = np.flatnonzero(rows)
    return there if len(there) <= count else there[np.linspace(0, len(there) - 1, count).astype(int)]


def joints_tried(scene: Scene, hypotheses: Sequence[Hypothesis], poses: int = POSES, above: float = np.inf) -> Looked:
    """The misfit of hypotheses about joint readings, over all sights. Args: above: a score that may as well be
    infinite."""
    at, above = some(scene.rows, poses), above * float(np.sqrt(len(scene.sights)))
    scores, rms = [], []
    for first in range(0, len(hypotheses), _CHUNK):
        own = [(q[at], rows[at]) for q, rows in map(scene.moved, hypotheses[first : first + _CHUNK])]
        q, rows = np.array([q for q, _ in own]), np.array([rows for _, rows in own])
        found = [s.misfit(s.chain(q), z[None, at], rows, above) for s, z in zip(scene.sights, scene.z, strict=True)]
        scores.append(_together(found))
        rms.append(_rms_together(scene, found))
    return Looked(tuple(hypotheses), None, np.concatenate(scores), np.concatenate(rms))


def _together(found: Sequence[Misfit]) -> Array:
    return np.asarray(np.sqrt(np.mean([f.score**2 for f in found], axis=0)))


def _rms_together(scene: Scene, found: Sequence[Misfit]) -> Array:
    own = [f for f, s in zip(found, scene.sights, strict=True) if s.unit == scene.sights[0].unit]
    return np.asarray(np.sqrt(np.mean([f.rms**2 for f in own], axis=0)))


def readings_tried(
    scene: Scene,
    k: int,
    hypotheses: Sequence[Hypothesis],
    q: Array | None = None,
    poses: int = POSES,
    above: float = np.inf,
) -> Looked:
    """The misfit of hypotheses about what one sight has read.

    Args:
        q: joint readings, those of the file when None. above: a score that may as well be infinite.
    """
    at, sight = some(scene.rows, poses), scene.sights[k]
    z = scene.z[k][at]
    seen = np.isfinite(z).all(axis=1) if sight.reads == "frame" else np.ones(len(z), dtype=bool)
    changed = np.full((len(hypotheses), *z.shape), np.nan)
    for i, h in enumerate(hypotheses):
        changed[i, seen] = z[seen] if h.measured is None else h.measured(z[seen])
    found = sight.misfit(
        sight.chain((scene.q if q is None else q)[None, at]), changed, np.ones((1, len(at)), dtype=bool), above
    )
    return Looked(tuple(hypotheses), k, found.score, found.rms)


def said(scene: Scene, looked: Looked, hypothesis: Hypothesis) -> str:
    """A hypothesis in words, with whose readings it is about where there are several."""
    if looked.sight is None or len(scene.sights) == 1:
        return hypothesis.text
    return f"{scene.sights[looked.sight].part.observation.name}: {hypothesis.text}"
