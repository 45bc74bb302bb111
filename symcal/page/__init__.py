"""Results as one HTML file that asks for nothing else: numbers first, then the arm that one can turn and touch."""

from symcal.page.identification import Identified, write_page

__all__ = ["Identified", "write_page"]
