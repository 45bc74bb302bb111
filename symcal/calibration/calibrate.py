"""From a model and its data to a calibrated robot: registration, baselines, identification, and the robot it leaves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from symcal.calibration.extension import Extension
from symcal.calibration.implausible import implausible
from symcal.calibration.loss_choice import LossChoice, choose_loss
from symcal.calibration.mistakes.identified import TRIED, UNTRIED, told_by_identification
from symcal.calibration.mistakes.mistake import Mistake
from symcal.calibration.mistakes.search import find_mistakes
from symcal.calibration.outliers import Outlier, StandingOut, outliers
from symcal.calibration.plausibility import CHECK, SLIPS, plausibility, unexplained
from symcal.calibration.record import measurement_record
from symcal.calibration.warnings import outlier_notes, quality, refuse_nonsense
from symcal.data.dataset import Dataset, Readings
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Fit, Options, fit, variance_model
from symcal.fit.noise import known_sigma, unknown_noise
from symcal.fit.redundancy import check_redundancy
from symcal.fit.remainder import Trial
from symcal.fit.residual_rows import rows_of
from symcal.fit.variances import VarianceModel, Variances
from symcal.model.measurement import Setup
from symcal.model.model import Model, State, build_model
from symcal.notebook import html_table
from symcal.placing.placement import Placed, from_other, placed, placed_by, stated
from symcal.placing.placement import place as place
from symcal.robot.robot import Record, Robot
from symcal.units import in_mrad
from symcal.words import number, percent

Array = NDArray[np.float64]

_BLAS = ThreadpoolController()
_NAMED = 6  # places that a warning names


@dataclass(frozen=True, slots=True)
class Calibration:
    """An identification: fits of the same training data from poor to rich, and the robot that the last one makes.

    setup: the estimated frames fitted with nominal kinematics; the fits refer to it.
    before: nominal kinematics with base and tool fitted, whether or not the task estimates them: the fair baseline.
    before_raw: nominal kinematics with the frames as given, where all are given.
    offsets: joint zeros and frames. after: all parameters that are not held. outliers: readings of the training data
        that the noise of the others does not explain. loss_choice: why which loss was taken, where that was asked.
    trial: of a smooth remainder, where one was asked for. bare: the model without it, where it was kept; what is known
        before and with joint zeros alone refers to that. extension: what was found beyond geometry, where that was
        asked for. mistakes: between robot file and measurements, that explain them far better than they are as given.
    placing: how everything was placed, and by a baseline of its own. train: the poses that it was identified from, to
        be shown.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> calibration = sc.identify(robot, data, task)
        >>> list(calibration.states)
        ['before_raw', 'before', 'offsets_only', 'after']
        >>> calibration.after.identifiability.rank
        11
    """

    model: Model
    setup: Setup
    before: State
    before_raw: State | None
    offsets: Fit
    after: Fit
    robot: Robot
    notes: tuple[str, ...] = ()
    searches: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    outliers: tuple[Outlier, ...] = ()
    loss_choice: LossChoice | None = None
    trial: Trial | None = None
    bare: Model | None = None
    extension: Extension | None = None
    mistakes: tuple[Mistake, ...] = ()
    placing: tuple[Placed, ...] = ()
    train: Dataset | None = None

    @property
    def states(self) -> dict[str, State]:
        """What is compared, by the names of the results file."""
        raw = {} if self.before_raw is None else {"before_raw": self.before_raw}
        return raw | {
            "before": self.before,
            "offsets_only": State(self.bare or self.model, self.setup, self.offsets.x, self.before.unplaced),
            "after": State(self.model, self.setup, self.after.x, self.before.unplaced),
        }

    def _repr_html_(self) -> str:
        """Errors of the parameters that were estimated, with what the data told of each; errors at the poses."""
        from symcal.calibration.picture import errors_sketch

        fit, parameters = self.after, self.model.parameters
        rows = []
        for name, sigma, learnt in zip(fit.free, fit.posterior.sigmas, fit.posterior.learnt, strict=True):
            i = parameters.names.index(name)
            unit, factor = in_mrad(parameters.units[i])
            rows.append([name, number(fit.x[i] * factor), number(sigma * factor), unit, percent(learnt)])
        title = f"{self.robot.name}: {fit.identifiability.rank} of {len(fit.free)} directions seen"
        head = ["parameter", "error", "sigma", "unit", "learnt from the data"]
        notes = ([fit.trouble] if fit.trouble else []) + list(self.notes)
        return html_table(title, head, rows, notes, errors_sketch(self.before, self.states["after"], self.train))


def calibrate(
    model: Model,
    baseline: Model | None,
    data: Dataset,
    options: Options,
    mistakes: tuple[Mistake, ...] | None = None,
) -> Calibration:
    """Calibrate with models that were built before; only poses of the `train` split are used.

    Args:
        baseline: from `baseline_model`. mistakes: as they were found in these data before; looked for when None, among
            all poses.
    Raises:
        RefusedError: too few poses, or data that the robot cannot have produced: with the mistake that explains them,
        where one does.
    """
    with one_thread():
        found = find_mistakes(model, data) if mistakes is None else mistakes
        for each in found:
            if each.fatal:
                raise RefusedError(each.text)
        searched = mistakes is None and not found
        try:
            calibration = _calibrate(model, baseline, data, options)
        except RefusedError as error:
            found = (told_by_identification(model, data) or ()) if searched else found
            if not found:
                raise
            raise RefusedError(f"{'; '.join(each.text for each in found)}. {_capital(str(error))}") from None
        notes = calibration.notes
        if searched and unexplained(data.part("train"), calibration.before, calibration.states["after"]):
            told = told_by_identification(model, data)
            found = told or ()
            if not found:
                said = UNTRIED if told is None else TRIED
                notes = tuple(f"{note} ({said})" if CHECK in note else note for note in notes)
        if found:
            notes = (*(each.text for each in found), *_without_advice(calibration))
        return replace(calibration, notes=notes, mistakes=found)


def _without_advice(calibration: Calibration) -> list[str]:
    """What is said of a calibration but for slips and columns to look at: a mistake that is named makes them."""
    slips = outlier_notes(StandingOut(calibration.outliers), calibration.after.loss)
    return [note for note in calibration.notes if note not in slips and CHECK not in note and SLIPS not in note]


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra on one thread while it lasts: matrices are small, and a second one only costs."""
    with _BLAS.limit(limits=1):
        yield


@dataclass(frozen=True, slots=True)
class _Fitted:
    """The fits of an identification, and what they were made with.

    at: what is stated of the parameters, as errors from the placed setup, shape (n,).
    """

    placed: tuple[Placed, ...]
    before: State
    raw: State | None
    offsets: Fit
    after: Fit
    at: Array
    choice: LossChoice | None


def _calibrate(model: Model, baseline: Model | None, data: Dataset, options: Options) -> Calibration:
    train = _training(model, data)
    found = _fitted(model, baseline, train, options)
    setup, before, after = found.placed[0].setup, found.before, found.after
    odd = outliers(model, train, after, found.at)
    robot = calibrated_robot(model, after)
    plausible = not implausible(robot)
    notes = (
        *found.placed[0].notes,
        *_unplaced(before.unplaced),
        *plausibility(train, before, State(model, setup, after.x) if plausible else None),
        *quality(model, train, after, odd),
    )
    searches = found.placed[0].searches
    return Calibration(
        model,
        setup,
        before,
        found.raw,
        found.offsets,
        after,
        robot,
        notes,
        searches,
        odd.listed,
        found.choice,
        placing=found.placed,
        train=train,
    )


def calibrate_near(
    model: Model, baseline: Model | None, data: Dataset, options: Options, near: Calibration
) -> Calibration:
    """Calibrate with data that are much like those of a calibration of the same model, as a fold's are.

    Places are not searched for but start where they were found before, and fits where they ended with the variances
    that they ended with; the minimum is that of these data alone. What an identification says of itself is left out:
    notes, outliers and mistakes.

    Args:
        near: of the model, without a remainder, and of ``baseline``.
    Raises:
        RefusedError: too few poses, or data that the robot cannot have produced.
    """
    with one_thread():
        train = _training(model, data)
        found = _fitted(model, baseline, train, options, near)
        refuse_nonsense(model, train, found.after)
        robot = calibrated_robot(model, found.after)
        return Calibration(
            model,
            found.placed[0].setup,
            found.before,
            found.raw,
            found.offsets,
            found.after,
            robot,
            loss_choice=found.choice,
        )


def _training(model: Model, data: Dataset) -> Dataset:
    """The poses that are identified with, of what the task asks for."""
    measured = [(each.kind, each.features) for each in data.of]
    wanted = [(o.instrument.name, o.features) for o in model.task.observations]
    if measured != wanted:
        asked = ", ".join(Readings(o.instrument, o.name, o.features).said() for o in model.task.observations)
        raise InputError(f"the data are {', '.join(each.said() for each in data.of)}, the task asks for {asked}")
    train = data.part("train")
    if len(train) == 0:
        raise RefusedError("no pose is marked for training")
    return train


def _fitted(
    model: Model, baseline: Model | None, train: Dataset, options: Options, near: Calibration | None = None
) -> _Fitted:
    free = placed_by(model, train)
    if not any(o.instrument.is_camera for o in model.task.observations):  # before it is placed its rows say nothing
        others = set(model.placement) - set(free)
        start = rows_of(model.measurement, train, model.setup, model.residuals, others)
        estimated = unknown_noise(start, known_sigma(start, options.sigma))
        check_redundancy(start, (*model.kinematic, *free), bool(estimated))
    unplaced = tuple(name for name in model.placement if name not in free)
    choice = None
    if options.loss == "auto":
        choice = _chosen(model, train, free, unplaced, replace(options, loss="linear"))
        options = replace(options, loss=choice.chosen)
    places = [placed(model, train, options, near=None if near is None else near.placing[0])]
    setup = places[0].setup
    rows = rows_of(model.measurement, train, setup, model.residuals, unplaced)
    at = stated(model, setup)
    nominal = np.zeros(len(model.parameters))
    first = None if near is None else _near(model, near.offsets, setup)
    second = None if near is None else _near(model, near.after, setup)
    offsets = fit(rows, (*model.offsets, *free), options, prior_mean=at, nested=(nominal,), near=first)
    after = fit(rows, (*model.kinematic, *free), options, prior_mean=at, nested=(nominal, offsets.x), near=second)
    before = State(model, setup, nominal, unplaced)
    raw = None if free else before
    if baseline is not None:
        own = placed_by(baseline, train)
        unplaced = tuple(name for name in baseline.placement if name not in own)
        places.append(placed(baseline, train, options, near=None if near is None else near.placing[1]))
        before = State(baseline, places[1].setup, np.zeros(len(baseline.parameters)), unplaced)
    return _Fitted(tuple(places), before, raw, offsets, after, at, choice)


def _near(model: Model, other: Fit, setup: Setup) -> tuple[Array, Variances]:
    """Where a fit from a setup starts that is much like another one."""
    return from_other(model, other.x, other.setup, setup), other.variances


def _chosen(
    model: Model, train: Dataset, free: tuple[str, ...], unplaced: tuple[str, ...], options: Options
) -> LossChoice:
    """The loss that cross-validation chooses, with frames as the linear one places them; of very many poses by a few
    thousand of them, evenly spread."""
    count, train = len(train), train.few()
    setup = place(model, train, options)
    rows = rows_of(model.measurement, train, setup, model.residuals, unplaced)
    choice = choose_loss(model, train, rows, (*model.kinematic, *free), options, stated(model, setup))
    if len(train) == count:
        return choice
    return replace(choice, why=f"{choice.why}; by {len(train)} of {count} poses, evenly spread")


def _unplaced(names: Sequence[str]) -> list[str]:
    """What is said of places that no training pose tells."""
    if not names:
        return []
    things = list(dict.fromkeys(name.rpartition("_")[0] for name in names))
    more = f" and {len(things) - _NAMED} more" if len(things) > _NAMED + 1 else ""
    shown = things[:_NAMED] if more else things
    return [
        f"no training pose tells where {', '.join(shown)}{more} {'is' if len(things) == 1 else 'are'}: fitted to the "
        "held-out poses with the robot held, and as many degrees of freedom are taken off their rms"
    ]


def linearised(model: Model, train: Dataset, after: Fit, options: Options) -> tuple[VarianceModel, tuple[str, ...]]:
    """The system of a fit to training poses, and what no training pose places.

    Args:
        options: of the identification; its loss may be `auto`.
    """
    unplaced = tuple(name for name in model.placement if name not in after.free)
    rows = rows_of(model.measurement, train, after.setup, model.residuals, unplaced)
    one = replace(options, loss=after.loss)  # `auto` has chosen
    return variance_model(rows, after.free, one, prior_mean=stated(model, after.setup)), unplaced


def baseline_model(model: Model) -> Model | None:
    """The model whose robot frames are all estimated, for the baseline; None if that is the model itself.

    The base is free where something on world is known, else what stands on world; the tool where something known is
    on it.
    """
    task = model.task
    ends = [(o, end) for o in task.observations for end in (o.at, o.target.at)]
    on_tool = [
        o.at.unknown if end is o.at else end.unknown or bool(o.target.unknown_points)
        for o, end in ends
        if end.on == "tool"
    ]
    free_tool = bool(on_tool) and not all(on_tool)
    cameras = task.scene is not None
    on_world = [end for _, end in ends if end.on == "world"]
    free_base = not cameras and bool(on_world) and not all(end.unknown for end in on_world)
    observations = [replace(o, at=replace(o.at, unknown=True)) for o in task.observations] if cameras else None
    same = (task.base, task.tool) == (free_base, free_tool) and (not cameras or task.observations[0].at.unknown)
    if same:
        return None  # numbers of cameras keep their calibrated values at nominal kinematics
    free = replace(task, base=free_base, tool=free_tool, fix=(), scales={}, priors={})
    return build_model(model.robot, free if observations is None else free.observed(observations))


def calibrated_robot(model: Model, result: Fit) -> Robot:
    """The robot with its identified numbers, frames and covariance."""
    errors = model.parameters.mapping(result.x)
    kinematic = {name: errors[name] for name in model.robot.parameters}
    setup = model.moved(result.setup, result.x)
    free = result.free
    sigma: dict[str, float | None] = dict.fromkeys(model.parameters.names)
    sigma |= dict(zip(free, result.posterior.sigmas.tolist(), strict=True))
    full = np.zeros((len(model.parameters), len(model.parameters)))
    index = model.parameters.indices(free)
    full[np.ix_(index, index)] = result.posterior.covariance
    provenance: dict[str, Any] = {
        "measurements": measurement_record(model, result.setup, setup, errors, free),
        "noise_sigma": {f"{g.name}_{g.unit}": result.sigmas.get(g.name) for g in model.measurement.groups},
        "rank": result.identifiability.rank,
        "dof": result.dof,
        "size_factor": result.factor,
        "size_factors": dict(result.factors),
        "noise_estimated": list(result.estimated),
        "loss": result.loss,
        "priors": {p.name: p.prior_sigma for p in model.parameters.items if p.prior_sigma is not None},
        "learnt": dict(zip(free, result.posterior.learnt.tolist(), strict=True)),
        "trouble": result.trouble,
    }
    record = Record(
        errors=errors,
        sigmas=sigma,
        covariance=full,
        nominal_base=result.setup.base,
        nominal_tool=result.setup.tool,
        provenance=provenance,
    )
    scales = {p.name: p.scale for p in model.parameters.items if p.name in model.task.scales and not p.unknown}
    robot = replace(model.robot, scales={**model.robot.scales, **scales})
    return replace(robot.corrected(kinematic), base=setup.base, tool=setup.tool, record=record)
