"""Few poses, correlated joints, hopeless sets: as good as the best truncation could be, or refused. Short form of
few_poses.py."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases import revolute
from few_poses import Case, best_truncation, draw, identified, measured_at, poses, summary, true_rms
from scipy import stats

from symcal.calibration.calibrate import Calibration, calibrate
from symcal.calibration.evaluate import evaluate, expected_position_rms, statistics
from symcal.calibration.simulate import simulate
from symcal.errors import RefusedError
from symcal.fit.estimation import Fit, Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.fit.robust import Loss
from symcal.fit.whitened import FREEDOM
from symcal.instruments.noise import Noise
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.robot import Robot
from symcal.runs.data import measurements
from symcal.runs.load import load
from symcal.solvers import SOLVERS

COUNT = 24


@cache
def sets() -> list[tuple[Case, Calibration]]:
    cases = [draw(seed) for seed in range(COUNT)]
    return [(case, identified(case)) for case in cases]


def test_errors_to_the_truth_are_those_of_the_best_rank_that_nobody_knows() -> None:
    ratios = np.array([true_rms(c, f.setup, f.after.x) / best_truncation(c, f.setup) for c, f in sets()])
    assert np.median(ratios) <= 1.1, summary(ratios)
    assert np.percentile(ratios, 90) <= 1.3, summary(ratios)
    assert ratios.max() <= 2, summary(ratios)


def test_all_converge() -> None:
    assert [f.after.message for _, f in sets() if not f.after.converged] == []
    assert all(f.after.solution.status.converged for _, f in sets())


def test_the_noise_is_neither_over_nor_underestimated() -> None:
    """Residuals over the true noise are chi-squared with the degrees of freedom that the fits state."""
    assert in_band(sum(residual_sum(case, f.after) for case, f in sets()), sum(f.after.dof for _, f in sets()))
    positions = [(f.after.dof, f.after.sigmas["position"] / c.noise.sizes["position"]) for c, f in sets()[1::2]]
    assert in_band(sum(dof * ratio**2 for dof, ratio in positions), sum(dof for dof, _ in positions))


def in_band(value: float, dof: float) -> bool:
    return bool(stats.chi2.ppf(5e-4, dof) < value < stats.chi2.isf(5e-4, dof))


def residual_sum(case: Case, found: Fit) -> float:
    """Squared residuals over the true noise."""
    sizes = {"position": case.noise.sizes["position"], "orientation": case.noise.sizes["orientation"]}
    sigma = case.model.measurement.per_component(sizes)
    return float(np.sum((residuals(case.model, found, case) / sigma) ** 2))


def residuals(model: Model, found: Fit, case: Case) -> np.ndarray:
    r, _ = model.residual(case.data.q, found.x, found.setup.vector, case.data.z)
    return r


def objective(case: Case, found: Fit, x: np.ndarray) -> float:
    """Of any errors, at the noise and the sizes of a fit, straight from its definition."""
    parameters = case.model.parameters
    white = residuals(case.model, replace(found, x=x), case) / case.model.measurement.per_component(found.sigmas)
    sizes = parameters.scales * np.array([FREEDOM if p.unknown else found.factor for p in parameters.items])
    return float(np.sum(white**2) + np.sum((x / sizes) ** 2))


def test_no_model_with_fewer_parameters_is_better_in_what_is_minimised() -> None:
    for case, found in sets():
        reached = objective(case, found.after, found.after.x)
        for other in (found.offsets.x, np.zeros_like(found.after.x), case.truth):
            assert reached <= objective(case, found.after, other) * (1 + 1e-9)


def test_where_the_way_from_nominal_leads_nowhere_a_nested_estimate_is_the_start() -> None:
    """A turntable half a turn off, without noise: nominal is a maximum along it, and the gradient there is zero."""
    table = Robot("table", "craig", (revolute(theta=0.0, d=100.0),))
    model = build_model(table, Task.of("position", points={"P": (100.0, 0.0, 0.0)}))
    rng = np.random.default_rng(1)
    data = simulate(model, {"theta_1": np.pi}, rng.uniform(-2, 2, (20, 1)), Noise(), rng)
    options = Options(sigma={"position": 0.05}, scales="stated")
    rows = rows_of(model.measurement, data, model.setup, model.residuals)
    near = model.parameters.vector({"theta_1": 3.0})
    assert fit(rows, model.kinematic, options).x[0] == pytest.approx(0.0, abs=0.1)
    guarded = fit(rows, model.kinematic, options, nested=(np.zeros(2), near))
    assert guarded.converged
    assert guarded.x[0] == pytest.approx(np.pi, abs=0.01)  # the size of 10 mrad pulls three hundred times itself
    again = fit(rows, model.kinematic, options, nested=(guarded.x,))
    assert again.x == pytest.approx(guarded.x, abs=1e-9)
    assert again.converged


def test_worse_nested_estimates_change_nothing() -> None:
    case, found = sets()[1]
    rows = rows_of(case.model.measurement, case.data, found.setup, case.model.residuals)
    free = (*case.model.kinematic, *case.model.placement)
    worse = [found.after.x + 0.1 * case.model.parameters.scales, np.full_like(found.after.x, 0.05)]
    plain, guarded = fit(rows, free, Options()), fit(rows, free, Options(), nested=worse)
    assert np.array_equal(plain.x, guarded.x)
    assert len(plain.path) == len(guarded.path)


MIDDLE = np.array([0.0, 0.3, -0.3, 0.0, 0.6, 0.0])


def hard(name: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Poses measured and poses between them (of wide sets: of the same area)."""
    t = np.linspace(-1, 1, 240)[:, None]
    path = MIDDLE + 0.6 * t * rng.normal(size=6)
    if name == "a curve":
        path += 0.4 * np.sin(3 * t) * rng.normal(size=6)
    if name in ("a line", "a curve"):
        return path[::10], path[5::10]
    near = MIDDLE + 1e-3 * rng.normal(size=(60, 6))
    if name == "nearly one pose":
        return near[:30], near[30:]
    if name == "one pose repeated":
        return np.repeat(near[:1], 30, axis=0), near[30:]
    two = np.vstack([MIDDLE, MIDDLE + 0.5])
    if name.startswith("two poses"):
        return (np.repeat(two, 15, axis=0), two) if name.endswith("repeated") else (two, two)
    wide = poses("independent", 40, rng)
    return wide[: int(name.split()[0])], wide[10:]


def outcome(case: Case) -> Calibration | str:
    """The identification, or why it was refused."""
    try:
        return identified(case)
    except RefusedError as error:
        return str(error)


@pytest.mark.parametrize("kind", ["position", "pose"])
@pytest.mark.parametrize(
    "name",
    [
        "a line",
        "a curve",
        "nearly one pose",
        "one pose repeated",
        "two poses",
        "two poses repeated",
        *(f"{n} poses" for n in (1, 5, 6, 7, 9, 10)),
    ],
)
def test_hard_sets_end_near_the_truth_or_in_a_refusal(name: str, kind: str) -> None:
    """No worse than with joint zeros alone, or than the covariance says; ten positions and seven poses are one more
    than the 27 unknowns that such an arm shows need."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        q, unseen = hard(name, rng)
        case = measured_at(kind, q, unseen, 0.05, rng)
        equations = len(q) * (6 if kind == "pose" else 3)
        found = outcome(case)
        if isinstance(found, str):
            assert equations <= 36
            assert re.fullmatch(r"[0-9]+ poses .*measure .*poses.*", found)  # one line
            continue
        assert equations > 27
        expected = np.sqrt(np.mean(expected_position_rms(case.model, found.after, unseen) ** 2))
        after, offsets = (true_rms(case, found.setup, each.x) for each in (found.after, found.offsets))
        assert found.after.converged
        assert after <= max(1.5 * offsets, 3 * expected)
        assert in_band(residual_sum(case, found.after), found.after.dof)


@pytest.mark.long
def test_twenty_random_poses_of_a_measured_robot(
    configs: Path, symcal_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Franka Research 3: never worse than joint zeros alone on what was held out, and much better as a rule."""
    monkeypatch.setenv("SYMCAL_DATA", str(symcal_data))
    experiment = load(configs / "real" / "franka_fr3.yaml")
    rng = np.random.default_rng(1)
    data = measurements(experiment.file, experiment.document, experiment.model, rng).data
    train, test = data.part("train"), data.part("test")
    ratios = []
    for _ in range(10):
        chosen = train.take(np.sort(rng.permutation(len(train))[:20]))
        found = calibrate(experiment.model, None, chosen, experiment.options)
        after, offsets = (statistics(evaluate(found.states[name], test).size).rms for name in ("after", "offsets_only"))
        ratios.append(after / offsets)
    assert max(ratios) <= 1.02
    assert np.median(ratios) <= 0.85


@pytest.mark.parametrize("loss", ["huber", "cauchy", "tukey"])
def test_a_robust_noise_does_not_fall_to_nothing_on_few_poses(loss: Loss) -> None:
    """Clean data: weights that fall to zero must not take the noise with them."""
    ratios, inside = [], []
    for seed in range(0, 24, 4):  # pose measurements
        case = draw(seed)
        few = replace(case, data=case.data.take(np.arange(12)))
        found = identified(few, Options(loss=loss))
        assert found.after.converged
        sigmas, noise = found.after.sigmas, case.noise
        ratios.append(
            [sigmas["position"] / noise.sizes["position"], sigmas["orientation"] / noise.sizes["orientation"]]
        )
        known = found.after.posterior
        own = [known.names.index(name) for name in case.model.offsets]
        index = case.model.parameters.indices(case.model.offsets)
        inside.append(np.abs(found.after.x - case.truth)[index] < known.half_widths()[own])
    assert np.min(ratios) > 0.3
    assert 0.7 < np.median(ratios, axis=0).min() <= np.median(ratios, axis=0).max() < 1.4
    assert np.mean(inside) > 0.85


def test_few_poses_of_two_quantities_are_not_refused_by_chance() -> None:
    """Eight poses leave many equations: neither noise falls to nothing."""
    for seed in range(0, 24, 2):
        case = draw(seed)
        found = identified(replace(case, data=case.data.take(np.arange(8))))
        assert 0.2 < found.after.sigmas["position"] / case.noise.sizes["position"] < 6


def test_ipopt_ends_where_the_others_do_when_noise_is_tiny() -> None:
    case = draw(2)
    there = replace(case.model, setup=case.setup)
    errors = case.model.parameters.mapping(case.truth)
    exact = simulate(there, errors, case.data.q, Noise("normal", 1e-3, 5e-6), np.random.default_rng(0))
    fits = [identified(replace(case, data=exact), Options(solver=name)).after for name in SOLVERS]
    assert all(found.converged for found in fits)
    for found in fits[1:]:
        assert np.abs((found.x - fits[0].x)[: len(case.model.kinematic)]).max() < 1e-6
