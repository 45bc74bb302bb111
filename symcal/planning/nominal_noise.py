"""The noise that a plan is made for, and a promise is held against."""

from __future__ import annotations

from symcal.config.conversion import ExperimentFile, SimulatedData
from symcal.errors import RefusedError
from symcal.model.model import Model


def nominal_noise(file: ExperimentFile, model: Model) -> dict[str, float]:
    """Standard deviation by group of the measurement, mm and rad: as measured, as planned with, or as simulated.

    Raises:
        RefusedError: none of them is stated. What a plan can promise is a multiple of the noise, and what is
        identifiable depends on it.
    """
    stated = model.measurement.stated_noise
    simulated: dict[str, float] = {}
    if isinstance(file.data, SimulatedData):
        root = 3**-0.5 if file.data.noise.distribution == "uniform" else 1.0
        simulated = {name: size * root for name, size in file.data.noise.sizes.items()}
    out: dict[str, float] = {}
    for group in model.measurement.groups:
        value = stated.get(group.name)
        factor = file.units.factor(group.unit)
        value = value or _times(file.plan.noise.get(group.quantity), factor)
        value = value or _times(simulated.get(group.quantity), factor)
        if not value:
            key = "measurement" if file.measurement is not None else f"measurements.{group.observation}"
            raise RefusedError(
                f"no noise of the {group.name} is stated, so a plan can promise nothing and what is identifiable is "
                f"undecided: give its standard deviation per axis under '{key}.noise.{group.quantity}', or under "
                f"'plan.noise.{group.quantity}' if it is only nominal"
            )
        out[group.name] = value
    return out


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor
