"""The statistics of a fit: over many seeds, estimates and noise must scatter as the program says they do."""

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
from symcal.identification.estimation import Fit, Options, fit
from symcal.identification.identifiability import analyse
from symcal.identification.model import Model, Task, build_model
from symcal.identification.noise import known_sigma, spread_of, variance_components
from symcal.identification.rows import rows_of
from symcal.identification.uncertainty import covariance, predicted_rms, sigmas
from symcal.least_squares import Tolerances
from symcal.solvers import SOLVERS

SIGMA = 0.0577


@cache
def arm_model() -> Model:
    """Six axes measured in pose by an instrument that knows base and tool."""
    return build_model(ARM, Task("pose"))


def fitted(model: Model, data: Dataset, options: Options = Options(), **keywords: object) -> Fit:
    rows = rows_of(model.measurement, data, model.setup, model.residual)
    return fit(rows, model.parameters.names, options, **keywords)  # type: ignore[arg-type]


@cache
def visible_truth() -> dict[str, float]:
    """Table III without the part of it that no position shows at nominal."""
    model = handling_model()
    (jacobian,) = model.jacobian(front_half(60, np.random.default_rng(0)), np.zeros(15), model.setup.vector)
    seen = analyse(jacobian.reshape(-1, 15), model.parameters, noise_known=False).seen
    scaled = model.parameters.vector(TABLE_III) / model.parameters.scales
    return dict(zip(model.parameters.names, model.parameters.scales * (seen @ (seen.T @ scaled)), strict=True))


def whitened(model: Model, data: Dataset, found: Fit, truth: Mapping[str, float]) -> float:
    """|W (x - truth)|^2: the error in the coordinates that the data see, in sigmas."""
    (jacobian,) = model.jacobian(data.q, found.x, model.setup.vector)
    sigma = model.measurement.per_component(found.sigmas)
    error = found.x - model.parameters.vector(truth)
    return float(np.sum((jacobian @ error / sigma) ** 2))


def inside(values: list[float], dof: float, tail: float = 1e-3) -> bool:
    """Does the sum of independent chi-squared values of ``dof`` each lie where all but 2 ``tail`` of them would?"""
    low, high = stats.chi2.ppf([tail, 1 - tail], dof * len(values))
    return bool(low < sum(values) < high)


@cache
def position_runs() -> list[tuple[Dataset, Fit]]:
    model, truth = handling_model(), visible_truth()
    data = [measure(model, truth, 40, np.random.default_rng(seed), SIGMA) for seed in range(150)]
    return [(d, fitted(model, d, Options(sigma={"position": SIGMA}))) for d in data]


def test_position_errors_are_chi_squared_in_the_coordinates_that_are_seen() -> None:
    model, runs = handling_model(), position_runs()
    assert {f.identifiability.rank for _, f in runs} == {11}
    values = [whitened(model, d, f, visible_truth()) for d, f in runs]
    assert inside(values, 11)
    assert stats.kstest(values, stats.chi2(11).cdf).pvalue > 1e-3


def test_residuals_are_chi_squared_with_equations_minus_rank() -> None:
    runs = position_runs()
    assert {f.dof for _, f in runs} == {120 - 11}
    values = [f.chi_squared for _, f in runs]
    assert inside(values, 109)
    assert stats.kstest(values, stats.chi2(109).cdf).pvalue > 1e-3


def test_the_sigmas_cover_the_truth_as_often_as_they_should() -> None:
    model = handling_model()
    truth = model.parameters.vector(visible_truth())
    scores = []
    for _, f in position_runs():
        listed = sigmas(f.identifiability)
        scores += [(f.x[i] - truth[i]) / s for i, s in enumerate(listed) if s is not None]
    assert len(scores) >= 8 * 150
    assert np.std(scores) == pytest.approx(1.0, abs=0.06)
    assert np.mean(np.abs(scores) < 1.96) == pytest.approx(0.95, abs=0.02)


def test_training_errors_reach_the_cramer_rao_bound() -> None:
    """rms over the training poses = sigma sqrt(n / N) with n = 11 seen directions and N = 40 positions, per pose."""
    model, truth = handling_model(), visible_truth()
    x = model.parameters.vector(truth)
    squares = []
    for d, f in position_runs():
        r, _ = model.residual(d.q, f.x, model.setup.vector, d.z)
        exact, _ = model.residual(d.q, x, model.setup.vector, d.z)
        squares.append(np.mean(np.sum((r - exact) ** 2, axis=1)))
    assert np.sqrt(np.mean(squares)) == pytest.approx(SIGMA * np.sqrt(11 / 40), rel=0.05)


def test_errors_at_other_poses_are_the_predicted_ones() -> None:
    model, truth = handling_model(), visible_truth()
    q = front_half(200, np.random.default_rng(99))
    exact = measure_exactly(model, q, truth)
    realised, predicted = [], []
    for _, f in position_runs():
        r, _ = model.residual(q, f.x, model.setup.vector, exact)
        (jacobian,) = model.jacobian(q, f.x, model.setup.vector)
        realised.append(np.sum(r**2, axis=1))
        predicted.append(predicted_rms(jacobian, covariance(f.identifiability)) ** 2)
    ratio = np.sqrt(np.mean(realised, axis=0) / np.mean(predicted, axis=0))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.05)
    assert 0.8 < ratio.min() <= ratio.max() < 1.25


def measure_exactly(model: Model, q: np.ndarray, truth: Mapping[str, float]) -> np.ndarray:
    r, _ = model.residual(q, model.parameters.vector(truth), model.setup.vector, np.zeros((len(q), 3)))
    return r


def test_what_is_not_seen_stays_at_nominal() -> None:
    """The estimate has no part along the directions of the gauge."""
    for _, f in position_runs()[:10]:
        seen = f.identifiability
        assert np.abs(seen.hidden.T @ (f.x / seen.scales)).max() < 1e-6
        assert np.linalg.norm(f.x / seen.scales) < 1.2 * np.linalg.norm(
            handling_model().parameters.vector(TABLE_III) / seen.scales
        )


def test_a_reference_takes_the_place_of_nominal() -> None:
    d, _ = position_runs()[0]
    reference = np.zeros(15)
    reference[handling_model().parameters.index("theta_5")] = 0.3
    found = fitted(handling_model(), d, Options(sigma={"position": SIGMA}), reference=reference)
    assert found.x[handling_model().parameters.index("theta_5")] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("poses", [12, 40])
def test_the_noise_of_positions_is_estimated_without_bias(poses: int) -> None:
    model, truth = handling_model(), visible_truth()
    runs = [fitted(model, measure(model, truth, poses, np.random.default_rng(seed), SIGMA)) for seed in range(80)]
    assert {f.estimated for f in runs} == {("position",)}
    values = [f.dof * (f.sigmas["position"] / SIGMA) ** 2 for f in runs]
    assert inside(values, 3 * poses - 11)
    assert np.mean([f.chi_squared / f.dof for f in runs]) == pytest.approx(1.0, abs=1e-3)


def test_two_variance_components_are_estimated_without_bias() -> None:
    model = arm_model()
    position, orientation = 0.05, 3e-4
    truth = random_errors(model, np.random.default_rng(0))
    runs = [
        fitted(model, measure(model, truth, 15, np.random.default_rng(seed), position, orientation))
        for seed in range(80)
    ]
    rank = runs[0].identifiability.rank
    assert runs[0].dof == 90 - rank
    for name, sigma in (("position", position), ("orientation", orientation)):
        ratio = np.array([f.sigmas[name] / sigma for f in runs]) ** 2
        assert ratio.mean() == pytest.approx(1.0, abs=4 * ratio.std() / np.sqrt(len(runs)))
    values = [
        whitened(model, measure(model, truth, 15, np.random.default_rng(seed)), f, truth) for seed, f in enumerate(runs)
    ]
    # Hotelling's law in place of chi-squared, since the noise is estimated too
    assert np.mean(values) == pytest.approx(rank * 30 / 28, rel=0.15)


def test_variance_components_are_the_maximum_of_the_restricted_likelihood() -> None:
    """REML: -2 log L = log|V| + log|J^T V^-1 J| + r^T V^-1 r, by brute force around the estimate."""
    model = arm_model()
    data = measure(model, random_errors(model, np.random.default_rng(3)), 12, np.random.default_rng(4), 0.05, 3e-4)
    found = fitted(model, data)
    r, jacobian = model.residual(data.q, found.x, model.setup.vector, data.z)
    seen = found.identifiability
    j = (jacobian * seen.scales) @ seen.seen

    def minus_two_log(position: float, orientation: float) -> float:
        sigma = model.measurement.per_component({"position": position, "orientation": orientation})
        white, rows = (r / sigma).ravel(), (j / sigma[:, None]).reshape(-1, seen.rank)
        step = np.linalg.lstsq(rows, white, rcond=None)[0]
        left = white - rows @ step
        logdet = 2 * np.log(np.abs(np.diag(np.linalg.qr(rows, mode="r")))).sum()
        return float(2 * len(data) * np.log(sigma).sum() + logdet + left @ left)

    best = minus_two_log(found.sigmas["position"], found.sigmas["orientation"])
    for a in (0.99, 1.0, 1.01):
        for b in (0.99, 1.0, 1.01):
            assert minus_two_log(a * found.sigmas["position"], b * found.sigmas["orientation"]) >= best - 1e-6


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


def test_a_file_that_states_every_sigma_leaves_nothing_to_estimate() -> None:
    d, known = position_runs()[0]
    found = fitted(handling_model(), replace(d, sigma=np.full((40, 3), SIGMA)))
    assert found.estimated == ()
    assert np.allclose(found.x, known.x, atol=1e-9)
    assert found.chi_squared == pytest.approx(known.chi_squared)


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
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
    model = build_model(handling(), Task("position", priors=dict.fromkeys(handling().parameters, 0.004)))
    data = measure(model, TABLE_III, 40, np.random.default_rng(3), SIGMA)
    centre = np.full(15, 1e-3)
    found = fitted(model, data, Options(sigma={"position": SIGMA}), prior_mean=centre)
    assert found.identifiability.rank == 15
    assert found.dof == 120 + 15 - 15
    r, jacobian = model.residual(data.q, found.x, model.setup.vector, data.z)
    gradient = jacobian.reshape(-1, 15).T @ r.ravel() / SIGMA**2 + (found.x - centre) / 0.004**2
    assert np.abs(gradient * model.parameters.scales).max() < 1e-4
    information = jacobian.reshape(-1, 15).T @ jacobian.reshape(-1, 15) / SIGMA**2 + np.eye(15) / 0.004**2
    assert np.allclose(covariance(found.identifiability), np.linalg.inv(information), rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_fits_the_same(solver: str) -> None:
    d, reference = position_runs()[1]
    options = Options(solver=solver, sigma={"position": SIGMA})  # type: ignore[arg-type]
    found = fitted(handling_model(), d, options)
    assert found.solution.solver == solver
    scales = handling_model().parameters.scales
    assert np.abs((found.x - reference.x) / scales).max() < 1e-6
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
    found = fit(rows_of(model.measurement, data, model.setup, model.residual), (), Options())
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


def test_a_leverage_sums_to_the_rank() -> None:
    """sum (1 - H_ii) over everything = m - rank: what the variance components divide by."""
    d, f = position_runs()[0]
    model = handling_model()
    rows = rows_of(model.measurement, d, model.setup, model.residual)
    known = known_sigma(rows, {})
    spread = spread_of(rows, known, {"position": SIGMA}, np.ones((40, 3)))
    _, jacobian = rows(f.x)
    ones = np.ones((40, 3))
    found = variance_components(rows, ones, jacobian, known, spread, f.identifiability, ("position",))
    assert 120 / found["position"] ** 2 == pytest.approx(120 - 11, rel=1e-6)
