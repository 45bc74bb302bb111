"""How objects show themselves in a notebook: one short table, and a small drawing that needs no script."""

from symcal.notebook.sketch import Dots, Panel, Path, sketch
from symcal.notebook.table import html_table

__all__ = ["Dots", "Panel", "Path", "html_table", "sketch"]
