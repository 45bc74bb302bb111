"""`symcal camera`: images of a board in, camera.yaml and the page that judges it out."""

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
from symcal.camera.camera import INTRINSIC_NAMES
from symcal.camera.files import write_camera
from symcal.errors import InputError
from symcal.vision.board import detect_boards
from symcal.vision.calibrate import CameraCalibration, calibrate_camera
from symcal.vision.verdict import Verdict, judge

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
    bowed: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> CameraRun:
    """Calibrate a camera and write its file, and beside it a page of the same name that judges it.

    Args:
        images: files and folders. out: camera.yaml.
    Raises:
        RefusedError: too few views, or views that do not determine the camera; with the reasons for every image.
    """
    from symcal.plots.camera import camera_figures
    from symcal.plots.save import save_figures
    from symcal.report import write_report

    files = image_files(images)
    progress(f"looking for the board in {len(files)} images")
    detections, refusals = detect_boards(files, board)
    progress(f"calibrating from {len(detections)} views")
    calibration = calibrate_camera(detections, board, refusals, bowed=bowed)
    verdict = judge(calibration)
    provenance = {
        "symcal": version("symcal"),
        "date": date.today().isoformat(),
        "board": _board(board),
        "views": [view.name for view in calibration.used],
        "left_out": {view.name: view.reason for view in calibration.views if not view.used}
        | {refusal.name: refusal.reason for refusal in refusals},
        "grade": verdict.grade,
    }
    write_camera(out, calibration.camera, provenance)
    progress("writing the page")
    page = out.with_suffix(".pdf")
    with TemporaryDirectory(prefix="symcal-camera-") as folder:
        pictures = save_figures(camera_figures(calibration), folder)
        write_report(camera_content(calibration, verdict), pictures, page, "camera")
    return CameraRun(calibration, verdict, (out, page))


def camera_content(calibration: CameraCalibration, verdict: Verdict) -> dict[str, Any]:
    """The calibration as plain data: numbers with standard deviations, views, verdict."""
    camera = calibration.camera
    held = [name for name in INTRINSIC_NAMES if name not in calibration.free]
    note = f"{' and '.join(held)} is not determined by these views and was held at zero." if held else ""
    if calibration.dot_radius is not None:
        note += f" The dots were found to have a radius of {calibration.dot_radius:.3g} mm."
    return {
        "versions": {"symcal": version("symcal")},
        "board": _board(calibration.board),
        "width": camera.width,
        "height": camera.height,
        "rms_px": camera.rms_px,
        "intrinsics": {
            name: {"value": float(value), "sigma": float(sigma), "free": name in calibration.free}
            for name, value, sigma in zip(INTRINSIC_NAMES, camera.intrinsics, calibration.sigma, strict=True)
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
        "note": note.strip(),
    }


def _board(board: Board) -> str:
    return f"{board.kind} of {board.columns} x {board.rows} at {board.square:g} mm"
