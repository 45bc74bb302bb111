"""What positions of one point cannot tell: the unseen directions, and what two ways of fitting make of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.config.study import SimulationOneConfig
from symcal.fit.identifiability import Identifiability, analyse
from symcal.fit.many import fit_many
from symcal.kernels import batch_function
from symcal.model.measurement import Measurement, Setup
from symcal.paper.repetitions import judge, measure
from symcal.paper.results import Gauge, Setting, StudyPlan
from symcal.paper.setting import target_measurement
from symcal.paper.simulation_2 import unregularised

Array = NDArray[np.float64]


def gauge(
    setting: Setting, plan: StudyPlan, count: int, solver: SimulationOneConfig, rng: np.random.Generator
) -> Gauge:
    """Spectra at nominal and at the truth, and ``count`` repetitions with plausible sizes as prior, and without."""
    model, nominal = setting.model, np.zeros(len(setting.truth))
    data = measure(setting, plan.poses, count, rng)
    spread = {
        "unregularised": np.array([unregularised(setting, plan.poses, z, solver) for z in data]),
        "posterior": fit_many(model, plan.poses, data, setting.sigma).x,
    }
    return Gauge(
        plan=plan.name,
        seen=_seen(setting, plan.poses, nominal, model.measurement, model.setup),
        at_truth=_seen(setting, plan.poses, setting.truth, model.measurement, model.setup),
        target=_seen(setting, plan.poses, nominal, *target_measurement(setting)),
        spread=spread,
        true_rms={name: judge(setting, x, rng)[:, 3] for name, x in spread.items()},
    )


def _seen(setting: Setting, poses: Array, x: Array, measurement: Measurement, setup: Setup) -> Identifiability:
    (jacobian,) = batch_function(measurement.jacobian, evaluations=0)(poses, x, setup.vector)
    return analyse(jacobian.reshape(-1, len(x)) / setting.sigma, measurement.parameters)
