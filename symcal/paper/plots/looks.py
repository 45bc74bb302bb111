"""How the plans of the paper's study look in every figure: by colour, by line and by marker."""

from __future__ import annotations

from symcal.paper.repetitions import NEW_RANDOM
from symcal.plots.style import BLUE, FAINT, GREEN, ORANGE, VERMILION, FigureLook

PLANS: dict[str, FigureLook] = {
    "paper_ga": FigureLook("paper's fitness (GA)", VERMILION, "s", "--", True),
    "ga": FigureLook("information as fitness (GA)", GREEN, "^", "-.", True),
    "certified": FigureLook("certified", BLUE, "o", "-", False),
    "random": FigureLook("one random plan", ORANGE, "D", ":", True),
    NEW_RANDOM: FigureLook("a new random plan each time", FAINT, "x", (0, (1, 1)), True),  # type: ignore[arg-type]
}
