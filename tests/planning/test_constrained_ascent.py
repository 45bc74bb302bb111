"""Maxima on the borders of constraints, against sequential quadratic programming by somebody else."""

from __future__ import annotations

import numpy as np
import scipy.optimize
from planning_cases import handling

from symcal.planning.constrained_ascent import climb_within
from symcal.planning.constraints import Constraint, feasible
from symcal.planning.region import tool_points

STARTS = 12


def test_ends_are_as_high_as_those_of_sequential_quadratic_programming(rng):
    info = handling()
    area, points = info.area, tool_points(info)

    def near(poses):
        return np.linalg.norm(points(poses)[0][:, :2], axis=1) - 500.0

    def low(poses):
        return points(poses)[0][:, 2] + 0.2 * points(poses)[0][:, 0] - 1200.0

    within = feasible((Constraint("near", "mm", near, 100.0), Constraint("low", "mm", low, 100.0)))
    poses = area.sample(rng, 2000)
    plan = area.snapped(rng, 40)
    weight = np.linalg.inv(info.total(plan))
    poses = poses[within(poses)][:STARTS]
    ends, values = climb_within(info.function, weight, area, within, poses, 60)
    assert within(ends).all()
    np.testing.assert_allclose(values, info.function.weighted(ends, weight))
    assert (np.abs(within.violations(ends)) < 1e-6).any(axis=1).sum() >= STARTS // 3  # most maxima lie on a border

    def theirs(start):
        found = scipy.optimize.minimize(
            lambda u: -float(info.function.weighted(area.lower + area.span * u[None], weight)[0]),
            area.unit(start[None])[0],
            method="SLSQP",
            bounds=[(0.0, 1.0)] * area.dof,
            constraints={"type": "ineq", "fun": lambda u: -within.violations(area.lower + area.span * u[None])[0]},
            options={"maxiter": 200},
        )
        return -found.fun

    # from the ends nothing higher is near; the best of all is at least theirs
    assert all(theirs(end) <= value * (1 + 2e-3) for end, value in zip(ends, values, strict=True))
    assert values.max() >= max(theirs(start) for start in poses) * (1 - 1e-4)
