"""Readings of held-out poses that stand out of all others there: slips that would be taken for errors of the robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from symcal.calibration.calibrate import Calibration
from symcal.calibration.outliers import Outlier, where_read
from symcal.data.dataset import Dataset
from symcal.fit.residual_rows import rows_of
from symcal.placing.placement import settled
from symcal.units import DEGREES, SHOWN_UNITS
from symcal.words import plural

_FEWEST = 5  # readings that one may stand out of
_FAR = 6.0  # standard deviations, by the median of all held-out readings: what errors of robots are not
_NAMED = 5


def held_out_outliers(calibration: Calibration, test: Dataset) -> tuple[Outlier, ...]:
    """Readings of the test poses far beyond the others', the furthest first, group by group.

    The spread of a group is that of the training, or by the median residual of its test readings where that is larger:
    then what all of them have in common, errors of the robot among it, is no outlier.
    """
    state = settled(calibration.states["after"], test)
    model, after = state.model, calibration.after
    rows = rows_of(model.measurement, test, state.setup, model.residuals)
    residual, out = rows.residual(state.x), []
    for group in model.measurement.groups:
        columns = list(group.columns)
        shape = (len(test), -1, group.block)
        seen = rows.seen[:, columns].reshape(shape)
        norms = np.linalg.norm(np.where(seen, residual[:, columns].reshape(shape), 0.0), axis=2)
        size = seen.sum(axis=2)
        there = size > 0
        if there.sum() < _FEWEST:
            continue
        typical = float(np.median(norms[there] / np.sqrt(2 * scipy.special.gammaincinv(size[there] / 2, 0.5))))
        sigma = max(typical, float(after.sigmas.get(group.name, 0.0)), group.floor)
        for i, k in sorted(zip(*np.nonzero(there & (norms > _FAR * sigma)), strict=True), key=lambda at: -norms[at]):
            part, point, _ = where_read(model, group, int(k))
            out.append(
                Outlier(
                    pose=test.labels[i],
                    instrument=part.observation.name,
                    quantity=group.quantity,
                    group=group.name,
                    point=point,
                    off=float(norms[i, k]) * (DEGREES if group.unit == "rad" else 1.0),
                    unit=SHOWN_UNITS[group.unit],
                    noises=float(norms[i, k] / sigma),
                    weight=0.0,
                    parameter="",
                    sigmas=0.0,
                    tool_mm=0.0,
                    split="test",
                )
            )
    return tuple(out)


def held_out_notes(found: Sequence[Outlier]) -> list[str]:
    """What is said of them."""
    poses = list(dict.fromkeys(each.pose for each in found))
    if not poses:
        return []
    listed = ", ".join(poses[:_NAMED]) + (", ..." if len(poses) > _NAMED else "")
    worst = max(found, key=lambda each: each.noises)
    if len(poses) == 1:
        said = f"test pose {worst.pose} stands out of all others, {worst.off:.4g} {worst.unit} off: it spoils"
    else:
        said = (
            f"{plural(len(poses), 'test pose')} ({listed}) stand out of all others, {worst.pose} by {worst.off:.4g} "
            f"{worst.unit}: they spoil"
        )
    return [f"{said} what the test poses say of the accuracy; measure again, or leave out"]
