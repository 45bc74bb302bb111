"""What a run with rendered images leaves beside numbers and report: the camera as calibrated, and some images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from symcal.camera.files import write_camera
from symcal.images.examples import Example
from symcal.outputs.names import file_names
from symcal.vision.calibrate import CameraCalibration
from symcal.vision.images import write_image


def write_images(calibration: CameraCalibration, examples: Sequence[Example], folder: Path) -> None:
    """Write camera.yaml and the example images of rendered ones into a run's folder."""
    write_camera(folder / "camera.yaml", calibration.camera, {"views": len(calibration.used)})
    if examples:
        (folder / "images").mkdir()
    names = file_names(example.name for example in examples)
    for example in examples:
        write_image(folder / "images" / f"{names[example.name]}.png", example.image)
