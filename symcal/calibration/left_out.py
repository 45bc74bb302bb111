"""Errors of a calibration on its own training poses, left out in turn: for data of which nothing was held out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from symcal.calibration.calibrate import Calibration, linearised
from symcal.calibration.evaluate import Errors, evaluate, pooled
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.fit.held_out import folds_of, steps_without
from symcal.model.model import State

FOLDS = 20


def left_out(calibration: Calibration, data: Dataset, options: Options) -> dict[str, Errors] | None:
    """Errors `before` and `after`; None where nothing that judges was read, or the fit is no estimate.

    The identification without a fold is that of the linearised model, variances held; each fold is then judged by the
    full model. Of the nominal robot the frames stay fitted to all poses, which is in its favour.

    Args:
        data: what the calibration is of. options: of the identification.
    """
    model, after, train = calibration.model, calibration.after, data.part("train")
    if not np.isfinite(after.x).all():
        return None
    system, unplaced = linearised(model, train, after, options)
    found = []
    for fold, step in steps_without(system, after.x, after.variances, folds_of(system, FOLDS)):
        state = State(model, after.setup, after.x + step, unplaced)
        try:
            errors = evaluate(state, train.take(fold))
        except RefusedError:  # what judges has read nothing there
            continue
        found.append(replace(errors, pose=fold[errors.pose]))
    if not found:
        return None
    return {"before": evaluate(calibration.before, train), "after": pooled(found)}
