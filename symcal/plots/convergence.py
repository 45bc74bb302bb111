"""How the identification came to its result."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator
from numpy.typing import NDArray

from symcal.dataset import Dataset
from symcal.evaluate import evaluate
from symcal.identify import Calibration, State
from symcal.plots.style import NARROW, PARTS, Illustration, grid, print_settings, settle, sheet
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
    with print_settings():
        figure = sheet(NARROW, 62)
        axes = figure.add_subplot()
        for part, style in (
            ("train", {"color": "#00517F", "marker": "o", "linestyle": "-"}),
            ("test", {"color": "#E69F00", "marker": "s", "linestyle": "--", "markerfacecolor": "white"}),
        ):
            if part in curves:
                axes.plot(steps, curves[part], label=f"{PARTS[part]} poses", markersize=2.6, **style)
        lowest, highest = min(float(c.min()) for c in curves.values()), max(float(c.max()) for c in curves.values())
        axes.set_yscale("log")
        axes.set_ylim(max(lowest, 1e-15) / 1.25, max(highest, 1e-15) * 1.25)
        if highest < 30 * lowest:
            axes.yaxis.set_major_locator(
                LogLocator(subs=(1.0, 2.0, 5.0) if highest > 4 * lowest else tuple(range(1, 10)))
            )
            axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
            axes.yaxis.set_minor_formatter(FuncFormatter(lambda *_: ""))
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set(xlabel="accepted step", ylabel="rms position error / mm")
        grid(axes)
        axes.legend(loc="upper right")
    train = curves["train"]
    fall = train[0] - train[-1]
    enough = int(np.argmax(train <= train[-1] + 0.01 * fall)) if fall > 0 else 0
    caption = (
        f"Rms position error over the training poses: {number(float(train[0]))} mm at the start (nominal, frames fitted), {number(float(train[-1]))} mm "
        f"after {plural(int(steps[-1]), 'accepted step')}"
        + (f"; 99 % of the way is done after {enough}" if fall > 0 else "")
        + f". The solver {fit.solution.message}."
    )
    return Illustration(settle(figure), "convergence", "Convergence", caption)


def _rms(state: State, data: Dataset) -> float:
    return float(np.sqrt(np.mean(evaluate(state, data).position ** 2)))
