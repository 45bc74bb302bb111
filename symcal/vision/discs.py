"""Disc-like blobs in a grey image: roughly where the discs of a target may be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.vision.outlines import sample

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

_LEVELS = 16
_SMOOTHING_PX = 1.2


@dataclass(frozen=True, slots=True)
class Blob:
    """An elliptic region with one edge all around.

    Attributes:
        center: of its ellipse, px, to some tenths.
        minor, major: semi-axes, px.
        bright: lighter than its surroundings.
        hole: its middle is as its surroundings.
        misfit_px: largest distance between the edge and the ellipse.
    """

    center: tuple[float, float]
    minor: float
    major: float
    bright: bool
    hole: bool
    misfit_px: float

    @property
    def area(self) -> float:
        """Area of the ellipse, px^2."""
        return float(np.pi * self.minor * self.major)


def find_blobs(
    image: Float32, box: tuple[int, int, int, int], areas: tuple[float, float], contrast: float
) -> list[Blob]:
    """Ellipses whose edge shows at one of several thresholds; each once, of the middle size; the best fitting first.

    Args:
        image: grey levels, shape (height, width).
        box: first and last-but-one column and row to look at.
        areas: smallest and largest, px^2.
        contrast: smallest spread of grey levels in the box worth a look.
    """
    left, top, right, bottom = box
    smooth = np.asarray(cv2.GaussianBlur(image[top:bottom, left:right], (0, 0), _SMOOTHING_PX), dtype=np.float32)
    low, high = float(smooth.min()), float(smooth.max())
    if high - low < contrast:
        return []
    found: list[Blob] = []
    for level in low + (high - low) * (np.arange(_LEVELS) + 0.5) / _LEVELS:
        mask = (smooth > level).astype(np.uint8)
        contours, hierarchy = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        if hierarchy is None:
            continue
        shortest = 2 * np.sqrt(np.pi * areas[0]) * 0.7
        for contour, (_, _, _, parent) in zip(contours, hierarchy.reshape(-1, 4), strict=True):
            if len(contour) >= shortest:
                blob = _ellipse(np.asarray(contour[:, 0], dtype=np.float32), parent < 0, smooth, areas)
                if blob is not None:
                    found.append(blob)
    groups: list[list[Blob]] = []
    for blob in sorted(found, key=lambda b: b.misfit_px / b.minor):
        group = next((group for group in groups if _concentric(blob, group[0])), None)
        if group is None:
            groups.append([blob])
        else:
            group.append(blob)
    middle = [sorted(group, key=lambda b: b.area)[len(group) // 2] for group in groups]
    return [replace(b, center=(b.center[0] + left, b.center[1] + top)) for b in middle]


def _ellipse(contour: Float32, bright: bool, patch: Float32, areas: tuple[float, float]) -> Blob | None:
    """The blob inside a contour, or None if that is no whole ellipse of a likely size."""
    height, width = patch.shape
    if contour.min() <= 1 or contour[:, 0].max() >= width - 2 or contour[:, 1].max() >= height - 2:
        return None
    area = float(cv2.contourArea(contour))
    if not 0.8 * areas[0] <= area <= 1.25 * areas[1]:
        return None
    center, diameters, angle = cv2.fitEllipse(contour)
    axes = np.array(diameters) / 2
    if not (np.all(np.isfinite(axes)) and axes.min() > 1 and areas[0] <= np.pi * axes[0] * axes[1] <= areas[1]):
        return None
    turn = np.deg2rad(angle)
    across = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    unit = (contour - center) @ across.T / axes
    misfit = float(np.abs(np.linalg.norm(unit, axis=1) - 1).max() * axes.min())
    if misfit > max(1.5, 0.06 * float(axes.min())):
        return None
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = (np.stack([np.cos(around), np.sin(around)], axis=1) * axes) @ across
    middle, rim, outside = (float(np.median(sample(patch, center + s * ring))) for s in (0.2, 0.75, 1.3))
    hole = abs(middle - rim) > abs(middle - outside)
    return Blob((float(center[0]), float(center[1])), float(axes.min()), float(axes.max()), bright, hole, misfit)


def _concentric(a: Blob, b: Blob) -> bool:
    """Whether two blobs are one edge seen at two thresholds."""
    distance = np.hypot(a.center[0] - b.center[0], a.center[1] - b.center[1])
    return bool(distance < 0.3 * min(a.minor, b.minor) and a.bright == b.bright)
