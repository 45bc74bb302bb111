"""Whether the model of an identification explains its training data, and if not, what the residuals follow.

Lack of fit says whether something is missing (`symcal.calibration.lack_of_fit`), score tests say what
(`symcal.fit.score`, `symcal.calibration.patterns`). Of patterns that resemble each other the least probable one is
taken into the model first, and the others are tested again beside it: what is left are the causes. p-values are
corrected for their number ([Holm1979]).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.lack_of_fit import LackOfFit, lack_of_fit
from symcal.calibration.patterns import Kind, Pattern, drifts, joint_patterns, joint_rows
from symcal.calibration.thinned import thinned
from symcal.data.dataset import Dataset
from symcal.fit.difference import holm
from symcal.fit.estimation import Fit, Options, variance_model
from symcal.fit.pose_rows import PoseRows, pose_rows
from symcal.fit.rank_tests import rank_correlation
from symcal.fit.residual_rows import rows_of
from symcal.fit.score import Score, score_of
from symcal.fit.variances import VarianceModel
from symcal.model.measurement import Group
from symcal.placing.placement import stated

Array = NDArray[np.float64]

LEVEL = 0.01
"""Corrected probability below which a pattern counts: of good data, one set in a hundred has one."""
_ROUNDING = 1e-6  # relative, of a weight: far more than kernels of other instructions make of it
_CAUSES = 6  # patterns that are taken into the model one after the other
_STEADY = 0.02  # of its mean: a reach that varies by less is none


@dataclass(frozen=True, slots=True)
class Found:
    """A pattern that was tested.

    p: of this test alone; corrected: for the number of all. beside: beside the causes, corrected; of a cause, when it
    was found. weight: what ranks it. unit: of amplitude, rad or mm of the joint, or that of a reading that drifts.
    amplitude: of a wave; half of the play; of a drift, over the whole run; of others, half of what the joint moves by
    over the poses. at_tool: what a joint's amplitude is at the tool, rms over the poses, mm. rms, of: of what the
    pattern explains of the residuals of its noise group, and of these, in the group's unit, by reading.
    """

    kind: Kind
    name: str
    p: float
    corrected: float
    joint: int = 0
    k: int = 0
    weight: float = 0.0
    beside: float = 1.0
    amplitude: float | None = None
    unit: str = ""
    at_tool: float | None = None
    rms: float | None = None
    of: float | None = None
    of_unit: str = ""
    correlation: float | None = None
    stated: bool = False


@dataclass(frozen=True, slots=True)
class ModelCheck:
    """What was found; made by `model_check`.

    lack: of every noise group. tests: all of them. causes: significant ones that explain the others, foremost first.
    untested: joints that have no zero in the robot file. along: residuals along the motion of each joint, shape (N,
    dof), in ``unit`` of the group ``group``; NaN where it was not read. explained: what a wave that is a cause explains
    of them, by joint, shape (N,).
    """

    lack: tuple[LackOfFit, ...]
    tests: tuple[Found, ...] = ()
    causes: tuple[Found, ...] = ()
    untested: tuple[int, ...] = ()
    group: str = ""
    unit: str = ""
    q: Array = field(default_factory=lambda: np.zeros((0, 0)))
    along: Array = field(default_factory=lambda: np.zeros((0, 0)))
    explained: Mapping[int, Array] = field(default_factory=dict)

    @property
    def lacking(self) -> tuple[LackOfFit, ...]:
        """Noise groups whose residuals are larger than they should be."""
        judged = sum(each.p is not None for each in self.lack)
        return tuple(each for each in self.lack if each.p is not None and each.p * judged < LEVEL)


def lacks_physics(check: ModelCheck) -> bool:
    """Whether residuals follow something that the model does not have: large ones need not be slips then."""
    return bool(check.causes)


def model_check(calibration: Calibration, data: Dataset, options: Options) -> ModelCheck:
    """Check the model of an identification against the data that it was made from.

    Args:
        data: all of them, in the order of the file; of very many a few thousand training poses are looked at, evenly
            spread. options: of the identification.
    """
    calibration, data = thinned(calibration, data)
    model, after, train = calibration.model, calibration.after, data.part("train")
    unplaced = calibration.before.unplaced
    rows = rows_of(model.measurement, train, calibration.setup, model.residuals, set(unplaced) - set(after.free))
    at = stated(model, calibration.setup)
    system = variance_model(rows, after.free, options, prior_mean=at)
    own = pose_rows(system.system.rows, after.x, system.spread(after.variances))
    joints = joint_rows(model.robot, model.parameters.names, own)
    score = _score(system, own, after, joints)
    groups = model.measurement.groups
    steps = np.where([joint.revolute for joint in model.robot.joints], 1.0, 1e-3)
    check = ModelCheck(
        lack=lack_of_fit(after, score, tuple(g.name for g in groups), train.q * steps),
        untested=tuple(i for i in range(1, model.robot.dof + 1) if not joints[:, i - 1].any()),
        group=groups[0].name,
        unit=groups[0].unit,
        q=train.q,
    )
    if score is None:
        return check
    patterns = [*joint_patterns(model.robot, train, data, own, joints), *drifts(own, data)]
    search = _Search(
        calibration, train, score, patterns, joints, _residuals(system, after), _levers(calibration, train.q)
    )
    tests, causes, explained = search.found()
    return replace(check, tests=tests, causes=causes, along=search.along(own.r), explained=explained)


def _score(system: VarianceModel, own: PoseRows, after: Fit, joints: Array) -> Score | None:
    whole = system.system
    known = whole.known_rows(after.x, after.every_factor)
    return score_of(own, own.jacobian[:, whole.index] * whole.scales, known, joints)


def _residuals(system: VarianceModel, after: Fit) -> dict[int, tuple[float, float]]:
    """By noise group the rms of its residuals by reading, and of these over their standard deviations, summed."""
    rows = system.system.rows
    r: Array = rows.residual(after.x)
    share = int(rows.seen.sum()) / after.equations  # of the readings of the fit
    if rows.mixing is not None:  # back from principal axes
        whole = np.where(rows.seen[:, :, None], rows.mixing, np.eye(r.shape[1]))
        r = np.asarray(np.linalg.solve(whole, r[:, :, None])[:, :, 0], dtype=np.float64)
    out = {}
    for number, group in enumerate(rows.measurement.groups):
        columns = list(group.columns)
        count = max(int(rows.seen[:, columns].sum()) / group.block, 1.0)
        squares, _ = after.by_group.get(group.name, (0.0, 0.0))
        out[number] = float(np.sqrt(np.sum(r[:, columns] ** 2) / count)), float(np.sqrt(share * squares))
    return out


def _levers(calibration: Calibration, q: Array) -> Array:
    """Speed of the tool by each joint's coordinate, shape (N, dof), mm/rad and mm/mm."""
    model, fit = calibration.model, calibration.after
    _, jacobian, _ = model.flange(q, fit.x, fit.setup.vector[:24])
    rates = np.array([joint.ratio for joint in model.robot.joints])
    return np.asarray(np.linalg.norm(jacobian[:, :3], axis=1) / np.abs(rates))


def foremost(found: Sequence[Found]) -> Found:
    """Of largest weight; of those that weigh the same but for rounding, the last in the order of the patterns.

    Gravity at a joint that turns about a level axis is a wave of it, once to a turn: one and the same column. Gravity,
    which comes after the waves, is told then, since it says why.
    """
    largest = max(each.weight for each in found)
    return [each for each in found if each.weight >= largest - _ROUNDING * abs(largest)][-1]


@dataclass(frozen=True, slots=True)
class _Search:
    """The tests under way."""

    calibration: Calibration
    data: Dataset
    score: Score
    patterns: Sequence[Pattern]
    joints: Array
    residuals: Mapping[int, tuple[float, float]]
    levers: Array

    def found(self) -> tuple[tuple[Found, ...], tuple[Found, ...], dict[int, Array]]:
        """All tests, the causes, and what waves among these explain along their joints."""
        alone = self._all(self.score)
        tests = dict(zip(alone, holm(np.array([each.p for each in alone.values()])).tolist(), strict=True))
        found = {name: replace(alone[name], corrected=p, beside=p) for name, p in tests.items()}
        score, causes, explained = self.score, list[Found](), dict[int, Array]()
        left = {pattern.name: pattern for pattern in self.patterns if pattern.name in found}
        now = found
        while len(causes) < _CAUSES:
            significant = [now[name] for name in left if now[name].beside < LEVEL]
            if not significant:
                break
            best = foremost(significant)
            pattern = left.pop(best.name)
            tested = score.test(pattern.columns)
            if best.kind == "harmonic" and tested is not None:
                before = explained.get(best.joint, 0.0)
                explained[best.joint] = before + self.along(tested.pattern)[:, best.joint - 1]
            causes.append(best)
            found[best.name] = best
            score = score.with_columns(pattern.columns)
            again = self._all(score)
            rest = [name for name in found if name in again and name not in {each.name for each in causes}]
            corrected = holm(np.array([again[name].p for name in rest])).tolist()
            now = {name: replace(again[name], beside=p) for name, p in zip(rest, corrected, strict=True)}
            found |= {name: replace(found[name], beside=each.beside) for name, each in now.items()}
            left = {name: pattern for name, pattern in left.items() if name in now}
        causes += [
            now[name]
            for name in now
            if now[name].kind in ("neighbours", "reach") and now[name].beside < LEVEL and found[name].corrected < LEVEL
        ]
        return tuple(found.values()), tuple(causes), explained

    def _all(self, score: Score) -> dict[str, Found]:
        found = [self._tested(score, pattern) for pattern in self.patterns]
        found += [self._neighbours(score, i) for i in range(len(score.rows.displacements))]
        found.append(self._reach(score))
        return {each.name: each for each in found if each is not None}

    def _tested(self, score: Score, pattern: Pattern) -> Found | None:
        tested = score.test(pattern.columns)
        if tested is None:
            return None
        group, size = self._foremost(tested.pattern)
        amplitude = _amplitude(pattern, tested.coefficients)
        lever = float(np.sqrt(np.mean(self.levers[:, pattern.joint - 1] ** 2))) if pattern.joint else None
        residual, whole = self.residuals[group]
        return Found(
            pattern.kind,
            pattern.name,
            tested.p,
            tested.p,
            pattern.joint,
            pattern.k,
            weight=tested.weight,
            amplitude=amplitude,
            unit=pattern.unit,
            at_tool=None if lever is None else amplitude * lever,
            rms=residual * min(size / whole, 1.0) if whole else None,
            of=residual,
            of_unit=self._groups[group].unit,
            stated=pattern.stated,
        )

    def _foremost(self, pattern: Array) -> tuple[int, float]:
        """The noise group that a pattern explains most of, and how large it is there, in standard deviations."""
        squares = np.bincount(self.score.rows.group, pattern**2)
        group = int(np.argmax(squares))
        return group, float(np.sqrt(squares[group]))

    def _neighbours(self, score: Score, number: int) -> Found | None:
        moved = score.rows.displacements[number]
        tested = score.neighbours(moved)
        if tested is None:
            return None
        correlation, p = tested
        name = f"the neighbours in the order of the measurements ({moved.what})"
        return Found("neighbours", name, p, p, correlation=correlation)

    def _reach(self, score: Score) -> Found | None:
        turning = [i for i, joint in enumerate(self.calibration.model.robot.joints) if joint.revolute]
        if not turning:
            return None
        squares, count = score.sizes()
        seen = np.flatnonzero(count)
        reach = self.levers[seen, turning[0]]
        sizes = scipy.special.chdtr(count[seen], squares[seen])
        if len(seen) <= 3 or np.std(reach) < _STEADY * np.mean(reach) or np.ptp(sizes) == 0:
            return None
        correlation, p = rank_correlation(reach, sizes)
        name = f"the distance from the axis of joint {turning[0] + 1}, in size"
        return Found("reach", name, p, p, correlation=correlation)

    @property
    def _groups(self) -> Sequence[Group]:
        return self.calibration.model.measurement.groups

    def along(self, values: Array) -> Array:
        """Whitened rows, shape (k,), as components along what each joint moves of the first noise group's readings,
        in its unit, shape (N, dof); NaN where it was not read."""
        rows = self.score.rows
        own = rows.group == 0
        size, whole = self.residuals[0]
        count = max(float(np.sum(own)), 1.0)
        sigma = size / whole * np.sqrt(count / self._groups[0].block) if whole else 1.0
        joints = np.where(own[:, None], self.joints, 0.0)
        norms = np.sqrt(self._by_pose(joints**2))
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(sigma * self._by_pose(joints * values[:, None]) / norms)

    def _by_pose(self, values: Array) -> Array:
        pose, count = self.score.rows.pose, len(self.data)
        return np.column_stack([np.bincount(pose, column, minlength=count) for column in values.T])


def _amplitude(pattern: Pattern, coefficients: Array) -> float:
    if pattern.kind in ("harmonic", "drift", "approach") or pattern.motion is None:
        return float(np.linalg.norm(coefficients))
    return float(np.ptp(pattern.motion @ coefficients) / 2)
