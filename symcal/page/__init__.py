"""Results as one HTML file that asks for nothing else: numbers first, then the arm that one can turn and touch."""

from symcal.page.gallery import Gallery, Thumbnail
from symcal.page.identification import Identified, write_page
from symcal.page.study import write_study_page

__all__ = ["Gallery", "Identified", "Thumbnail", "write_page", "write_study_page"]
