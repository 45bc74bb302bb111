"""Identification beyond geometry: groups of joint terms, each kept only when the data say so.

All candidate groups are fitted at once, each with one factor on its plausible sizes by marginal likelihood; groups are
left out while the least of them gains too little (`symcal.fit.groups`), or held-out poses speak against it; the robot
with those that are left is identified as any other. The way is ours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration, calibrate, linearised
from symcal.calibration.candidates import CONDITIONED, candidates
from symcal.calibration.extension import Extension, GroupFinding, HeldOut, JointFinding, SharedFinding
from symcal.calibration.joint_findings import joint_findings, shared_findings
from symcal.data.conditions import directions_from_order
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Fit, Options
from symcal.fit.groups import Groups, groups_at
from symcal.fit.held_out import folds_of
from symcal.joints import Term
from symcal.joints.backlash import direction_name
from symcal.model.model import Model, build_model
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

FOLDS = 5
_AGAINST = 2.0  # standard errors by which held-out poses must be worse for a group to be left out


def calibrate_extended(
    model: Model, baseline: Model | None, data: Dataset, options: Options, wanted: Sequence[str]
) -> Calibration:
    """`symcal.calibration.calibrate.calibrate` of a robot with the joint terms that the data ask for.

    What was found is the result's ``extension``.

    Args:
        model: of the robot without them. wanted: `("auto",)` or names of groups (`candidates.GROUPS`); empty: none is
            tried.
    Raises:
        InputError: no such group, or one that the data carry nothing for. RefusedError: as of `calibrate`, which data
            that are too few for joint terms alone do not raise: it is then said in the notes.
    """
    if not wanted:
        return calibrate(model, baseline, data, options)
    terms = candidates(model.robot, wanted, data.conditions)
    groups = tuple(dict.fromkeys(p.group for term in terms for p in term.parameters))
    own = {p.group for p in model.robot.term_parameters.values()}
    full = with_terms(model, terms)
    options = replace(options, shrinking=tuple(group for group in groups if group not in own))
    try:
        found = calibrate(full, baseline, data, options)
    except RefusedError as error:
        alone = calibrate(model, baseline, data, options)  # refused as well where the data are no better
        said = f"nothing beyond geometry was tried: {error}"
        return replace(alone, notes=(*alone.notes, said))
    train = data.part("train")
    at = _groups_of(full, train, found.after, options)
    chosen, folds = options.shrinking, folds_of(at.model, FOLDS)

    @cache
    def held_out(gone: frozenset[str]) -> Array:
        return at.held_out(tuple(gone), folds)

    gains: dict[str, float] = {}
    rejected: list[str] = []
    while True:
        left = at.eliminated([group for group in chosen if group not in rejected], rejected)
        gains |= left.gains
        kept = list(left.kept)
        trial = {group: _compared(at, held_out, chosen, kept, group) for group in chosen}
        against = [group for group in kept if trial[group].better < -_AGAINST]
        if not against:
            break
        rejected.append(min(against, key=lambda group: trial[group].better))
    model_kept = with_terms(model, [term for term in terms if _in(term, [*kept, *own])])
    last = found if len(kept) == len(chosen) else calibrate(model_kept, baseline, data, options, found.mistakes)
    first = full.measurement.groups[0]
    shared = shared_findings(last) if kept else ()
    extension = Extension(
        wanted=tuple(wanted),
        poses=len(train),
        folds=len(folds),
        quantity=first.quantity,
        unit=first.unit,
        geometry=_rms(at, held_out(frozenset(chosen))),
        chosen=_rms(at, held_out(frozenset(chosen) - set(kept))),
        groups=tuple(
            GroupFinding(
                group,
                group in kept,
                (last if group in kept else found).after.factors[group],
                group in rejected,
                gains[group],
                trial[group],
                _joints(last, group, shared) if group in kept else joint_findings(found, group, at.covariance(group)),
            )
            for group in chosen
        ),
        shared=shared,
    )
    return replace(last, extension=extension)


def _joints(calibration: Calibration, group: str, shared: Sequence[SharedFinding]) -> tuple[JointFinding, ...]:
    """A group at its joints; of waves that only mean something with the moment of the own link none is named."""
    sums = {each.joint for each in shared} if group == "harmonics 1" else set()
    found = joint_findings(calibration, group)
    return tuple(replace(each, named=False, summed=True) if each.joint in sums else each for each in found)


def with_directions(data: Dataset, robot: Robot, wanted: Sequence[str]) -> Dataset:
    """The data with directions of approach from the order of its poses, where backlash is asked for by name and no
    column says them; a note says so."""
    names = [direction_name(i) for i in range(1, robot.dof + 1)]
    if "backlash" not in wanted or any(name in data.conditions for name in names):
        return data
    said = "no column says from where the joints came: backlash takes it from the order of the poses in the file"
    found = directions_from_order(data, robot)
    return replace(found, notes=(*found.notes, said))


def shrinking(calibration: Calibration, options: Options) -> Options:
    """The options of further fits of this robot: groups that were tried stay such as may not be there."""
    found = calibration.extension
    return options if found is None else replace(options, shrinking=tuple(group.name for group in found.groups))


def with_terms(model: Model, terms: Sequence[Term]) -> Model:
    """The model of the same task for a robot with more joint terms; itself without any."""
    if not terms:
        return model
    robot: Robot = replace(model.robot, terms=(*model.robot.terms, *terms))
    return build_model(robot, model.task)


def planned_model(model: Model, wanted: Sequence[str]) -> Model:
    """The model that poses are planned for: with every joint term that the identification may keep.

    Backlash and payload are not among them: no posture tells of these, but how it is approached and loaded.
    """
    if tuple(wanted) != ("auto",):
        wanted = tuple(group for group in wanted if group not in CONDITIONED)
    return with_terms(model, candidates(model.robot, wanted, ())) if wanted else model


def _in(term: Term, groups: Sequence[str]) -> bool:
    return all(number.group in groups for number in term.numbers)


def _groups_of(model: Model, train: Dataset, after: Fit, options: Options) -> Groups:
    """The fit, linearised at its estimate.

    Raises:
        RefusedError: it did not converge.
    """
    if not np.isfinite(after.x).all():
        raise RefusedError(f"the identification with joint terms did not converge: {after.trouble}")
    system, _ = linearised(model, train, after, options)
    return groups_at(system, after.x, after.variances)


def _compared(
    at: Groups, held_out: Callable[[frozenset[str]], Array], chosen: Sequence[str], kept: Sequence[str], group: str
) -> HeldOut:
    """Held-out poses without and with a group, beside the other kept ones.

    Args:
        held_out: residuals of held-out poses by the groups that are left out.
    """
    without = frozenset(chosen) - (set(kept) - {group})
    with_ = without - {group}
    spread = at.model.spread(at.variances_without(tuple(with_)))
    residuals = [held_out(gone) for gone in (without, with_)]
    squares = [np.sum((np.where(np.isfinite(spread), r, 0.0) / spread) ** 2, axis=1) for r in residuals]
    difference = squares[0] - squares[1]
    error = float(np.std(difference, ddof=1)) / np.sqrt(len(difference))
    better = float(difference.mean()) / error if error > 0 else 0.0
    return HeldOut(_rms(at, residuals[0]), _rms(at, residuals[1]), better)


def _rms(at: Groups, residual: Array) -> float:
    """Root mean square of the norm of a reading of the first noise group."""
    rows = at.model.system.rows
    group = rows.measurement.groups[0]
    columns = list(group.columns)
    seen = rows.seen[:, columns].reshape(len(residual), -1, group.block).any(axis=2)
    norms = np.linalg.norm(residual[:, columns].reshape(len(residual), -1, group.block), axis=2)
    return float(np.sqrt(np.mean(norms[seen] ** 2)))
