"""Results as a PDF report through a Typst template."""

from symcal.report.render import Picture, write_report
from symcal.report.verdict import verdict

__all__ = ["Picture", "verdict", "write_report"]
