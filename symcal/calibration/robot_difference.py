"""Did the robot change? Two calibrations of one robot, compared in what both determine.

Parameters of links and joint terms are compared; places of base, tool and instruments belong to a set-up and are not.
What a calibrated robot records is enough: posterior, plausible sizes, degrees of freedom of the noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal import kinematics
from symcal.calibration.parameter_difference import Difference, Estimate, difference
from symcal.calibration.same_robot import what_differs
from symcal.calibration.tool_difference import ToolDifference, tool_difference
from symcal.errors import InputError, RefusedError
from symcal.instruments import KINDS
from symcal.model.growth import growth_slope
from symcal.model.parameter_set import parameter_set
from symcal.robot.robot import Record, Robot

Array = NDArray[np.float64]

_NO_COVARIANCE = -1e-6  # least eigenvalue of a correlation matrix that is rounding
_BARELY = 1e-12  # share not learnt: below, it is rounding


@dataclass(frozen=True, slots=True, eq=False)
class RobotDifference:
    """What two calibrations of one robot differ by.

    names: of the n parameters compared. units: mm, rad and such by name. first, second: identified errors (minus
    nominal), shape (n,). numbers: difference of the second and the first, judged. left_out: parameters that one of them
    does not estimate, with the words why. tool: what it comes to, mm. same: the two records are the same numbers.
    """

    names: tuple[str, ...]
    units: Mapping[str, str]
    first: Array
    second: Array
    numbers: Difference
    left_out: Mapping[str, str]
    tool: ToolDifference
    same: bool

    @property
    def differing(self) -> tuple[str, ...]:
        """Parameters that differ beyond their joint uncertainty, the surest first."""
        return tuple(self.names[i] for i in self.numbers.differing())


def robot_difference(first: Robot, second: Robot) -> RobotDifference:
    """Compare two calibrated robots that were measured independently; the first is the reference.

    Raises:
        InputError: one of them was never calibrated, or its covariance is none.
        RefusedError: they are different robots, or estimate nothing in common.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> first, second = (sc.identify(robot, data.take(half), task).robot for half in (range(20), range(20, 40)))
        >>> len(sc.robot_difference(first, second).names)
        15
    """
    records = _record(first), _record(second)
    differs = what_differs(first, second)
    if differs:
        raise RefusedError(f"these are calibrations of different robots: {differs}")
    described = {p.name: p for p in (*first.described, *second.described)}
    free = [[name for name in described if (record.sigmas.get(name) or 0.0) > 0] for record in records]
    names = tuple(name for name in free[0] if name in free[1])
    if not names:
        raise RefusedError("the two calibrations estimate no parameter of the robot in common: nothing to compare")
    a, b = (_estimate(record, names) for record in records)
    slope = _growth(first, names) if not all(_sees_length(robot) for robot in (first, second)) else None
    found = difference(a, b, slope)
    return RobotDifference(
        names=names,
        units={name: described[name].unit for name in names},
        first=a.mean,
        second=b.mean,
        numbers=found,
        left_out={
            name: f"estimated in the {'first' if name in free[0] else 'second'} alone"
            for name in described
            if (name in free[0]) != (name in free[1])
        },
        tool=tool_difference(first, second, names, found.covariance, _loose(records[0]) | _loose(records[1])),
        same=dict(records[0].errors) == dict(records[1].errors)
        and np.array_equal(records[0].covariance, records[1].covariance),
    )


def _record(robot: Robot) -> Record:
    if robot.record is None:
        raise InputError(f"the robot '{robot.name}' has no 'calibration': compare takes calibrated robots")
    return robot.record


def _estimate(record: Record, names: tuple[str, ...]) -> Estimate:
    """What a calibration knows of parameters, whatever it knows of the others."""
    place = {name: i for i, name in enumerate(record.errors)}
    index = [place[name] for name in names]
    covariance = record.covariance[np.ix_(index, index)]
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if not sigmas.all() or np.linalg.eigvalsh(covariance / np.outer(sigmas, sigmas))[0] < _NO_COVARIANCE:
        raise InputError("this is no covariance: was it changed by hand?", key="calibration.covariance")
    try:
        dof = float(record.provenance.get("dof") or math.inf)
        learnt = [float(record.provenance["learnt"][name]) for name in names]
    except (TypeError, ValueError, LookupError):
        message = "the calibration does not say what was learnt from the data: identify once more"
        raise InputError(message, key="calibration.provenance.learnt") from None
    sizes = [_size(share, sigma) for share, sigma in zip(learnt, sigmas.tolist(), strict=True)]
    mean = np.array([record.errors[name] for name in names])
    return Estimate(mean, (covariance + covariance.T) / 2, np.array(sizes), dof if dof > 0 else math.inf)


def _size(learnt: float, sigma: float) -> float:
    """Standard deviation of a parameter before the data: learnt is one less the ratio of the variances."""
    return sigma / math.sqrt(min(max(1 - learnt, _BARELY), 1.0))


def _loose(record: Record) -> set[str]:
    """What a set-up finds from its own measurements: `base`, `tool`, or both."""
    found = {part for part in ("base", "tool") for n, s in record.sigmas.items() if n.startswith(f"{part}_") and s}
    for each in _measurements(record):
        unknown, on = each.get("unknown", {}), {"world": "base", "base": "base", "flange": "tool", "tool": "tool"}
        if unknown.get("place"):
            found.add(on.get(each.get("on", ""), "tool"))
        if unknown.get("target") or unknown.get("points"):
            found.add(on.get(each.get("target", {}).get("on", ""), "tool"))
    return found


def _sees_length(robot: Robot) -> bool:
    """Whether the readings change when all lengths grow by the same share; see `symcal.model.growth`."""
    kinds = [each.get("instrument") for each in _measurements(_record(robot))]
    seen = [KINDS[kind].sees_length for kind in kinds if kind in KINDS]
    return not seen or any(seen) or not all(joint.revolute for joint in robot.joints)


def _measurements(record: Record) -> list[dict[str, Any]]:
    found = record.provenance.get("measurements", {})
    return [each for each in found.values() if isinstance(each, dict)] if isinstance(found, dict) else []


def _growth(robot: Robot, names: tuple[str, ...]) -> Array:
    """Slope of the growth of all lengths by the parameters, shape (n,)."""
    nominal = robot.nominal()
    parameters = parameter_set(nominal)
    slope = parameters.mapping(growth_slope(kinematics.chain(nominal, parameters)))
    return np.array([slope.get(name, 0.0) for name in names])
