r"""A rigid target with many known points, in two stages: where it stands, and what is read of each point there.

The pose stage is the robot's: T_instrument_target(q, x) and how every parameter moves it, a screw (omega, v) at the
target's origin in the instrument's frame. The point stage is the kind's alone: a point c of the target is at p + R c
and moves with v - (R c) x omega, so with the slopes [J_omega, J_v] of a residual by a twist of the point,

    J = [J_omega - J_v [R c]x, J_v] S + J_own        S: screws by all parameters, shape (6, n)

It is evaluated for all points that were seen at once; the expression does not grow with their number.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import kinematics
from symcal.instruments import Instrument
from symcal.kinematics import Station
from symcal.model.facing import margins_of
from symcal.model.observation import Observation
from symcal.spatial import skew

SX = ca.SX
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Stages:
    """What one observation of a rigid target consists of; made by `stages`.

    pose: (q, x, setup) -> place: R and p by columns, (12,); turn: R_world_instrument by columns, (9,); own: numbers of
        the instrument, (o,); S: screws by all parameters, (6, n).
    residual: (place, c, z, own) -> r; J by the twist of the target's origin; J by the own numbers that are parameters.
    planned: (place, c, own) -> the same slopes at a residual of zero.
    reading: (place, c, own) -> the reading. margins: likewise, by how much the point can be read.
    miss: (place, turn, c, z, own) -> what is judged of a reading.
    columns: which parameters those own numbers are, shape (k,). points: c of every point, shape (K, 3), mm.
    """

    pose: ca.Function
    residual: ca.Function
    planned: ca.Function
    reading: ca.Function
    margins: ca.Function
    miss: ca.Function
    columns: NDArray[np.intp]
    points: Array


def stages(
    state: dict[str, SX], observation: Observation, reader: Station, read: Station, own: SX, by_own: dict[int, int]
) -> Stages:
    """The stages of an observation of points.

    Args:
        state: q, x and setup. reader, read: the frame of readings, and that of the target. own: numbers of the
            instrument as expressions of x and setup. by_own: which of them are parameters, and their columns.
    """
    inverse = reader.rotation.T
    place = (inverse @ read.rotation, inverse @ (read.origin - reader.origin))
    screws = ca.vertcat(
        inverse @ (kinematics.omegas(read.screws) - kinematics.omegas(reader.screws)),
        inverse @ (kinematics.stack(read.screws, read.origin) - kinematics.stack(reader.screws, read.origin)),
    )
    pose = kinematics.function(
        "pose_stage",
        state,
        {"place": ca.vertcat(ca.vec(place[0]), place[1]), "turn": ca.vec(reader.rotation), "own": own, "S": screws},
    )
    kind = observation.instrument
    at, turn, c = SX.sym("place", 12), SX.sym("turn", 9), SX.sym("c", 3)
    z, numbers = SX.sym("z", len(kind.columns)), SX.sym("own", len(kind.own))
    rotation, arm, point = _point(at, c)
    unseen = {"place": at, "c": c, "own": numbers}
    seen = {"place": at, "c": c, "z": z, "own": numbers}
    which = list(by_own)
    by_twist, by_numbers = _slopes(kind, rotation, arm, point, z, numbers, which)
    planned_twist, planned_numbers = _slopes(kind, rotation, arm, point, None, numbers, which)
    shift, _ = kind.miss(rotation, point, z, numbers, riding=observation.riding)
    error = ca.reshape(turn, 3, 3) @ shift if kind.judged_in_world else shift
    name = kind.name
    return Stages(
        pose=pose,
        residual=kinematics.function(
            f"{name}_points",
            seen,
            {"r": kind.residual(rotation, point, z, numbers), "J_twist": by_twist, "J_own": by_numbers},
        ),
        planned=kinematics.function(f"{name}_planned", unseen, {"J_twist": planned_twist, "J_own": planned_numbers}),
        reading=kinematics.function(f"{name}_reading", unseen, {"h": kind.predict(rotation, point, numbers)}),
        margins=kinematics.function(
            f"{name}_margins", unseen, {"m": margins_of(observation, rotation, point, numbers)}
        ),
        miss=kinematics.function(f"{name}_miss", {"place": at, "turn": turn, **seen}, {"e": error}),
        columns=np.array([by_own[i] for i in which], dtype=np.intp),
        points=observation.target.nominal,
    )


def alike(points: Array) -> Array:
    """Few points that stand for many: of the same mean and second moments, shape (2 d, 3) for points in d dimensions.

    So the rms over them of whatever moves like a rigid body is that over all of them.
    """
    centre = points.mean(axis=0)
    _, size, axes = np.linalg.svd(points - centre, full_matrices=False)
    spread = size / np.sqrt(len(points))
    kept = spread > 1e-9 * spread[0]
    arms = np.sqrt(kept.sum()) * spread[kept, None] * axes[kept]
    return np.vstack([centre + arms, centre - arms])


def _point(place: SX, c: SX) -> tuple[SX, SX, SX]:
    """R, R c and p + R c."""
    rotation = ca.reshape(place[:9], 3, 3)
    arm = rotation @ c
    return rotation, arm, place[9:] + arm


def _slopes(
    kind: Instrument, rotation: SX, arm: SX, point: SX, reading: SX | None, own: SX, which: list[int]
) -> tuple[SX, SX]:
    """Slopes of the residual by a twist of the target's origin, and by some of the own numbers."""
    by_twist, by_own = kind.slopes(rotation, point, reading, own)
    by_turn, by_shift = by_twist[:, :3], by_twist[:, 3:]
    return ca.horzcat(by_turn - by_shift @ skew(arm), by_shift), by_own[:, which]
