"""From images of a target on the tool to measured image points, one pose per image; nothing is dropped silently.

Where nobody says where the camera stands, the first images tell: all poses that their discs allow go into the consensus
of `camera_placement`. With the camera and the mount so found (or stated), every image is searched near the place
where the nominal robot puts the target, which also tells equal discs apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from symcal import spatial
from symcal.camera.camera import Camera
from symcal.camera.target import Target
from symcal.data.dataset import Dataset, Readings
from symcal.errors import InputError, RefusedError
from symcal.images.shots import Shot, conditions_of, listed_failures, with_thumbnail
from symcal.instruments import seen_by
from symcal.kernels import batch_function
from symcal.kinematics import chain, forward, frame_vector
from symcal.model.parameter_set import parameter_set
from symcal.placing.camera_placement import place_camera
from symcal.placing.registration import rigid_fit
from symcal.robot.robot import Robot
from symcal.vision.failures import NotDetected
from symcal.vision.images import thumbnail
from symcal.vision.locate import Guess, locate_target
from symcal.vision.target import TargetDetection, detect_target

Array = NDArray[np.float64]

_BLAS = ThreadpoolController()

_FIRST = 16  # images that are looked at without a prediction
_FEWEST = 5  # of them that must show the target


@dataclass(frozen=True, slots=True)
class MeasuredImages:
    """Image points of all images that show the target.

    data: `pixels`. images: the image of each pose. detections: of each pose. thumbnails: of each pose, as JPEG; empty
    for some where there are very many. failures: (image, reason) of every other.
    T_world_camera, T_flange_target: of the predictions, shape (4, 4), mm. found: whether they came from the images.
    notes: what should be known about them.
    """

    data: Dataset
    images: tuple[str, ...]
    detections: tuple[TargetDetection, ...]
    thumbnails: tuple[bytes, ...]
    failures: tuple[tuple[str, str], ...]
    T_world_camera: Array
    T_flange_target: Array
    found: bool
    notes: tuple[str, ...]

    @property
    def where(self) -> str:
        """Where the camera was found, in words; nothing where it was known."""
        x, y, z = self.T_world_camera[:3, 3]
        return f"the camera was found at ({x:.0f}, {y:.0f}, {z:.0f}) mm in world, by the nominal robot" * self.found


def measure_images(
    shots: Sequence[Shot],
    robot: Robot,
    camera: Camera,
    target: Target,
    *,
    T_world_camera: Array | None = None,
    search_px: float = 100.0,
    progress: Callable[[str], None] = lambda _: None,
) -> MeasuredImages:
    """Image points of the target in every image.

    Args:
        target: its mount, if it has one, is where it roughly sits on the flange.
        T_world_camera: roughly; camera and mount are found from the images when this or the mount is None.
        search_px: how far off the predictions may be.
    Raises:
        RefusedError: no image shows the target, or too few to find the camera; with the reasons.
    """
    with _BLAS.limit(limits=1):  # small matrices: a second thread only costs
        return _measure(shots, robot, camera, target, T_world_camera, search_px, progress)


def _measure(
    shots: Sequence[Shot],
    robot: Robot,
    camera: Camera,
    target: Target,
    T_world_camera: Array | None,
    search_px: float,
    progress: Callable[[str], None],
) -> MeasuredImages:
    if not shots:
        raise RefusedError("none of the images is there and has joint readings: check the names in the joints file")
    flange = flange_poses(robot, np.array([shot.q for shot in shots]))
    notes: tuple[str, ...] = ()
    known = T_world_camera is not None and target.mount is not None
    if T_world_camera is not None and target.mount is not None:
        place, mount = T_world_camera, target.mount
    else:
        place, mount, notes = find_camera(shots, flange, camera, target, progress)
    kept: list[tuple[Shot, TargetDetection]] = []
    small: list[bytes] = []
    pictured = with_thumbnail(len(shots))
    failures: list[tuple[str, str]] = []
    for number, (shot, pose) in enumerate(zip(shots, flange, strict=True), start=1):
        progress(f"measuring image {number} of {len(shots)}")
        try:
            predicted = spatial.inverse(place) @ pose @ mount
            image = shot.load()
            kept.append((shot, detect_target(camera, target, image, predicted, search_px=search_px)))
            small.append(thumbnail(image) if number - 1 in pictured else b"")
        except (NotDetected, InputError) as error:
            failures.append((shot.name, error.message if isinstance(error, InputError) else str(error)))
    if not kept:
        raise RefusedError(f"no image could be measured: {listed_failures(failures)}")
    return MeasuredImages(
        data=_dataset(kept, camera, target),
        images=tuple(shot.name for shot, _ in kept),
        detections=tuple(detection for _, detection in kept),
        thumbnails=tuple(small),
        failures=tuple(failures),
        T_world_camera=place,
        T_flange_target=mount,
        found=not known,
        notes=notes,
    )


def find_camera(
    shots: Sequence[Shot],
    flange: Array,
    camera: Camera,
    target: Target,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Array, Array, tuple[str, ...]]:
    """T_world_camera and T_flange_target that some of the images agree on, and what should be known about them.

    Args:
        flange: T_world_flange of every image by the nominal robot, shape (N, 4, 4), mm.
    Raises:
        RefusedError: too few images show anything like the target, or they do not agree.
    """
    first = np.unique(np.linspace(0, len(shots) - 1, min(len(shots), _FIRST)).astype(int))
    guesses: list[list[Guess]] = []
    used: list[int] = []
    failures: list[tuple[str, str]] = []
    for i in first:
        progress(f"looking for the target in image '{shots[i].name}'")
        try:
            guesses.append(locate_target(camera, target, shots[i].load()))
            used.append(int(i))
        except (NotDetected, InputError) as error:
            failures.append((shots[i].name, str(error)))
    if len(used) < _FEWEST:
        raise RefusedError(
            f"the target is seen in {len(used)} of the first {len(first)} images, {_FEWEST} are needed to find the "
            f"camera: say where the camera and the target are, or mend the images ({listed_failures(failures)})"
        )
    width = max(len(each) for each in guesses)
    pixels = np.full((len(used), width, len(target.names), 2), np.nan)
    for i, each in enumerate(guesses):
        pixels[i, : len(each)] = [guess.pixels for guess in each]
    choices = [np.array([guess.T_camera_target for guess in each]) for each in guesses]
    best = place_camera(camera, target, flange[used], choices, pixels)[0]
    turns = _symmetries(target)
    mount, notes = best.mount, []
    if len(turns) > 1 and target.mount is None:
        notes.append(
            "equal discs look the same from several sides and nothing says how the target is mounted: its discs are "
            "named alike in all images, but maybe not as on the drawing"
        )
    elif target.mount is not None:
        nominal = target.mount[:3, :3]
        mount = max((best.mount @ turn for turn in turns), key=lambda m: float(np.trace(nominal.T @ m[:3, :3])))
    return best.camera, mount, tuple(notes)


def _dataset(kept: Sequence[tuple[Shot, TargetDetection]], camera: Camera, target: Target) -> Dataset:
    """Image points without a stated noise: that of the image is the least part of it, and the residuals tell it all."""
    z = np.full((len(kept), 2 * len(target.names)), np.nan)
    for row, (_, detection) in enumerate(kept):
        for name, pixel in zip(detection.names, detection.pixels, strict=True):
            k = target.names.index(name)
            z[row, 2 * k : 2 * k + 2] = pixel
    return Dataset(
        of=(Readings(seen_by(camera, calibrate=False), "pixels", target.names),),
        q=np.array([shot.q for shot, _ in kept]),
        z=z,
        labels=tuple(shot.label for shot, _ in kept),
        split=tuple(shot.split for shot, _ in kept),
        provenance="images",
        conditions=conditions_of([shot for shot, _ in kept]),
    )


def flange_poses(robot: Robot, q: Array) -> Array:
    kernel = batch_function(forward(chain(robot, parameter_set(robot))), evaluations=len(q))
    return kernel(q, np.zeros(len(robot.parameters)), frame_vector(robot.base, np.eye(4)))[0]


def _symmetries(target: Target) -> list[Array]:
    """Motions (4, 4) that carry the target's discs onto one another and leave their normal; the identity among them."""
    found = [np.eye(4)]
    if target.marked is not None or len(target.names) > 8:
        return found
    normal = np.array(target.normal)
    for order in permutations(range(len(target.names))):
        motion = rigid_fit(target.points, target.points[list(order)])
        off = target.points @ motion[:3, :3].T + motion[:3, 3] - target.points[list(order)]
        new = all(np.abs(motion - other).max() > 1e-6 for other in found)
        if new and np.abs(off).max() < 1e-6 * np.ptp(target.points) and motion[:3, :3] @ normal @ normal > 1 - 1e-9:
            found.append(motion)
    return found
