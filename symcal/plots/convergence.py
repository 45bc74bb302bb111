"""How the identification came to its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors, evaluate
from symcal.calibration.held_out_places import HeldOutPlaces, held_out_places
from symcal.data.dataset import Dataset
from symcal.model.model import State
from symcal.placing.placement import settled
from symcal.plots.panels import quantity, rms
from symcal.plots.style import BLUE, NARROW, ORANGE, PARTS, Illustration, grid, print_settings, settle, sheet
from symcal.words import number, plural


def convergence(
    calibration: Calibration, parts: Mapping[str, Dataset], places: HeldOutPlaces | None = None
) -> Illustration:
    """Rms error after every accepted step, over some of very many poses; places that only held-out poses tell are
    fitted to these at each.

    Args:
        parts: the measurements of `train`, and of `test` if there are any. places: what the held-out poses told of the
            identified state; found here when None.
    """
    fit = calibration.after
    places = places or held_out_places(calibration.states["after"], parts.get("test"))
    judging = {part: data.few() for part, data in parts.items() if part in ("train", "test") and len(data)}
    errors = {part: _along(calibration, data, places, held_out=part == "test") for part, data in judging.items()}
    curves = {part: np.array([rms(each) for each in path]) for part, path in errors.items()}
    last = errors["train"][-1]
    steps = np.arange(len(fit.path))
    lowest, highest = min(float(c.min()) for c in curves.values()), max(float(c.max()) for c in curves.values())
    with print_settings():
        figure = sheet(NARROW, 60)
        axes = figure.add_subplot()
        if "train" in curves:
            label = f"{PARTS['train']} poses"
            axes.plot(steps, curves["train"], color=BLUE, marker="o", markersize=2.6, label=label)
        if "test" in curves:
            axes.plot(
                steps,
                curves["test"],
                color=ORANGE,
                linestyle="--",
                marker="s",
                markersize=2.6,
                markerfacecolor="white",
                label=f"{PARTS['test']} poses",
            )
        axes.set_yscale("log")
        axes.set_ylim(max(lowest, 1e-15) / 1.25, max(highest, 1e-15) * 1.25)
        if highest < 30 * lowest:
            subs = (1.0, 2.0, 5.0) if highest > 4 * lowest else tuple(float(i) for i in range(1, 10))
            axes.yaxis.set_major_locator(LogLocator(subs=subs))
            axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
            axes.minorticks_off()
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="accepted step", ylabel=f"rms {quantity(last)}")
        grid(axes)
        axes.legend(loc="upper right")
    train = curves["train"]
    fall = float(train[0] - train[-1])
    enough = int(np.argmax(train <= train[-1] + 0.01 * fall))
    which = _which(parts["train"], judging["train"])
    caption = (
        f"Rms {last.title} over {which}: {number(float(train[0]))} {last.unit} at the start (nominal, "
        f"frames fitted), {number(float(train[-1]))} {last.unit} after {plural(int(steps[-1]), 'accepted step')}"
        + (f", 99 % of the way after {enough}" if fall > 0 else "")
        + ("; at each the places of the held-out poses are fitted to these anew" if places.settled else "")
        + ". Steps go on over the rounds in which the noise and the size of the errors are found anew. "
        f"The last word: {fit.message}."
    )
    return Illustration(settle(figure), "convergence", "Convergence", caption)


def _which(train: Dataset, judging: Dataset) -> str:
    if len(judging) == len(train):
        return "the training poses"
    return f"{len(judging)} of the {len(train)} training poses, evenly spread"


def _along(calibration: Calibration, data: Dataset, places: HeldOutPlaces, *, held_out: bool) -> list[Errors]:
    """Errors on these poses at the start and after every accepted step."""
    fit, unplaced = calibration.after, calibration.states["after"].unplaced
    states = [State(calibration.model, fit.setup, x, unplaced) for x in fit.path]
    if not (held_out and places.settled):
        return [evaluate(state, data) for state in states]
    fitted = sum(name in o.names for o in calibration.model.task.judged_by for name in places.settled)
    near = places.state.setup
    return [replace(evaluate(settled(state, data, near), data), fitted=fitted) for state in states]
