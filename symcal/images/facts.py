"""What results.json says about an experiment with a camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.aligned import aligned_errors, expected_centre_rms, target_points
from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors, statistics
from symcal.camera.camera import INTRINSIC_NAMES, Camera, project_points
from symcal.data.dataset import Dataset
from symcal.fit.residual_rows import rows_of
from symcal.images.comparison import Ways
from symcal.images.rendered import RenderedImages
from symcal.model.task import Scene
from symcal.vision.calibrate import CameraCalibration

Array = NDArray[np.float64]


def accuracy_facts(calibration: Calibration, data: Dataset, truth: Array, test: Array) -> dict[str, Any]:
    """Errors of the target's points at the test poses, what was to be expected there, and residuals in the image.

    Args:
        truth: true points, shape (N, k, 3), mm, at the readings ``test``, shape (N, dof).
    """
    points, residuals = {}, {}
    for name, state in calibration.states.items():
        points[name] = _statistics(aligned_errors(target_points(state, test), truth).size)
        r, _ = rows_of(state.model.measurement, data, state.setup, state.model.residuals)(state.x)
        seen = np.isfinite(data.z).reshape(len(data), -1, 2).all(axis=2)
        residuals[name] = _statistics(np.linalg.norm(r.reshape(len(data), -1, 2)[seen], axis=1))
    expected = {
        part: float(np.sqrt(np.mean(expected_centre_rms(calibration.model, calibration.after, q) ** 2)))
        for part, q in (("train", data.q), ("test", test))
    }
    return {"points_position_mm": points, "residuals_px": residuals, "expected_position_rms_mm": expected}


def comparison_facts(ways: Ways, errors: Mapping[str, Errors]) -> dict[str, Any]:
    """Errors of the target's centre at the test poses by way of identification, and what each way rests on."""
    best = statistics(errors["pixels"].size).rms
    out: dict[str, Any] = {}
    for name, way in ways.ways.items():
        found = errors[name].size
        out[name] = {
            "position_mm": _statistics(found),
            "times_pixels": statistics(found).rms / best,
            "poses": way.poses,
            "parameters": len(way.fit.free),
            "rank": way.fit.identifiability.rank,
            "noise_sigma_mm": way.fit.sigmas.get("position"),
            "noise_sigma_px": way.fit.sigmas.get("image"),
            "chi_squared_per_dof": way.fit.chi_squared / way.fit.dof if way.fit.dof else None,
        }
    return out


def project_poses(lens: Camera, scene: Scene, poses: Array) -> Array:
    """True image points at poses T_camera_target, shape (N, n, 2), px."""
    points = np.einsum("nij,kj->nki", poses[:, :3, :3], scene.target.points) + poses[:, None, :3, 3]
    return project_points(lens, points)


def image_facts(images: RenderedImages, truth: Array) -> dict[str, Any]:
    """How many images were measured, how well, and why the others were not.

    Args:
        truth: true image points of the measured images, shape (N, n, 2), px.
    """
    measured = images.measured
    error = measured.data.z.reshape(len(measured.data), -1, 2) - truth
    return {
        "measured": len(measured.data),
        "failures": [{"image": name, "reason": reason} for name, reason in measured.failures],
        "camera_found_from_images": measured.found,
        **point_facts(error),
        "sigma_of_image_noise_px": float(
            np.sqrt(np.mean(np.concatenate([d.sigma_px for d in measured.detections]) ** 2))
        ),
    }


def point_facts(error: Array) -> dict[str, Any]:
    """Errors of measured image points against the truth, shape (N, n, 2), px, NaN where nothing was seen."""
    seen = np.isfinite(error).all(axis=2)
    return {
        "error_px": _statistics(np.linalg.norm(error[seen], axis=1)),
        "error_per_axis_px": float(np.sqrt(np.mean(error[seen] ** 2))),
    }


def camera_facts(calibration: CameraCalibration, lens: Camera) -> dict[str, Any]:
    """The calibrated camera beside the true one."""
    camera = calibration.camera
    return {
        "views": len(calibration.used),
        "views_left_out": len(calibration.views) - len(calibration.used) + len(calibration.refusals),
        "rms_px": camera.rms_px,
        "intrinsics": {
            name: {"true": float(true), "calibrated": float(value), "sigma": float(sigma)}
            for name, true, value, sigma in zip(
                INTRINSIC_NAMES, lens.intrinsics, camera.intrinsics, calibration.sigma, strict=True
            )
        },
    }


def _statistics(values: Array) -> dict[str, float | int]:
    s = statistics(values)
    return {"mean": s.mean, "rms": s.rms, "p95": s.p95, "max": s.max, "count": s.count}
