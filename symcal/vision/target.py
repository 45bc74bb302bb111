"""Detection of a disc target in one grey image: image points of the disc centres, or the reason why not."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera
from symcal.camera.p3p import solve_p3p_batch
from symcal.camera.reproject import fit_pose
from symcal.camera.target import Target
from symcal.vision.failures import Failure, NotDetected
from symcal.vision.outlines import Outline, RimFit, fit_rim
from symcal.vision.search import LEAST_CONTRAST, Colour, Shape, label_discs, predict_outlines, why_missing

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

_BLACK = 0.05  # of full scale
_FAR_TURN_DEG = 10.0
_ROUNDS = 4


@dataclass(frozen=True, slots=True)
class TargetDetection:
    """Image points of a target's discs.

    Attributes:
        names: of the discs found, in the target's order; k of them.
        pixels: images of their centres, corrected for perspective and distortion, shape (k, 2), px.
        sigma_px: standard deviation per axis due to the image's noise, shape (k,).
        bias_px: the correction: centroid of each outline minus image of the disc's centre, shape (k, 2).
        blur_px: sigma of each edge's profile, shape (k,).
        T_camera_target: pose that fits the pixels best, near the prediction, shape (4, 4), mm.
        disc_radius: as the image shows it at that pose, mm.
        shift_px: mean displacement from the prediction.
        missed: for every other disc, why.
    """

    names: tuple[str, ...]
    pixels: Float
    sigma_px: Float
    bias_px: Float
    blur_px: Float
    T_camera_target: Float
    disc_radius: float
    shift_px: tuple[float, float]
    missed: tuple[NotDetected, ...]


def detect_target(
    camera: Camera,
    target: Target,
    image: NDArray[np.generic],
    T_predicted: Float,
    *,
    search_px: float = 100.0,
    colour: Colour = "any",
    shape: Shape = "disc",
    least: int = 3,
) -> TargetDetection:
    """Find a target's discs near their predicted images, to a fraction of a pixel.

    Blobs of the predicted size are labelled by their arrangement; the pose that fits them predicts each disc's
    outline, the outline is fitted to the edge in the image, and the image of the disc's centre moves as the outline's
    centroid does (the two differ under perspective and distortion); the pose from these centres predicts better
    outlines, and so on.

    Args:
        camera: numbers and distortion.
        target: discs, normal, and the marked one.
        image: grey levels of 8 or 16 bits, shape (height, width).
        T_predicted: T_camera_target from the robot's nominal model, shape (4, 4), mm.
        search_px: how far off the prediction may be, in the mean over the discs.
        colour: of the discs on their plate.
        shape: "sphere" where balls stand for discs: seen from all sides, `disc_radius` is theirs.
        least: number of discs below which an image is refused, at least 3.
    Raises:
        NotDetected: with the named reason.
    """
    grey = grey_levels(camera, image)
    outlines = predict_outlines(camera, target, T_predicted, target.disc_radius, shape)
    labelling, blobs = label_discs(camera, target, grey, outlines, search_px=search_px, colour=colour, least=least)
    chosen = {i: blobs[k] for i, k in enumerate(labelling.blobs) if k >= 0}
    missed = {
        i: why_missing(camera, name, outlines[i], labelling.shift)
        for i, name in enumerate(target.names)
        if i not in chosen
    }
    found = list(chosen)
    radius = target.disc_radius * float(np.median([np.sqrt(chosen[i].area / outlines[i].area) for i in found]))
    pixels = np.array([chosen[i].center for i in found])
    start = _start(camera, target.points[found], pixels, T_predicted)
    pose = fit_pose(camera, start, target.points[found], pixels)
    fits: dict[int, RimFit] = {}
    for _ in range(_ROUNDS):
        outlines = predict_outlines(camera, target, pose, radius, shape)
        for i in list(found):
            try:
                fits[i] = _measure(camera, grey, outlines[i], fits.get(i), target.names[i])
            except NotDetected as reason:
                missed[i] = reason
                found.remove(i)
        if len(found) < least:
            raise missed[min(i for i in missed if i in chosen)]
        shifts = np.array([fits[i].shift for i in found])
        growth = float(np.mean([fits[i].growth for i in found]))
        pixels = np.array([outlines[i].projected for i in found]) + shifts
        pose, radius = fit_pose(camera, start, target.points[found], pixels), radius * (1 + growth)
        if np.abs(shifts).max() < 1e-3 and abs(growth) < 1e-3:
            break
    return TargetDetection(
        names=tuple(target.names[i] for i in found),
        pixels=pixels,
        sigma_px=np.array([fits[i].sigma_px for i in found]),
        bias_px=np.array([outlines[i].centroid - outlines[i].projected for i in found]),
        blur_px=np.array([fits[i].blur_px for i in found]),
        T_camera_target=pose,
        disc_radius=radius,
        shift_px=labelling.shift,
        missed=tuple(missed[i] for i in sorted(missed)),
    )


def grey_levels(camera: Camera, image: NDArray[np.generic]) -> Float32:
    """Grey levels as fractions of full scale."""
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise NotDetected(Failure.WRONG_IMAGE, f"it has the shape {image.shape} and the type {image.dtype}")
    height, width = image.shape
    if (width, height) != (camera.width, camera.height):
        raise NotDetected(
            Failure.WRONG_SIZE, f"{width} x {height} px, but the camera has {camera.width} x {camera.height}"
        )
    grey = image.astype(np.float32) / np.float32(255 if image.dtype == np.uint8 else 65535)
    if float(np.percentile(grey[::4, ::4], 99.9)) < _BLACK:
        raise NotDetected(Failure.BLACK, f"the brightest pixel has {float(grey.max()):.0%} of full scale")
    return np.asarray(grey, dtype=np.float32)


def _start(camera: Camera, points: Float, pixels: Float, T_predicted: Float) -> Float:
    """The predicted pose, or a closed-form one where labels are clear although the prediction is turned by far."""
    area = {
        base: float(np.linalg.norm(np.cross(points[base[1]] - points[base[0]], points[base[2]] - points[base[0]])))
        for base in combinations(range(len(points)), 3)
    }
    base = list(max(area.items(), key=lambda item: item[1])[0])
    away = T_predicted[:3, :3].T @ (T_predicted[:3, :3] @ points[base].mean(axis=0) + T_predicted[:3, 3])
    result = solve_p3p_batch(camera, points[base], pixels[None, base], T_predicted[None], normal=-away)[0]
    if result is None or result.turn_deg[result.chosen] < _FAR_TURN_DEG:
        return T_predicted
    return result.T_camera_target


def _measure(camera: Camera, grey: Float32, outline: Outline, before: RimFit | None, name: str) -> RimFit:
    """The fit of a predicted outline to the edge, unless it cannot be trusted.

    The band around the outline is as narrow as the edge's blur allows, and stays clear of a mark's hole.
    """
    widest = float(np.clip(0.3 * outline.minor, 2.0, 8.0))
    width = widest if before is None else float(np.clip(3 * before.blur_px + 1.5, 2.0, widest))
    u, v = outline.projected
    where = f"at ({u:.0f}, {v:.0f}) px"
    reach = outline.points + width * outline.normals
    if np.any((reach < 0) | (reach > np.array([camera.width, camera.height]) - 1)):
        raise NotDetected(Failure.CUT, f"{where} has less than {width:.0f} px to the border", name)
    fit = fit_rim(grey, outline, width, widest / 3 if before is None else before.blur_px)
    if abs(fit.contrast) < LEAST_CONTRAST:
        raise NotDetected(Failure.LOW_CONTRAST, f"{where} differs from its surroundings by {fit.contrast:.1%}", name)
    if fit.blur_px > 0.42 * widest:
        raise NotDetected(Failure.BLURRED, f"{where} has an edge blurred by {fit.blur_px:.1f} px (sigma)", name)
    if before is not None and fit.fit < 0.95:
        raise NotDetected(Failure.HIDDEN, f"{where}: {1 - fit.fit:.0%} of its edge does not look like one", name)
    return fit
