"""Whether the errors are as large as the identification itself expects."""

from __future__ import annotations

import numpy as np
import scipy
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors, expected_position_rms
from symcal.data.dataset import Dataset
from symcal.plots.panels import marker_size, per_pose
from symcal.plots.style import BLUE, FAINT, INK, NARROW, VERMILION, Illustration, grid, print_settings, settle, sheet
from symcal.words import number, plural

Array = NDArray[np.float64]


def predicted_error(calibration: Calibration, data: Dataset, after: Errors) -> Illustration:
    """Realised position error of held-out poses over the predicted one, with the noise of the measurement in both.

    Of all instruments that give points, at the poses that they have read.

    Predicted is sqrt(tr(J C J^T) + tr Sigma) per point. The 95 % limit takes the components as independent and alike
    and the noise as known with the degrees of freedom of the fit (Fisher's F in place of chi-squared), which is ours.

    Args:
        data: held-out measurements. after: the errors of the identified robot on them.
    """
    fit = calibration.after
    poses, realised = per_pose(after.size, after.pose)
    expected = expected_position_rms(calibration.model, fit, data.q[poses])
    predicted = np.sqrt(expected**2 + _noise(calibration, data.take(poses), after.vectors.shape[1]) ** 2)
    components = after.vectors.shape[1] * np.bincount(np.unique(after.pose, return_inverse=True)[1])
    limit = np.sqrt(scipy.special.fdtri(components, max(fit.dof, 1.0), 0.95))
    inside = realised <= predicted * limit
    with print_settings():
        figure = sheet(NARROW, 60)
        axes = figure.add_subplot()
        low, high = float(predicted.min()), float(predicted.max())
        margin = 0.06 * (high - low) or 0.05 * high
        line = np.array([low - margin, high + margin])
        axes.plot(line, line, color=INK, linewidth=0.8, label="as predicted (rms)")
        axes.plot(
            line,
            line * float(np.median(limit)),
            color=FAINT,
            linewidth=0.8,
            linestyle="--",
            label="95 % should be below",
        )
        axes.plot(
            predicted[inside],
            realised[inside],
            linestyle="none",
            marker="o",
            color=BLUE,
            markersize=marker_size([len(poses)]),
        )
        axes.plot(
            predicted[~inside],
            realised[~inside],
            linestyle="none",
            marker="D",
            color=VERMILION,
            markerfacecolor="white",
            markersize=2.8,
        )
        axes.set_xlim(line[0], line[1])
        axes.set_ylim(0, 1.15 * max(float(realised.max()), float((line * np.median(limit)).max())))
        axes.set(xlabel="predicted rms position error / mm", ylabel="measured error / mm")
        axes.xaxis.set_major_locator(MaxNLocator(nbins=5))
        grid(axes, "both")
        axes.legend(loc="upper left", fontsize=6)
    rms, hoped, alone = (number(float(np.sqrt(np.mean(v**2)))) for v in (realised, predicted, expected))
    share = number(100 * float(inside.mean()), 2)
    caption = (
        f"Measured against predicted position error of {plural(len(poses), 'held-out pose')}: {share} % are below the "
        f"95 % limit, and the rms is {rms} mm where {hoped} mm was predicted. Of that, the uncertainty of the "
        f"parameters alone makes {alone} mm; the rest is noise as the training data show it."
    )
    return Illustration(settle(figure), "predicted_error", "Predicted and measured error", caption)


def _noise(calibration: Calibration, data: Dataset, size: int) -> Array:
    """Rms norm of the noise of what has been read of points, per point of ``size`` components, shape (N,), mm."""
    measurement = calibration.model.measurement
    judged = {o.of: o.instrument.error[0] for o in measurement.observations if o.instrument.gives_point}
    groups = [group for group in measurement.groups if group.quantity == judged.get(group.observation)]
    columns = [column for group in groups for column in group.columns]
    found = [calibration.after.sigmas.get(group.name, np.nan) for group in groups for _ in group.columns]
    sigma = np.tile(found, (len(data), 1))
    if data.sigma is not None:
        given = data.sigma[:, columns]
        sigma = np.where(np.isfinite(given), given, sigma)
    seen = np.hstack([part.seen(data.z) for part in measurement.parts])[:, columns]
    return np.asarray(np.sqrt(size * np.nanmean(np.where(seen, sigma, np.nan) ** 2, axis=1)))
