"""All figures of an identification, in the order of its report."""

from __future__ import annotations

from collections.abc import Sequence

from symcal.calibration.calibrate import Calibration
from symcal.calibration.held_out_places import held_out_places
from symcal.calibration.model_check import ModelCheck
from symcal.calibration.tolerance import Tolerance
from symcal.data.dataset import Dataset
from symcal.plots.contacts import contacts, has_contacts
from symcal.plots.convergence import convergence
from symcal.plots.distribution import error_distribution
from symcal.plots.image_residuals import image_residuals
from symcal.plots.learnt import what_was_learnt
from symcal.plots.model_check import residuals_by_joint
from symcal.plots.parameters import correlation_matrix, parameter_corrections
from symcal.plots.poses import errors_per_pose
from symcal.plots.prediction import predicted_error
from symcal.plots.remainder import remainder
from symcal.plots.residuals import residuals_per_axis
from symcal.plots.spectrum import singular_values
from symcal.plots.style import Comparison, Drawing, Illustration, drawing
from symcal.words import MOSTLY


def identification_figures(
    calibration: Calibration,
    data: Dataset,
    errors: Comparison,
    against: str = "noisy measurement",
    check: ModelCheck | None = None,
    tolerance: Tolerance | None = None,
) -> tuple[Illustration, ...]:
    """The figures that say what an identification is worth; see `identification_drawings`."""
    drawings = identification_drawings(calibration, data, errors, against, check, tolerance)
    return tuple(illustration for each in drawings for illustration in each())


def identification_drawings(
    calibration: Calibration,
    data: Dataset,
    errors: Comparison,
    against: str = "noisy measurement",
    check: ModelCheck | None = None,
    tolerance: Tolerance | None = None,
) -> tuple[Drawing, ...]:
    """The figures that say what an identification is worth, still to be drawn.

    Args:
        data: the measurements with their splits.
        errors: by part (`train`; `test`, `cross_validation`, `truth` where there are any) and state, as
            `evaluate.compare` gives them.
        against: what the errors are taken against. check: of the model, whose residuals are drawn by joint. tolerance:
            what the identification is held against.
    """
    parts: dict[str, Dataset] = {name: data.part(name) for name in ("train", "test") if name in data.split}
    labels: dict[str, Sequence[str]] = {name: part.labels for name, part in parts.items()}
    judged = next(part for part in ("test", "cross_validation", "train") if errors.get(part))
    limit = None if tolerance is None else tolerance.limit(errors[judged]["after"].unit)
    places = held_out_places(calibration.states["after"], parts.get("test"))
    truth = errors.get("truth")
    kinematic = calibration.model.kinematic
    told_apart = (calibration.after.posterior.learnt >= MOSTLY).sum() > 1
    points = any(o.instrument.gives_point for o in calibration.model.task.observations)
    predicted = points and errors.get("test") and "test" in parts and errors["test"]["after"].of_tool
    drawn: list[Drawing | None] = [
        drawing(errors_per_pose, errors, labels, against),
        drawing(error_distribution, errors[judged], judged, against=against, limit=limit),
        drawing(error_distribution, truth, "truth", name="true_error_distribution") if truth else None,
        drawing(contacts, calibration, data, places) if has_contacts(calibration, data) else None,
        drawing(residuals_per_axis, errors, against),
        lambda: image_residuals(calibration, data),
        drawing(what_was_learnt, calibration) if kinematic else None,
        drawing(parameter_corrections, calibration) if kinematic else None,
        drawing(convergence, calibration, parts, places),
        drawing(singular_values, calibration.after.identifiability),
        None if check is None else drawing(residuals_by_joint, check, calibration.model.robot),
        drawing(correlation_matrix, calibration.after) if told_apart else None,
        drawing(predicted_error, calibration, parts["test"], errors["test"]["after"]) if predicted else None,
        None if calibration.trial is None else drawing(remainder, calibration, data),
    ]
    return tuple(each for each in drawn if each is not None)
