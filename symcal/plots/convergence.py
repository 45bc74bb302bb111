"""How the identification came to its result."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator
from numpy.typing import NDArray

from symcal.calibration.evaluate import evaluate
from symcal.calibration.identify import Calibration
from symcal.data.dataset import Dataset
from symcal.model.model import State
from symcal.plots.style import BLUE, NARROW, ORANGE, PARTS, Illustration, grid, print_settings, settle, sheet
from symcal.words import number, plural

Array = NDArray[np.float64]


def convergence(calibration: Calibration, parts: Mapping[str, Dataset]) -> Illustration:
    """Rms position error after every accepted step.

    Args:
        parts: the measurements of `train`, and of `test` if there are any.
    """
    fit = calibration.after
    curves = {
        part: np.array([_rms(State(calibration.model, fit.setup, x), data) for x in fit.path])
        for part, data in parts.items()
        if part in ("train", "test") and len(data)
    }
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
        axes.set(xlabel="accepted step", ylabel="rms position error / mm")
        grid(axes)
        axes.legend(loc="upper right")
    train = curves["train"]
    fall = float(train[0] - train[-1])
    enough = int(np.argmax(train <= train[-1] + 0.01 * fall))
    kind = calibration.model.measurement.kind
    what = "position error" if kind.gives_point else kind.error_words
    caption = (
        f"Rms {what} over the training poses: {number(float(train[0]))} mm at the start (nominal, frames "
        f"fitted), {number(float(train[-1]))} mm after {plural(int(steps[-1]), 'accepted step')}"
        + (f", 99 % of the way after {enough}" if fall > 0 else "")
        + ". Steps go on over the rounds in which the noise and the size of the errors are found anew. "
        f"The last word: {fit.message}."
    )
    return Illustration(settle(figure), "convergence", "Convergence", caption)


def _rms(state: State, data: Dataset) -> float:
    return float(np.sqrt(np.mean(evaluate(state, data).position ** 2)))
