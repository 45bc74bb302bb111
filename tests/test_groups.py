"""Gains of groups of joint terms against a dense marginal likelihood written here."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import ARM
from scipy.optimize import minimize
from term_law import measured

from symcal.fit.estimation import Options, fit, variance_model
from symcal.fit.groups import enough, groups_at
from symcal.fit.residual_rows import rows_of
from symcal.fit.variance_components import at_variances
from symcal.fit.variances import NOTHING, Variances
from symcal.joints.coupling import Coupling
from symcal.joints.harmonics import Harmonics
from symcal.joints.ratio import Ratio
from symcal.model.model import build_model
from symcal.model.task import Task

TERMS = (
    *(Harmonics(j, True, k=(1,)) for j in (1, 2, 3)),
    *(Harmonics(j, True, k=(2,)) for j in (1, 2, 3)),
    Ratio(4, True),
    Coupling(6, True, by=5),
)
TRUE = {"q1_sin_2": 3e-4, "q2_cos_2": -5e-4, "q4_ratio": 2e-3}
NAMES = ("harmonics 1", "harmonics 2", "ratio", "coupling")


@cache
def fitted():
    """A fit with four groups of which two are true; link sizes known, noise of both kinds unknown."""
    robot = replace(ARM, terms=TERMS)
    model, rng = build_model(robot, Task.of("pose")), np.random.default_rng(2)
    truth = {p.name: 0.1 * float(rng.normal() * p.scale) for p in model.parameters.items if not p.group} | TRUE
    q = rng.uniform(ARM.lower, ARM.upper, (30, 6))
    data = measured(robot, truth, q, rng)
    options = Options(scales="stated", shrinking=NAMES)
    rows = rows_of(model.measurement, data, model.setup, model.residuals)
    found = fit(rows, model.kinematic, options)
    system = variance_model(rows, model.kinematic, options)
    return (
        model,
        rows,
        found,
        system,
        groups_at(system, found.x, Variances(found.sigmas, _factors(found), found.weights)),
    )


def _factors(found):
    return {"": found.factor, **found.factors}


class Dense:
    """-2 log of the Gaussian marginal density of the linearised readings, by their covariance.

    y = r - J x: readings of the model linearised at x, which are J e + noise with e of variance s^2 by parameter.
    """

    def __init__(self) -> None:
        model, rows, found, _, _ = fitted()
        r, jacobian = rows(found.x)
        index = model.parameters.indices(model.kinematic)
        self.j = jacobian[:, :, index].reshape(r.size, -1)
        self.y = r.ravel() - self.j @ found.x[index]
        items = [model.parameters.items[i] for i in index]
        self.scales = np.array([p.scale for p in items])
        self.groups = np.array([p.group for p in items])
        self.turns = np.tile([False] * 3 + [True] * 3, len(r))

    def value(self, noise: tuple[float, float], factors: dict[str, float]) -> tuple[float, np.ndarray]:
        """And its slopes by the two noises and the groups in order of ``NAMES``.

        noise: log variances, mm^2 and rad^2. factors: log variances by group.
        """
        size = self.scales**2 * np.exp([factors.get(g, 0.0) for g in self.groups])
        own = [np.where(self.turns, 0.0, np.exp(noise[0])), np.where(self.turns, np.exp(noise[1]), 0.0)]
        covariance = (self.j * size) @ self.j.T + np.diag(own[0] + own[1])
        inverse = np.linalg.inv(covariance)
        told = inverse @ self.y
        changes = [np.diag(each) for each in own]
        changes += [(self.j * (size * (self.groups == g))) @ self.j.T for g in NAMES]
        slopes = [np.sum(inverse * change) - told @ change @ told for change in changes]
        return float(np.linalg.slogdet(covariance)[1] + self.y @ told), np.array(slopes)

    def least(self, without: tuple[str, ...]) -> float:
        """Over noise (tied as the package ties it) and the factors of the other groups, from two starts."""
        _, _, found, system, groups = fitted()
        nothing, free = 2 * np.log(NOTHING), [g for g in NAMES if g not in without]
        (tie,) = system.ties(groups.names)
        kept = [0, 1, *(2 + NAMES.index(g) for g in free)]

        def objective(v: np.ndarray) -> tuple[float, np.ndarray]:
            factors = dict.fromkeys(without, nothing) | dict(zip(free, v[2:], strict=True))
            value, slope = self.value((v[0], v[1]), factors)
            off = v[1] - v[0] - tie.gap
            slope[:2] += 4 * off / (tie.width**2 + off**2) * np.array([-1.0, 1.0])
            return value + 2 * np.log1p((off / tie.width) ** 2), slope[kept]

        noise = [2 * np.log(found.sigmas[g]) for g in ("position", "orientation")]
        # far below the noise there is, a dense covariance cannot be inverted
        bounds = [(each - 8.0, each + 8.0) for each in noise] + [(nothing, 2 * np.log(100.0))] * len(free)
        best = np.inf
        for start in (0.0, -6.0):
            at = np.array([*noise, *[start] * len(free)])
            for _ in range(2):
                settings = {"ftol": 1e-16, "gtol": 1e-8}
                out = minimize(objective, at, jac=True, bounds=bounds, method="L-BFGS-B", options=settings)
                at = out.x
            best = min(best, float(out.fun))
        return best


@pytest.mark.parametrize("phi", [(0.0, 0.0), (-2.0, 1.5)])
def test_the_likelihood_is_the_dense_one_up_to_a_constant(phi):
    """At any variances, not at the best ones alone."""
    _, _, found, system, groups = fitted()
    dense, ties = Dense(), system.ties(groups.names)
    values = []
    for step in (0.0, 1.0):
        v = groups.model.phi(groups.names, Variances(found.sigmas, _factors(found), found.weights))
        v = v + step * np.array([phi[0], phi[1], 0.3, -0.4, 0.5, 0.7])[: len(v)]
        own = at_variances(groups.blocks, groups.fixed, v, ties).value
        tied = 2 * np.log1p((ties[0].off(v) / ties[0].width) ** 2)
        by_name = dict(zip(groups.names, v, strict=True))
        factors = {g: by_name[f"sizes of {g}"] for g in NAMES}
        values.append(own - tied - dense.value((by_name["position"], by_name["orientation"]), factors)[0])
    assert values[0] == pytest.approx(values[1], abs=1e-6)


@pytest.mark.parametrize("without", [("harmonics 1",), ("harmonics 2",), ("ratio",), ("coupling", "harmonics 1")])
def test_gains_are_those_of_the_dense_marginal_likelihood(without):
    groups, dense = fitted()[4], Dense()
    found = groups.without(without).value - groups.without(()).value
    wanted = dense.least(without) - dense.least(())
    assert found == pytest.approx(wanted, abs=1e-6 * max(1.0, abs(wanted)))


def test_what_is_not_there_is_left_out_one_after_the_other():
    groups = fitted()[4]
    out = groups.eliminated(NAMES)
    assert out.kept == ("harmonics 2", "ratio")
    assert set(out.gains) == set(NAMES)
    for name in NAMES:
        assert (out.gains[name] > enough(len(NAMES))) == (name in out.kept)
    # gains of what is kept are those beside it alone
    gone = ("harmonics 1", "coupling")
    wanted = groups.without((*gone, "ratio")).value - groups.without(gone).value
    assert out.gains["ratio"] == pytest.approx(wanted, abs=1e-3)


def test_residuals_of_held_out_poses_are_those_of_a_fit_without_them():
    """By the dense law: the expectation of held-out readings given the others."""
    _, rows, found, _, groups = fitted()
    gone = ("harmonics 1", "coupling")
    folds = [np.arange(k, 30, 5) for k in range(5)]
    own = groups.held_out(gone, folds)
    variances = groups.variances_without(gone)
    dense = Dense()
    size = dense.scales**2 * np.array([variances.factors.get(g, 1.0) ** 2 for g in dense.groups])
    noise = np.where(dense.turns, variances.sigmas["orientation"], variances.sigmas["position"]) ** 2
    covariance = (dense.j * size) @ dense.j.T
    wanted = np.empty(dense.y.size)
    for fold in folds:
        held = np.isin(np.repeat(np.arange(30), 6), fold)
        inner = covariance[np.ix_(~held, ~held)] + np.diag(noise[~held])
        wanted[held] = dense.y[held] - covariance[np.ix_(held, ~held)] @ np.linalg.solve(inner, dense.y[~held])
    np.testing.assert_allclose(own.ravel() / np.sqrt(noise), wanted / np.sqrt(noise), atol=1e-5)
    assert rows.residual(found.x).shape == own.shape
