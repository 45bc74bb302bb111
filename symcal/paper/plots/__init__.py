"""The figures of the paper's study: its own, as far as a simulation gives them, and those that it lacks."""

from __future__ import annotations

from symcal.paper.plots.chance import measured_errors, true_errors
from symcal.paper.plots.fitness import fitness_readings
from symcal.paper.plots.simulations import convergence, test_errors
from symcal.paper.plots.trajectory import joint_motion, test_data, trajectories
from symcal.paper.plots.unseen import spectra, spreads
from symcal.paper.plots.vision import vision
from symcal.paper.results import Study
from symcal.plots.style import Illustration


def study_figures(study: Study) -> tuple[Illustration, ...]:
    """All figures of the study, in the order of its report."""
    return (
        measured_errors(study),
        true_errors(study),
        vision(study, "paper_ga"),
        trajectories(study, ("certified", "paper_ga")),
        joint_motion(study, ("certified", "paper_ga")),
        convergence(study),
        test_data(study),
        test_errors(study, ("paper_ga", "random", "certified")),
        spectra(study),
        spreads(study),
        fitness_readings(study),
    )


__all__ = ["study_figures"]
