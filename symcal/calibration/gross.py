"""Outliers of a model that lacks something: only gross ones, since what it lacks makes others."""

from __future__ import annotations

from dataclasses import replace

from symcal.calibration.calibrate import Calibration
from symcal.calibration.outliers import StandingOut
from symcal.calibration.warnings import outlier_notes
from symcal.words import plural

GROSS = 10.0
"""Noises: gravity or a wave, spread over all poses and counted as noise, leaves no more than that at one of them."""


def gross_alone(calibration: Calibration) -> Calibration:
    """The calibration with its gross outliers alone; the others are said to be none before the physics is in the model.

    Call it where the residuals follow something (`symcal.calibration.model_check.lacks_physics`).
    """
    kept = tuple(each for each in calibration.outliers if each.noises > GROSS)
    gone = {each.pose for each in calibration.outliers} - {each.pose for each in kept}
    if not gone:
        return calibration
    loss = calibration.after.loss
    old = outlier_notes(StandingOut(calibration.outliers), loss)
    said = (
        f"{plural(len(gone), 'training pose')} {'stands' if len(gone) == 1 else 'stand'} out of the others, but the "
        "residuals follow something that the model lacks: outliers can be told when that is in it"
    )
    notes = [note for note in calibration.notes if note not in old]
    return replace(calibration, outliers=kept, notes=(*notes, *outlier_notes(StandingOut(kept), loss), said))
