"""Views of a camera that disagree with the others about where things stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from symcal.data.dataset import Dataset
from symcal.fit.residual_rows import rows_of
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.placing.camera_placement import ODD
from symcal.words import number, plural

_NAMED = 5


def disagreements(model: Model, data: Dataset, setup: Setup) -> tuple[tuple[str, ...], Dataset]:
    """A sentence for each camera of which a few views are much further off than the others with the nominal robot.

    Such a view is of another board, of a board or camera that was moved, of wrong joint readings, or is detected wrong.

    Returns:
        the sentences, and the data without those views.
    """
    cameras = [part for part in model.measurement.parts if part.observation.instrument.is_camera]
    if not cameras:
        return (), data
    z = data.z.copy()
    r = rows_of(model.measurement, data, setup, model.residuals).residual(np.zeros(len(model.parameters)))
    notes = []
    for part in cameras:
        count = part.seen(data.z).sum(axis=1)
        views = np.flatnonzero(count)
        rms = np.sqrt(np.sum(r[views][:, part.components] ** 2, axis=1) / np.maximum(count[views] / 2, 1))
        rms = np.nan_to_num(rms, nan=np.inf)  # points behind the camera
        middle = float(np.median(rms)) if len(views) else 0.0
        odd = np.flatnonzero(rms > ODD * max(middle, part.observation.instrument.quantities[0].floor))
        if len(views) < 3 or not len(odd) or len(odd) > len(views) / 3:
            continue
        odd = odd[np.argsort(-rms[odd], kind="stable")]
        named = ", ".join(data.labels[views[i]] for i in odd[:_NAMED]) + (", ..." if len(odd) > _NAMED else "")
        z[views[odd][:, None], np.arange(part.readings.start, part.readings.stop)] = np.nan
        verb = "disagrees" if len(odd) == 1 else "disagree"
        notes.append(
            f"{plural(len(odd), 'view')} of '{part.observation.name}' {verb} with the others about where camera and "
            f"target stand ({named}: off by {number(float(rms[odd].min()), 2)} px or more, the others by "
            f"{number(middle, 2)} px): was something moved, or do joint readings and image not belong together?"
        )
    if not notes:
        return (), data
    return tuple(notes), replace(data, z=z).take(np.flatnonzero(np.isfinite(z).any(axis=1)))
