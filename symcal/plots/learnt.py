"""What was learnt: how much of the uncertainty about each parameter the measurements took away."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.plots.parameters import in_rows
from symcal.plots.style import BLUE, FAINT, INK, WIDE, Illustration, escaped, print_settings, settle, sheet
from symcal.words import MOSTLY, is_term_number, listed, percent, symbol

Array = NDArray[np.float64]

_GAP = 0.9  # between groups, in bars
_MOST_NAMED = 8
_CROWDED = 32


def what_was_learnt(calibration: Calibration) -> Illustration:
    """Share learnt of every free parameter of links and joint terms, 0 to 100 %, in groups of one kind.

    Filled: learnt, empty: assumed.

    Raises:
        ValueError: no link parameter is free.
    """
    known = calibration.after.posterior
    share = dict(zip(known.names, known.learnt.tolist(), strict=True))
    robot = calibration.model.robot
    names = [name for name in robot.parameters if name in share]
    if not names:
        raise ValueError("no link parameter is free")
    groups = {name: p.group for name, p in robot.term_parameters.items()}
    links = [name for name in names if name not in groups]
    rows = [*([links] if links else []), *in_rows([name for name in names if name in groups], robot)]
    with print_settings():
        figure = sheet(WIDE, 44 * len(rows) + 8 * (len(rows) - 1))
        for axes, row in zip(figure.subplots(len(rows), 1, squeeze=False)[:, 0], rows, strict=True):
            _bars(axes, row, [groups.get(name, name.partition("_")[0]) for name in row], share)
        handles = [
            Patch(facecolor=BLUE, edgecolor=BLUE, label="learnt from the data"),
            Patch(facecolor="white", edgecolor=FAINT, linewidth=0.5, label="still assumed"),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return Illustration(settle(figure), "learnt", "What was learnt", _caption(names, share))


def _bars(axes: Axes, names: list[str], kinds: list[str], share: dict[str, float]) -> None:
    at, values = _places(kinds), 100 * np.array([share[name] for name in names])
    wordy = any(is_term_number(name) for name in names)
    axes.bar(at, 100.0, width=0.72, facecolor="white", edgecolor=FAINT, linewidth=0.5, zorder=2)
    axes.bar(at, values, width=0.72, color=BLUE, zorder=3)
    axes.axhline(100 * MOSTLY, color=INK, linewidth=0.6, linestyle="--", zorder=1)
    axes.set_xlim(at[0] - 1, at[-1] + 1)
    axes.set_ylim(0, 103)
    axes.set_yticks(range(0, 101, 25))
    labels = [escaped(symbol(name)) for name in names]
    axes.set_xticks(at, labels, fontsize=5.5 if len(names) > _CROWDED else 7, rotation=90 if wordy else 0)
    axes.tick_params(axis="x", length=0)
    axes.set_ylabel("learnt / %")


def _places(kinds: list[str]) -> Array:
    """Where the bars stand: one apart, with a gap where the kind of parameter changes; shape (n,)."""
    new = np.array([0.0, *(a != b for a, b in zip(kinds[1:], kinds[:-1], strict=True))])
    return np.asarray(np.arange(len(kinds)) + _GAP * np.cumsum(new))


def _caption(names: list[str], share: dict[str, float]) -> str:
    assumed = [name for name in names if share[name] < MOSTLY]
    of = "parameter of links and joint terms" if any(map(is_term_number, names)) else "link parameter"
    caption = (
        f"How much of the uncertainty (variance) about each free {of} the measurements took away. 0 %: they "
        "say nothing about it, and it keeps its nominal value; 75 %: its standard deviation is half of what was "
        f"plausible before; 100 %: all of it comes from the data. {len(names) - len(assumed)} of {len(names)} were "
        "mostly learnt (dashed: half)"
    )
    if assumed:
        foremost = sorted(assumed, key=lambda name: round(share[name], 3))[:_MOST_NAMED]
        called = "the others" if len(foremost) == len(assumed) else "least of all"
        caption += f"; {called}: {listed([f'{symbol(name)} ({percent(share[name])})' for name in foremost])}"
    return caption + ". Frames are left out: nothing was assumed about them."
