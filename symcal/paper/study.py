"""The study from beginning to end, in memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from symcal.calibration.calibrate import one_thread
from symcal.config.conversion import ExperimentFile
from symcal.documents.document import Document
from symcal.errors import InputError
from symcal.fit.estimation import Options
from symcal.model.model import Model
from symcal.paper.gauge import gauge
from symcal.paper.plans import certified_plan, random_plans, reading_of, study_plans, weights_of
from symcal.paper.readings import readings
from symcal.paper.repetitions import repeat
from symcal.paper.results import Study
from symcal.paper.setting import study_setting
from symcal.paper.simulation_1 import simulation_1
from symcal.paper.simulation_2 import published_errors, simulation_2
from symcal.planning.drive_plan import plan_generator

Progress = Callable[[str], None]


def run_study(
    file: ExperimentFile,
    document: Document,
    model: Model,
    options: Options,
    seed: int,
    progress: Progress = lambda _: None,
) -> Study:
    """Plans, both simulations, repetitions, readings and gauge; the same seed gives the same study.

    Raises:
        RefusedError: the experiment is not one that the study can be made of (see `study_setting`).
        InputError: it has no section `study`.
    """
    if file.study is None:
        raise InputError("this experiment has no section 'study'", file=document.path, key="study")
    with one_thread():
        return _run(file, document, model, options, seed, progress)


def _run(
    file: ExperimentFile, document: Document, model: Model, options: Options, seed: int, progress: Progress
) -> Study:
    assert file.study is not None
    study = file.study.sized()
    seconds: dict[str, float] = {}

    @contextmanager
    def stage(name: str, words: str) -> Iterator[None]:
        progress(words)
        began = time.perf_counter()
        yield
        seconds[name] = time.perf_counter() - began

    for_setting, for_random, for_plans, for_first, for_second, for_repeat, for_readings, for_gauge = (
        np.random.default_rng(seed).spawn(8)
    )
    with stage("plans", "planning: certified"):
        # the generator and the order of its uses are those of every command that plans: the same seed, the same plan
        for_certified = plan_generator(seed)
        setting, problem = study_setting(file, document, model, study, for_certified, for_setting)
        certified = certified_plan(problem, file.plan, for_certified, progress)
        random = random_plans(setting, study.random_plans, for_random)
        plans = study_plans(setting, certified, random, study, for_plans, progress)
    with stage("simulation_1", "Simulation I"):
        first = simulation_1(setting, plans, study.simulation_1, for_first)
    with stage("simulation_2", "Simulation II"):
        second, data, test = simulation_2(setting, plans, options, study.simulation_1, for_second)
    with stage("repetitions", f"Simulation II, {study.repetitions} times"):
        repetitions = repeat(setting, plans, study.repetitions, for_repeat)
    with stage("gauge", "unseen directions"):
        unseen = gauge(setting, plans["certified"], study.unregularised, study.simulation_1, for_gauge)
    with stage("readings", "the paper's fitness in its several readings"):
        weights, main = weights_of(study.weights), reading_of(study)
        proof = certified[0].plan.certificate
        ways = readings(setting, plans, random, weights, main, study.search, proof, for_readings)
    return Study(
        setting=setting,
        problem=problem,
        certified=certified[0],
        plans=plans,
        random=random,
        readings=ways,
        simulation_1=first,
        simulation_2=second,
        data=data,
        test=test,
        repetitions=repetitions,
        gauge=unseen,
        published_true=published_errors(setting),
        seconds=seconds,
    )
