"""A model whose flange can be displaced along the axes of the base: what a remainder is identified with."""

from __future__ import annotations

from dataclasses import dataclass

from symcal.errors import RefusedError
from symcal.joints.remainder import SHIFTS
from symcal.kinematics import chain
from symcal.model.assembled import RowKernel, rows_kernel
from symcal.model.measurement import Measurement
from symcal.model.model import Model
from symcal.model.observe import observe
from symcal.parameters import SCALE, Parameter, ParameterSet


@dataclass(frozen=True, slots=True)
class Shifted:
    """A measurement with three parameters more, `SHIFTS`, behind its own, and its residuals."""

    measurement: Measurement
    residuals: tuple[RowKernel, ...]


def with_shift(model: Model) -> Shifted:
    """The same measurements where the flange is displaced.

    Raises:
        RefusedError: what is measured is neither points nor poses.
    """
    task, own = model.task, model.parameters
    for o in task.observations:
        if not o.instrument.gives_point:
            raise RefusedError(
                f"a remainder is found from positions or poses alone, and '{o.name}' reads {o.instrument.label}: leave "
                "out 'identification.remainder'"
            )
    shifts = tuple(Parameter(name, "mm", 0.0, SCALE["mm"]) for name in SHIFTS)
    parameters = ParameterSet((*own.items, *shifts), own.joint_priors)
    measurement = observe(chain(model.robot, parameters, conditions=True), *task.observations, values=task.values)
    return Shifted(measurement, tuple(rows_kernel(part) for part in measurement.parts))
