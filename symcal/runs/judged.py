"""What is judged about an identification, one thing after the other, each added to the content of results.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors
from symcal.calibration.gross import gross_alone
from symcal.calibration.halves import Halves, two_halves
from symcal.calibration.halves_words import halves_facts, halves_warnings
from symcal.calibration.held_out_outliers import held_out_notes, held_out_outliers
from symcal.calibration.judgement import decide_run, with_decision
from symcal.calibration.mistakes.mistake import mistake_facts
from symcal.calibration.mistakes.moved import moved_between
from symcal.calibration.model_check import ModelCheck, lacks_physics, model_check
from symcal.calibration.model_words import model_check_facts, model_warnings
from symcal.calibration.outliers import outlier_facts
from symcal.config import conversion as config
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.placing.placement import settled
from symcal.runs.load import Experiment

Array = NDArray[np.float64]


def with_check(
    content: dict[str, Any], calibration: Calibration, data: Dataset, experiment: Experiment
) -> tuple[ModelCheck, Calibration]:
    """The check of the model, its facts and warnings added to the content; what the model lacks makes no outliers."""
    check = model_check(calibration, data, replace(experiment.options, loss=calibration.after.loss))
    tried = experiment.file.identification.groups
    content["model_check"] = model_check_facts(check, tried)
    if calibration.mistakes:  # which the residuals follow
        return check, calibration
    content["warnings"] += model_warnings(check, tried)
    if not lacks_physics(check):
        return check, calibration
    gross = gross_alone(calibration)
    said = [note for note in content["warnings"] if note not in calibration.notes or note in gross.notes]
    content["warnings"] = said + [note for note in gross.notes if note not in said]
    content["outliers"] = outlier_facts(gross.outliers)
    return check, gross


def judge_test_poses(content: dict[str, Any], calibration: Calibration, data: Dataset) -> None:
    """Slips among the test poses, and an instrument that was moved before them, added to the content."""
    if "test" not in data.split:
        return
    test = data.part("test")
    moved = moved_between(settled(calibration.states["after"], test), test)
    content["mistakes"] += mistake_facts(moved)
    odd = () if moved else held_out_outliers(calibration, test)
    content["outliers"] += outlier_facts(odd)
    content["warnings"] = [*(each.text for each in moved), *content["warnings"], *held_out_notes(odd)]


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
        content["warnings"] += () if calibration.mistakes else halves_warnings(found)
    except RefusedError as error:
        content["halves"] = halves_facts(str(error))
    return found


def decided(
    content: dict[str, Any],
    calibration: Calibration,
    data: Dataset,
    errors: Mapping[str, Mapping[str, Errors]],
    experiment: Experiment,
    test: Array | None = None,
) -> Calibration:
    """The calibration with the decision about it, which is added to the content: by all that is already there."""
    decision = decide_run(
        calibration,
        data,
        errors,
        content,
        experiment.options,
        config.tolerance_of(experiment.file),
        area_of(experiment),
        test,
    )
    content["decision"] = decision.facts
    return with_decision(calibration, decision)


def area_of(experiment: Experiment) -> tuple[Array, Array] | None:
    """The working area, where the file says one."""
    if not experiment.file.plan.area:
        return None
    return config.area_of(experiment.file, experiment.document, experiment.robot)
