"""Identification of many trials: at once where everything that is not the robot is known, else one by one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset, Readings
from symcal.errors import RefusedError
from symcal.fit.many import fit_many
from symcal.fit.posterior import Posterior
from symcal.fit.redundancy import check_redundancy
from symcal.fit.residual_rows import rows_of
from symcal.fit.whitened import beforehand
from symcal.model.model import Model
from symcal.trials.description import Cell, Description
from symcal.trials.draw import Drawn, draw
from symcal.trials.setting import Setting

Array = NDArray[np.float64]

NORMAL_95 = 1.959963984540054  # half width of the interval that holds 95 % of a normal law, in standard deviations


@dataclass(frozen=True, slots=True)
class Estimate:
    """One identification.

    x: errors, shape (n,), in the model's setup or that of the fit. free: indices of the parameters that were found.
    covariance: of these, (n', n'); root: a square root of it. half_widths: of the stated 95 % intervals, (n',).
    assumed: standard deviations before the data, (n',). posterior: where noise or sizes were estimated too, whose
    intervals are wider; root is then not needed. trouble: why it must not be used.
    """

    x: Array
    free: NDArray[np.intp]
    covariance: Array
    half_widths: Array
    assumed: Array
    rank: int
    iterations: int
    cost: float
    setup: Array
    root: Array
    posterior: Posterior | None = None
    trouble: str = ""


Refusal = str
"""Why there is no estimate of a trial."""


def one_by_one(description: Description, setting: Setting) -> str:
    """Why trials must be identified one after the other, in words; empty where many go at once."""
    model, options = setting.model, description.options
    unplaced = [place.on for o in model.task.everything for place in (o.at, o.target.at) if place.unknown]
    reasons = {
        "the noise is estimated": not description.told,
        "the sizes of the errors are estimated": options.scales == "estimated",
        f"the loss is {options.loss}": options.loss != "linear",
        f"the solver is {options.solver}": options.solver != "levenberg_marquardt",
        "places are found": bool(unplaced),
        "not every pose is read by every instrument": not setting.written_out,
    }
    return ", ".join(reason for reason, true in reasons.items() if true)


def identify(description: Description, setting: Setting, cell: Cell, drawn: Drawn) -> list[Estimate | Refusal]:
    """An estimate for every trial, or why it is refused."""
    wanted = [i for i in range(len(drawn.z)) if i not in drawn.refused]
    found: dict[int, Estimate | Refusal] = dict(drawn.refused)
    if one_by_one(description, setting):
        found |= {i: _calibrated(description, setting, cell, drawn, i) for i in wanted}
    elif wanted:
        found |= zip(wanted, _at_once(setting, cell, drawn, wanted), strict=True)
    return [found[i] for i in range(len(drawn.z))]


def _at_once(setting: Setting, cell: Cell, drawn: Drawn, wanted: list[int]) -> list[Estimate]:
    model = setting.model
    noise = setting.sigma(cell)
    sigma = model.measurement.per_component(noise) if len(set(noise.values())) > 1 else next(iter(noise.values()))
    q = drawn.q if drawn.q.ndim == 2 else drawn.q[wanted]
    fits = fit_many(model, q, drawn.z[wanted], sigma, strict=False)
    index, assumed = model.parameters.indices(fits.free), beforehand(model.parameters, fits.free).assumed
    half = NORMAL_95 * np.sqrt(np.diagonal(fits.covariance, axis1=1, axis2=2))
    return [
        Estimate(
            fits.x[i],
            index,
            fits.covariance[i],
            half[i],
            assumed,
            int(fits.rank[i]),
            int(fits.iterations[i]),
            float(fits.cost[i]),
            model.setup.vector,
            fits.root[i],
            trouble="" if fits.converged[i] else "the identification did not converge",
        )
        for i in range(len(wanted))
    ]


def _dataset(model: Model, q: Array, z: Array) -> Dataset:
    return Dataset(
        of=tuple(Readings(o.instrument, o.name, o.features) for o in model.task.observations),
        q=q,
        z=z,
        labels=tuple(map(str, range(len(q)))),
        split=("train",) * len(q),
        provenance="simulated",
    )


def refusal(description: Description, setting: Setting, cell: Cell) -> Refusal:
    """Why no trial of a cell can be identified, by the poses of its first one; empty if they can.

    The whole identification of one trial finds that out by itself.
    """
    model = setting.model
    if one_by_one(description, setting):
        return ""
    first = draw(description, setting, cell, [cell.number * description.repetitions])
    rows = rows_of(model.measurement, _dataset(model, first.poses(0), first.z[0]), model.setup, model.residuals)
    try:
        check_redundancy(rows, (*model.kinematic, *model.placement), not description.told)
    except RefusedError as error:
        return str(error)
    return ""


def _calibrated(description: Description, setting: Setting, cell: Cell, drawn: Drawn, i: int) -> Estimate | Refusal:
    """One trial, as `symcal identify` identifies; without its search for mistakes between robot and data."""
    from symcal.calibration.calibrate import calibrate

    model = setting.model
    options = replace(description.options, sigma=setting.sigma(cell) if description.told else {})
    try:
        found = calibrate(model, None, _dataset(model, drawn.poses(i), drawn.z[i]), options, ())
    except RefusedError as error:
        return str(error)
    after = found.after
    return Estimate(
        after.x,
        model.parameters.indices(after.free),
        after.posterior.covariance,
        after.posterior.half_widths(),
        after.posterior.assumed,
        after.identifiability.rank,
        after.iterations,
        float(after.solution.cost),
        after.setup.vector,
        np.zeros((0, 0)),
        after.posterior,
        trouble=after.trouble,
    )
