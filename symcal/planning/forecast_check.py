"""What the plan behind the data promised, beside what the identification found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from symcal.calibration.evaluate import Errors
from symcal.config.conversion import ExperimentFile
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.model.model import Model
from symcal.planning.nominal_noise import nominal_noise


def forecast_check(
    file: ExperimentFile, model: Model, data: Dataset, errors: Mapping[str, Mapping[str, Errors]]
) -> dict[str, Any] | None:
    """Predicted and realised rms position error at the held-out poses; None where no noise is stated or none held out.

    Predicted at nominal from the stated noise, the plausible sizes and the training poses, as a plan predicts it: what
    a later fit thinks of its own noise does not enter.

    Args:
        errors: by part and state, as `symcal.calibration.compare.compare` gives them.
    """
    givers = [o for o in model.task.observations if o.instrument.gives_point]
    if not givers or "test" not in data.split or "after" not in errors.get("test", {}):
        return None
    try:
        sigmas = nominal_noise(file, model)
    except RefusedError:
        return None
    from symcal.planning.area import WorkingArea
    from symcal.planning.information import pose_information
    from symcal.planning.region import TaskRegion, region_accuracy

    train, test = data.part("train"), data.part("test")
    area = WorkingArea(data.q.min(axis=0), data.q.max(axis=0))
    free = (*model.kinematic, *model.placement)
    try:
        info = pose_information(model.measurement, model.setup, sigmas, free, area=area, poses=len(train))
    except RefusedError:
        return None
    accuracy = region_accuracy(info, TaskRegion(test.q))
    predicted = accuracy.mean_rms(info.posterior(train.q))
    point = {group.observation: group.name for group in reversed(model.measurement.groups) if group.unit == "mm"}
    sigma = float(np.sqrt(np.mean([sigmas[point[o.of]] ** 2 for o in givers])))
    truth = errors.get("truth", {}).get("after")
    return {
        "noise_sigma_mm": sigma,
        "poses": len(train),
        "rank": info.rank,
        "hidden_mm": accuracy.hidden_mm,
        "predicted_rms_mm": predicted,
        "predicted_measured_rms_mm": float(np.sqrt(predicted**2 + 3 * sigma**2)),
        "found_measured_rms_mm": _rms(errors["test"]["after"]),
        "found_true_rms_mm": None if truth is None else _rms(truth),
    }


def _rms(errors: Errors) -> float:
    return float(np.sqrt(np.mean(errors.size**2)))
