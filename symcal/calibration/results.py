"""Everything that a report says, as one plain dictionary (results.json).

Numbers, their units in the keys, and against what they are.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors, Statistics, statistics
from symcal.calibration.held_out_places import held_out_places
from symcal.calibration.mistakes.mistake import mistake_facts
from symcal.calibration.observation_facts import observation_facts, unknown_words
from symcal.calibration.outliers import outlier_facts
from symcal.calibration.place_results import frame_facts, known_facts, length_facts, settled_facts
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Fit
from symcal.fit.identifiability import Identifiability
from symcal.model.measurement import Measurement
from symcal.model.task import Task
from symcal.robot.robot import Robot
from symcal.units import DEGREES, SHOWN_UNITS

Array = NDArray[np.float64]

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
        "inputs": {_shown(path.resolve(), base): _digest(path) for path in inputs},
    }


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
    """What measured: the first observation in short, and every one of them."""
    first = task.observations[0]
    judging = task.judged_by[0].instrument
    quantity, unit, _ = judging.error
    return {
        "type": first.instrument.name,
        "points": list(first.features),
        "error": judging.error_words,
        "of_tool": judging.gives_point,
        "judged_by": [o.name for o in task.judged_by],
        "quantity": f"{quantity}_{SHOWN_UNITS[unit]}",
        "unit": SHOWN_UNITS[unit],
        "estimate": unknown_words(task),
        "poses": dict(poses),
        "sees_length": any(o.instrument.sees_length for o in task.observations),
        "instruments": [observation_facts(o) for o in task.observations],
    }


def against(task: Task) -> str:
    """What errors on measurements are taken against."""
    return "noisy contacts" if all(o.instrument.constrains for o in task.judged_by) else "noisy measurement"


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


def identification_facts(fit: Fit, measurement: Measurement, unplaced: Collection[str] = ()) -> dict[str, Any]:
    """The solver's words, noise and sizes with the degrees of freedom, and every parameter in mm and rad.

    Of a parameter: sigma, the posterior standard deviation; half_width_95, half of its 95 % interval by Student's t;
    learnt, the share that came from the data (0 to 1); None for parameters that were held.

    Args:
        unplaced: parameters of places, points and instruments that no training pose tells.
    """
    parameters, known = measurement.parameters, fit.posterior
    nominal = [fit.setup.own.get(p.name, p.nominal) for p in parameters.items]
    columns = (known.sigmas, known.half_widths(), known.learnt)
    found = {name: values for name, *values in zip(fit.free, *(c.tolist() for c in columns), strict=True)}
    held: list[float | None] = [None, None, None]
    return {
        "solver": fit.solution.solver,
        "loss": fit.loss,
        "converged": fit.converged,
        "status": fit.solution.status.name.lower(),
        "message": fit.message,
        "iterations": fit.iterations,
        **noise_facts(fit.sigmas, measurement),
        "noise_estimated": list(fit.estimated),
        "scale_factor": fit.factor,
        "scale_factor_estimated": fit.factor_estimated,
        "equations": fit.equations,
        "effective_parameters": fit.equations - fit.dof,
        "dof": fit.dof,
        "chi_squared": fit.chi_squared,
        "parameters": {
            p.name: {
                "nominal": nominal[i],
                "error": float(fit.x[i]),
                "identified": nominal[i] + float(fit.x[i]),
                **dict(zip(("sigma", "half_width_95", "learnt"), found.get(p.name, held), strict=True)),
                "unit": p.unit,
                "free": p.name in fit.free,
                "unplaced": p.name in unplaced,
            }
            for i, p in enumerate(parameters.items)
        },
    }


def noise_facts(sigmas: Mapping[str, float], measurement: Measurement) -> dict[str, Any]:
    """Standard deviation of every noise group, and by unit where all that is measured in it shares one."""
    out: dict[str, Any] = {"noise": {}}
    found: dict[str, list[float]] = {unit: [] for unit in SHOWN_UNITS.values()}
    for group in measurement.groups:
        if group.name in sigmas:
            unit = SHOWN_UNITS[group.unit]
            sigma = float(sigmas[group.name]) * (DEGREES if group.unit == "rad" else 1.0)
            found[unit].append(sigma)
            out["noise"][group.name] = {
                "sigma": sigma,
                "unit": unit,
                "quantity": group.quantity,
                "instrument": group.observation,
            }
    return out | {f"noise_sigma_{unit}": values[0] if len(values) == 1 else None for unit, values in found.items()}


def instrument_facts(task: Task, errors: Mapping[str, Mapping[str, Mapping[str, Errors]]]) -> dict[str, dict[str, Any]]:
    """Every instrument in its own unit: what it is, and its errors by part and state.

    Args:
        errors: by part, state and observation, as `symcal.calibration.evaluate.evaluate_each` gives them.
    """
    out: dict[str, dict[str, Any]] = {}
    for o in task.observations:
        own = {
            part: {state: _statistics(each[o.name]) for state, each in states.items() if o.name in each}
            for part, states in errors.items()
        }
        quantity, unit, _ = o.instrument.error
        out[o.name] = observation_facts(o) | {
            "error": o.instrument.error_words,
            "quantity": f"{quantity}_{SHOWN_UNITS[unit]}",
            "unit": SHOWN_UNITS[unit],
            "accuracy": {part: states for part, states in own.items() if states},
        }
    return out


def accuracy_facts(errors: Mapping[str, Errors], labels: Sequence[str] | None = None) -> dict[str, Any]:
    """Statistics of position (mm) and orientation (deg) errors per state; of what else is measured, in its unit.

    Args:
        labels: of the poses. With them the state `after` says at which pose its largest error is.
    """
    out: dict[str, Any] = {}
    for name, found in errors.items():
        out[name] = {found.key: _statistics(found)}
        if labels is not None and name == "after":
            out[name][found.key]["worst"] = worst_facts(found.size, found.pose, labels, found.unit)
        if found.orientation is not None:
            out[name]["orientation_deg"] = _as_dict(statistics(np.rad2deg(found.orientation)))
    return out


def worst_facts(sizes: Array, poses: NDArray[np.intp], labels: Sequence[str], unit: str) -> dict[str, Any]:
    """The largest of errors: at which pose, by its label, and how large."""
    at = int(sizes.argmax())
    return {"pose": labels[int(poses[at])], "size": float(sizes[at]), "unit": unit}


def _statistics(errors: Errors) -> dict[str, Any]:
    found = _as_dict(errors.statistics)
    return found | {"fitted": errors.fitted} if errors.fitted else found


def _as_dict(s: Statistics) -> dict[str, float | int]:
    return {"mean": s.mean, "rms": s.rms, "p95": s.p95, "max": s.max, "count": s.count}


def calibration_facts(calibration: Calibration, held_out: Dataset | None = None) -> dict[str, Any]:
    """Identifiability, identification, outliers, frames and known values of a calibration.

    Args:
        held_out: poses that settle what no training pose tells.
    """
    model, after = calibration.model, calibration.after
    state = calibration.states["after"]
    found = held_out_places(state, held_out)
    choice = calibration.loss_choice
    return {
        "identifiability": identifiability_facts(after.identifiability) | {"length": length_facts(calibration)},
        "identification": identification_facts(after, model.measurement, state.unplaced)
        | {"loss_choice": None if choice is None else choice.facts},
        "mistakes": mistake_facts(calibration.mistakes),
        "outliers": outlier_facts(calibration.outliers),
        "starts": {name: {"agreed": n, "starts": of} for name, (n, of) in calibration.searches.items()},
        "frames": frame_facts(model, model.moved(found.state.setup, after.x), found.unknown),
        "settled": settled_facts(model, found),
        "known": known_facts(calibration, found),
    }
