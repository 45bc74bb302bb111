"""Simulation II again and again: what one draw of noise and one random plan cannot show."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symcal.fit.many import fit_many
from symcal.kernels import batch_function
from symcal.paper.results import Repetitions, Setting, StudyPlan
from symcal.paper.setting import positions
from symcal.solvers.least_squares import Tolerances

Array = NDArray[np.float64]

NEW_RANDOM = "new_random"

EXACT = Tolerances(cost=1e-15)
"""Printed figures are then those of the minimum to all their digits."""

_TOGETHER = 50  # repetitions whose test positions are held at once


def repeat(setting: Setting, plans: Mapping[str, StudyPlan], count: int, rng: np.random.Generator) -> Repetitions:
    """Simulation II ``count`` times on every plan, and on a new random plan each time; the test noise is shared."""
    for_random, for_test, *for_plans = rng.spawn(3 + len(plans))
    drawn = setting.info.area.sample(for_random, count * setting.count).reshape(count, setting.count, -1)
    poses = {name: plan.poses for name, plan in plans.items()} | {NEW_RANDOM: drawn}
    names = tuple(poses)
    errors: dict[str, Array] = {}
    figures: dict[str, Array] = {}
    bounds: dict[str, Array] = {}
    slowest = 0
    for name, own in zip(names, for_plans, strict=True):
        q = poses[name]
        fits = fit_many(setting.model, q, measure(setting, q, count, own), setting.sigma, tolerances=EXACT)
        slowest = max(slowest, int(fits.iterations.max()))
        errors[name] = fits.x
        bounds[name] = np.broadcast_to(cramer_rao(setting, q), count)
    seed = for_test.integers(2**63)  # every plan is judged against the same noisy test data
    for name in names:
        figures[name] = judge(setting, errors[name], np.random.default_rng(seed))

    def column(i: int) -> dict[str, Array]:
        return {name: figures[name][:, i] for name in names}

    return Repetitions(
        names=names,
        measured_mean=column(0),
        measured_max=column(1),
        true_mean=column(2),
        true_rms=column(3),
        true_max=column(4),
        cramer_rao_mm=bounds,
        errors={name: errors[name] for name in plans},
        iterations=slowest,
    )


def measure(setting: Setting, q: Array, count: int, rng: np.random.Generator) -> Array:
    """Noisy positions of the true robot, shape (count, N, 3), mm, at poses (N, dof) or (count, N, dof)."""
    exact = positions(setting, q.reshape(-1, q.shape[-1]), setting.truth).reshape(*q.shape[:-1], 3)
    noise = setting.noise.draw(setting.noise.sizes["position"], (count, q.shape[-2], 3), rng)
    return np.asarray(exact + noise)


def judge(setting: Setting, errors: Array, rng: np.random.Generator) -> Array:
    """Errors at the test poses of identified robots, errors (R, n): per row mean and max against noisy test data, and
    mean, rms and max against truth; shape (R, 5), mm."""
    test, truth = setting.test_poses, setting.test_positions
    out = np.empty((len(errors), 5))
    for first in range(0, len(errors), _TOGETHER):
        some = errors[first : first + _TOGETHER]
        (found,) = setting.predict(
            np.tile(test, (len(some), 1)), np.repeat(some, len(test), axis=0), setting.model.setup.vector
        )
        off = found.reshape(len(some), len(test), 3) - truth
        noise = setting.noise.draw(setting.noise.sizes["position"], off.shape, rng)
        exact, seen = _norms(off), _norms(off - noise)
        out[first : first + _TOGETHER] = np.stack(
            [
                seen.mean(axis=1),
                seen.max(axis=1),
                exact.mean(axis=1),
                np.sqrt(np.mean(exact**2, axis=1)),
                exact.max(axis=1),
            ],
            axis=1,
        )
    return out


def _norms(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def cramer_rao(setting: Setting, q: Array) -> Array:
    """Lower bound of the rms error over the test poses at the true parameters, with unseen directions left out, mm.

    sqrt(mean of tr(J C J^T)), C = S V_1 diag(1 / w) V_1^T S with W^T W = V diag(w) V^T.

    Args:
        q: poses of one plan, shape (N, dof), or of many, (R, N, dof).
    Returns:
        shape () or (R,).
    """
    model, scales = setting.model, setting.model.parameters.scales
    (asked,) = model.jacobian(setting.test_poses, setting.truth, model.setup.vector)
    asked = asked.reshape(-1, len(scales)) * scales
    weight = asked.T @ asked / len(setting.test_poses)
    (seen,) = batch_function(model.measurement.jacobian)(q.reshape(-1, q.shape[-1]), setting.truth, model.setup.vector)
    rows = seen.reshape(*q.shape[:-2], -1, len(scales)) * (scales / setting.sigma)
    values, vectors = np.linalg.eigh(rows.swapaxes(-1, -2) @ rows)
    inverse = np.where(values > 1.0, 1.0 / np.maximum(values, 1.0), 0.0)
    return np.asarray(np.sqrt(np.einsum("...ji,...i,jk,...ki->...", vectors, inverse, weight, vectors, optimize=True)))
