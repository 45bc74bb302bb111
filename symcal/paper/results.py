"""What the study found, as frozen arrays: everything that its figures, tables and report show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Statistics, statistics
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Fit
from symcal.fit.identifiability import Identifiability
from symcal.instruments.noise import Noise
from symcal.kernels import BatchFunction
from symcal.model.model import Model
from symcal.planning.camera_view import CameraView
from symcal.planning.certificate import Certificate
from symcal.planning.drive_plan import Planned
from symcal.planning.fitness import Reading
from symcal.planning.information import PoseInformation
from symcal.planning.ordering import Tour
from symcal.planning.path import Path
from symcal.planning.plan_problem import PlanProblem
from symcal.planning.region import Accuracy
from symcal.planning.skeleton import Skeleton
from symcal.planning.worst_pose import FeasibleSet

Array = NDArray[np.float64]

PLAN_NAMES = ("paper_ga", "ga", "certified", "random")
"""The paper's genetic algorithm with the paper's fitness; the same with a sound one; the certified plan; a random
one."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What all parts of the study share.

    predict: (q, x, setup) -> position of the measured point, shape (N, 3), mm. truth: errors of the simulated robot
    (Table III), shape (n,), mm and rad. sigma: of the noise per axis, mm. count: N, poses of every plan.
    test_poses: shape (T, dof). test_positions, nominal_positions: where the true and the nominal robot are there,
    shape (T, 3), mm.
    info, where, accuracy: information of a pose, the feasible set, and the predicted error over the test poses, all at
    nominal. view, arm: camera, target and nominal arm. margin_px, incidence: within which a pose counts as visible, px
    and rad. start: the initial pose, shape (dof,). speeds: shape (dof,).
    """

    model: Model
    predict: BatchFunction
    truth: Array
    noise: Noise
    sigma: float
    count: int
    test_poses: Array
    test_positions: Array
    nominal_positions: Array
    info: PoseInformation
    where: FeasibleSet
    accuracy: Accuracy
    view: CameraView
    margin_px: float
    incidence: float
    arm: Skeleton
    start: Array
    speeds: Array

    @property
    def before_raw(self) -> Array:
        """Position errors of the nominal robot at the test poses against truth, shape (T,), mm."""
        return np.asarray(np.linalg.norm(self.nominal_positions - self.test_positions, axis=1))


@dataclass(frozen=True, slots=True)
class StudyPlan:
    """One plan, driven as a tour from the initial pose.

    title: in words. poses: in the order of the tour, shape (N, dof). positions: nominal tool positions at them, shape
    (N, 3), mm. trace: the tool on the way from the initial pose, shape (K, 3), mm.
    expected_rms_mm: predicted rms error over the test poses. beats_random: share of the random plans
    whose prediction is larger. condition_number: of its scaled identifiable Jacobian.
    visible: share of its poses at which the camera sees the whole target.
    history: best fitness after each generation, the start first; None if no genetic algorithm made it.
    """

    name: str
    title: str
    poses: Array
    tour: Tour
    motion: Path
    positions: Array
    trace: Array
    certificate: Certificate
    expected_rms_mm: float
    beats_random: float
    condition_number: float
    visible: float
    history: Array | None
    seconds: float


@dataclass(frozen=True, slots=True)
class RandomPlanErrors:
    """Random plans of as many poses, uniform over the working area.

    poses: shape (P, N, dof). expected_rms_mm: predicted rms error over the test poses, shape (P,).
    """

    poses: Array
    expected_rms_mm: Array

    def beaten_by(self, expected_rms_mm: float) -> float:
        """Share of them whose prediction is larger."""
        return float(np.mean(self.expected_rms_mm > expected_rms_mm))


@dataclass(frozen=True, slots=True)
class ReadingResult:
    """The paper's fitness in one reading: the best plan of the genetic algorithm by it, and what that plan is worth.

    reading: None for the condition number in coordinates in which the area's mean information is the identity.
    text: the reading in words. main: the one behind the plan `paper_ga`.
    scores: the value of every plan of the study by this fitness, by name. distinct: poses of its plan that differ by
    more than a hundredth of the working area.
    """

    key: str
    text: str
    reading: Reading | None
    main: bool
    poses: Array
    history: Array
    expected_rms_mm: float
    d_efficiency_lower_bound: float
    beats_random: float
    distinct: int
    scores: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Recovery:
    """Simulation I on one plan: errors found from exact positions.

    position_error_mm: mean over the training poses, the start first, shape (iterations + 1,). found: errors in
    canonical form, shape (n,). mirrored: the solver ended at the mirror root.
    """

    plan: str
    iterations: int
    position_error_mm: Array
    damping: Array
    found: Array
    mirrored: bool
    message: str


@dataclass(frozen=True, slots=True)
class SimulationOne:
    """Simulation I on the plan that the config names, on all plans, and on many random plans.

    draws: per random plan (iterations, last mean position error in mm, largest deviation from truth in mm or rad),
    shape (D, 3). mirrors: how many of them ended at the mirror root before the canonical form was taken.
    """

    main: Recovery
    plans: Mapping[str, Recovery]
    draws: Array
    mirrors: int


@dataclass(frozen=True, slots=True)
class Identified:
    """Simulation II on one plan, one draw of the noise.

    calibration: with plausible sizes as prior. unregularised: all parameters free, by the paper's algorithm, as errors,
    shape (n,).
    The rest are position errors at the test poses, shape (T,), mm: `measured` against noisy test data, `true` against
    truth.
    """

    plan: str
    calibration: Calibration
    unregularised: Array
    before_measured: Array
    after_measured: Array
    after_true: Array
    unregularised_true: Array
    cramer_rao_mm: float

    @property
    def fit(self) -> Fit:
        return self.calibration.after


@dataclass(frozen=True, slots=True)
class Repetitions:
    """Simulation II again and again: new noise on training and test data each time, and a new random plan.

    names: the plans, then `new_random` (another plan each time). Per plan and repetition, shape (R,): mean and max
    against noisy test data, and mean, rms and max against truth, mm. cramer_rao_mm: lower bound of the rms error over
    the test poses at the true parameters, shape (R,) (constant for the fixed plans).
    errors: identified parameters of the fixed plans, shape (R, n).
    """

    names: tuple[str, ...]
    measured_mean: Mapping[str, Array]
    measured_max: Mapping[str, Array]
    true_mean: Mapping[str, Array]
    true_rms: Mapping[str, Array]
    true_max: Mapping[str, Array]
    cramer_rao_mm: Mapping[str, Array]
    errors: Mapping[str, Array]
    iterations: int

    @property
    def count(self) -> int:
        return len(self.true_rms[self.names[0]])

    def over_cramer_rao(self, name: str) -> float:
        """Root mean square of the rms errors over the repetitions, relative to that of the bound."""
        square = np.mean(self.true_rms[name] ** 2) / np.mean(self.cramer_rao_mm[name] ** 2)
        return float(np.sqrt(square))

    def wins(self, name: str, other: str = "new_random") -> float:
        """Share of the repetitions in which a plan's rms error against truth is smaller than another's."""
        return float(np.mean(self.true_rms[name] < self.true_rms[other]))


@dataclass(frozen=True, slots=True)
class Gauge:
    """What positions of one point cannot tell: the spectrum, the unseen directions, and what two methods make of
    them over repeated noise on one plan.

    seen: of the nominal robot. at_truth: of the true one. target: parameters seen with the three target points.
    spread: per method (`unregularised`, `posterior`) the identified errors, shape (R, n), mm and rad.
    true_rms: per method the rms error against truth over the test poses, shape (R,), mm.
    """

    plan: str
    seen: Identifiability
    at_truth: Identifiability
    target: Identifiability
    spread: Mapping[str, Array]
    true_rms: Mapping[str, Array]


@dataclass(frozen=True, slots=True)
class Study:
    """The whole study.

    problem, certified: the planning problem of the experiment, and its certified plan with all that a plan says.
    data: what was measured in Simulation II, by plan. test: the noisy measurements of the test poses. published_true:
    errors against truth, shape (T,), mm, at our test poses, of the robots of the paper's Tables V (`optimal`) and VI
    (`random`). seconds: wall time of each part.
    """

    setting: Setting
    problem: PlanProblem
    certified: Planned
    plans: Mapping[str, StudyPlan]
    random: RandomPlanErrors
    readings: tuple[ReadingResult, ...]
    simulation_1: SimulationOne
    simulation_2: Mapping[str, Identified]
    data: Mapping[str, Dataset]
    test: Dataset
    repetitions: Repetitions
    gauge: Gauge
    published_true: Mapping[str, Array]
    seconds: Mapping[str, float]

    @property
    def before_raw(self) -> Statistics:
        """Errors of the nominal robot at the test poses against truth."""
        return statistics(self.setting.before_raw)
