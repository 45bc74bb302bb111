"""`symcal camera`: images of a board or a list of corners in, camera.yaml and the page that judges it out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from symcal.camera.board import Board
from symcal.camera.camera import NUMBER_NAMES
from symcal.camera.files import camera_to_dict
from symcal.documents.document import document_text
from symcal.errors import InputError
from symcal.outputs.whole_file import require_own, write_all_whole
from symcal.vision.board import detect_boards
from symcal.vision.calibrate import CameraCalibration, calibrate_camera
from symcal.vision.camera_fit import K3_SIGMAS
from symcal.vision.corners import CornerList, load_corners
from symcal.vision.fixed_terms import fixed_terms
from symcal.vision.verdict import Verdict, judge
from symcal.words import listed

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp"})


@dataclass(frozen=True, slots=True)
class CameraRun:
    """A calibration, what is to be thought of it, and the files written."""

    calibration: CameraCalibration
    verdict: Verdict
    written: tuple[Path, ...]


def image_files(paths: Sequence[Path]) -> list[Path]:
    """Files as they are, and the images of folders in the order of their names.

    Raises:
        InputError: a folder that is not there or has no images.
    """
    out: list[Path] = []
    for path in paths:
        if not path.is_dir():
            if path.suffix.lower() not in IMAGE_SUFFIXES and not path.exists():
                raise InputError("there is no such file or folder", file=path)
            out.append(path)
            continue
        found = sorted(file for file in path.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES)
        if not found:
            raise InputError("this folder has no images", file=path, allowed=sorted(IMAGE_SUFFIXES))
        out += found
    return out


def calibrate_from_images(
    images: Sequence[Path],
    board: Board,
    out: Path,
    *,
    fix: str = "auto",
    skew: bool = False,
    keep_all: bool = False,
    bowed: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> CameraRun:
    """Calibrate a camera and write its file, and beside it a page of the same name that judges it.

    Args:
        images: files and folders. out: camera.yaml. fix, skew, keep_all, bowed: as `calibrate_camera` has them.
    Raises:
        RefusedError: too few views, or views that do not determine the camera; with the reasons for every image.
        InputError: an unknown term to hold, or no images.
    """
    _page(out)
    fixed_terms(fix)
    files = image_files(images)
    progress(f"looking for the board in {len(files)} images")
    detections, refusals = detect_boards(files, board)
    progress(f"calibrating from {len(detections)} views")
    calibration = calibrate_camera(detections, board, refusals, fix=fix, skew=skew, keep_all=keep_all, bowed=bowed)
    return _written(calibration, out, progress)


def calibrate_from_corners(
    points: Path,
    size: tuple[int, int],
    out: Path,
    *,
    fix: str = "none",
    skew: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> CameraRun:
    """Calibrate a camera from a list of corners; every view that determines a pose is used.

    Args:
        points: file of corners. size: (width, height) of the image, px. Others: as for images.
    Raises:
        RefusedError: too few views, or views that do not determine the camera; with the reasons for those left out.
        InputError: as `load_corners` says, or an unknown term to hold.
    """
    _page(out)
    fixed_terms(fix)
    corners = load_corners(points, size)
    progress(f"calibrating from {len(corners.views)} views")
    return _written(calibrate_camera(corners, fix=fix, skew=skew), out, progress)


def _written(calibration: CameraCalibration, out: Path, progress: Callable[[str], None]) -> CameraRun:
    from symcal.plots.camera import camera_figures
    from symcal.plots.save import save_figures
    from symcal.report.render import report_pdf

    verdict = judge(calibration)
    provenance = {
        "symcal": version("symcal"),
        "date": date.today().isoformat(),
        "board": _board(calibration.board),
        "views": [view.name for view in calibration.used],
        "left_out": {view.name: view.reason for view in calibration.views if not view.used}
        | {refusal.name: refusal.reason for refusal in calibration.refusals},
        "free": list(calibration.free),
        "grade": verdict.grade,
    }
    progress("writing the page")
    page = _page(out)
    try:
        with TemporaryDirectory(prefix="symcal-camera-") as folder:
            pictures = save_figures(camera_figures(calibration), folder)
            pdf = report_pdf(camera_content(calibration, verdict), pictures, "camera")
    except OSError as error:
        message = f"the page cannot be made, because temporary files cannot be written: {error.strerror or error}"
        raise InputError(message, file=error.filename) from None
    write_all_whole({out: document_text(camera_to_dict(calibration.camera, provenance)), page: pdf})
    return CameraRun(calibration, verdict, (out, page))


def _page(out: Path) -> Path:
    """The page that judges a camera file: beside it, of the same name.

    Raises:
        InputError: the camera file has the page's own name. RefusedError: a PDF stands there that is somebody's.
    """
    page = out.with_suffix(".pdf")
    if page == out:
        raise InputError("a camera file is YAML, and its page takes this name: name it .yaml", key="--out", found=out)
    require_own(page, b"Author(symcal ", b"Author (symcal ")  # as Typst 0.15 writes it, and as those before it do
    return page


def camera_content(calibration: CameraCalibration, verdict: Verdict) -> dict[str, Any]:
    """The calibration as plain data: numbers with standard deviations, views, verdict."""
    camera = calibration.camera
    names = NUMBER_NAMES[: len(calibration.sigma)]
    return {
        "source": "corners" if isinstance(calibration.board, CornerList) else "images",
        "versions": {"symcal": version("symcal")},
        "board": _board(calibration.board),
        "width": camera.width,
        "height": camera.height,
        "rms_px": camera.rms_px,
        "intrinsics": {
            name: {"value": float(value), "sigma": float(sigma), "free": name in calibration.free}
            for name, value, sigma in zip(names, camera.numbers, calibration.sigma, strict=False)
        },
        "grade": verdict.grade,
        "summary": verdict.summary,
        "findings": list(verdict.findings),
        "retake": [{"view": name, "why": why} for name, why in verdict.retake],
        "views": [
            {
                "name": view.name,
                "used": view.used,
                "rms_px": view.rms_px,
                "tilt_deg": float(np.rad2deg(view.tilt)),
                "reason": view.reason,
            }
            for view in calibration.views
        ],
        "refusals": [{"name": refusal.name, "reason": refusal.reason} for refusal in calibration.refusals],
        "note": " ".join(_notes(calibration)),
    }


def _notes(calibration: CameraCalibration) -> list[str]:
    """What is held and why, what is free but not told, and what was assumed."""
    notes = []
    names = NUMBER_NAMES[: len(calibration.sigma)]
    asked = listed(calibration.asked)
    undetermined = [name for name in names if name not in (*calibration.free, *calibration.asked)]
    if asked:
        notes.append(f"{asked} {'were' if len(calibration.asked) > 1 else 'was'} held at zero, as asked.")
    if undetermined:
        notes.append(f"{listed(undetermined)} is not determined by these views and was held at zero.")
    k3 = names.index("k3")
    value, sigma = float(calibration.camera.numbers[k3]), float(calibration.sigma[k3])
    if "k3" in calibration.free and abs(value) < K3_SIGMAS * sigma:
        notes.append(f"k3 is free, but these views do not tell it from zero ({value:.2g} with a sigma of {sigma:.2g}).")
    if calibration.dot_radius is not None:
        notes.append(f"The dots were found to have a radius of {calibration.dot_radius:.3g} mm.")
    if isinstance(calibration.board, CornerList) and calibration.board.note:
        notes.append(calibration.board.note)
    return notes


def _board(board: Board | CornerList) -> str:
    if isinstance(board, CornerList):
        return str(board)
    text = f"{board.kind} of {board.columns} x {board.rows} at {board.square:g} mm"
    return text if board.dictionary is None else f"{text} ({board})"
