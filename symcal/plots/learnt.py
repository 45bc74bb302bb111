"""What was learnt: how much of the uncertainty about each parameter the measurements took away."""

from __future__ import annotations

import numpy as np
from matplotlib.patches import Patch
from numpy.typing import NDArray

from symcal.calibration.identify import Calibration
from symcal.plots.style import BLUE, FAINT, INK, WIDE, Illustration, escaped, print_settings, settle, sheet
from symcal.words import MOSTLY, listed, percent, symbol

Array = NDArray[np.float64]

_GAP = 0.9  # between groups, in bars
_MOST_NAMED = 8


def what_was_learnt(calibration: Calibration) -> Illustration:
    """Share learnt of every free link parameter, 0 to 100 %, in groups of one kind; filled: learnt, empty: assumed.

    Raises:
        ValueError: no link parameter is free.
    """
    known = calibration.after.posterior
    share = dict(zip(known.names, known.learnt.tolist(), strict=True))
    names = [name for name in calibration.model.robot.parameters if name in share]
    if not names:
        raise ValueError("no link parameter is free")
    at, values = _places(names), 100 * np.array([share[name] for name in names])
    crowded = len(names) > 32
    with print_settings():
        figure = sheet(WIDE, 44)
        axes = figure.add_subplot()
        axes.bar(at, 100.0, width=0.72, facecolor="white", edgecolor=FAINT, linewidth=0.5, zorder=2)
        axes.bar(at, values, width=0.72, color=BLUE, zorder=3)
        axes.axhline(100 * MOSTLY, color=INK, linewidth=0.6, linestyle="--", zorder=1)
        axes.set_xlim(at[0] - 1, at[-1] + 1)
        axes.set_ylim(0, 103)
        axes.set_yticks(range(0, 101, 25))
        axes.set_xticks(at, [escaped(symbol(name)) for name in names], fontsize=5.5 if crowded else 7)
        axes.tick_params(axis="x", length=0)
        axes.set_ylabel("learnt / %")
        handles = [
            Patch(facecolor=BLUE, edgecolor=BLUE, label="learnt from the data"),
            Patch(facecolor="white", edgecolor=FAINT, linewidth=0.5, label="still assumed"),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return Illustration(settle(figure), "learnt", "What was learnt", _caption(names, share))


def _places(names: list[str]) -> Array:
    """Where the bars stand: one apart, with a gap where the kind of parameter changes; shape (n,)."""
    kinds = [name.partition("_")[0] for name in names]
    new = np.array([0.0, *(a != b for a, b in zip(kinds[1:], kinds[:-1], strict=True))])
    return np.asarray(np.arange(len(names)) + _GAP * np.cumsum(new))


def _caption(names: list[str], share: dict[str, float]) -> str:
    assumed = [name for name in names if share[name] < MOSTLY]
    caption = (
        "How much of the uncertainty (variance) about each free link parameter the measurements took away. 0 %: they "
        "say nothing about it, and it keeps its nominal value; 75 %: its standard deviation is half of what was "
        f"plausible before; 100 %: all of it comes from the data. {len(names) - len(assumed)} of {len(names)} were "
        "mostly learnt (dashed: half)"
    )
    if assumed:
        foremost = sorted(assumed, key=lambda name: round(share[name], 3))[:_MOST_NAMED]
        called = "the others" if len(foremost) == len(assumed) else "least of all"
        caption += f"; {called}: {listed([f'{symbol(name)} ({percent(share[name])})' for name in foremost])}"
    return caption + ". Frames are left out: nothing was assumed about them."
