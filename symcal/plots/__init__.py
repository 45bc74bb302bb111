"""Results as figures for print: each function returns an `Illustration` and neither shows nor saves it."""

from symcal.plots.contacts import contacts
from symcal.plots.convergence import convergence
from symcal.plots.distribution import error_distribution
from symcal.plots.identification import identification_figures
from symcal.plots.learnt import what_was_learnt
from symcal.plots.parameters import correlation_matrix, parameter_corrections
from symcal.plots.poses import errors_per_pose
from symcal.plots.prediction import predicted_error
from symcal.plots.residuals import residuals_per_axis
from symcal.plots.spectrum import singular_values
from symcal.plots.style import Comparison, Illustration, print_settings

__all__ = [
    "Comparison",
    "Illustration",
    "contacts",
    "convergence",
    "correlation_matrix",
    "error_distribution",
    "errors_per_pose",
    "identification_figures",
    "parameter_corrections",
    "predicted_error",
    "print_settings",
    "residuals_per_axis",
    "singular_values",
    "what_was_learnt",
]
