"""The statistics of a fit: over many seeds, estimates and noise must scatter as the program says they do.

Where a law is to hold exactly the truth is drawn anew in every trial, from the plausible sizes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import ARM, TABLE_III, front_half, handling, handling_model, measure, random_errors
from scipy import stats

from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Fit, Options, fit
from symcal.fit.identifiability import analyse
from symcal.fit.residual_rows import rows_of
from symcal.fit.whitened import FREEDOM
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.robot import Robot
from symcal.solvers import SOLVERS
from symcal.solvers.least_squares import Tolerances

SIGMA = 0.0577
KNOWN = Options(sigma={"position": SIGMA}, scales="stated")


@cache
def arm_model() -> Model:
    """Six axes measured in pose by an instrument that knows base and tool."""
    return build_model(ARM, Task.of("pose"))


@cache
def sized_model(robot: Robot, kind: str, estimate: frozenset[str] = frozenset()) -> Model:
    """With plausible sizes of 0.3 mm and 2 mrad: at those a robot is linear to a small part of the noise."""
    sizes = {name: 0.3 if name[:2] in ("a_", "d_") else 2e-3 for name in robot.parameters}
    return build_model(robot, Task.of(kind, estimate, scales=sizes))  # type: ignore[arg-type]


def fitted(model: Model, data: Dataset, options: Options = Options(), **keywords: object) -> Fit:
    rows = rows_of(model.measurement, data, model.setup, model.residuals)
    return fit(rows, model.parameters.names, options, **keywords)  # type: ignore[arg-type]


def drawn(model: Model, rng: np.random.Generator, factor: float = 1.0) -> np.ndarray:
    """Errors of the link parameters with their plausible sizes times ``factor``; frames as they are."""
    links = np.array([not p.unknown for p in model.parameters.items])
    return np.asarray(factor * model.parameters.scales * links * rng.normal(size=len(links)))


@cache
def visible_truth() -> dict[str, float]:
    """Table III without the part of it that no position shows at nominal."""
    model = handling_model()
    (jacobian,) = model.jacobian(front_half(60, np.random.default_rng(0)), np.zeros(15), model.setup.vector)
    seen = analyse(jacobian.reshape(-1, 15), model.parameters, noise_known=False).seen
    scaled = model.parameters.vector(TABLE_III) / model.parameters.scales
    return dict(zip(model.parameters.names, model.parameters.scales * (seen @ (seen.T @ scaled)), strict=True))


def mahalanobis(found: Fit, truth: np.ndarray) -> float:
    """(x - truth)^T C^-1 (x - truth)."""
    error = found.x - truth
    return float(error @ np.linalg.solve(found.posterior.covariance, error))


def objective(found: Fit, model: Model) -> float:
    """What was minimised: squared whitened residuals and errors in plausible sizes."""
    sizes = model.parameters.scales * np.array([FREEDOM if p.unknown else found.factor for p in model.parameters.items])
    return found.chi_squared + float(np.sum((found.x / sizes) ** 2))


def inside(values: list[float], dof: float, tail: float = 1e-3) -> bool:
    """Does the sum of independent chi-squared values of ``dof`` each lie where all but 2 ``tail`` of them would?"""
    low, high = stats.chi2.ppf([tail, 1 - tail], dof * len(values))
    return bool(low < sum(values) < high)


def is_chi_squared(values: list[float], dof: float) -> bool:
    """In mean and in shape."""
    return inside(values, dof) and bool(stats.kstest(values, stats.chi2(dof).cdf).pvalue > 1e-3)


@cache
def position_runs() -> list[tuple[Dataset, Fit, np.ndarray]]:
    """Noise and plausible sizes known, as the data are made."""
    model, runs = sized_model(handling(), "position"), []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        truth = drawn(model, rng)
        data = measure(model, model.parameters.mapping(truth), 40, rng, SIGMA)
        runs.append((data, fitted(model, data, KNOWN), truth))
    return runs


def test_errors_are_chi_squared_with_the_number_of_parameters_seen_or_not() -> None:
    runs = position_runs()
    assert max(f.identifiability.rank for _, f, _ in runs) < 15
    assert is_chi_squared([mahalanobis(f, truth) for _, f, truth in runs], 15)


def test_the_objective_is_chi_squared_with_equations_and_residuals_have_what_was_not_learnt() -> None:
    """Every plausible size is an equation too, so that as many are left as there are measurements."""
    model, runs = sized_model(handling(), "position"), position_runs()
    assert is_chi_squared([objective(f, model) for _, f, _ in runs], 120)
    assert {f.factor for _, f, _ in runs} == {1.0}
    assert inside([f.chi_squared for _, f, _ in runs], float(np.mean([f.dof for _, f, _ in runs])))


def test_frames_that_are_nearly_free_cost_an_equation_each() -> None:
    model = sized_model(ARM, "pose", frozenset({"base", "tool"}))
    options = Options(sigma={"position": 0.05, "orientation": 3e-4}, scales="stated")
    errors, objectives = [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        truth = drawn(model, rng)
        found = fitted(model, measure(model, model.parameters.mapping(truth), 15, rng, 0.05, 3e-4), options)
        objectives.append(objective(found, model))
        errors.append(mahalanobis(found, truth))
    assert is_chi_squared(objectives, 90 - 12)
    assert is_chi_squared(errors, 23 + 12)


def test_the_sigmas_cover_the_truth_as_often_as_they_should() -> None:
    scores = np.array([(f.x - truth) / f.posterior.sigmas for _, f, truth in position_runs()])
    assert np.std(scores) == pytest.approx(1.0, abs=0.06)
    assert np.mean(np.abs(scores) < 1.96) == pytest.approx(0.95, abs=0.02)


def test_training_errors_are_the_noise_times_the_root_of_what_was_learnt() -> None:
    """sigma^2 tr(H) over all equations: with flat priors the Cramer-Rao bound sigma sqrt(n / N)."""
    model = sized_model(handling(), "position")
    squares = []
    for d, f, truth in position_runs():
        r, _ = model.residual(d.q, f.x, model.setup.vector, d.z)
        exact, _ = model.residual(d.q, truth, model.setup.vector, d.z)
        squares.append(np.mean(np.sum((r - exact) ** 2, axis=1)))
    learnt = 120 - np.mean([f.dof for _, f, _ in position_runs()])
    assert 10 < learnt < 11
    assert np.sqrt(np.mean(squares)) == pytest.approx(SIGMA * np.sqrt(learnt / 40), rel=0.05)


def test_errors_at_other_poses_are_the_predicted_ones() -> None:
    model = sized_model(handling(), "position")
    q = front_half(200, np.random.default_rng(99))
    realised, predicted = [], []
    for _, f, truth in position_runs():
        r, _ = model.residual(q, f.x, model.setup.vector, measure_exactly(model, q, model.parameters.mapping(truth)))
        (jacobian,) = model.jacobian(q, f.x, model.setup.vector)
        realised.append(np.sum(r**2, axis=1))
        predicted.append(f.posterior.predicted_rms(jacobian) ** 2)
    ratio = np.sqrt(np.mean(realised, axis=0) / np.mean(predicted, axis=0))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.05)
    assert 0.8 < ratio.min() <= ratio.max() < 1.25


def measure_exactly(model: Model, q: np.ndarray, truth: Mapping[str, float]) -> np.ndarray:
    r, _ = model.residual(q, model.parameters.vector(truth), model.setup.vector, np.zeros((len(q), 3)))
    return r


@pytest.mark.parametrize("options", [KNOWN, Options()], ids=["known", "estimated"])
def test_what_is_not_seen_stays_at_nominal_and_keeps_its_size(options: Options) -> None:
    """The last zero of a point on the last axis, whose a_5 is held."""
    model = handling_model()
    data = measure(model, {"theta_5": 0.4, "d_2": 0.5, "theta_1": 0.01}, 40, np.random.default_rng(1), SIGMA)
    free = tuple(name for name in model.parameters.names if name != "a_5")
    found = fit(rows_of(model.measurement, data, model.setup, model.residuals), free, options)
    k = free.index("theta_5")
    assert found.x[model.parameters.index("theta_5")] == pytest.approx(0.0, abs=1e-12)
    assert found.posterior.sigmas[k] == pytest.approx(found.factor * 0.010, rel=0.02)
    assert found.posterior.learnt[k] == pytest.approx(0.0, abs=1e-9)
    assert found.factor_estimated == (options.scales == "estimated")


def test_what_frames_and_links_share_unseen_is_the_frames() -> None:
    """The heading of an unknown base and the first zero; its height and the first length."""
    model = sized_model(ARM, "pose", frozenset({"base"}))
    truth = {"theta_1": 0.004, "d_1": 0.6, "a_3": 0.3}
    found = fitted(model, measure(model, truth, 40, np.random.default_rng(1), 0.05, 3e-4))
    errors = model.parameters.mapping(found.x)
    learnt = dict(zip(found.free, found.posterior.learnt, strict=True))
    for frame, link in (("base_rz", "theta_1"), ("base_z", "d_1")):
        scale = model.parameters.scales[model.parameters.index(link)]
        assert errors[link] == pytest.approx(0.0, abs=1e-4 * scale)
        assert errors[frame] == pytest.approx(truth[link], abs=0.25 * scale)
        assert learnt[link] < 1e-3
        assert learnt[frame] > 0.999


def test_a_reference_takes_the_place_of_nominal() -> None:
    model = sized_model(handling(), "position")
    d, _, _ = position_runs()[0]
    reference = np.zeros(15)
    reference[model.parameters.index("theta_5")] = 0.3
    found = fitted(model, d, KNOWN, reference=reference)
    assert found.x[model.parameters.index("theta_5")] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("poses", [12, 40])
def test_the_noise_of_positions_is_estimated_without_bias(poses: int) -> None:
    model, runs = sized_model(handling(), "position"), []
    for seed in range(80):
        rng = np.random.default_rng(seed)
        truth = model.parameters.mapping(drawn(model, rng))
        runs.append(fitted(model, measure(model, truth, poses, rng, SIGMA)))
    assert {f.estimated for f in runs} == {("position",)}
    values = [f.dof * (f.sigmas["position"] / SIGMA) ** 2 for f in runs]
    assert inside(values, float(np.mean([f.dof for f in runs])))
    assert 3 * poses - 11 < np.mean([f.dof for f in runs]) < 3 * poses - 9
    assert [f.chi_squared / f.dof for f in runs] == pytest.approx(np.ones(80), abs=1e-5)  # each by itself


def test_two_variance_components_are_estimated_without_bias() -> None:
    model = sized_model(ARM, "pose")
    position, orientation = 0.05, 3e-4
    runs, errors = [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        truth = drawn(model, rng)
        runs.append(fitted(model, measure(model, model.parameters.mapping(truth), 15, rng, position, orientation)))
        errors.append(mahalanobis(runs[-1], truth))
    for name, sigma in (("position", position), ("orientation", orientation)):
        ratio = np.array([f.sigmas[name] / sigma for f in runs]) ** 2
        assert ratio.mean() == pytest.approx(1.0, abs=3 * ratio.std() / np.sqrt(len(runs)))
    # Hotelling's law in place of chi-squared, since the noise is estimated too, each kind from about 34 equations
    assert np.mean(errors) == pytest.approx(len(model.parameters) * 34 / 32, rel=0.1)


def test_noise_and_factor_are_the_maximum_of_the_restricted_likelihood() -> None:
    """-2 log L = log|V| + r^T V^-1 r with V of noise and sizes, by brute force around the estimate; and Cauchy laws of
    half width 15 % on the factor, and of a factor of three on the noises' ratio at a lever of 200 mm."""
    model = arm_model()
    data = measure(model, random_errors(model, np.random.default_rng(3)), 12, np.random.default_rng(4), 0.05, 3e-4)
    found = fitted(model, data)
    r, jacobian = model.residual(data.q, found.x, model.setup.vector, data.z)
    j = jacobian.reshape(r.size, -1)
    observed = r.ravel() - j @ found.x  # of the model linearised at the estimate, at nominal

    def minus_two_log(position: float, orientation: float, factor: float) -> float:
        noise = np.tile(model.measurement.per_component({"position": position, "orientation": orientation}), len(data))
        v = np.diag(noise**2) + factor**2 * (j * model.parameters.scales**2) @ j.T
        prior = 2 * np.log1p((np.log(factor) / np.log(1.15)) ** 2)
        prior += 2 * np.log1p((np.log(200 * orientation / position) / np.log(3)) ** 2)
        return float(np.linalg.slogdet(v)[1] + observed @ np.linalg.solve(v, observed) + prior)

    at = np.array([found.sigmas["position"], found.sigmas["orientation"], found.factor])
    best = minus_two_log(*at)
    for times in np.array(np.meshgrid(*[[0.99, 1.0, 1.01]] * 3)).reshape(3, -1).T:
        assert minus_two_log(*(at * times)) >= best - 1e-6
    gradient = [minus_two_log(*(at * np.exp(s))) - minus_two_log(*(at * np.exp(-s))) for s in 1e-3 * np.eye(3)]
    assert np.abs(gradient).max() / 2e-3 < 1e-2


def test_rows_whose_noise_is_known_do_not_decide_the_unknown_one() -> None:
    model, truth = handling_model(), visible_truth()
    ratios = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        data = measure(model, truth, 60, rng, SIGMA)
        z, sigma = data.z.copy(), np.full((60, 3), np.nan)
        z[:30] += rng.normal(scale=1.0, size=(30, 3))  # half of them with a poor instrument that says so
        sigma[:30] = np.hypot(1.0, SIGMA)
        ratios.append(fitted(model, replace(data, z=z, sigma=sigma)).sigmas["position"] / SIGMA)
    assert np.mean(np.square(ratios)) == pytest.approx(1.0, abs=0.06)


def test_a_file_that_states_every_sigma_leaves_no_noise_to_estimate() -> None:
    d, known, _ = position_runs()[0]
    model = sized_model(handling(), "position")
    found = fitted(model, replace(d, sigma=np.full((40, 3), SIGMA)), Options(scales="stated"))
    assert found.estimated == ()
    assert not found.factor_estimated
    assert np.allclose(found.x, known.x, atol=1e-9)
    assert found.chi_squared == pytest.approx(known.chi_squared)


def test_sizes_that_are_stated_hold_and_others_are_found_where_they_are_wrong() -> None:
    """By a factor of five, too small or too large: found to what fifteen draws can tell, and the noise with it."""
    model = sized_model(ARM, "pose")
    for factor in (0.2, 5.0):
        found = []
        for seed in range(20):
            rng = np.random.default_rng(seed)
            truth = model.parameters.mapping(drawn(model, rng, factor))
            data = measure(model, truth, 20, rng, 0.05, 1e-4)
            found.append(fitted(model, data))
            assert fitted(model, data, Options(scales="stated")).factor == 1.0
        logs = np.log([f.factor for f in found])
        assert np.median(logs) == pytest.approx(np.log(factor), abs=0.15)
        assert np.abs(logs - np.log(factor)).max() < 4 / np.sqrt(2 * 20)
        ratio = np.array([f.sigmas["position"] / 0.05 for f in found]) ** 2
        assert ratio.mean() == pytest.approx(1.0, abs=4 * ratio.std() / np.sqrt(len(found)))


def test_a_factor_near_one_is_left_at_one() -> None:
    """A quarter more or less is no contradiction of fifteen stated sizes."""
    model = sized_model(handling(), "position")
    logs = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        data = measure(model, model.parameters.mapping(drawn(model, rng)), 40, rng, SIGMA)
        logs.append(np.log(fitted(model, data).factor))
    assert np.std(logs) < 0.1 < 1 / np.sqrt(2 * 15)  # of the last the maximum of the likelihood alone would have


def test_what_was_learnt_is_one_minus_the_ratio_of_variances_and_adds_up() -> None:
    """Over links and frames in uncorrelated coordinates it is the trace of the projection, equations less dof."""
    model = sized_model(ARM, "pose", frozenset({"base", "tool"}))
    rng = np.random.default_rng(3)
    found = fitted(model, measure(model, model.parameters.mapping(drawn(model, rng)), 20, rng, 0.05, 3e-4))
    links = np.array([not p.unknown for p in model.parameters.items])
    assumed = np.where(links, found.factor, FREEDOM) * model.parameters.scales
    share = found.posterior.learnt
    # the covariance holds the uncertainty of the variances too, a little more than the share counts
    ratio = 1 - found.posterior.sigmas**2 / assumed**2
    assert np.abs(share - ratio).max() < 0.05
    assert (share >= ratio - 1e-9).all()
    assert found.equations == 120
    assert found.equations - found.dof == pytest.approx(share.sum(), abs=1e-6)


@pytest.mark.parametrize("loss", ["huber", "cauchy", "tukey"])
def test_a_robust_loss_bears_gross_errors(loss: str) -> None:
    model, truth = handling_model(), visible_truth()
    q = front_half(100, np.random.default_rng(5))
    exact = measure_exactly(model, q, truth)
    rms = {"linear": [], "robust": [], "clean": []}
    for seed in range(8):
        rng = np.random.default_rng(seed)
        clean = measure(model, truth, 60, rng, SIGMA)
        z = clean.z.copy()
        z[:3] += 20 * rng.normal(size=(3, 3))  # five per cent
        spoilt = replace(clean, z=z)
        for name, data, options in (
            ("clean", clean, Options()),
            ("linear", spoilt, Options()),
            ("robust", spoilt, Options(loss=loss)),  # type: ignore[arg-type]
        ):
            f = fitted(model, data, options)
            r, _ = model.residual(q, f.x, model.setup.vector, exact)
            rms[name].append(np.sqrt(np.mean(np.sum(r**2, axis=1))))
            if name == "robust":
                assert f.weights[:3].max() < 0.2
                assert np.median(f.weights[3:]) > 0.7
                assert f.sigmas["position"] == pytest.approx(SIGMA, rel=0.35)
    assert np.mean(rms["robust"]) < 1.5 * np.mean(rms["clean"])
    assert np.mean(rms["linear"]) > 5 * np.mean(rms["robust"])


def test_points_that_were_not_seen_count_nowhere() -> None:
    model = handling_model("a", "b", "c")
    rng = np.random.default_rng(7)
    data = measure(model, visible_truth(), 30, rng, SIGMA)
    z = data.z.copy()
    z.reshape(30, 3, 3)[rng.random((30, 3)) < 0.3] = np.nan
    z[0] = np.nan  # a pose that shows nothing at all
    found = fitted(model, replace(data, z=z))
    assert found.equations == np.isfinite(z).sum()
    assert found.sigmas["position"] == pytest.approx(SIGMA, rel=0.2)
    without = fitted(model, replace(data, z=z).take(np.arange(1, 30)))
    assert np.allclose(found.x, without.x, atol=1e-7)
    assert (found.weights[np.isnan(z)] == 0).all()


def test_priors_are_observations() -> None:
    """Against the stacked linear solution at the estimate; priors make every direction seen."""
    model = build_model(handling(), Task.of("position", priors=dict.fromkeys(handling().parameters, 0.004)))
    data = measure(model, TABLE_III, 40, np.random.default_rng(3), SIGMA)
    centre = np.full(15, 1e-3)
    found = fitted(model, data, Options(sigma={"position": SIGMA}), prior_mean=centre)
    assert not found.factor_estimated
    r, jacobian = model.residual(data.q, found.x, model.setup.vector, data.z)
    gradient = jacobian.reshape(-1, 15).T @ r.ravel() / SIGMA**2 + (found.x - centre) / 0.004**2
    assert np.abs(gradient * model.parameters.scales).max() < 1e-4
    information = jacobian.reshape(-1, 15).T @ jacobian.reshape(-1, 15) / SIGMA**2 + np.eye(15) / 0.004**2
    assert np.allclose(found.posterior.covariance, np.linalg.inv(information), rtol=1e-4, atol=1e-12)
    assert found.posterior.learnt == pytest.approx(1 - found.posterior.sigmas**2 / 0.004**2, abs=1e-6)
    assert found.dof == pytest.approx(120 - found.posterior.learnt.sum(), abs=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("options", [KNOWN, Options()], ids=["known", "estimated"])
def test_every_solver_fits_the_same(solver: str, options: Options) -> None:
    model, (data, _, _) = sized_model(handling(), "position"), position_runs()[1]
    reference = fitted(model, data, options)
    found = fitted(model, data, replace(options, solver=solver))  # type: ignore[arg-type]
    assert found.solution.solver == solver
    assert np.abs((found.x - reference.x) / model.parameters.scales).max() < 1e-5
    assert found.sigmas == pytest.approx(reference.sigmas, rel=1e-5)
    assert np.array_equal(found.path[0], np.zeros(15))
    assert np.allclose(found.path[-1], found.x, atol=1e-7)
    assert found.iterations == len(found.path) - 1


def test_without_noise_the_truth_comes_back_to_rounding() -> None:
    """All fifteen: at the estimate the Jacobian has full numerical rank ([Ding2017] Simulation I)."""
    model = handling_model()
    found = fitted(model, measure(model, TABLE_III, 40, np.random.default_rng(1)), Options(tolerances=Tolerances()))
    truth = model.parameters.vector(TABLE_III)
    seen = found.identifiability
    error = seen.seen.T @ ((found.x - truth) / seen.scales)
    assert np.abs(error * seen.seen_values / seen.seen_values[0]).max() < 1e-8
    assert found.sigmas["position"] < 1e-8


def test_nothing_to_estimate_is_a_fit_too() -> None:
    model = handling_model()
    data = measure(model, {}, 10, np.random.default_rng(1), SIGMA)
    found = fit(rows_of(model.measurement, data, model.setup, model.residuals), (), Options())
    assert (found.dof, found.iterations, found.identifiability.rank) == (30, 0, 0)
    assert found.sigmas["position"] == pytest.approx(np.sqrt(np.mean(measured_error(model, data) ** 2)), rel=1e-6)


def measured_error(model: Model, data: Dataset) -> np.ndarray:
    return data.z - measure_exactly(model, data.q, {})


@pytest.mark.parametrize("poses", [1, 3])
def test_too_few_poses_are_refused_with_a_number_that_will_do(poses: int) -> None:
    model = handling_model()
    with pytest.raises(RefusedError, match=r"equations for at least \d+ unknowns.*measure 6 poses or more"):
        fitted(model, measure(model, {}, poses, np.random.default_rng(1), SIGMA))
    assert fitted(model, measure(model, {}, 6, np.random.default_rng(1), SIGMA)).dof > 0


def test_readings_that_are_no_numbers_are_refused() -> None:
    model = handling_model()
    data = measure(model, {}, 20, np.random.default_rng(1), SIGMA)
    with pytest.raises(RefusedError, match="no finite number"):
        fitted(model, replace(data, q=np.full_like(data.q, np.nan)))


@pytest.mark.parametrize("options", [Options(), KNOWN], ids=["estimated", "known"])
def test_a_fit_that_did_not_converge_says_so(options: Options) -> None:
    model = handling_model()
    data = measure(model, TABLE_III, 40, np.random.default_rng(1), SIGMA)
    found = fitted(model, data, options)
    assert found.converged
    assert (found.trouble, found.message) == ("", found.solution.message)
    cut = fitted(model, data, replace(options, tolerances=Tolerances(0.0, 0.0, 0.0, iterations=0)))
    assert not cut.converged
    assert cut.message == cut.trouble
    assert "stopped" in cut.message
