"""Everything that a report says, as one plain dictionary (results.json).

Numbers, their units in the keys, and against what they are.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from symcal import spatial
from symcal.calibration.evaluate import Errors, statistics
from symcal.calibration.identify import Calibration
from symcal.fit.estimation import Fit
from symcal.fit.identifiability import Identifiability
from symcal.instruments import Setup
from symcal.model.model import Task
from symcal.parameters import ParameterSet
from symcal.robot.robot import Robot

SCHEMA = "symcal/results/1"

_LIBRARIES = ("symcal", "casadi", "numpy", "scipy")


def header(name: str, title: str | None, seed: int, inputs: Iterable[Path], base: Path) -> dict[str, Any]:
    """Name, seed, versions and hashes of the inputs; named as `_shown` says."""
    return {
        "schema": SCHEMA,
        "name": name,
        "title": title or name,
        "seed": seed,
        "versions": {"python": platform.python_version(), **{name: version(name) for name in _LIBRARIES}},
        "inputs": {_shown(path.resolve(), base): hashlib.sha256(path.read_bytes()).hexdigest() for path in inputs},
    }


def _shown(path: Path, base: Path) -> str:
    """A name that means the same elsewhere: relative to the experiment, or below the folder of measured sets."""
    data = os.environ.get("SYMCAL_DATA")
    if data and path.is_relative_to(Path(data).resolve()):
        return f"$SYMCAL_DATA/{path.relative_to(Path(data).resolve()).as_posix()}"
    relative = Path(os.path.relpath(path, base)).as_posix()
    return path.name if relative.startswith("../../..") else relative


def robot_facts(robot: Robot) -> dict[str, Any]:
    return {
        "name": robot.name,
        "convention": robot.convention,
        "dof": robot.dof,
        "joints": [{"name": joint.name, "kind": joint.kind} for joint in robot.joints],
    }


def measurement_facts(task: Task, poses: Mapping[str, int]) -> dict[str, Any]:
    return {
        "type": task.kind,
        "invert": task.invert,
        "points": list(task.point_names),
        "error": task.instrument.error_words,
        "estimate": sorted(task.estimate),
        "poses": dict(poses),
    }


def identifiability_facts(seen: Identifiability) -> dict[str, Any]:
    return {
        "parameters": len(seen.names),
        "rank": seen.rank,
        "numerical_rank": seen.numerical_rank,
        "condition_number": seen.condition_number if seen.rank else None,
        "singular_values": seen.singular_values.tolist(),
        "scales": dict(zip(seen.names, seen.scales.tolist(), strict=True)),
        "unseen": [{"direction": d.direction, "text": d.text} for d in seen.unseen()],
    }


def identification_facts(fit: Fit, parameters: ParameterSet) -> dict[str, Any]:
    """The solver's words, noise and sizes with the degrees of freedom, and every parameter in mm and rad.

    Of a parameter: sigma, the posterior standard deviation; half_width_95, half of its 95 % interval by Student's t;
    learnt, the share that came from the data (0 to 1); None for parameters that were held.
    """
    known = fit.posterior
    columns = (known.sigmas, known.half_widths(), known.learnt)
    found = {name: values for name, *values in zip(fit.free, *(c.tolist() for c in columns), strict=True)}
    held: list[float | None] = [None, None, None]
    position, orientation, image = (fit.sigmas.get(group) for group in ("position", "orientation", "image"))
    return {
        "solver": fit.solution.solver,
        "converged": fit.converged,
        "status": fit.solution.status.name.lower(),
        "message": fit.message,
        "iterations": fit.iterations,
        "noise_sigma_mm": None if position is None else float(position),
        "noise_sigma_deg": None if orientation is None else float(np.rad2deg(orientation)),
        "noise_sigma_px": None if image is None else float(image),
        "noise_estimated": list(fit.estimated),
        "scale_factor": fit.factor,
        "scale_factor_estimated": fit.factor_estimated,
        "equations": fit.equations,
        "effective_parameters": fit.equations - fit.dof,
        "dof": fit.dof,
        "chi_squared": fit.chi_squared,
        "parameters": {
            p.name: {
                "nominal": p.nominal,
                "error": float(fit.x[i]),
                "identified": p.nominal + float(fit.x[i]),
                **dict(zip(("sigma", "half_width_95", "learnt"), found.get(p.name, held), strict=True)),
                "unit": p.unit,
                "free": p.name in fit.free,
            }
            for i, p in enumerate(parameters.items)
        },
    }


def accuracy_facts(errors: Mapping[str, Errors]) -> dict[str, Any]:
    """Statistics of position (mm) and orientation (deg) errors per state."""
    out: dict[str, Any] = {}
    for name, found in errors.items():
        out[name] = {"position_mm": _statistics(found.position)}
        if found.orientation is not None:
            out[name]["orientation_deg"] = _statistics(np.rad2deg(found.orientation))
    return out


def _statistics(values: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float | int]:
    s = statistics(values)
    return {"mean": s.mean, "rms": s.rms, "p95": s.p95, "max": s.max, "count": s.count}


def frame_facts(setup: Setup, point_names: tuple[str, ...]) -> dict[str, Any]:
    """Base, tool, tool points, and camera if there is one, as found, in mm and deg."""

    def frame(matrix: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, list[float]]:
        return {
            "xyz_mm": matrix[:3, 3].tolist(),
            "rpy_deg": np.rad2deg(spatial.matrix_rpy(matrix[:3, :3])).tolist(),
        }

    return {
        "base": frame(setup.base),
        "tool": frame(setup.tool),
        **({} if setup.camera is None else {"camera": frame(setup.camera)}),
        "points_mm": {name: setup.points[k].tolist() for k, name in enumerate(point_names)},
    }


def calibration_facts(calibration: Calibration) -> dict[str, Any]:
    """Identifiability, identification and frames of a calibration."""
    model, after = calibration.model, calibration.after
    found = calibration.setup.moved(model.parameters.mapping(after.x), model.measurement.point_names)
    return {
        "identifiability": identifiability_facts(after.identifiability),
        "identification": identification_facts(after, model.parameters),
        "frames": frame_facts(found, model.measurement.point_names),
    }
