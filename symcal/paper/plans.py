"""The four plans that are compared, each as a tour of straight lines from the initial pose."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from symcal.config.plan import PlanConfig
from symcal.config.study import StudyConfig, WeightsConfig
from symcal.outputs.side_by_side import side_by_side
from symcal.paper.readings import evolve, main_fitness
from symcal.paper.results import PLAN_NAMES, RandomPlanErrors, Setting, StudyPlan
from symcal.paper.setting import positions
from symcal.planning.certificate import Certificate, certify
from symcal.planning.constraints import feasible
from symcal.planning.criteria import criterion
from symcal.planning.drive_plan import Planned, find_plan
from symcal.planning.fitness import PlanFunction, Reading, Weights, sound_fitness
from symcal.planning.ordering import shortest_tour, tour_of
from symcal.planning.path import plan_path
from symcal.planning.plan_problem import PlanProblem
from symcal.planning.visibility import visibility

Array = NDArray[np.float64]
Progress = Callable[[str], None]

TITLES = {
    "paper_ga": "genetic algorithm, the paper's fitness",
    "ga": "genetic algorithm, information as fitness",
    "certified": "certified",
    "random": "random",
}


def random_plans(setting: Setting, count: int, rng: np.random.Generator) -> RandomPlanErrors:
    """Random plans and what each predicts for the test poses."""
    info = setting.info
    poses = info.area.sample(rng, count * setting.count)
    poses = poses.reshape(count, setting.count, -1)
    posterior = info.posterior(poses)
    variance = np.sum(posterior * (setting.accuracy.everywhere @ posterior), axis=(1, 2))
    return RandomPlanErrors(poses, np.sqrt(variance))


def certified_plan(
    problem: PlanProblem, wanted: PlanConfig, rng: np.random.Generator, progress: Progress = lambda _: None
) -> tuple[Planned, float]:
    """The plan of the experiment's section `plan`, by the method `certified`; and the seconds that it took."""
    began = time.perf_counter()
    planned = find_plan(problem, wanted.model_copy(update={"method": "certified"}), rng, progress)
    return planned, time.perf_counter() - began


def study_plans(
    setting: Setting,
    certified: tuple[Planned, float],
    random: RandomPlanErrors,
    study: StudyConfig,
    rng: np.random.Generator,
    progress: Progress = lambda _: None,
) -> Mapping[str, StudyPlan]:
    """Make the plans: paper_ga, ga, certified and random, in the order of `PLAN_NAMES`.

    Args:
        random: plans that all predictions are compared with; the plan `random` is not among them.
    """
    for_paper, for_sound, for_random, for_certificates = rng.spawn(4)
    made: dict[str, tuple[Array, Array | None, float]] = {}
    paper = main_fitness(setting, weights_of(study.weights), reading_of(study))
    sound = sound_fitness(setting.info, criterion("D"), view=setting.view, weights=weights_of(study.sound_weights))
    names = ("paper_ga", "ga")
    progress("planning: " + " and ".join(TITLES[name] for name in names))
    jobs = zip((paper, sound), (for_paper, for_sound), strict=True)
    searched = side_by_side([partial(_evolved, setting, fitness, study, own) for fitness, own in jobs])
    made |= dict(zip(names, searched, strict=True))
    made["certified"] = certified[0].plan.poses, None, certified[1]
    made["random"] = setting.info.area.sample(for_random, setting.count), None, 0.0
    proof = certified[0].plan.certificate
    progress("ordering the plans")
    return {name: _study_plan(setting, name, *made[name], random, proof, for_certificates) for name in PLAN_NAMES}


def _evolved(
    setting: Setting, fitness: PlanFunction, study: StudyConfig, rng: np.random.Generator
) -> tuple[Array, Array, float]:
    """The plan, its history, and the seconds of computing that it took: another search runs beside it."""
    began = time.thread_time()
    poses, history = evolve(setting, fitness, study.search, study.search.generations, rng)
    return poses, history, time.thread_time() - began


def weights_of(config: WeightsConfig) -> Weights:
    return Weights(config.observability, config.angle, config.area)


def reading_of(study: StudyConfig) -> Reading:
    r = study.reading
    return Reading(r.conditioning, r.rows, r.point, r.over)


def _study_plan(
    setting: Setting,
    name: str,
    poses: Array,
    history: Array | None,
    seconds: float,
    random: RandomPlanErrors,
    proof: Certificate,
    rng: np.random.Generator,
) -> StudyPlan:
    info, robot = setting.info, setting.model.robot
    poses = poses[shortest_tour(poses, setting.start, setting.speeds).order]
    tour = tour_of(range(len(poses)), poses, setting.start, setting.speeds)
    motion = plan_path(setting.arm, poses, tour, setting.start, setting.speeds, (robot.lower, robot.upper))
    way = np.concatenate([segment.waypoints for segment in motion.segments])
    total = info.total(poses)
    expected = setting.accuracy.mean_rms(info.posterior(poses))
    same = name == "certified"
    return StudyPlan(
        name=name,
        title=TITLES[name],
        poses=poses,
        tour=tour,
        motion=motion,
        positions=positions(setting, poses, np.zeros(len(setting.truth))),
        trace=setting.arm.motion(way)[0],
        certificate=proof
        if same
        else certify(info, poses, criterion("D"), setting.where, rng, designs=(proof.design, proof.design)),
        expected_rms_mm=expected,
        beats_random=random.beaten_by(expected),
        condition_number=float(np.sqrt(np.linalg.cond(total))),
        visible=float(np.mean(camera_sees(setting)(poses))),
        history=history,
        seconds=seconds,
    )


def camera_sees(setting: Setting) -> Callable[[Array], NDArray[np.bool_]]:
    """(N, dof) -> (N,): at which poses the camera sees the whole target well enough."""
    return feasible(visibility(setting.view, margin=setting.margin_px, incidence=setting.incidence))
