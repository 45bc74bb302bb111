"""The figures of the paper's study: its own, as far as a simulation gives them, and those that it lacks."""

from __future__ import annotations

from symcal.paper.plots.chance import measured_errors, true_errors
from symcal.paper.plots.fitness import fitness_readings
from symcal.paper.plots.simulations import convergence, test_errors
from symcal.paper.plots.trajectory import joint_motion, test_data, trajectories
from symcal.paper.plots.unseen import spectra, spreads
from symcal.paper.plots.vision import vision
from symcal.paper.results import Study
from symcal.plots.style import Drawing, drawing


def study_drawings(study: Study) -> tuple[Drawing, ...]:
    """All figures of the study, in the order of its report; still to be drawn."""
    return (
        drawing(measured_errors, study),
        drawing(true_errors, study),
        drawing(vision, study, "paper_ga"),
        drawing(trajectories, study, ("certified", "paper_ga")),
        drawing(joint_motion, study, ("certified", "paper_ga")),
        drawing(convergence, study),
        drawing(test_data, study),
        drawing(test_errors, study, ("paper_ga", "random", "certified")),
        drawing(spectra, study),
        drawing(spreads, study),
        drawing(fitness_readings, study),
    )


__all__ = ["study_drawings"]
