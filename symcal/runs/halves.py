"""Two halves of the training poses of a run, and what its results say of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.halves import Halves, two_halves
from symcal.calibration.halves_words import halves_facts, halves_warnings
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.runs.load import Experiment

Array = NDArray[np.float64]


def with_halves(
    content: dict[str, Any],
    calibration: Calibration,
    data: Dataset,
    experiment: Experiment,
    area: tuple[Array, Array] | None,
) -> Halves | None:
    """Two halves, their facts and warnings added to the content; None where they cannot be compared."""
    found: Halves | None = None
    try:
        found = two_halves(calibration, data, experiment.options, np.random.default_rng(experiment.seed), area)
        content["halves"] = halves_facts(found)
        content["warnings"] += halves_warnings(found)
    except RefusedError as error:
        content["halves"] = halves_facts(str(error))
    return found
