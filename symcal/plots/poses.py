"""The error of every pose, before and after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from symcal.calibration.evaluate import Errors
from symcal.plots.panels import (
    SHOWN,
    crowded,
    drawn,
    drawn_parts,
    drawn_words,
    dress,
    far_apart,
    legend,
    logarithmic,
    marker_size,
    opening,
    per_pose,
    places,
    rms,
    titles,
)
from symcal.plots.style import (
    LOOKS,
    PARTS,
    RULE,
    WIDE,
    Comparison,
    Illustration,
    grid,
    marks,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number

Array = NDArray[np.float64]


def errors_per_pose(
    errors: Comparison, labels: Mapping[str, Sequence[str]] | None = None, against: str = "noisy measurement"
) -> Illustration:
    """Error of every pose (rms over its points), and rotation angle where there is one, before and after.

    Args:
        errors: by part and state; `train` and `test` are drawn side by side in the order of the measurement.
        labels: names of the poses of each part, for the worst one. against: what the errors are taken against.
    """
    parts = drawn_parts(errors)
    everything = [e for part in parts for e in errors[part].values()]
    orientation = all(e.orientation is not None and len(e.orientation) == len(e.pose) for e in everything)
    judged = errors[parts[0]]["after"]
    with print_settings():
        figure = sheet(WIDE, 92 if orientation else 58)
        rows = list(figure.subplots(2 if orientation else 1, 1, sharex=True, squeeze=False)[:, 0])
        at = _panel(rows[0], errors, parts, _sizes, rms)
        rows[0].set_ylabel(f"{judged.title}{_together(everything)} / {judged.unit}")
        if orientation:
            _panel(rows[1], errors, parts, _orientation, _orientation_rms)
            rows[1].set_ylabel("orientation error / deg")
        for row in rows:
            dress(row, at, titles(errors, parts) if row is rows[0] else ())
        rows[-1].set_xlabel("pose, in the order of the measurement")
        figure.align_ylabels()
        legend(figure, [s for s in SHOWN if s in errors[parts[0]]], markers=True, lines=True)
    caption = _caption(errors, parts, orientation, labels or {}, against)
    return Illustration(settle(figure), "errors_per_pose", "Error of every pose", caption)


def _panel(
    axes: Axes,
    errors: Comparison,
    parts: list[str],
    values_of: Callable[[Errors], Array],
    rms_of: Callable[[Errors], float],
) -> list[Array]:
    counts = [len(values_of(errors[part]["after"])) for part in parts]
    at, size, cloud = places(counts), marker_size(counts), crowded(counts)
    lowest, highest = np.inf, 0.0
    for part, x in zip(parts, at, strict=True):
        values = {s: values_of(errors[part][s]) for s in SHOWN if s in errors[part]}
        half = 0.5 * (x[1] - x[0]) if len(x) > 1 else 0.01
        if "before" in values and not cloud:
            axes.vlines(x, values["after"], values["before"], color=RULE, linewidth=0.6, zorder=1)
        for state, found in values.items():
            look = LOOKS[state]
            if state != "offsets_only" or not cloud:
                # the outermost ring is the largest, so that states which coincide all show
                larger = 1.0 if state == "before" and not cloud else 0.0
                shown = drawn(found)
                axes.plot(x[shown], found[shown], **marks(look), markersize=size + larger, zorder=3)
            level = rms_of(errors[part][state])
            axes.hlines(level, x[0] - half, x[-1] + half, color=look.color, linestyle=look.line, linewidth=1, zorder=4)
            lowest, highest = min(lowest, float(np.percentile(found, 1))), max(highest, float(found.max()))
    if far_apart({s: values_of(errors[parts[-1]][s]) for s in errors[parts[-1]]}) and lowest > 0:
        axes.set_ylim(0.7 * lowest, 1.4 * highest)
        axes.set_yscale("log")
        logarithmic(axes.yaxis)
    else:
        axes.set_ylim(0, 1.06 * highest or 1.0)
    grid(axes)
    return at


def _together(everything: Sequence[Errors]) -> str:
    """Over what the error of a pose is an rms, if not one observation alone."""
    if any(errors.point.max() > 0 for errors in everything):
        return f",\nrms over {'axes' if everything[0].unit == 'deg' else 'points'}"
    return ",\nrms over instruments" if any(len(np.unique(e.pose)) < len(e.pose) for e in everything) else ""


def _sizes(errors: Errors) -> Array:
    return per_pose(errors.size, errors.pose)[1]


def _orientation(errors: Errors) -> Array:
    """Rotation angles by pose, deg; an instrument that reads attitudes gives one for each of its observations."""
    return np.zeros(0) if errors.orientation is None else np.rad2deg(per_pose(errors.orientation, errors.pose)[1])


def _orientation_rms(errors: Errors) -> float:
    return 0.0 if errors.orientation is None else float(np.rad2deg(np.sqrt(np.mean(errors.orientation**2))))


def _caption(
    errors: Comparison, parts: list[str], orientation: bool, labels: Mapping[str, Sequence[str]], against: str
) -> str:
    words = {"before": "before", "offsets_only": "with joint offsets only", "after": "after"}
    sentences = []
    for part in parts:
        shown = [s for s in SHOWN if s in errors[part]]
        values = [f"{number(rms(errors[part][s]))}" for s in shown]
        text = f"{' → '.join(values)} {errors[part]['after'].unit}"
        if orientation:
            text += f" and {' → '.join(number(_orientation_rms(errors[part][s])) for s in shown)} deg"
        sentences.append(f"{text} over the {PARTS[part]} poses")
    last = parts[-1]
    found = errors[last]["after"]
    worst = int(np.argmax(found.size))
    pose = int(found.pose[worst])
    label = labels[last][pose] if last in labels else str(pose + 1)
    counts = [len(_sizes(errors[part]["after"])) for part in parts]
    cloud = crowded(counts)
    only = " (of 'joint offsets only' nothing else is drawn)" if cloud else ""
    return (
        f"{opening(found.words)} against the {against}, pose by pose; horizontal lines are the rms{only}. "
        f"Rms {' → '.join(words[s] for s in SHOWN if s in errors[last])}: {'; '.join(sentences)}. The largest "
        f"{found.title} after the identification is {number(float(found.size[worst]))} {found.unit}, at {PARTS[last]} "
        f"pose '{label}'.{drawn_words(counts, 'poses')}"
    )
