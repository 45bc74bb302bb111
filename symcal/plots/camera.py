"""Figures of a camera calibration: where the board was seen, how well it fits, and how far to believe the camera."""

from __future__ import annotations

import numpy as np

from symcal.plots.style import (
    BLUE,
    INK,
    NARROW,
    VERMILION,
    WIDE,
    Illustration,
    escaped,
    grid,
    over_image,
    print_settings,
    settle,
    sheet,
)
from symcal.vision.calibrate import CameraCalibration
from symcal.words import number, plural

_LABELLED = 30  # views whose names still fit under their bars


def camera_figures(calibration: CameraCalibration) -> tuple[Illustration, ...]:
    """Coverage, reprojection errors of points and of views, and the error to expect over the image."""
    return coverage(calibration), reprojection(calibration), view_errors(calibration), projection_error(calibration)


def coverage(calibration: CameraCalibration) -> Illustration:
    """Every point of the board that the calibration rests on, and the empty cells of the image."""
    camera, used = calibration.camera, calibration.used
    points = np.concatenate([view.pixels for view in used])
    counts = calibration.coverage
    rows, columns = counts.shape
    with print_settings():
        figure = sheet(NARROW, NARROW * camera.height / camera.width + 8)
        axes = figure.add_subplot()
        axes.plot(points[:, 0], points[:, 1], linestyle="none", marker=".", markersize=1.2, color=BLUE, zorder=3)
        for row, column in np.argwhere(counts == 0):
            axes.fill(
                (np.array([column, column + 1, column + 1, column]) / columns) * camera.width - 0.5,
                (np.array([row, row, row + 1, row + 1]) / rows) * camera.height - 0.5,
                facecolor="none",
                edgecolor=VERMILION,
                hatch="////",
                linewidth=0,
                zorder=1,
            )
        over_image(axes, camera.width, camera.height)
    empty = int((counts == 0).sum())
    caption = (
        f"{len(points)} points of the board in {plural(len(used), 'view')}; "
        f"{empty} of {counts.size} cells of the image (hatched) have none: what the camera does there is extrapolated."
        if empty
        else f"{len(points)} points of the board in {plural(len(used), 'view')}; every one of {counts.size} cells of "
        "the image has some."
    )
    return Illustration(settle(figure), "coverage", "Coverage of the image", caption)


def reprojection(calibration: CameraCalibration) -> Illustration:
    """Measured minus projected image points of all views used."""
    residuals = np.concatenate([view.residuals for view in calibration.used])
    limit = 1.1 * float(np.percentile(np.abs(residuals), 99.8))
    outside = int((np.abs(residuals) > limit).any(axis=1).sum())
    with print_settings():
        figure = sheet(NARROW, 78)
        axes = figure.add_subplot()
        axes.plot(residuals[:, 0], residuals[:, 1], linestyle="none", marker=".", markersize=1.4, color=BLUE)
        axes.axhline(0, color=INK, linewidth=0.5)
        axes.axvline(0, color=INK, linewidth=0.5)
        axes.set_xlim(-limit, limit)
        axes.set_ylim(limit, -limit)
        axes.set_aspect("equal")
        axes.set(xlabel="error in u / px", ylabel="error in v / px")
        grid(axes, "both")
    sigma = residuals.std(axis=0)
    caption = (
        f"Measured minus projected points of all views used: standard deviation {number(float(sigma[0]), 2)} px in u "
        f"and {number(float(sigma[1]), 2)} px in v"
        + (f"; {plural(outside, 'point')} beyond the frame" if outside else "")
        + ". A cloud that is not round, or stripes, would be an effect that the model lacks."
    )
    return Illustration(settle(figure), "reprojection", "Reprojection errors", caption)


def view_errors(calibration: CameraCalibration) -> Illustration:
    """Rms error and tilt of every view, used or not."""
    views = calibration.views
    at = np.arange(len(views))
    rms = np.array([view.rms_px for view in views])
    used = np.array([view.used for view in views])
    with print_settings():
        figure = sheet(WIDE, 62)
        axes = figure.add_subplot()
        axes.bar(at[used], rms[used], color=BLUE, width=0.7, label="used")
        if not used.all():
            axes.bar(
                at[~used], rms[~used], color="white", edgecolor=VERMILION, hatch="////", width=0.7, label="not used"
            )
        axes.set_ylabel("rms error / px")
        axes.set_ylim(0, 1.25 * float(rms.max()))
        axes.set_xticks(at if len(views) <= _LABELLED else [])
        if len(views) <= _LABELLED:
            axes.set_xticklabels([escaped(view.name) for view in views], rotation=60, ha="right", fontsize=5)
        tilts = axes.twinx()
        degrees = np.rad2deg([view.tilt for view in views])
        tilts.plot(at, degrees, linestyle="none", marker="D", color=INK, markerfacecolor="white", label="tilt")
        tilts.set_ylim(0, 90)
        tilts.set_ylabel("tilt of the board / deg (diamonds)")
        grid(axes)
        axes.legend(loc="upper left", ncols=2)
    worst = views[int(np.argmax(rms))]
    caption = (
        f"Rms reprojection error of every view, and the tilt of the board (diamonds): {number(float(rms.min()), 2)} to "
        f"{number(float(rms.max()), 2)} px, the largest in '{worst.name}'; tilts from "
        f"{number(float(degrees.min()), 2)} to {number(float(degrees.max()), 2)} deg."
    )
    return Illustration(settle(figure), "view_errors", "Error of every view", caption)


def projection_error(calibration: CameraCalibration) -> Illustration:
    """Error to expect of a projected point over the image, from the covariance of the intrinsics."""
    camera, sigma = calibration.camera, calibration.sigma_map
    with print_settings():
        figure = sheet(NARROW, NARROW * camera.height / camera.width + 8)
        axes = figure.add_subplot()
        frame = (-0.5, camera.width - 0.5, camera.height - 0.5, -0.5)
        drawn = axes.imshow(sigma, extent=frame, cmap="Blues", vmin=0, interpolation="nearest")
        bar = figure.colorbar(drawn, ax=axes, shrink=0.75)
        bar.set_label("standard deviation / px")
        axes.set(xlabel="u / px", ylabel="v / px")
    caption = (
        f"Error to expect of the image of a far point, from the covariance of the camera's numbers: "
        f"{number(float(np.nanmin(sigma)), 2)} to {number(float(np.nanmax(sigma)), 2)} px (1 sigma), the rotation that "
        "hides most of it taken out."
    )
    return Illustration(settle(figure), "projection_error", "Error to expect", caption)
