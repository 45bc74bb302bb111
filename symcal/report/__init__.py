"""Results as a PDF report through a Typst template, and figures as files."""

from symcal.report.figures import save_figure, save_figures
from symcal.report.render import Picture, write_report
from symcal.report.verdict import verdict

__all__ = ["Picture", "save_figure", "save_figures", "verdict", "write_report"]
