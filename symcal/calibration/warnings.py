"""What a person should know before believing an identification: wrong units, outliers, too few poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.length import unseen_length
from symcal.calibration.odd_values import odd_values
from symcal.calibration.outliers import StandingOut
from symcal.calibration.plausibility import about_centre, first_quantity, residuals, size_of, who_of
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Fit
from symcal.fit.robust import Loss
from symcal.model.measurement import Part
from symcal.model.model import Model, State
from symcal.words import plural

Array = NDArray[np.float64]

_ABSURD = 20.0  # scales: a correction larger than this is a mistake more often than a fact
_WRONG_NOISE = 1.5  # residuals over stated noise
_LARGER = 3.0  # factor on the plausible sizes that a reader is told
_ADRIFT = 30.0  # scales: a sigma beyond is more than what any parameter of the links may hide
_NAMED = 5
_SLIPS = 0.1  # of the poses: so few that spoil an identification are named alone
_NONSENSE = 0.1  # of the robot's length
_NOT_TOUCHING = 0.005  # of the robot's length, after the identification
_NONSENSE_TURN = np.deg2rad(20.0)
_GROWN = 5.0  # of its plausible size: a growth of all lengths beyond is no calibration
_LEAST_GROWN = 0.01
_TOLD = 0.3  # of its plausible size: a growth that is known better is news to nobody
_UNEVEN = 5.0  # times: contacts of one ball are about as good everywhere


def quality(model: Model, data: Dataset, after: Fit, odd: StandingOut) -> tuple[str, ...]:
    """What the identification says about itself.

    Args:
        odd: readings that stand out of it.

    Raises:
        RefusedError: the identified model does not explain the measurements at all.
    """
    refuse_nonsense(model, data, after, odd)
    notes = []
    learnt = after.equations - after.dof
    if after.dof < 2 * learnt:
        notes.append(
            f"only {after.dof:.0f} degrees of freedom are left for {learnt:.0f} parameters' worth that was learnt "
            f"({len(data)} poses): the errors on the training data say little about other poses; trust the held-out or "
            "cross-validated ones"
        )
    if not after.converged:
        notes.append(f"the identification did not converge: {after.trouble}")
    notes += outlier_notes(odd, after.loss)
    spoilt = odd.dragged and bool(odd.listed)  # by outliers: what follows from them is no news
    if after.factor > _LARGER and not spoilt:
        notes.append(
            f"the errors of this robot are about {after.factor:.2g} times as large as their plausible sizes: the robot "
            "file is further off than stated, or the model lacks something and the parameters make up for it"
        )
    notes += _adrift(model, after)
    notes += [*_unseen_length(model, after), *_uneven(model, after), *odd_values(model, after)]
    errors = model.parameters.mapping(after.x)
    large = [
        name
        for name in model.kinematic
        if name in model.robot.link_parameters  # the sizes of joint terms come from the data
        and abs(errors[name]) > _ABSURD * model.parameters.items[model.parameters.index(name)].scale
    ]
    if large and not spoilt:
        notes.append(
            f"corrections of {', '.join(large)} are more than {_ABSURD:.0f} times their plausible scale: check signs, "
            "units and zero positions, or give larger 'scales'"
        )
    for name, (squares, dof) in after.by_group.items():
        factor = float(np.sqrt(squares / dof)) if dof > 1 and name not in after.estimated else 1.0
        if odd.listed and factor > 1:
            factor = min(factor, max(odd.scales.get(name, factor), 1.0))
        if factor > _WRONG_NOISE or factor < 1 / _WRONG_NOISE:
            notes.append(
                f"{name} residuals are {factor:.3g} times the stated noise: the noise is stated too "
                + ("small, or the model lacks something" if factor > 1 else "large")
            )
    return tuple(notes)


def _unseen_length(model: Model, after: Fit) -> list[str]:
    """That contacts and directions see no length.

    Raises:
        RefusedError: the fit has shrunk or stretched the arm.
    """
    length = unseen_length(model, after)
    if length is None:
        return []
    grown, size = length.growth, length.size
    if abs(grown) > max(_GROWN * size, _LEAST_GROWN):
        raise RefusedError(
            f"the identification {'shrinks' if grown < 0 else 'stretches'} the arm by {abs(grown):.1%}: contacts see "
            "no length, and a smaller arm misses everything by less; check known values and places, which posture "
            "touched what, and the robot file, or add something that has a length: a known distance between two "
            "sockets ('value'), known places, an instrument that reads lengths"
        )
    if length.sigma < _TOLD * size:
        return []
    known = "only known values, places and points tell" if length.known else "nothing that was measured tells"
    contacts = all(o.instrument.constrains for o in model.task.observations)
    return [
        f"{known} how long the arm is: {'contacts are' if contacts else 'what was read is'} the same if all lengths "
        f"grow by one share. That share is held by the plausible sizes of the lengths, to {length.sigma:.2%} (one "
        "standard deviation)"
    ]


def _uneven(model: Model, after: Fit) -> list[str]:
    """Contacts that are much noisier than others of their kind: a slip that a known value or a place forces on them."""
    kinds = {o.of: o.instrument for o in model.task.observations if o.instrument.constrains}
    found = [
        (after.sigmas[g.name], g.observation)
        for g in model.measurement.groups
        if g.observation in kinds and g.name in after.estimated
    ]
    if len(found) < 2 or max(found)[0] < _UNEVEN * min(found)[0]:
        return []
    (low, quiet), (high, loud) = min(found), max(found)
    return [
        f"contacts with {loud} scatter by {high:.3g} mm, {high / low:.3g} times those with {quiet}: look for postures "
        "that touched something else, and for a known value or place that is wrong"
    ]


def _adrift(model: Model, after: Fit) -> list[str]:
    """Places and numbers that the data hardly tell anything of: they are where the search left them."""
    sigmas = dict(zip(after.free, after.posterior.sigmas, strict=True))
    loose = [
        (p.name, f"{sigmas[p.name]:.3g} mm" if p.unit == "mm" else f"{np.rad2deg(sigmas[p.name]):.3g} deg")
        for p in model.parameters.items
        if p.unknown and p.unit in ("mm", "rad") and sigmas.get(p.name, 0.0) > _ADRIFT * p.scale
    ]
    if not loose:
        return []
    shown = ", ".join(f"{name} (+-{sigma})" for name, sigma in loose[:_NAMED])
    more = f" and {len(loose) - _NAMED} more" if len(loose) > _NAMED else ""
    return [
        f"the data hardly tell {shown}{more}: do not use what was found of them; place more, or measure with another "
        "instrument"
    ]


_NOTHING_ODD = StandingOut()


def refuse_nonsense(model: Model, data: Dataset, after: Fit, odd: StandingOut = _NOTHING_ODD) -> None:
    """Wrong units, signs and joint order leave errors of the robot's own size; medians, so that a slip is no reason.

    Raises:
        RefusedError: the identified model does not explain the measurements at all.
    """
    r = residuals(data, State(model, after.setup, after.x))
    for part in model.measurement.parts:
        wrong = _nonsense(model, data, part, r)
        if not wrong:
            continue
        slips = list(dict.fromkeys(each.pose for each in odd.listed)) if odd.dragged else []
        if slips and len(slips) <= _SLIPS * len(data):
            raise RefusedError(
                f"{who_of(model, part)}{plural(len(slips), 'pose')} ({', '.join(slips[:_NAMED])}) "
                f"{'spoils' if len(slips) == 1 else 'spoil'} the identification: "
                f"{odd.listed[0].off:.4g} {odd.listed[0].unit} from where all others put {odd.listed[0].pose}: measure "
                "again, leave out, or use 'loss: auto'"
            )
        frames = part.observation.instrument.reads == "frame"
        pose = ", the order x, y, z, w of the quaternion, 'invert' or 'reports' (whose pose it is)" if frames else ""
        read = "which posture touched what" if part.observation.instrument.constrains else "the unit of the measurement"
        raise RefusedError(
            f"{who_of(model, part)}even after the identification half of the poses are off by more than "
            f"{' and '.join(wrong)}: these are not measurements of this robot as it is described; check units, signs "
            f"and order of the joint columns, {read}{pose}, and the robot file"
            + "".join(f"; {note}" for note in data.notes[:3])
        )


def _nonsense(model: Model, data: Dataset, part: Part, r: Array) -> list[str]:
    wrong = []
    found = first_quantity(part, data, r)
    if found is not None:
        position, measured, unit = found
        error = float(np.median(np.linalg.norm(position, axis=1)))
        spread = float(np.median(np.linalg.norm(about_centre(measured), axis=1)))
        much = _NOT_TOUCHING if part.observation.instrument.constrains else _NONSENSE
        if error > spread / 4 and (unit != "mm" or error > much * size_of(model, data)):
            of = f" (the measured points spread over {spread:.4g} {unit})" * (
                not part.observation.instrument.constrains
            )
            wrong.append(f"{error:.4g} {unit}{of}")
    seen, first = part.seen(data.z), 0
    rows = r[:, part.components].reshape(len(data) * part.features, -1)
    seen = seen.reshape(len(rows), -1)
    for quantity in part.observation.instrument.quantities:
        own = slice(first, first + quantity.size)
        first += quantity.size
        whole = seen[:, own].all(axis=1)
        if quantity.unit == "rad" and whole.any():
            turn = float(np.median(np.linalg.norm(rows[whole, own], axis=1)))
            if turn > _NONSENSE_TURN:
                wrong.append(f"{np.rad2deg(turn):.3g} deg")
    return wrong


def outlier_notes(found: StandingOut, loss: Loss) -> list[str]:
    """Readings whose residual is no accident at the noise of the others."""
    notes = [
        f"{crowd.poses} of {crowd.of} training poses have a {crowd.group} residual beyond the noise: not outliers, but "
        "a noise stated too small or an effect that the model lacks"
        for crowd in found.crowds
    ]
    advice = "measure them again" + (" or use 'loss: auto'" if loss == "linear" else "")
    for group in dict.fromkeys(each.group for each in found.listed):
        poses = list(dict.fromkeys(each.pose for each in found.listed if each.group == group))
        listed = ", ".join(poses[:_NAMED]) + (", ..." if len(poses) > _NAMED else "")
        notes.append(
            f"{len(poses)} training pose(s) have a {group} residual that the noise of the others does not explain "
            f"(pose {listed}): {advice}"
        )
    return notes
