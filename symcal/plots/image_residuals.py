"""What an identification leaves in the image of each camera: over the image, and view by view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.camera.camera import Camera
from symcal.data.dataset import Dataset
from symcal.fit.residual_rows import rows_of
from symcal.model.measurement import Part
from symcal.plots.style import (
    BLUE,
    FAINT,
    INK,
    VERMILION,
    WIDE,
    Illustration,
    grid,
    over_image,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number, plural

Array = NDArray[np.float64]

_DRAWN = 2000  # vectors of single points, beyond which an even choice of them is drawn
_CELLS = 14  # along the longer side of the image, over which the mean is taken
_FEWEST = 5  # points of a cell that have a mean worth showing
_LENGTH = 0.05  # of the image's width: a vector of the rms residual


def image_residuals(calibration: Calibration, data: Dataset) -> tuple[Illustration, ...]:
    """A figure for each camera that reads many points: residual vectors over its image, and the rms of every view.

    Args:
        data: the measurements with their splits; those in use are drawn.
    """
    model, after = calibration.model, calibration.states["after"]
    parts = [part for part in model.measurement.parts if part.staged is not None and part.observation.instrument.camera]
    if not parts:
        return ()
    used = data.used
    r = rows_of(model.measurement, used, after.setup, model.residuals).residual(after.x)
    return tuple(_of_camera(part, used, r, alone=len(parts) == 1) for part in parts if part.seen(used.z).any())


def _of_camera(part: Part, data: Dataset, r: Array, *, alone: bool) -> Illustration:
    camera, name = part.observation.instrument.camera, part.observation.name
    assert camera is not None
    seen: NDArray[np.bool_] = np.asarray(part.seen(data.z).reshape(len(data), part.features, 2).all(axis=2))
    pixels = data.z[:, part.readings].reshape(len(data), part.features, 2)
    off = -r[:, part.components].reshape(len(data), part.features, 2)  # measured minus model, as it is seen
    count = seen.sum(axis=1)
    views = np.flatnonzero(count)
    rms = np.sqrt(np.sum(np.where(seen[..., None], off, 0.0) ** 2, axis=(1, 2))[views] / count[views])
    at, vectors = pixels[seen], off[seen]
    overall = float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
    with print_settings():
        figure = sheet(WIDE, 74)
        over, bars = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
        scale = overall / (_LENGTH * camera.width)
        few = np.linspace(0, len(at) - 1, min(len(at), _DRAWN)).astype(int)
        lines = np.stack([at[few], at[few] + vectors[few] / max(scale, 1e-12), np.full((len(few), 2), np.nan)], axis=1)
        over.plot(*lines.reshape(-1, 2).T, color=FAINT, linewidth=0.25)
        where, mean = _cells(camera, at, vectors)
        if len(where):
            over.quiver(
                *where.T,
                *mean.T,
                angles="xy",
                scale_units="xy",
                scale=max(scale, 1e-12),
                color=VERMILION,
                width=0.003,
                zorder=3,
            )
        over_image(over, camera.width, camera.height)
        test = np.array([data.split[i] == "test" for i in views])
        place = np.arange(len(views))
        bars.bar(place[~test], rms[~test], color=BLUE, width=0.75, label="training")
        if test.any():
            bars.bar(place[test], rms[test], color="white", edgecolor=BLUE, linewidth=0.5, width=0.75, label="held-out")
            bars.legend(loc="upper left", ncols=2)
        bars.axhline(overall, color=INK, linewidth=0.6, linestyle="--")
        bars.set(xlabel="view, in the order of the measurement", ylabel="rms residual / px")
        bars.set_ylim(0, 1.25 * float(rms.max()))
        bars.set_xticks([])
        grid(bars)
    worst = views[int(np.argmax(rms))]
    largest = float(np.linalg.norm(mean, axis=1).max()) if len(where) else 0.0
    caption = (
        f"Left: measured minus modelled image points of {plural(len(views), 'view')} after the identification (grey, "
        f"{plural(len(at), 'point')}, rms {number(overall, 2)} px, drawn as long as a twentieth of the image), and "
        f"their mean over cells of the image (orange, at most {number(largest, 2)} px): a pattern would be a lens that "
        f"the model lacks. Right: rms of every view, {number(float(rms.min()), 2)} to {number(float(rms.max()), 2)} "
        f"px, the largest in '{data.labels[worst]}'; {int(count[views].min())} to {int(count[views].max())} of "
        f"{part.features} points were seen."
    )
    title = "Residuals over the image" if alone else f"Residuals over the image of {name}"
    return Illustration(settle(figure), f"image_residuals_{name}", title, caption)


def _cells(camera: Camera, at: Array, vectors: Array) -> tuple[Array, Array]:
    """Centres of the cells of the image that have points enough, and the mean vector there, shape (k, 2) each."""
    size = max(camera.width, camera.height) / _CELLS
    cell = np.floor(at / size).astype(int)
    labels, which = np.unique(cell, axis=0, return_inverse=True)
    which = which.ravel()
    count = np.bincount(which)
    mean = np.stack([np.bincount(which, vectors[:, i]) / count for i in (0, 1)], axis=1)
    kept = count >= _FEWEST
    return (labels[kept] + 0.5) * size, mean[kept]
