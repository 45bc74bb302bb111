"""The shipped study in its small version, made once."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from symcal.runs.load import Experiment, load
from symcal.runs.study import StudyOutcome, study_experiment

CONFIG = Path(__file__).resolve().parents[2] / "configs" / "handling_robot.yaml"

SMALL = (
    "study.quick=true",
    "study.search.population=40",
    "study.repetitions=3000",
    "study.random_plans=3000",
    "study.simulation_1.draws=400",
    "outputs.figures=false",  # test_paper_report.py draws them
    "outputs.report=false",
)


@cache
def experiment() -> Experiment:
    return load(CONFIG, overrides=SMALL)


@cache
def outcome() -> StudyOutcome:
    return study_experiment(experiment())
