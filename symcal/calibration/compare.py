"""Every state of a calibration on the same measurements: those at hand, or each fold held out in turn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration, baseline_model, calibrate, calibrate_near
from symcal.calibration.evaluate import Errors, evaluate, pooled
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.model.model import Model
from symcal.outputs.side_by_side import side_by_side

Refine = Callable[[Calibration, Dataset], Calibration]
"""What is done with a calibration after it was identified from a dataset."""


def as_it_is(calibration: Calibration, _: Dataset) -> Calibration:
    """Nothing is done with it."""
    return calibration


def folds(data: Dataset, count: int, rng: np.random.Generator) -> list[NDArray[np.intp]]:
    """Indices of the held-out poses of each fold; poses in random order, sizes equal to within one.

    Raises:
        RefusedError: fewer poses than folds.
    """
    if len(data) < count:
        raise RefusedError(f"{len(data)} poses cannot be split into {count} folds")
    return [np.sort(part) for part in np.array_split(rng.permutation(len(data)), count)]


def cross_validate(
    model: Model,
    data: Dataset,
    options: Options,
    count: int,
    rng: np.random.Generator,
    refine: Refine = as_it_is,
    *,
    near: Calibration | None = None,
) -> dict[str, Errors]:
    """Errors on held-out folds, each predicted by an identification on the other folds; pooled over all poses.

    Args:
        refine: what is done with the identification of every fold. near: the identification from all of these data,
            if it is known: the fits of the folds start where places stand in it, see `calibrate_near`.
    Raises:
        RefusedError: too few poses for a fold's identification.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> model = sc.build_model(robot, task)
        >>> errors = sc.cross_validate(model, data, sc.Options(), 4, rng)
        >>> errors["after"].statistics.rms < errors["before"].statistics.rms
        True
    """
    baseline = baseline_model(model)

    def errors_of(held_out: NDArray[np.intp]) -> dict[str, Errors]:
        mask = np.zeros(len(data), dtype=bool)
        mask[held_out] = True
        labelled = replace(data, split=tuple("test" if out else "train" for out in mask))
        if near is None:
            own = calibrate(model, baseline, labelled, options, mistakes=())
        else:
            own = calibrate_near(model, baseline, labelled, options, near)
        found = {name: evaluate(state, data.take(held_out)) for name, state in refine(own, labelled).states.items()}
        return {name: replace(each, pose=held_out[each.pose]) for name, each in found.items()}

    every = side_by_side([partial(errors_of, held_out) for held_out in folds(data, count, rng)])
    return {name: pooled([each[name] for each in every]) for name in every[0]}


def compare(calibration: Calibration, data: Dataset) -> Mapping[str, Errors]:
    """Errors of every state of a calibration on the same measurements.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> errors = sc.compare(sc.identify(robot, data, task), data)
        >>> errors["after"].statistics.rms < errors["before"].statistics.rms
        True
    """
    return {name: evaluate(state, data) for name, state in calibration.states.items()}
