"""What figures of errors share: where the poses of each part of the data stand, their titles, the legend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from symcal.calibration.evaluate import Errors
from symcal.data.dataset import SOME, evenly
from symcal.plots.style import FAINT, LOOKS, PARTS, Comparison, FigureLook, marks
from symcal.words import plural

Array = NDArray[np.float64]

SHOWN = ("before", "offsets_only", "after")

_SMALLEST_SHARE = 0.25
_APART = 12.0
_GAP = 0.02
_LARGEST = 100


def drawn_parts(errors: Comparison) -> list[str]:
    """The parts that a fit and its judgement stand on, as far as there are errors of them."""
    return [part for part in ("train", "test") if errors.get(part)]


def places(counts: Sequence[int]) -> list[Array]:
    """Abscissas of the members of each part, in 0..1 with a gap between parts.

    A part's width goes with its size, but a small one beside a large one keeps a quarter.
    """
    shares = np.maximum(np.array(counts) / sum(counts), _SMALLEST_SHARE if len(counts) > 1 else 1.0)
    widths = shares / shares.sum() * (1 - _GAP * (len(counts) - 1))
    starts = np.concatenate([[0.0], np.cumsum(widths[:-1] + _GAP)])
    return [s + w * (np.arange(n) + 0.5) / n for s, w, n in zip(starts, widths, counts, strict=True)]


def marker_size(counts: Sequence[int]) -> float:
    """Marker size in points that leaves so many marks apart as long as that can be read."""
    return float(np.clip(3.4 - 0.006 * sum(counts), 1.2, 3.0))


def crowded(counts: Sequence[int]) -> bool:
    """Whether the marks of the poses run into a cloud, so that only what matters most should be drawn."""
    return max(counts) > 300


def drawn(values: Array) -> NDArray[np.intp]:
    """Which of very many values get a mark: `SOME`, evenly spread, and the largest ones; all where there are no more.

    A million marks are a cloud like some thousand, and make a file that nothing opens.
    """
    if len(values) <= SOME:
        return np.arange(len(values))
    return np.union1d(evenly(len(values)), np.argpartition(np.abs(values), -_LARGEST)[-_LARGEST:])


def drawn_words(counts: Sequence[int], what: str) -> str:
    """A sentence for the caption where not all get a mark."""
    if max(counts) <= SOME:
        return ""
    return f" Marks stand for {SOME} of the {max(counts)} {what}, evenly spread, and for the {_LARGEST} largest values."


def far_apart(values: Mapping[str, Array]) -> bool:
    """Whether states differ so much that a linear axis would show only the largest."""
    typical = [float(np.median(v)) for v in values.values()]
    return max(typical) > _APART * max(min(typical), 1e-300)


def logarithmic(axis: Axis) -> None:
    """Ticks of a logarithmic axis: plain numbers as long as these are short."""
    low, high = axis.get_view_interval()
    if high < 1e3 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    if low >= 1e-3 and high < 1e4:
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def dress(axes: Axes, at: list[Array], titles: Sequence[str] = ()) -> None:
    """Limits, the line between the parts, and their titles above."""
    axes.set_xlim(-0.008, 1.008)
    axes.set_xticks([])
    for left, right in pairwise(at):
        axes.axvline((left[-1] + right[0]) / 2, color=FAINT, linewidth=0.6)
    for x, title in zip(at, titles, strict=False):
        axes.annotate(
            title,
            ((x[0] + x[-1]) / 2, 1),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=6.5,
        )


def titles(errors: Comparison, parts: Sequence[str]) -> list[str]:
    return [f"{PARTS[part]}: {plural(len(np.unique(errors[part]['after'].pose)), 'pose')}" for part in parts]


def legend(figure: Figure, states: Sequence[str], *, markers: bool, lines: bool) -> None:
    """Above the figure: the states, with the signs that it uses for them."""
    handles = [Line2D([], [], label=LOOKS[s].label, **_sign(LOOKS[s], markers, lines)) for s in states]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), handlelength=2.6 if lines else 1.2)


def _sign(look: FigureLook, markers: bool, lines: bool) -> dict[str, Any]:
    sign = marks(look) | {"markersize": 3.2, "linewidth": 1.1}
    return sign | ({"linestyle": look.line} if lines else {}) | ({} if markers else {"marker": ""})


def per_pose(values: Array, pose: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Poses that were seen, and the rms of the values of each."""
    seen, place = np.unique(pose, return_inverse=True)
    return seen, np.sqrt(np.bincount(place, values**2) / np.bincount(place))


def rms(errors: Errors) -> float:
    """Of the norms of errors, in their unit."""
    return errors.statistics.rms


def opening(words: str) -> str:
    """Words as a sentence begins with them."""
    return words[:1].upper() + words[1:]


def quantity(errors: Errors) -> str:
    """What an axis of their norms says: `position error / mm`."""
    return f"{errors.title} / {errors.unit}"
