"""What one observation says about the chain, whatever its two ends are: how much of what was read no frames explain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.mistakes.hypotheses import (
    Hypothesis,
    axis_hypotheses,
    frame_hypotheses,
    point_hypotheses,
)
from symcal.calibration.mistakes.rotation_fit import COUNT, SIZE, Channel, form, least, least_left, left, sums
from symcal.data.dataset import Dataset
from symcal.model.measurement import Part
from symcal.model.model import Model
from symcal.placing.ends import Ends, ends_of
from symcal.placing.registration import LEVER
from symcal.spatial import inverse, pose_matrix

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FEATURES = 6  # of a target with many points, those that are seen most
_SPARE = 6.0  # equations beyond the unknowns of the frames, at least
_TURN = 0.02  # of the lever: axes that turn less have no spread to compare with


@dataclass(frozen=True, slots=True)
class Misfit:
    """How badly readings and chain go together with free frames, by hypothesis, shape (H,) each.

    score: rms of what is left over the spread of what was read, over points and axes alike; scale-free. rms: of what is
    left of a point, of an axis (deg), or of a point `LEVER` off the origin of a frame. rotation: M, shape (H, 3, 3).
    """

    score: Array
    rms: Array
    rotation: Array


@dataclass(frozen=True, slots=True)
class Sight:
    """One observation whose readings give points, frames or axes, or that touches a point.

    part: its columns. ends: the chain between its two ends. features: which of them are looked at.
    """

    part: Part
    ends: Ends
    features: tuple[int, ...]

    @property
    def reads(self) -> str:
        return self.part.observation.instrument.reads

    @property
    def constrains(self) -> bool:
        return self.part.observation.instrument.constrains

    @property
    def unit(self) -> str:
        return "deg" if self.reads == "axes" else "mm"

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """What may be wrong with its readings."""
        if self.constrains:
            return ()
        of: dict[str, Callable[[], tuple[Hypothesis, ...]]] = {
            "points": point_hypotheses,
            "frame": frame_hypotheses,
            "axes": axis_hypotheses,
        }
        return of[self.reads]()

    def chain(self, q: Array) -> Array:
        """The nominal chain between the ends, shape (..., N, 4, 4), mm, of readings (..., N, dof)."""
        zero = np.zeros(len(self.ends.model.parameters))
        return self.ends.chain(q.reshape(-1, q.shape[-1]), zero).reshape(*q.shape[:-1], 4, 4)

    def read(self, z: Array) -> Array:
        """The readings of the observation out of all, shape (N, w)."""
        return np.asarray(z[:, self.part.readings])

    def channels(self, z: Array, rows: Mask) -> list[Channel]:
        """What was read, feature by feature. Args: z: own readings, shape (..., N, w). rows: that count, (..., N)."""
        if self.reads == "frame":
            return self._of_frames(z, rows)
        values = z.reshape(*z.shape[:-1], -1, 3)
        out = []
        for k in self.features:
            read = values[..., k, :]
            seen: Mask = np.logical_and(np.isfinite(read).all(axis=-1), rows)
            read = np.where(seen[..., None], read, 0.0)
            if self.reads == "axes":
                norm = np.linalg.norm(read, axis=-1, keepdims=True)
                read = LEVER * read / np.where(norm > 0, norm, 1.0)
            out.append(Channel(read, seen, self.reads == "points"))
        return out

    def _of_frames(self, z: Array, rows: Mask) -> list[Channel]:
        o = self.part.observation
        there: Mask = np.isfinite(z.sum(axis=-1))
        seen: Mask = np.logical_and(there, rows)
        poses = pose_matrix(np.where(there[..., None], z, np.array([0.0, 0, 0, 0, 0, 0, 1])))
        reader = o.target.at if o.reports == "instrument" else o.at
        poses = inverse(poses) if reader.moves else poses
        origin, axes = poses[..., :3, 3], LEVER * poses[..., :3, :3]
        return [
            Channel(origin, seen, True),
            *(Channel(axes[..., :, k], seen, False) for k in range(3)),
        ]

    def misfit(self, chain: Array, z: Array, rows: Mask, above: float = np.inf) -> Misfit:
        """What no frames explain; not looked for exactly where the score is above a limit, and infinite there.

        Args:
            chain: shape (H or 1, N, 4, 4). z: own readings, shape (H or 1, N, w). rows: that count, shape (H or 1, N).
        """
        found = [(of.sum(axis=-2), located) for of, located in self.sums(chain, z, rows)]
        if not np.isfinite(above):
            return self.fitted(found)
        count = np.broadcast_shapes(*(of.shape[:-1] for of, _ in found))
        found = [(np.broadcast_to(of, (*count, SIZE)), located) for of, located in found]
        near = np.flatnonzero(self._least_score(found) < above)
        out = Misfit(np.full(count, np.inf), np.full(count, np.inf), np.broadcast_to(np.eye(3), (*count, 3, 3)).copy())
        if near.size:
            exact = self.fitted([(of[near], located) for of, located in found])
            out.score[near], out.rms[near], out.rotation[near] = exact.score, exact.rms, exact.rotation
        return out

    def sums(self, chain: Array, z: Array, rows: Mask) -> list[tuple[Array, bool]]:
        """What the fit of frames needs of every pose, shape (..., N, 65), by channel, with whether it is located."""
        rotation, position = chain[..., :3, :3], chain[..., :3, 3]
        return [(sums(rotation, position, channel), channel.located) for channel in self.channels(z, rows)]

    def fitted(self, found: Sequence[tuple[Array, bool]]) -> Misfit:
        """The misfit of channels' sums over poses, shape (H, 65) each, with whether they are located."""
        m, _ = least(form(list(found)))
        square, rms = np.zeros(m.shape[:-2]), np.zeros(m.shape[:-2])
        sorts = self._sorts(found)
        for own, share, floor in sorts:
            cost = left(form(own), m) * share
            count = np.maximum(sum(of[..., COUNT] for of, _ in own), 1.0)
            square = square + cost / floor
            rms = np.hypot(rms, np.sqrt(cost / count) * (180 / np.pi / LEVER if self.reads == "axes" else 1.0))
        return Misfit(np.sqrt(square / len(sorts)), rms, m)

    def _least_score(self, found: Sequence[tuple[Array, bool]]) -> Array:
        """A number that the score is not below, shape (H,): points and axes each with the matrix that suits them."""
        sorts = self._sorts(found)
        return np.asarray(
            np.sqrt(sum(least_left(form(own)) * share / floor for own, share, floor in sorts) / len(sorts))
        )

    def _sorts(self, found: Sequence[tuple[Array, bool]]) -> list[tuple[list[tuple[Array, bool]], Array, Array]]:
        """Points and axes apart: sums, by what unknowns take more is left, shape (H,), and the spread, (H,), mm^2."""
        out = []
        for located in (True, False):
            own = [(of, at) for of, at in found if at == located]
            if not own:
                continue
            equations, taken = self._balance(own, located)
            share = np.maximum(equations, 1e-9) / np.maximum(equations - taken, 1.0)
            count = np.maximum(sum(of[..., COUNT] for of, _ in own), 1.0)
            floor = count * (1e-6 if located else LEVER * _TURN) ** 2
            out.append((own, share, np.maximum(sum(self._spread(of) for of, _ in own), floor)))
        return out

    def _balance(self, own: Sequence[tuple[Array, bool]], located: bool) -> tuple[Array, float]:
        """Equations of channels of one sort, shape (H,), and the unknowns of frames that they take."""
        rows = 3 * np.asarray(sum(of[..., COUNT] for of, _ in own))
        if located:
            return rows, (3.0 if self.constrains else 6.0) + 3 * len(own)
        if self.reads == "frame":  # three axes turn as one
            return rows / 3, 6.0
        return rows * 2 / 3, 3.0 + 2 * len(own)

    def spare(self, found: Sequence[tuple[Array, bool]]) -> float:
        """Equations beyond the unknowns of the frames, of sums of one hypothesis, shape (65,) each."""
        out = 0.0
        for located in {at for _, at in found}:
            equations, taken = self._balance([each for each in found if each[1] == located], located)
            out += float(equations) - taken
        return out

    def enough(self, z: Array, rows: Mask) -> bool:
        """Whether there are more readings than the frames take."""
        counts = [(np.where(np.arange(SIZE) == COUNT, c.seen.sum(), 0.0), c.located) for c in self.channels(z, rows)]
        return self.spare(counts) >= _SPARE

    def spread(self, found: Sequence[tuple[Array, bool]]) -> Array:
        """Rms distance of what was read from its middle, over points, or axes where no points are read; shape (H,)."""
        own = [of for of, located in found if located] or [of for of, _ in found]
        count = np.maximum(sum(of[..., COUNT] for of in own), 1.0)
        return np.asarray(np.sqrt(sum(self._spread(of) for of in own) / count))

    def _spread(self, of: Array) -> Array:
        """Squared distances from the middle in a channel's sums, shape (H,), mm^2; of the chain where nothing is."""
        count = np.maximum(of[..., COUNT], 1.0)
        if self.constrains:
            squares, first = of[..., 24], of[..., 21:24]
        else:
            squares, first = of[..., 0] + of[..., 4] + of[..., 8], of[..., 9:12]
        return np.asarray(np.maximum(squares - np.sum(first**2, axis=-1) / count, 0.0))


def sights(model: Model, data: Dataset) -> tuple[Sight, ...]:
    """The observations that can be looked at like this: what reads points, frames or axes, or touches points."""
    out = []
    for part in model.measurement.parts:
        o = part.observation
        kind = o.instrument
        touches = kind.constrains and sum(q.size for q in kind.quantities) == 3
        if not (kind.gives_point or kind.reads == "axes" or touches) or (kind.reads == "points" and part.size % 3):
            continue
        ends = ends_of(model, o, frozenset())
        if ends is None:
            continue
        if kind.reads == "axes" and o.riding:
            ends = replace(ends, reversed=True)
        there = np.isfinite(data.z[:, part.readings]).reshape(len(data), part.features, -1).all(axis=2).sum(axis=0)
        if not there.any():
            continue
        order = np.argsort(-there, kind="stable")[:_FEATURES]
        out.append(Sight(part, ends, tuple(int(k) for k in np.sort(order) if there[k] > 1)))
    return tuple(out)
