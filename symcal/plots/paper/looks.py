"""How the plans of the paper's study look in every figure: by colour, by line and by marker."""

from __future__ import annotations

from symcal.paper_study.repetitions import NEW_RANDOM
from symcal.plots.style import BLUE, FAINT, GREEN, ORANGE, VERMILION, Look

PLANS: dict[str, Look] = {
    "paper_ga": Look("paper's fitness (GA)", VERMILION, "s", "--", True),
    "ga": Look("information as fitness (GA)", GREEN, "^", "-.", True),
    "certified": Look("certified", BLUE, "o", "-", False),
    "random": Look("one random plan", ORANGE, "D", ":", True),
    NEW_RANDOM: Look("a new random plan each time", FAINT, "x", (0, (1, 1)), True),  # type: ignore[arg-type]
}
