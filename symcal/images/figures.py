"""Figures of a measurement with a camera: some of its images, and what different ways make of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import FuncFormatter

from symcal.calibration.evaluate import Errors
from symcal.images.examples import Example
from symcal.images.run import ImageRun
from symcal.plots.style import (
    BLUE,
    GREEN,
    NARROW,
    ORANGE,
    VERMILION,
    WIDE,
    Illustration,
    escaped,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number, plural

_WAYS = {
    "pixels": ("pixels", BLUE, "-"),
    "p3p_covariance": ("P3P, full covariance", GREEN, "-."),
    "p3p_points": ("P3P, three points", ORANGE, ":"),
    "p3p": ("P3P, centroid", VERMILION, "--"),
}


def image_figures(run: ImageRun) -> tuple[Illustration, ...]:
    """What there is to show of a run with a camera."""
    figures = []
    if run.way_errors:
        figures.append(ways_compared(run.way_errors))
    if run.images is not None and run.images.examples:
        figures.append(example_images(run.images.examples))
    return tuple(figures)


def example_images(examples: Sequence[Example]) -> Illustration:
    """Images with what was found in them."""
    columns = min(len(examples), 2)
    rows = -(-len(examples) // columns)
    height, width = np.max([example.image.shape for example in examples], axis=0)
    with print_settings():
        figure = sheet(WIDE, rows * (WIDE / columns * height / width + 7))
        for i, example in enumerate(examples):
            axes = figure.add_subplot(rows, columns, i + 1)
            height, width = example.image.shape
            step = max(1, width // 900)
            frame = (-0.5, width - 0.5, height - 0.5, -0.5)
            axes.imshow(example.image[::step, ::step], cmap="gray", vmin=0, vmax=255, extent=frame)
            marks: dict[str, Any] = {
                "linestyle": "none",
                "marker": "+",
                "markersize": 4 if example.labels else 3,
                "color": VERMILION,
            }
            axes.plot(example.pixels[:, 0], example.pixels[:, 1], **marks)
            for (u, v), label in zip(example.pixels, example.labels, strict=False):
                axes.annotate(escaped(label), (u, v), xytext=(5, 4), textcoords="offset points", color=VERMILION)
            axes.set_axis_off()
            axes.set_title(escaped(example.name))
    caption = f"{plural(len(examples), 'image')} of this run; crosses are the points that were found in them."
    return Illustration(settle(figure), "example_images", "Images", caption)


def ways_compared(errors: Mapping[str, Errors]) -> Illustration:
    """Share of the unseen poses below an error, for each way to identify from the same images."""
    rms = {name: float(np.sqrt(np.mean(errors[name].size ** 2))) for name in _WAYS if name in errors}
    with print_settings():
        figure = sheet(NARROW, 66)
        axes = figure.add_subplot()
        for name in rms:
            label, color, line = _WAYS[name]
            values = np.sort(errors[name].size)
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            axes.plot(values, share, color=color, linestyle=line, label=label)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_ylim(0, 100)
        axes.set(xlabel="position error of the target's centre / mm", ylabel="poses below / %")
        grid(axes, "both")
        axes.legend(loc="upper left", fontsize=5.5)
    count = len(errors["pixels"].size)
    listed = ", ".join(f"{_WAYS[name][0]} {number(value)} mm" for name, value in rms.items())
    caption = (
        f"Position error at {plural(count, 'unseen pose')} against the truth, after one rigid alignment, by way of "
        f"identification from the same images. Rms: {listed}."
    )
    return Illustration(settle(figure), "ways_compared", "Ways to use the images", caption)
