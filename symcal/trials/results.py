"""What a finished study says, as one plain dictionary (results.json)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.calibration import results
from symcal.trials.description import Cell, Description
from symcal.trials.identify import one_by_one
from symcal.trials.load import Study
from symcal.trials.machine import Machine
from symcal.trials.need import answers, label
from symcal.trials.setting import setting_of
from symcal.trials.statistics import CONFIDENCE, Question, cell_facts, judged_column, pooled
from symcal.trials.store import Store

_CHANCE = 1e-3
"""Of a warning that intervals do not hold, where all of a study's do."""


def study_content(study: Study, description: Description, store: Store, machine: Machine) -> dict[str, Any]:
    """Everything that the report says, with its numbers."""
    file, experiment = study.file, study.experiment
    judged = file.judge
    tolerance = None if judged.tolerance is None else judged.tolerance * experiment.file.units.factor("mm")
    question = Question(judged_column(judged.of, judged.against), judged.share, tolerance)
    cells = []
    for cell in description.cells:
        names = setting_of(description, cell.task).named
        facts = cell_facts(store, cell.number, question, description.repetitions, names)
        cells.append({"cell": cell.number, "shown": dict(cell.shown), "noise": _noise(description, cell), **facts})
    asked = {
        "of": judged.of,
        "against": judged.against,
        "share": judged.share,
        "tolerance_mm": tolerance,
        "test_poses": len(description.test),
        "confidence": CONFIDENCE,
    }
    settings = {cell.task: setting_of(description, cell.task) for cell in description.cells}
    slow = [one_by_one(description, settings[task]) for task in sorted(settings)]
    content = {
        **results.header(file.name, file.title, description.seed, study.inputs, study.document.path.parent.resolve()),
        "kind": "study",
        "machine": {**machine.facts(), "portable": description.portable},
        "robot": results.robot_facts(experiment.robot),
        "experiment": experiment.file.title or experiment.file.name,
        "units": experiment.file.units.model_dump(),
        "repetitions": description.repetitions,
        "trials": description.trials,
        "varied": list(study.varied),
        "question": asked,
        "identification": {
            "noise": file.identification.noise,
            "sizes": file.identification.sizes,
            "path": "at once" if not any(slow) else "one by one",
            "because": next((reason for reason in slow if reason), ""),
        },
        "cells": cells,
        "answers": answers(cells, study.varied, asked),
    }
    content["warnings"] = _warnings(content)
    return content


def _noise(description: Description, cell: Cell) -> Mapping[str, Any]:
    """Standard deviation of every group of readings, mm, rad or px, and the law."""
    setting = setting_of(description, cell.task)
    return {"distribution": cell.noise.distribution, "sigma": setting.sigma(cell)}


def _warnings(content: Mapping[str, Any]) -> list[str]:
    """Trials that do not count, and intervals that do not hold what they say."""
    found = []
    for cell in content["cells"]:
        lost = cell["trials"]["failed"] + cell["trials"]["refused"]
        if lost:
            why = "; ".join(f"{each['reason']} ({each['trials']})" for each in cell["reasons"])
            found.append(
                f"{label(cell, content['varied'])}: {lost} of {content['repetitions']} trials count as errors larger "
                f"than any, because they failed or were refused: {why}"
            )
        coverage = cell["coverage"]
        held = None if coverage is None else pooled([coverage["position"]])
        if held is not None and held.below(CONFIDENCE) < _CHANCE / len(content["cells"]):
            found.append(
                f"{label(cell, content['varied'])}: intervals of positions that should hold the truth in 95 % of the "
                f"trials hold it in {100 * held.value:.1f} %"
            )
    if content["machine"]["portable"]:
        found.append(
            "computed with the one level of kernels that every machine has: linear algebra and elementary functions "
            "are still those of each machine, and processors of another kind may differ in the last bits"
        )
    return found
