"""What a run with rendered images leaves beside numbers and report: the camera as calibrated, and some images."""

from __future__ import annotations

from pathlib import Path

from symcal.camera.files import write_camera
from symcal.images.run import ImageRun
from symcal.vision.images import write_image


def write_images(run: ImageRun, folder: Path) -> None:
    """Write camera.yaml and the example images into a run's folder; nothing where no images were rendered."""
    if run.images is None:
        return
    write_camera(folder / "camera.yaml", run.images.camera.camera, {"views": len(run.images.camera.used)})
    if run.images.examples:
        (folder / "images").mkdir()
    for example in run.images.examples:
        write_image(folder / "images" / f"{'_'.join(example.name.split())}.png", example.image)
