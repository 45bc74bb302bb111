"""A camera's part in a calibration, as plain data in calibrated.yaml: what a later validation needs to know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.camera.camera import INTRINSIC_NAMES, Camera
from symcal.camera.files import camera_from_dict, camera_to_dict, target_from_dict, target_to_dict
from symcal.instruments import Setup
from symcal.model.model import Model, Scene

Array = NDArray[np.float64]


def scene_record(model: Model, nominal: Setup, found: Setup, errors: Mapping[str, float]) -> dict[str, Any]:
    """Camera and target of a `pixels` calibration; nothing for other kinds.

    Args:
        nominal: the frames fitted with nominal kinematics. found: the identified ones. errors: of all parameters.
    """
    scene = model.task.scene
    if scene is None or nominal.camera is None or found.camera is None:
        return {}
    identified = scene.camera.intrinsics + np.array([errors.get(name, 0.0) for name in INTRINSIC_NAMES])
    fx, fy, cx, cy, *dist = identified.tolist()
    after = replace(scene.camera, fx=fx, fy=fy, cx=cx, cy=cy, dist=tuple(dist), covariance=None, rms_px=None)
    before = replace(scene.camera, covariance=None, rms_px=None)
    return {
        "target": target_to_dict(replace(scene.target, mount=None)),
        "before": {"camera": camera_to_dict(before), "T_world_camera": _pose(nominal.camera)},
        "after": {"camera": camera_to_dict(after), "T_world_camera": _pose(found.camera)},
    }


def recorded_scene(record: Mapping[str, Any], state: str, file: Path) -> Scene:
    """The scene of `scene_record`, with the camera `before` or `after` the identification.

    Raises:
        InputError: the file was changed by hand into something that is no scene.
    """
    own = record[state]
    camera: Camera = camera_from_dict(own["camera"], file)
    pose = spatial.pose_matrix(np.array(own["T_world_camera"], dtype=float))
    return Scene(camera, target_from_dict(record["target"], file), pose)


def _pose(frame: Array) -> list[float]:
    """x, y, z in mm and a quaternion x, y, z, w."""
    return [float(v) for v in spatial.matrix_pose(frame)]
