"""What must not reach a controller without being asked for twice.

A least-squares fit always returns numbers. Three kinds of them are no corrections of a robot: errors far beyond what is
plausible, errors along directions that the data did not see (there the starting guess speaks), and errors that the data
leave more uncertain than they were before. The limits are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.export.json import parameter_unit
from symcal.parameters import FRAME_AXES, SCALE
from symcal.robot import Record, Robot

Array = NDArray[np.float64]

IMPLAUSIBLE = 10.0
"""Plausible scales beyond which a link parameter's error is taken for a mistake: 10 mm, 0.1 rad by default."""
UNSEEN = 0.1
"""Plausible scales that an error may have along unseen directions, where the nonlinear model lets it drift a little."""

_NULL = 1e-12  # eigenvalue of a correlation matrix that is zero but for rounding


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why one number should not be exported."""

    parameter: str
    reason: Literal["implausible", "unseen", "uncertain"]
    text: str


def doubts(robot: Robot) -> tuple[Doubt, ...]:
    """What speaks against using a calibration on a controller; empty for a nominal robot.

    Link parameters and tool are judged. The base says where the instrument stood and does not count; neither does the
    size of a tool's error, since nominal tools are often rough guesses, nor what it shares unseen with the last link:
    the sum is what was measured.
    """
    record = robot.record
    if record is None:
        return ()
    links = robot.parameters
    judged = [name for name in record.errors if name in links or name in {f"tool_{axis}" for axis in FRAME_AXES}]
    hidden = _unseen_errors(robot, record)
    found: list[Doubt] = []
    for name in judged:
        error, sigma, scale = record.errors[name], record.sigmas.get(name), _scale(robot, name)
        if name in links and abs(error) > IMPLAUSIBLE * scale:
            limit = f"{IMPLAUSIBLE:g} times its plausible {_text(name, scale)}"
            text = f"{name} is off by {_text(name, error)}, more than {limit}"
            found.append(Doubt(name, "implausible", text))
        elif name in links and sigma is None and abs(hidden[name]) > UNSEEN * scale:
            text = f"{_text(name, hidden[name])} of {name} lie along directions that the data do not see"
            found.append(Doubt(name, "unseen", text))
        elif sigma is not None and sigma > scale and error != 0:
            text = f"{name} is known to {_text(name, sigma)} only, worse than its plausible {_text(name, scale)}"
            found.append(Doubt(name, "uncertain", text))
    return tuple(found)


def check_exportable(robot: Robot, force: bool = False) -> tuple[Doubt, ...]:
    """Let a calibration pass to a controller, or refuse it by name and reason.

    Returns:
        the doubts that ``force`` overrode.
    Raises:
        RefusedError: there are doubts and ``force`` is False.
    """
    found = doubts(robot)
    if found and not force:
        reasons = "; ".join(doubt.text for doubt in found)
        raise RefusedError(
            f"this calibration of {robot.name} should not go to a controller: {reasons}. Measure what sees these "
            "parameters, hold them at nominal, state their true scales, or force the export"
        )
    return found


def _unseen_errors(robot: Robot, record: Record) -> dict[str, float]:
    """The part of every error along directions without information, mm or rad.

    The covariance is zero exactly there: in scaled coordinates its null space is the space of unseen directions (and of
    parameters that were held). A minimum-norm estimate has no error there; and where a frame took what it shares with a
    link, the link has no error at all, so that no more than a parameter's own error is ever put down to it.
    """
    names = list(record.errors)
    scales = np.array([_scale(robot, name) for name in names])
    covariance = record.covariance / np.outer(scales, scales)
    # through the correlations: well and badly seen directions may be ten orders of magnitude apart
    deviations = np.sqrt(np.diag(covariance))
    weight = 1 / np.where(deviations > 0, deviations, 1.0)
    values, vectors = np.linalg.eigh(weight[:, None] * covariance * weight)
    null, _ = np.linalg.qr(weight[:, None] * vectors[:, values <= _NULL])
    scaled = np.array([record.errors[name] for name in names]) / scales
    unseen = null @ (null.T @ scaled)
    own = np.sign(unseen) * np.minimum(np.abs(unseen), np.abs(scaled))
    return dict(zip(names, (scales * own).tolist(), strict=True))


def _scale(robot: Robot, name: str) -> float:
    return robot.scales.get(name, SCALE[parameter_unit(name)])


def _text(name: str, value: float) -> str:
    return f"{np.degrees(value):.3g} deg" if parameter_unit(name) == "rad" else f"{value:.3g} mm"
