"""Whether readings go with nominal kinematics and fitted frames: units, joint order, signs, orientations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.residual_rows import rows_of
from symcal.model.measurement import Part
from symcal.model.model import Model, State
from symcal.placing.registration import LEVER
from symcal.spatial import matrix_vectors, quaternion_matrices
from symcal.words import plural

Array = NDArray[np.float64]

CHECK = "check the order, units and signs of the joint columns"
SLIPS = "look at the poses that stand out first"
"""Advice where nominal kinematics does not go with the measurements."""
_FAR = 0.03  # of the robot's length: postures that touch one thing are rarely so far from it by nominal kinematics
_OFF = 0.1  # of the measured spread: a nominal robot is rarely so far off
_OFF_SIZE = 0.02  # of the robot's length: nor so far
_TURNED = np.deg2rad(8.0)
_TOLD = 0.25  # of what nominal kinematics leaves: corrections that leave less explain it
_MUCH, _SOME = 0.02, 0.002  # of the spread of what was read
_HARDLY = 0.3  # of what nominal kinematics leaves
_FEW = 0.1  # of the readings: so many may be slips
_MOST = 0.5  # of an rms that is left without them


def plausibility(data: Dataset, before: State, after: State | None = None) -> tuple[str, ...]:
    """What the nominal robot with fitted frames says about units, joint order and signs.

    Args:
        after: what was identified, where its corrections are plausible: what these explain is no mistake.
    """
    model = before.model
    r = residuals(data, before)
    left = r if after is None else residuals(data, after)
    return tuple(note for part in model.measurement.parts for note in _plausible(model, data, part, r, left))


def unexplained(data: Dataset, before: State, after: State) -> bool:
    """Whether an identification leaves more than robots do: hundredths of what was read, or less but much of what
    nominal kinematics leaves. Arguments as of `plausibility`."""
    model = before.model
    r, left = residuals(data, before), residuals(data, after)
    for part in model.measurement.parts:
        was, is_ = first_quantity(part, data, r), first_quantity(part, data, left)
        if was is None or is_ is None:
            continue
        kind, error = part.observation.instrument, _rms(is_[0])
        extent = size_of(model, data) if kind.constrains else _rms(about_centre(was[1]))
        if error > _MUCH * extent or (error > _SOME * extent and error > _HARDLY * _rms(was[0])):
            return True
    return False


def residuals(data: Dataset, state: State) -> Array:
    """Residuals of a state, shape (N, m), mm, rad and px."""
    model = state.model
    return rows_of(model.measurement, data, state.setup, model.residuals).residual(state.x)


def _plausible(model: Model, data: Dataset, part: Part, r: Array, left: Array) -> list[str]:
    found = first_quantity(part, data, r)
    if found is None:
        return []
    position, measured, unit = found
    error, spread, reach = map(_rms, (position, about_centre(measured), about_centre(measured + position)))
    kind, who = part.observation.instrument, who_of(model, part)
    if kind.constrains:
        return _missed(who, error, size_of(model, data))
    small = reach > 1.0 and 0 < spread < reach / 30
    large = spread > 30 * max(reach, 1.0) or spread > 30 * max(size_of(model, data), LEVER)  # a tool of any length fits
    if unit == "mm" and (small or large):
        raise RefusedError(
            f"{who}the measured {'points' if kind.gives_point else kind.label} spread over {spread:.3g} mm, the "
            f"robot's over {min(reach, size_of(model, data)):.3g} mm: the measurements are not in the unit that their "
            "columns name"
        )
    extent = max(reach, LEVER if kind.reads == "frame" else 1.0)
    # robots whose small motions are looked at are off by much of them, and not of their own size
    if error > _OFF * extent and (unit != "mm" or error > _OFF_SIZE * size_of(model, data)):
        off = f"{who}nominal kinematics with fitted frames is off by {error:.4g} {unit} rms"
        told = first_quantity(part, data, left)
        if told is not None and _rms(told[0]) < min(_TOLD * error, _OFF_SIZE * extent):
            return [f"{off}, {error / extent:.0%} of the measured spread, which plausible corrections explain"]
        few = _few(position)
        if few is not None:
            return [
                f"{off}, but without "
                f"{plural(few, 'reading')} by {_rms(position[_largest_last(position)[:-few]]):.4g} {unit}: {SLIPS}"
            ]
        return [f"{off}, {error / extent:.0%} of the measured spread: {CHECK}, and the robot file"]
    return _turned(data, part, r, who)


def _turned(data: Dataset, part: Part, r: Array, who: str) -> list[str]:
    """What is said of orientations that nominal kinematics does not explain, where positions are as they should be."""
    if part.observation.instrument.reads != "frame":
        return []
    seen = part.seen(data.z).all(axis=1)
    turns = r[seen][:, part.components][:, 3:]
    first, *rest = quaternion_matrices(data.z[seen][:, part.readings][:, 3:])
    from_first = np.linalg.norm(matrix_vectors(first.T @ np.array(rest)), axis=-1) if rest else np.zeros(1)
    spread = float(np.sqrt(np.mean(from_first**2)))
    error = _rms(turns)
    if error < max(_TURNED, _OFF * spread) or _few(turns) is not None:
        return []
    return [
        f"{who}by nominal kinematics with fitted frames orientations are turned by {np.rad2deg(error):.3g} deg rms: "
        "check the order x, y, z, w of the quaternions, whose pose it is ('reports', 'invert'), and the signs of the "
        "joint columns"
    ]


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def _largest_last(vectors: Array) -> NDArray[np.intp]:
    return np.argsort(np.linalg.norm(vectors, axis=1), kind="stable")


def _few(vectors: Array) -> int | None:
    """How many of some errors make most of their rms, where these are few; None where all do."""
    least = _largest_last(vectors)
    for count in range(1, int(_FEW * len(vectors)) + 1):
        if _rms(vectors[least[:-count]]) < _MOST * _rms(vectors):
            return count
    return None


def _missed(who: str, error: float, size: float) -> list[str]:
    """What is said where postures that touch one thing are far from it by nominal kinematics."""
    if error < _FAR * size:
        return []
    return [
        f"{who}by nominal kinematics the postures miss what they touch by {error:.4g} mm rms, {error / size:.0%} of "
        f"the robot's length: {CHECK}, which posture touched what, and the robot file"
    ]


def who_of(model: Model, part: Part) -> str:
    """Whose measurements they are, where there are several instruments."""
    return f"{part.observation.name}: " if len(model.measurement.parts) > 1 else ""


def first_quantity(part: Part, data: Dataset, r: Array) -> tuple[Array, Array, str] | None:
    """Residuals and readings of the first quantity, shape (k, d) each, of what was seen, and their unit.

    None where nothing was seen, or where readings are no numbers that residuals could be compared with.
    """
    kind = part.observation.instrument
    quantity = kind.quantities[0]
    columns = kind.columns[: quantity.size]
    if any(unit != quantity.unit for _, unit in columns):
        return None
    rows = r[:, part.components].reshape(len(data) * part.features, -1)[:, : quantity.size]
    measured = data.z[:, part.readings].reshape(len(data) * part.features, -1)[:, : quantity.size]
    seen = np.isfinite(measured).all(axis=1)
    return (rows[seen], measured[seen], quantity.unit) if seen.any() else None


def about_centre(points: Array) -> Array:
    """Points less their mean, shape (k, d)."""
    return np.asarray(points - points.mean(axis=0))


def size_of(model: Model, data: Dataset) -> float:
    """The nominal robot's length: links, strokes in these data, tool; mm."""
    return model.robot.length_with_tool(data.q)
