"""How figures look: sizes for print, and colours that survive colour blindness and grey copies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from symcal.calibration.evaluate import Errors
from symcal.colors import BLUE as BLUE
from symcal.colors import FAINT as FAINT
from symcal.colors import GREEN as GREEN
from symcal.colors import INK as INK
from symcal.colors import ORANGE as ORANGE
from symcal.colors import PURPLE as PURPLE
from symcal.colors import RULE as RULE
from symcal.colors import VERMILION as VERMILION

Comparison = Mapping[str, Mapping[str, Errors]]
"""Errors by part of the data (`train`, `test`, `cross_validation`, ...) and by state (`before`, `after`, ...)."""

_DOTS_PER_INCH = 150  # on which texts are laid out
NARROW, WIDE = 85.0, 170.0
"""Widths of one and of two columns of a page, mm."""

FONT = "DejaVu Sans"
"""Comes with matplotlib."""

_SETTINGS: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": [FONT],
    "mathtext.fontset": "dejavusans",
    "font.size": 7.0,
    "axes.labelsize": 7.0,
    "axes.titlesize": 7.0,
    "axes.titlelocation": "left",
    "axes.titlepad": 4.0,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 6.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.linewidth": 0.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.minor.width": 0.35,
    "ytick.minor.width": 0.35,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.4,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.0,
    "lines.markeredgewidth": 0.6,
    "hatch.linewidth": 0.4,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.borderaxespad": 0.2,
    "legend.columnspacing": 1.4,
    "text.usetex": False,
    "axes.unicode_minus": True,
}


@dataclass(frozen=True, slots=True, eq=False)
class Illustration:
    """A figure with what it says.

    name: of its files, without suffix. title: a few words. caption: what it shows, its numbers computed from the data.
    """

    figure: Figure
    name: str
    title: str
    caption: str

    @property
    def width_mm(self) -> float:
        return float(self.figure.get_figwidth() * 25.4)


Drawing = Callable[[], Sequence[Illustration]]
"""Figures still to be drawn, one or none as a rule: independent of one another, so that two processes can share them
(`symcal.plots.save.draw`)."""


def drawing(make: Callable[..., Illustration | None], *args: Any, **options: Any) -> Drawing:
    """A figure still to be drawn; ``make`` may find that there is none."""

    def drawn() -> tuple[Illustration, ...]:
        illustration = make(*args, **options)
        return () if illustration is None else (illustration,)

    return drawn


@dataclass(frozen=True, slots=True)
class FigureLook:
    """How a state of the robot is drawn everywhere: from light to dark as the model gets better."""

    label: str
    color: str
    marker: str
    line: str
    hollow: bool


LOOKS: dict[str, FigureLook] = {
    "before_raw": FigureLook("nominal, frames as given", "#999999", "x", ":", True),
    "before": FigureLook("before: nominal, frames fitted", ORANGE, "o", "--", True),
    "offsets_only": FigureLook("joint offsets only", GREEN, "^", "-.", True),
    "after": FigureLook("after: all parameters", BLUE, "o", "-", False),
}
"""From light to dark."""

PARTS: dict[str, str] = {
    "train": "training",
    "test": "held-out",
    "cross_validation": "cross-validated",
    "truth": "simulated test",
}


@contextmanager
def print_settings(truetype: bool = False) -> Iterator[None]:
    """matplotlib's settings for print, and the ones before when left; needed to draw and again to write a file.

    Args:
        truetype: embed fonts as TrueType instead of Type 3. Some journals ask for it; it takes three times as long.
    """
    with matplotlib.rc_context(_SETTINGS | {"pdf.fonttype": 42 if truetype else 3}):
        yield


def sheet(width: float, height: float) -> Figure:
    """An empty figure of a size in mm, outside matplotlib's global state.

    Its texts are measured on a canvas of pixels, from which `symcal.plots.save` takes it to one of vectors.
    """
    figure = Figure(figsize=(width / 25.4, height / 25.4), dpi=_DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def settle(figure: Figure) -> Figure:
    """Lay the figure out once and for all, so that writing it does not do it again."""
    for axis in _straight(figure):
        if not axis.label.get_text():  # matplotlib would look for its place among the numbers nonetheless
            axis.set_label_coords(0.5, 0.5)
    engine = figure.get_layout_engine()
    if engine is not None:
        with print_settings(), _margins_remembered(figure):
            engine.execute(figure)
    figure.set_layout_engine("none")
    return figure


@contextmanager
def _margins_remembered(figure: Figure) -> Iterator[None]:
    """Axes measure what stands around them once, and again only where their ticks have changed: the layout asks twice,
    before and after it has moved them, and most of its time goes into the sizes of texts. Not axes that have their
    place within the room that the layout gives them (images, bars of colours)."""
    each = {axis.axes for axis in _straight(figure)}
    each = {axes for axes in each if axes.get_aspect() == "auto" and axes.get_axes_locator() is None}
    for axes in each:
        vars(axes)["get_tightbbox"] = _Remembering(axes)
    try:
        yield
    finally:
        for axes in each:
            del vars(axes)["get_tightbbox"]


class _Remembering:
    """`Axes.get_tightbbox` of axes, from their frame and the margins found before as long as their ticks are the
    same."""

    def __init__(self, axes: Axes) -> None:
        self.measure, self.axes = axes.get_tightbbox, axes
        self.ticks: list[Any] = []
        self.margins = np.zeros((2, 2))

    def __call__(self, *args: Any, **options: Any) -> Bbox | None:
        axes = self.axes
        ticks = [axis.get_ticklocs(minor=m).tolist() for axis in (axes.xaxis, axes.yaxis) for m in (False, True)]
        if ticks != self.ticks:
            found = self.measure(*args, **options)
            if found is None:
                return None
            self.ticks, self.margins = ticks, found.get_points() - axes.bbox.get_points()
            return found
        return Bbox(axes.bbox.get_points() + self.margins)


def _straight(figure: Figure) -> Iterator[Axis]:
    """Axes that are drawn and have their names beside them: none of views in space."""
    for axes in figure.axes:
        if axes.name == "rectilinear" and axes.axison:
            yield from (axes.xaxis, axes.yaxis)


def escaped(text: str) -> str:
    """Text that matplotlib takes literally: a name may have two dollars in it."""
    return text.replace("$", r"\$")


def over_image(axes: Axes, width: int, height: int) -> None:
    """Axes over an image of so many pixels: equal, v downwards."""
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set(xlabel="u / px", ylabel="v / px")


def grid(axes: Axes, axis: str = "y") -> None:
    axes.grid(True, axis=axis)  # type: ignore[arg-type]
    axes.tick_params(which="both", direction="out")


def marks(look: FigureLook) -> dict[str, Any]:
    """Keyword arguments for markers of a state, without a line."""
    return {
        "linestyle": "none",
        "marker": look.marker,
        "color": look.color,
        "markerfacecolor": "white" if look.hollow else look.color,
    }
