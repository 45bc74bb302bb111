"""Grey images of boards and disc targets as a camera sees them: for tests and for simulated measurements.

Every pixel is the mean of the printed pattern over its square (exact inside a colour, averaged over a fine grid of rays
where an edge runs through it); then come a Gaussian blur, vignetting, Gaussian noise and rounding to 8 bits. The same
arguments and generator state give the same image.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from symcal.camera.board import Board
from symcal.camera.camera import Camera, project_points, rays
from symcal.camera.target import Target
from symcal.vision.patterns import Plate, board_plate, target_plates

Float = NDArray[np.floating[Any]]
Image = NDArray[np.uint8]

_BAND_PX = 64  # rows worked on at a time, so that the arrays stay in the processor's cache
_GRID_PX = 8  # spacing of the grid on which the distortion is inverted; cubic between: below 1e-5 px


@dataclass(frozen=True, slots=True)
class Look:
    """How a scene is lit and imaged; grey levels and noise as fractions of full scale.

    Attributes:
        black, white: of the printed pattern. background: around the plate.
        blur_px: sigma of the Gaussian point spread, px; 0 for none.
        noise: sigma of the Gaussian noise of each pixel.
        vignetting: loss of light at the farthest corner, growing with the squared distance from the principal point.
    """

    black: float = 0.1
    white: float = 0.85
    background: float = 0.4
    blur_px: float = 0.7
    noise: float = 0.01
    vignetting: float = 0.0


def render_board(
    camera: Camera,
    board: Board,
    T_camera_board: Float,
    rng: np.random.Generator,
    look: Look = Look(),
    *,
    circle_radius: float | None = None,
) -> Image:
    """Image of a calibration board; its face looks as `Board.facing` says, towards a camera in front of it.

    Args:
        camera: numbers and distortion.
        board: printed on a white plate with a margin of one square; parts of it may be out of the image.
        T_camera_board: shape (4, 4), mm.
        rng: for the noise.
        look: grey levels, blur, noise, vignetting.
        circle_radius: of the dots of a circle grid, mm; by default 0.3 of the distance between neighbours.
    Returns:
        shape (height, width); from behind, the bare plate.
    """
    return _expose(
        camera, _scene(camera, [board_plate(board, circle_radius)], T_camera_board, look, samples=8), rng, look
    )


def render_discs(
    camera: Camera,
    target: Target,
    T_camera_target: Float,
    rng: np.random.Generator,
    look: Look = Look(),
    *,
    discs: Literal["black", "white"] = "black",
    margin: float | None = None,
) -> Image:
    """Image of a disc target; its face looks along `target.normal`.

    Args:
        camera: numbers and distortion.
        target: coplanar discs share one plate, others have a square plate each.
        T_camera_target: shape (4, 4), mm.
        rng: for the noise.
        look: grey levels, blur, noise, vignetting.
        discs: their colour; the plate has the other one.
        margin: between a disc and the edge of the plate, mm; by default one disc radius.
    Returns:
        shape (height, width); from behind, bare plates.
    """
    plates = target_plates(target, discs == "black", target.disc_radius if margin is None else margin)
    return _expose(camera, _scene(camera, plates, T_camera_target, look, samples=16), rng, look)


def _scene(camera: Camera, plates: list[Plate], T_camera_frame: Float, look: Look, samples: int) -> NDArray[np.float32]:
    """Light per pixel before the lens blurs it; nearer plates hide farther ones."""
    image = np.full((camera.height, camera.width), look.background, dtype=np.float32)
    poses = [T_camera_frame @ plate.T_frame_plate for plate in plates]
    middles = [(pose @ [*plate.outline.mean(axis=0), 0, 1])[2] for pose, plate in zip(poses, plates, strict=True)]
    for index in np.argsort(middles)[::-1]:
        _paint(image, camera, plates[index], poses[index], look, samples)
    return image


def _paint(
    image: NDArray[np.float32], camera: Camera, plate: Plate, T_camera_plate: Float, look: Look, samples: int
) -> None:
    """Draw one plate over the image, in place."""
    box = _box(camera, plate.outline, T_camera_plate)
    if box is None:
        return
    # Plane coordinates of the point that a ray (x, y, 1) meets: the rows of the inverse homography, up to 1 / depth.
    homography = np.stack([T_camera_plate[:3, 0], T_camera_plate[:3, 1], T_camera_plate[:3, 3]], axis=1)
    across, down, along = np.linalg.inv(homography).tolist()  # plain floats keep float32 arrays float32
    front = float(T_camera_plate[:3, 2] @ T_camera_plate[:3, 3]) * plate.facing < 0

    def light(x: Float, y: Float) -> Float:
        depth = along[0] * x + along[1] * y + along[2]
        depth[depth <= 0] = np.nan
        on_x = (across[0] * x + across[1] * y + across[2]) / depth
        on_y = (down[0] * x + down[1] * y + down[2]) / depth
        ink = plate.pattern(on_x, on_y)
        return look.black + (look.white - look.black) * (ink if front else np.where(np.isnan(ink), ink, 1.0))

    u0, v0, u1, v1 = box
    for top in range(v0, v1, _BAND_PX):
        bottom = min(top + _BAND_PX, v1)
        # One pixel more on every side, to see edges that run along the band's own border.
        _paint_band(image[top:bottom, u0:u1], _ray_patch(camera, u0 - 1, top - 1, u1 + 1, bottom + 1), light, samples)


def _paint_band(patch: NDArray[np.float32], ray: Float, light: Callable[[Float, Float], Float], samples: int) -> None:
    value = light(ray[0], ray[1]).astype(np.float32)
    filled = np.where(np.isnan(value), np.float32(-1), value)
    kernel = np.ones((3, 3), dtype=np.uint8)
    uneven = cv2.dilate(filled, kernel) - cv2.erode(filled, kernel) > 1e-6
    row, column = np.nonzero(uneven[1:-1, 1:-1])
    below = patch[row, column].astype(np.float64)
    inner = value[1:-1, 1:-1]
    np.copyto(patch, inner, where=~np.isnan(inner))

    # The rays are linear over one pixel to 1e-4 px, so that the samples need no further undistortion.
    row, column = row + 1, column + 1
    middle = ray[:, row, column].astype(np.float64)
    by_u = (ray[:, row, column + 1] - ray[:, row, column - 1]) / 2.0
    by_v = (ray[:, row + 1, column] - ray[:, row - 1, column]) / 2.0
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    total = np.zeros(len(below))
    for dv in offsets:
        start = middle + dv * by_v
        x, y = start[:, None, :] + offsets[:, None] * by_u[:, None, :]
        inked = light(x, y)
        total += np.where(np.isnan(inked), below, inked).sum(axis=0)
    patch[row - 1, column - 1] = total / samples**2


def _box(camera: Camera, outline: Float, T_camera_plate: Float) -> tuple[int, int, int, int] | None:
    """Pixels that can see the plate: first and last-but-one column and row; None if there are none."""
    steps = np.linspace(0, 1, 32)[:, None]
    border = np.concatenate([a + steps * (b - a) for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True)])
    points = np.column_stack([border, np.zeros(len(border))]) @ T_camera_plate[:3, :3].T + T_camera_plate[:3, 3]
    if np.all(points[:, 2] <= 0):
        return None
    pixels = project_points(camera, points)
    if not np.all(np.isfinite(pixels)):
        return 0, 0, camera.width, camera.height
    (u0, v0), (u1, v1) = np.floor(pixels.min(axis=0)) - 2, np.ceil(pixels.max(axis=0)) + 3
    left, top, right, bottom = max(int(u0), 0), max(int(v0), 0), min(int(u1), camera.width), min(int(v1), camera.height)
    return (left, top, right, bottom) if right - left > 1 and bottom - top > 1 else None


def _ray_patch(camera: Camera, u0: int, v0: int, u1: int, v1: int) -> Float:
    """Normalised rays of the pixels of a rectangle, shape (2, v1 - v0, u1 - u0); NaN where the lens shows nothing."""
    u = np.arange(u0 - _GRID_PX, u1 + 2 * _GRID_PX + 1, _GRID_PX, dtype=np.float64)
    v = np.arange(v0 - _GRID_PX, v1 + 2 * _GRID_PX + 1, _GRID_PX, dtype=np.float64)
    coarse = np.moveaxis(rays(camera, np.stack(np.meshgrid(u, v), axis=-1)), -1, 0)
    fine = _upsampled(_upsampled(np.nan_to_num(coarse), v1 - v0).swapaxes(1, 2), u1 - u0).swapaxes(1, 2)
    hidden = np.isnan(coarse[0])
    if hidden.any():
        # Whatever a hidden knot touches is unknown.
        touched = ndimage.maximum_filter(hidden, size=5)[1:-1, 1:-1]
        fine[:, np.kron(touched, np.ones((_GRID_PX, _GRID_PX), dtype=bool))[: v1 - v0, : u1 - u0]] = np.nan
    return fine


def _upsampled(knots: Float, count: int) -> NDArray[np.float32]:
    """Values at `count` pixels from the second knot on, cubic Lagrange along axis 1: (2, n, m) -> (2, count, m)."""
    t = np.arange(_GRID_PX) / _GRID_PX
    weights = (
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    )
    cells = knots.shape[1] - 3
    fine = sum(weight[:, None] * knots[:, k : k + cells, None] for k, weight in enumerate(weights))
    return np.asarray(fine, dtype=np.float32).reshape(2, cells * _GRID_PX, -1)[:, :count]


def _expose(camera: Camera, scene: NDArray[np.float32], rng: np.random.Generator, look: Look) -> Image:
    """Blur, vignetting, noise and rounding."""
    if look.blur_px > 0:
        scene = np.asarray(cv2.GaussianBlur(scene, (0, 0), look.blur_px), dtype=np.float32)
    if look.vignetting > 0:
        u2 = (np.arange(camera.width, dtype=np.float32) - camera.cx) ** 2
        v2 = (np.arange(camera.height, dtype=np.float32) - camera.cy) ** 2
        scene *= 1 - np.float32(look.vignetting) * (u2 + v2[:, None]) / (u2.max() + v2.max())
    if look.noise > 0:
        scene += np.float32(look.noise) * rng.standard_normal(scene.shape, dtype=np.float32)
    return np.clip(np.rint(scene * 255), 0, 255).astype(np.uint8)
