"""What the report says beside the study's results: model, scene, choices, and the plans against each other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.config.study import StudyConfig
from symcal.instruments.noise import Noise
from symcal.paper.printed import printed_tables
from symcal.paper.results import Setting, Study

Array = NDArray[np.float64]

_AT_LIMIT = 0.01  # of a joint's range: a reading so near to its end counts as on it


def surroundings(study: Study, config: StudyConfig) -> dict[str, Any]:
    """Further entries of results.json; angles of the model in deg, as the paper's tables have them."""
    setting = study.setting
    # other true errors than the paper's have nothing to do with its tables
    printed = printed_tables(setting, study.plans["certified"].poses) if study.published_true else {}
    names = setting.model.parameters.names
    again = study.repetitions
    return {
        "model": {"links": _links(setting), "ranges": _ranges(setting)},
        "scene": _scene(setting),
        "choices": {
            "weights": config.weights.model_dump(),
            "sound_weights": config.sound_weights.model_dump(),
            "search": config.search.model_dump(),
            "simulation_1": config.simulation_1.model_dump(),
            "speeds": setting.speeds.tolist(),
            "scales": dict(zip(names, setting.model.parameters.scales.tolist(), strict=True)),
        },
        "printed": {
            name: {
                "rounding_mm": table.rounding_mm,
                "moved_mm": table.moved_mm,
                "turned_rad": table.turned,
                "reduced": dict(zip(names, table.reduced.tolist(), strict=True)),
            }
            for name, table in printed.items()
        },
        "readings_at_limits": {name: at_limits(study, plan.poses) for name, plan in study.plans.items()},
        "wins": {a: {b: again.wins(a, b) for b in again.names if b != a} for a in again.names},
        "over_cramer_rao": {name: again.over_cramer_rao(name) for name in again.names},
        "cramer_rao_rms_mm": {name: float(np.sqrt(np.mean(again.cramer_rao_mm[name] ** 2))) for name in again.names},
    }


def at_limits(study: Study, poses: Array) -> float:
    """Share of the joint readings that are at an end of the working area's range."""
    unit = study.setting.info.area.unit(poses)
    return float(np.mean((unit < _AT_LIMIT) | (unit > 1 - _AT_LIMIT)))


def mean_norm(noise: Noise) -> float:
    """Mean Euclidean norm of the noise of a position, mm: no mean error against noisy positions can be expected below.

    Of independent uniform components on [-1, 1]: sqrt(3)/4 - pi/24 + log(2 + sqrt(3))/2, the mean distance of a unit
    cube's points from its corner; of normal ones: sqrt(8 / pi).
    """
    if noise.distribution == "uniform":
        return float(noise.sizes["position"] * (np.sqrt(3) / 4 - np.pi / 24 + np.log(2 + np.sqrt(3)) / 2))
    return float(noise.sizes["position"] * np.sqrt(8 / np.pi))


def _links(setting: Setting) -> list[dict[str, Any]]:
    found = []
    for link in setting.model.robot.links:
        angles = {k: float(np.rad2deg(v)) for k, v in link.parameters.items() if k in ("theta", "alpha", "beta")}
        lengths = {k: float(v) for k, v in link.parameters.items() if k in ("a", "d")}
        found.append({"joint": link.joint.name, "kind": link.joint.kind, "parameters": angles | lengths})
    return found


def _ranges(setting: Setting) -> list[dict[str, Any]]:
    area = setting.info.area
    found = []
    for i, joint in enumerate(setting.model.robot.joints):
        factor = 180 / np.pi if joint.revolute else 1.0
        found.append(
            {
                "joint": joint.name,
                "unit": "deg" if joint.revolute else "mm",
                "limits": [joint.lower * factor, joint.upper * factor],
                "area": [float(area.lower[i] * factor), float(area.upper[i] * factor)],
            }
        )
    return found


def _scene(setting: Setting) -> dict[str, Any]:
    view = setting.view
    tool = setting.arm.motion(setting.start[None])[0][0]
    return {
        "camera_mm": view.T_world_camera[:3, 3].tolist(),
        "distance_mm": float(np.linalg.norm(view.T_world_camera[:3, 3] - tool)),
        "width_px": view.camera.width,
        "height_px": view.camera.height,
        "focal_px": view.camera.fx,
        "side_mm": float(np.linalg.norm(view.target.points[0] - view.target.points[1])),
        "incidence_deg": float(np.rad2deg(setting.incidence)),
    }
