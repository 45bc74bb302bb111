"""Is a camera calibration good enough, and if not, what should be photographed again? All limits here are ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera, rays
from symcal.vision.calibrate import CameraCalibration, View, outliers
from symcal.vision.corners import is_flat

Grade = Literal["good", "usable", "poor"]

GOOD_RMS_PX, POOR_RMS_PX = 0.5, 1.5
GOOD_FOCAL, POOR_FOCAL = 1e-3, 1e-2
"""Relative standard deviation of the focal length."""
GOOD_SIGMA_PX, POOR_SIGMA_PX = 0.5, 3.0
"""Error to expect of a projected point in the worst covered cell."""
FEWEST_VIEWS = 8
TILT = np.deg2rad(20.0)
TILTED_VIEWS = 3
BLUR_FACTOR, BLUR_PX = 1.8, 1.8
"""A view is blurred when its edges are wider than this multiple of the median, and than this sigma."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The calibration in words.

    Attributes:
        grade: good; usable (works, with the findings in mind); poor (photograph again before measuring).
        summary: one sentence. findings: what keeps it from being good, and what to do about it.
        retake: (view, why) of single images to be taken again.
    """

    grade: Grade
    summary: str
    findings: tuple[str, ...]
    retake: tuple[tuple[str, str], ...]


def judge(calibration: CameraCalibration) -> Verdict:
    """Grade a camera calibration and name the views to take again."""
    camera, used = calibration.camera, calibration.used
    findings: list[str] = []
    poor = False
    rms = camera.rms_px or 0.0
    if rms > GOOD_RMS_PX:
        poor |= rms > POOR_RMS_PX
        findings.append(
            f"the reprojection error of {rms:.2f} px is above {GOOD_RMS_PX:g} px: is the board flat, rigid and sharp, "
            "and does the lens have more distortion than the model (fisheye)?"
        )
    focal = float(max(calibration.sigma[0] / camera.fx, calibration.sigma[1] / camera.fy))
    if focal > GOOD_FOCAL:
        poor |= focal > POOR_FOCAL
        findings.append(
            f"the focal length is only known to {focal:.2%} (1 sigma, good is {GOOD_FOCAL:.1%}): "
            "take more views, tilted by 30 to 45 deg"
        )
    covered = calibration.sigma_map[calibration.coverage > 0]
    worst = float(np.nanmax(covered)) if covered.size else np.inf
    if worst > GOOD_SIGMA_PX:
        poor |= worst > POOR_SIGMA_PX
        findings.append(f"projected points are uncertain by up to {worst:.2f} px (1 sigma) where the board was seen")
    flat = is_flat(calibration.board.points)
    if flat and len(used) < FEWEST_VIEWS:
        findings.append(f"only {len(used)} views were used: take at least {FEWEST_VIEWS}, better 15 to 20")
    tilted = sum(view.tilt > TILT for view in used)
    if flat and tilted < TILTED_VIEWS:
        poor |= tilted == 0
        findings.append(
            f"the views are frontal: {tilted} of {len(used)} are tilted by more than {np.rad2deg(TILT):.0f} deg, so "
            "that focal length and distance are hard to tell apart; tilt the board by 30 to 45 deg, about both its axes"
        )
    empty = uncovered_corners(camera, np.concatenate([view.pixels for view in used]))
    if empty:
        findings.append(
            f"no point of the board was seen at the image's {', '.join(empty)} corner{'s' if len(empty) > 1 else ''}: "
            "distortion is extrapolated there; move the board into them"
        )
    grade: Grade = "poor" if poor else "usable" if findings else "good"
    advice = {
        "good": "good enough to measure with",
        "usable": "usable, but the views could be better",
        "poor": "not good enough: take new views before measuring",
    }
    summary = (
        f"The calibration is {advice[grade]}: {rms:.2f} px rms over {len(used)} views, "
        f"focal length known to {focal:.3%}, projection to {worst:.2f} px."
    )
    return Verdict(grade, summary, tuple(findings), tuple(_retake(calibration)))


def uncovered_corners(camera: Camera, pixels: NDArray[np.float64]) -> list[str]:
    """Corners of the image (a fifth of its width and height) without any point, where the lens shows something."""
    names = []
    for vertical, at_v in (("top", 0), ("bottom", 1)):
        for horizontal, at_u in (("left", 0), ("right", 1)):
            u, v = pixels[:, 0] / camera.width, pixels[:, 1] / camera.height
            near = (np.abs(u - at_u) < 0.2) & (np.abs(v - at_v) < 0.2)
            middle = np.array([camera.width * (0.1 + 0.8 * at_u), camera.height * (0.1 + 0.8 * at_v)])
            if not near.any() and np.all(np.isfinite(rays(camera, middle))):
                names.append(f"{vertical} {horizontal}")
    return names


def _retake(calibration: CameraCalibration) -> list[tuple[str, str]]:
    result = [(refusal.name, refusal.reason) for refusal in calibration.refusals]
    blurs = np.array([view.blur_px for view in calibration.views])
    typical = float(np.nanmedian(blurs)) if np.isfinite(blurs).any() else float("nan")
    rms = np.array([view.rms_px for view in calibration.used])
    strange = {view.name for view, out in zip(calibration.used, outliers(rms), strict=True) if out}
    for view in calibration.views:
        reasons = [] if view.used else [f"not used: {view.reason}"]
        if view.name in strange:
            times = view.rms_px / float(np.median(rms))
            reasons.append(f"error {view.rms_px:.2f} px, {times:.1f} times the median of the views")
        if _blurred(view, typical):
            reasons.append(f"blurred: edges of {view.blur_px:.1f} px (sigma), the others {typical:.1f} px")
        if reasons:
            result.append((view.name, "; ".join(reasons)))
    return result


def _blurred(view: View, typical: float) -> bool:
    return view.blur_px > max(BLUR_FACTOR * typical, BLUR_PX)
