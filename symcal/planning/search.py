"""Plan the poses: choose a method, certify what it found, and put random plans beside it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import one_thread
from symcal.errors import InputError, RefusedError
from symcal.notebook import html_table
from symcal.planning.accuracy_forecast.prediction import Prediction, predict
from symcal.planning.accuracy_forecast.random_plans import RandomPlans, random_plans
from symcal.planning.area import Feasible, WorkingArea
from symcal.planning.bias_criterion import NAME, integrated_error
from symcal.planning.certificate import Certificate, certify
from symcal.planning.criteria import criterion as criterion_by_name
from symcal.planning.information import PoseInformation
from symcal.planning.methods import METHODS, Method, SearchTask, fewest_poses, improve
from symcal.planning.optimal_design import TOLERANCE
from symcal.planning.picture import plan_sketch
from symcal.planning.region import TaskRegion, area_region, region_accuracy
from symcal.planning.worst_pose import FeasibleSet, feasible_set
from symcal.words import number, plural, rounded_down

Array = NDArray[np.float64]

SAMPLE = 5000
"""Poses that stand for the feasible set: the pool of an exchange, and where every search of a maximum starts."""
PROVEN_TOLERANCE = 2e-4
"""Excess at which the search for a design stops whose bounds are to be proven."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Poses to measure, and what is known about them before anything is measured.

    poses: shape (N, dof), rad and mm, required ones first. indices: their places in the candidates, None without
    candidates. rank: n, directions that the plan determines. sigmas: the noise that was assumed, by group.
    method, criterion, value: how it was found, and the criterion's value for it. history: (seconds, best value so far).
    search_seconds: wall time of search and certificate. area: the joint readings that were allowed.
    """

    poses: Array
    indices: NDArray[np.intp] | None
    rank: int
    sigmas: dict[str, float]
    method: str
    criterion: str
    value: float
    history: tuple[tuple[float, float], ...]
    search_seconds: float
    certificate: Certificate
    prediction: Prediction
    random: RandomPlans | None
    area: WorkingArea

    def __len__(self) -> int:
        return len(self.poses)

    def _repr_html_(self) -> str:
        """What the plan promises, how good it is at least, and how its poses use the joints."""
        rows = [
            ["directions that it determines", str(self.rank), ""],
            ["expected error, rms over the region", number(self.prediction.mean_pose_rms_mm), "mm"],
            ["expected error, worst pose", number(self.prediction.worst_pose_rms_mm), "mm"],
            ["of which unseen", number(self.prediction.hidden_mm), "mm"],
            ["D-efficiency, at least", rounded_down(self.certificate.d_efficiency_lower_bound), ""],
            ["G-efficiency", rounded_down(self.certificate.g_efficiency), ""],
        ]
        title = f"Plan of {plural(len(self), 'pose')}: {self.method}, criterion {self.criterion}"
        return html_table(title, ["", "", "unit"], rows, drawing=plan_sketch(self.poses, self.area))


@one_thread()
def select_poses(
    info: PoseInformation,
    count: int,
    rng: np.random.Generator,
    *,
    method: str = "certified",
    criterion: str | None = None,
    unmodelled: float = 2.0,
    region: TaskRegion | None = None,
    aligned: bool = False,
    feasible: Feasible | None = None,
    required: Array | None = None,
    candidates: Array | None = None,
    distance: float = 0.0,
    sample: int = SAMPLE,
    random: int = 200,
    prove: bool = False,
    methods: Mapping[str, Method] = METHODS,
    progress: Callable[[float, float], None] | None = None,
) -> Plan:
    """Choose poses to measure. The same generator state gives the same plan.

    Args:
        count: N, poses of the plan, required ones included. method: a name in ``methods``.
        criterion: a name in `symcal.planning.criteria.NAMES`, or J (`symcal.planning.bias_criterion`), which also
        guards
            against errors that the model lacks; when None it is J among candidates, which a real robot has measured,
            and else D. unmodelled: for J, the size of those errors per measured component in units of its noise.
        region: where accuracy is predicted; the feasible part of the working area when None. aligned: see
            `symcal.planning.region.region_accuracy`.
        feasible: which poses can be measured, beyond the working area. required: poses that the user insists on, shape
            (k, dof).
        candidates: choose among these only, each at most once, shape (K, dof); the feasible set is then finite.
        distance: smallest distance between two poses, in units of the working area (each joint's range is 1).
        sample: poses that stand for the feasible set. random: plans to compare with; 0 for none.
        methods: search methods by name; others may be added to `symcal.planning.methods.METHODS`.
        progress: told seconds and the criterion's value whenever it improves.
    Raises:
        InputError: unknown method or criterion, or a required pose that is not feasible.
        RefusedError: too few poses to determine what is identifiable, or no feasible ones.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> model = sc.build_model(robot, sc.Task.of("position"))
        >>> info = sc.pose_information(model.measurement, model.setup, {"position": 0.05})
        >>> plan = sc.select_poses(info, 20, np.random.default_rng(1), method="exchange", random=0)
        >>> plan.poses.shape
        (20, 5)
    """
    if method not in methods:
        raise InputError("no such search method", key="method", found=method, allowed=methods)
    for_set, for_region, for_criterion, for_search, for_certificate, for_random = rng.spawn(6)
    must = np.zeros((0, info.area.dof)) if required is None else np.asarray(required, dtype=np.float64)
    _check(info, must, count, feasible)
    region = area_region(info.area, for_region, feasible=feasible) if region is None else region
    accuracy = region_accuracy(info, region, aligned=aligned)
    criterion = criterion or ("D" if candidates is None else NAME)

    began = time.perf_counter()
    where = _where(info, for_set, sample, feasible, candidates)
    extended = None
    if criterion == NAME:
        asked = region.poses if candidates is None else where.sample
        extended, merit = integrated_error(info, asked, for_criterion, unmodelled)
        fixed = extended.fixed(info.prior)
    else:
        merit = criterion_by_name(criterion, poses=count, accuracy=accuracy)
        fixed = info.prior
    task = SearchTask(info, merit, count - len(must), fixed, where, must, distance, extended)
    if len(must):
        task = replace(task, fixed=task.total(must))
    history: list[tuple[float, float]] = []
    best = -np.inf

    def report(poses: Array) -> None:
        nonlocal best
        score = task.score(poses)
        if score > best:
            best = score
            history.append((time.perf_counter() - began, float(merit.value(task.total(poses)))))
            if progress is not None:
                progress(*history[-1])

    found = methods[method](task, for_search, report) if task.count else must[:0]
    report(found)
    poses = np.concatenate([must, found])
    total = info.total(poses)
    if not np.isfinite(np.linalg.cond(total)) or np.linalg.cond(total) > _SINGULAR:
        raise RefusedError(
            f"{count} poses of method '{method}' do not determine the {info.rank} identifiable directions"
        )
    tolerance = PROVEN_TOLERANCE if prove else TOLERANCE
    certificate = certify(info, poses, merit, where, for_certificate, tolerance=tolerance)
    known = (certificate.design, certificate.own_design)
    if method == "certified" and certificate.own_design is not None and task.count:
        better = improve(task, found, certificate.own_design, for_search, report)
        if better is not found:
            found, poses = better, np.concatenate([must, better])
            certificate = certify(info, poses, merit, where, for_certificate, designs=known)
    if prove:
        certificate = certify(
            info, poses, merit, where, for_certificate, designs=known, tolerance=tolerance, prove=True
        )
    seconds = time.perf_counter() - began

    compared = None
    if random:
        compared = random_plans(info, accuracy, task, certificate.logdet_upper_bound, random, for_random)
    return Plan(
        poses=poses,
        indices=None if candidates is None else _places(candidates, found),
        rank=info.rank,
        sigmas=dict(info.sigmas),
        method=method,
        criterion=criterion,
        value=float(merit.value(task.total(found))),
        history=tuple(history),
        search_seconds=seconds,
        certificate=certificate,
        prediction=predict(accuracy, info.posterior(poses), for_certificate),
        random=compared,
        area=info.area,
    )


_SINGULAR = 1e14


def _check(info: PoseInformation, required: Array, count: int, feasible: Feasible | None) -> None:
    if count < max(len(required), 1):
        raise InputError(
            f"{len(required)} poses are required, which is more than the plan has", key="poses", found=count
        )
    if count < fewest_poses(info):
        raise RefusedError(
            f"{count} poses give {count * info.components} numbers, and {info.rank} directions are identifiable: "
            f"take at least {fewest_poses(info)} poses"
        )
    robot = info.measurement.chain.robot
    inside = ((required >= robot.lower - 1e-9) & (required <= robot.upper + 1e-9)).all(axis=1)
    fits = inside if feasible is None or len(required) == 0 else inside & feasible(required)
    if not fits.all():
        which = ", ".join(str(i + 1) for i in np.flatnonzero(~fits))
        raise InputError(f"required poses that cannot be measured: {which}", key="required")


def _where(
    info: PoseInformation, rng: np.random.Generator, sample: int, feasible: Feasible | None, candidates: Array | None
) -> FeasibleSet:
    if candidates is None:
        return feasible_set(info.area, rng, sample, feasible)
    possible = candidates if feasible is None else candidates[feasible(candidates)]
    if len(possible) == 0:
        raise RefusedError(f"none of the {len(candidates)} candidates is feasible")
    return FeasibleSet(possible, None, feasible)


def _places(candidates: Array, found: Array) -> NDArray[np.intp]:
    """Places of the chosen poses in the candidates; of equal ones each is used once."""
    rest: dict[bytes, list[int]] = {}
    for i, pose in enumerate(candidates):
        rest.setdefault(pose.tobytes(), []).append(i)
    return np.array([rest[pose.tobytes()].pop(0) for pose in found], dtype=np.intp)
