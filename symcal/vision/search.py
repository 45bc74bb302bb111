"""The search for a target's discs around their predicted images."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera
from symcal.camera.target import Target
from symcal.vision.discs import Blob, find_blobs
from symcal.vision.failures import Failure, NotDetected
from symcal.vision.labelling import Labelling, assign_labels
from symcal.vision.outlines import Outline, predict_outline

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Colour = Literal["black", "white", "any"]
Shape = Literal["disc", "sphere"]

LEAST_CONTRAST = 0.03  # of full scale
_LEAST_MINOR_PX = 5.0
_SIZES = 0.4, 2.5  # area of a blob over that of the predicted outline
_MOST_BLOBS = 14


def predict_outlines(
    camera: Camera, target: Target, T_camera_target: Float, radius: float, shape: Shape
) -> list[Outline]:
    """Outlines of all discs, which must be seen from the front and not too small.

    Raises:
        NotDetected: BACK_SIDE, TOO_SMALL, or OUTSIDE (behind the camera, beyond the lens' field of view).
    """
    normal = np.array(target.normal)
    outlines = []
    for name, point in zip(target.names, target.points, strict=True):
        center = T_camera_target[:3, :3] @ point + T_camera_target[:3, 3]
        if center[2] <= 0:
            raise NotDetected(Failure.OUTSIDE, "is predicted behind the camera", name)
        cosine = float(-(T_camera_target[:3, :3] @ normal) @ center / np.linalg.norm(center))
        if shape == "disc" and cosine <= 0:
            angle = np.rad2deg(np.arccos(cosine))
            raise NotDetected(Failure.BACK_SIDE, f"is predicted to be seen at {angle:.0f} deg from its normal", name)
        outline = predict_outline(camera, T_camera_target, point, normal, radius, sphere=shape == "sphere")
        if outline is None:
            raise NotDetected(Failure.OUTSIDE, "is predicted beyond the lens' field of view", name)
        if outline.minor < _LEAST_MINOR_PX:
            raise NotDetected(
                Failure.TOO_SMALL, f"would have a smaller radius of {outline.minor:.1f} px in the image", name
            )
        outlines.append(outline)
    return outlines


def label_discs(
    camera: Camera,
    target: Target,
    grey: Float32,
    outlines: list[Outline],
    *,
    search_px: float,
    colour: Colour,
    least: int,
) -> tuple[Labelling, list[Blob]]:
    """Blobs near the predicted outlines, and which disc each of them is.

    Args:
        camera: numbers and distortion.
        target: discs, and the marked one.
        grey: fractions of full scale, shape (height, width).
        outlines: predicted, one per disc.
        search_px: how far off the prediction may be, in the mean over the discs.
        colour: of the discs.
        least: number of discs that must be found.
    Raises:
        NotDetected: OUTSIDE, CUT, LOW_CONTRAST, NO_DISCS, TOO_FEW or AMBIGUOUS.
    """
    rims = np.concatenate([outline.points for outline in outlines])
    left, top = (max(int(c), 0) for c in np.floor(rims.min(axis=0) - search_px))
    right, bottom = np.ceil(rims.max(axis=0) + search_px).astype(int) + 1
    right, bottom = min(right, camera.width), min(bottom, camera.height)
    if right - left < 2 * _LEAST_MINOR_PX or bottom - top < 2 * _LEAST_MINOR_PX:
        raise NotDetected(Failure.OUTSIDE, "the whole target is predicted beyond the image border")
    areas = [outline.area for outline in outlines]
    sizes = _SIZES[0] * min(areas), _SIZES[1] * max(areas)
    blobs = find_blobs(grey, (left, top, right, bottom), sizes, LEAST_CONTRAST)
    predicted = np.array([outline.projected for outline in outlines])
    best: tuple[Labelling, list[Blob]] | None = None
    for dark in (True, False):
        if colour == ("white" if dark else "black"):
            continue
        some = [blob for blob in blobs if blob.bright != dark][:_MOST_BLOBS]
        found = np.array([blob.center for blob in some]).reshape(-1, 2)
        labelling = assign_labels(predicted, found, _allowed(target, areas, some), search_px)
        if labelling is not None and (best is None or _rank(labelling) < _rank(best[0])):
            best = labelling, some
    if best is None or best[0].count < least:
        raise _too_few(camera, target, grey[top:bottom, left:right], outlines, blobs, None if best is None else best[0])
    if not best[0].clear:
        raise NotDetected(
            Failure.AMBIGUOUS,
            f"two labellings lie {best[0].rms_px:.1f} and {best[0].next_rms_px:.1f} px from the prediction; "
            "a marked disc or a better prediction would decide",
        )
    return best


def why_missing(camera: Camera, name: str, outline: Outline, shift: tuple[float, float]) -> NotDetected:
    """The likeliest reason why a disc has no blob, given the displacement of the others."""
    rim = outline.points + shift
    last = np.array([camera.width, camera.height]) - 1
    u, v = outline.projected + shift
    where = f"is predicted at ({u:.0f}, {v:.0f}) px"
    if np.any((rim < -0.5) | (rim > last + 0.5), axis=1).all():
        return NotDetected(Failure.OUTSIDE, where, name)
    if np.any((rim < 2) | (rim > last - 2)):
        return NotDetected(Failure.CUT, where, name)
    return NotDetected(Failure.HIDDEN, f"{where}, where no blob has its shape and size", name)


def _allowed(target: Target, areas: list[float], blobs: list[Blob]) -> NDArray[np.bool_]:
    """Whether a disc may be a blob: of its size, and marked as it is; shape (discs, blobs)."""
    allowed = np.zeros((len(areas), len(blobs)), dtype=bool)
    for i, (name, area) in enumerate(zip(target.names, areas, strict=True)):
        for k, blob in enumerate(blobs):
            of_its_size = _SIZES[0] < blob.area / area < _SIZES[1]
            allowed[i, k] = of_its_size and (target.marked is None or blob.hole == (name == target.marked))
    return allowed


def _rank(labelling: Labelling) -> tuple[int, float]:
    return -labelling.count, labelling.rms_px


def _too_few(
    camera: Camera,
    target: Target,
    patch: Float32,
    outlines: list[Outline],
    blobs: list[Blob],
    best: Labelling | None,
) -> NotDetected:
    """The likeliest reason why there are not enough discs."""
    for name, outline in zip(target.names, outlines, strict=True):
        reason = why_missing(camera, name, outline, (0.0, 0.0) if best is None else best.shift)
        if reason.failure in (Failure.OUTSIDE, Failure.CUT):
            return reason
    spread = float(np.percentile(patch, 99.9) - np.percentile(patch, 0.1))
    noise = 1.4826 * float(np.median(np.abs(np.diff(patch, axis=1)))) / np.sqrt(2)
    if spread - 6 * noise < LEAST_CONTRAST:
        return NotDetected(Failure.LOW_CONTRAST, f"grey levels near the target differ by {spread:.1%} of full scale")
    if not blobs:
        return NotDetected(Failure.NO_DISCS, "nothing near the prediction has their shape and size")
    return NotDetected(
        Failure.TOO_FEW,
        f"{len(blobs)} blobs near the prediction have about their shape and size, "
        f"but {0 if best is None else best.count} of {len(target.names)} lie as predicted",
    )
