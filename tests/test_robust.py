"""Robust losses, what stands out, intervals of robust fits, and the choice of a loss; long form in robust_draws.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import ARM, measure, random_errors
from few_poses import model_of
from robust_draws import draw, judged
from scipy import integrate, stats
from strategies import random_frame

from symcal.calibration.calibrate import Calibration, calibrate
from symcal.calibration.compare import cross_validate
from symcal.calibration.loss_choice import choose_loss
from symcal.data.dataset import Dataset
from symcal.errors import InputError
from symcal.fit.deletion import judged as judged_readings
from symcal.fit.deletion import readings_at, without
from symcal.fit.estimation import Options, fit
from symcal.fit.noise import known_sigma
from symcal.fit.residual_rows import rows_of
from symcal.fit.robust import LOSSES, Loss, loss_slopes, loss_weights, shrinkage, tuning
from symcal.fit.sandwich import sandwich
from symcal.fit.whitened import whitened
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.placing.placement import stated

ROBUST: tuple[Loss, ...] = ("huber", "cauchy", "tukey")


def test_tukeys_constant_is_that_of_the_tables() -> None:
    """4.685 for one component ([Maronna2019]); for more by Stein's identity E psi' = E psi r, by quadrature."""
    assert tuning("tukey", 1) == pytest.approx(4.685, abs=2e-3)
    for block in (1, 2, 3):
        c = tuning("tukey", block)
        slope, square = (
            integrate.quad(
                lambda t, k=k, block=block, c=c: (1 - (t / c) ** 2) ** (2 * k) * t**2 * stats.chi.pdf(t, block), 0, c
            )[0]
            / block
            for k in (1, 2)
        )
        assert slope**2 / square == pytest.approx(0.95, abs=1e-4)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("block", [1, 2, 3])
def test_slopes_are_those_of_psi_over_all_directions(loss: Loss, block: int) -> None:
    rng = np.random.default_rng(block)
    way = rng.normal(size=(20000, block))
    way /= np.linalg.norm(way, axis=1)[:, None]
    for size in (0.3, 1.7, 3.1, 4.4):
        step = 1e-5
        ends = [size * way + s * step * np.eye(block)[0] for s in (1, -1)]
        psi = [loss_weights(loss, np.linalg.norm(r, axis=1), block) * r[:, 0] for r in ends]
        wanted = np.mean(psi[0] - psi[1]) / (2 * step)
        assert loss_slopes(loss, np.array([size]), block)[0] == pytest.approx(wanted, abs=0.02)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("block", [1, 2, 3])
def test_the_weighted_noise_is_consistent_at_the_normal_law(loss: Loss, block: int) -> None:
    r = np.random.default_rng(3).normal(size=(200000, block))
    w = loss_weights(loss, np.linalg.norm(r, axis=1), block)
    square = np.sum(w[:, None] * r**2) / (block * w.sum())
    assert square / shrinkage(loss, block) == pytest.approx(1.0, abs=0.01)


def test_auto_is_for_an_identification() -> None:
    model = build_model(ARM, Task.of("position", frozenset(), {"P": (30.0, 20.0, 80.0)}))
    data = measure(model, {}, 30, np.random.default_rng(1), 0.05)
    with pytest.raises(InputError, match="one fit needs one"):
        fit(rows_of(model.measurement, data, model.setup, model.residuals), model.kinematic, Options(loss="auto"))


# ------------------------------------------------------------------------------------------------------ gross errors


@pytest.mark.long
def test_a_tenth_of_gross_errors_costs_little() -> None:
    """Long form: robust_draws.py. Ratios to the linear fit of the clean data; all errors are listed."""
    count = 40
    found = [judged(seed, count, "position", 0.1, ("cauchy", "tukey", "auto")) for seed in range(3)]
    for loss in ("cauchy", "tukey", "auto"):
        own = [each[loss] for each in found]
        assert np.median([each.ratio for each in own]) < 1.2
        assert max(each.ratio for each in own) < 1.45
        assert sum(each.missed for each in own) == 0
        assert sum(each.accused for each in own) <= 0.01 * count * len(own)
        assert np.median([each.sigma for each in own]) == pytest.approx(1.0, abs=0.15)
        assert 0.9 < np.mean([each.inside for each in own]) < 0.99
        assert all(each.loss in ("cauchy", "tukey") for each in own)


@pytest.mark.parametrize("loss", ROBUST)
def test_the_covariance_is_the_sandwich(loss: Loss) -> None:
    """Against sums written out here, inverted as they are."""
    case = draw(4, 40)
    found = calibrate(case.model, None, case.spoilt, Options(loss=loss))
    after, model = found.after, case.model
    rows = rows_of(model.measurement, case.spoilt, found.setup, model.residuals)
    system = whitened(rows, after.free, np.zeros(len(after.x)), stated(model, found.setup))
    r, jacobian = rows(after.x)
    slopes = jacobian[:, :, system.index] * system.scales / after.sigmas["position"]
    t = np.linalg.norm(r, axis=1) / after.sigmas["position"]
    w = loss_weights(loss, t, 3)
    steep = w * loss_slopes(loss, t, 3).sum() / w.sum()
    known = system.known_rows(after.x, after.every_factor)[:, :-1]
    inverse = np.linalg.inv(np.einsum("b,bij,bik->jk", steep, slopes, slopes) + known.T @ known)
    leverage = steep * np.einsum("bij,jk,bik->b", slopes, inverse, slopes) / 3
    scatter = np.einsum("b,bij,bik->jk", (w * t) ** 2 / 3 / (1 - leverage), slopes, slopes) + known.T @ known
    spread = np.full(r.shape, after.sigmas["position"])
    assert sandwich(system, after.x, spread, after.every_factor, loss) == pytest.approx(
        inverse @ scatter @ inverse, rel=1e-5, abs=1e-9
    )


def test_gross_errors_of_a_pose_are_borne_too() -> None:
    own = judged(3, 60, "pose", 0.1, ("tukey",))["tukey"]
    assert own.ratio < 1.45
    assert (own.missed, own.accused) == (0, 0)


def test_clean_data_stay_with_the_linear_loss() -> None:
    found = [judged(seed, 60, "position", 0.0, ("auto",))["auto"] for seed in range(3)]
    assert np.median([each.ratio for each in found]) == 1.0
    assert max(each.ratio for each in found) < 1.1
    assert sum(each.accused > 0 for each in found) <= 1


def test_a_linear_fit_lists_gross_errors_that_hide_each_other() -> None:
    case = draw(1, 60)
    found = calibrate(case.model, None, case.spoilt, Options())
    assert {int(each.pose) for each in found.outliers} == {int(case.spoilt.labels[i]) for i in case.wrong}
    for each in found.outliers:
        assert each.off == pytest.approx(50.0, abs=3.0)
        assert each.noises == pytest.approx(50 / 0.05, rel=0.6)
        assert (each.unit, each.group, each.point, each.weight) == ("mm", "position", "", 1.0)


# ------------------------------------------------------------------------------------------------- without one reading


def slip(loss: Loss, size: float = 0.6) -> tuple[Calibration, Dataset, Model, Options]:
    """One slip of a dozen noises; all variances stated, so that a refit has the same."""
    model = build_model(ARM, Task.of("position", frozenset({"base"}), {"P": (30.0, 20.0, 80.0)}))
    rng = np.random.default_rng(5)
    there = replace(model, setup=replace(model.setup, base=random_frame(rng, 1500.0)))
    data = measure(there, random_errors(model, rng), 40, rng, 0.05)
    z = data.z.copy()
    z[7] += [size, 0.0, 0.0]
    options = Options(loss=loss, sigma={"position": 0.05}, scales="stated")
    spoilt = replace(data, z=z)
    return calibrate(model, None, spoilt, options), spoilt, model, options


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_what_changes_without_a_reading_is_what_a_refit_changes(loss: Loss) -> None:
    found, data, model, options = slip(loss)
    (listed,) = found.outliers
    assert listed.pose == data.labels[7]
    kept = data.take(np.delete(np.arange(40), 7))
    rows = rows_of(model.measurement, kept, found.setup, model.residuals)
    if loss == "huber":  # the weights of the others held: a linear fit with them as noise
        weights = np.delete(found.after.weights, 7, axis=0)
        rows = rows_of(model.measurement, replace(kept, sigma=0.05 / np.sqrt(weights)), found.setup, model.residuals)
        options = replace(options, loss="linear")
    again = fit(rows, found.after.free, options, prior_mean=stated(model, found.setup))
    index = model.parameters.indices(found.after.free)
    change = ((again.x - found.after.x)[index]) / found.after.posterior.sigmas
    most = int(np.abs(change).argmax())
    assert listed.parameter == found.after.free[most]
    assert listed.sigmas == pytest.approx(change[most], rel=0.02)
    at, _ = model.points(data.q, found.after.x, found.setup.vector)
    moved, _ = model.points(data.q, again.x, found.setup.vector)
    assert listed.tool_mm == pytest.approx(np.sqrt(np.mean(np.sum((moved - at) ** 2, axis=1))), rel=0.02)
    predicted, _ = model.residual(data.q[7:8], again.x, found.setup.vector, data.z[7:8])
    if loss == "linear":
        assert listed.off == pytest.approx(np.linalg.norm(predicted), rel=0.02)


def test_deletion_is_the_least_squares_solution_of_the_rest() -> None:
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(30, 6))
    y = np.linalg.lstsq(rows[:, :5], -rows[:, 5], rcond=None)[0]
    at = np.column_stack([rows[:, :5], rows @ np.append(y, 1.0)])
    rest = np.linalg.lstsq(rows[3:, :5], -rows[3:, 5], rcond=None)[0]
    assert np.allclose(without(at, at[:3]), rest - y)


def test_clean_readings_are_rarely_accused() -> None:
    """The law of the test itself: of position and orientation in one set of a hundred."""
    model = model_of("pose")
    case = draw(0, 30, "pose", 0.0)
    start = calibrate(model, None, case.clean, Options())
    rows = rows_of(model.measurement, case.clean, start.setup, model.residuals)
    x = start.after.x
    system = whitened(rows, start.after.free, np.zeros(len(x)), x)
    given = readings_at(system, x, known_sigma(rows, {}))
    assert given.held is not None
    beforehand = system.known_rows(x, {"": 1.0})
    beforehand[:, -1] = 0.0
    beforehand[:, :-1] *= 1e-3  # next to nothing is known: the F law is exact
    accused = 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        noise = [s * rng.normal(size=pile.seen.shape) for pile, s in zip(given.piles, (0.05, 2.5e-4), strict=True)]
        noisy = replace(
            given,
            piles=tuple(replace(pile, r=r) for pile, r in zip(given.piles, noise, strict=True)),
            held=tuple(np.dstack([rows[:, :, :-1], r]) for rows, r in zip(given.held, noise, strict=True)),
        )
        found = judged_readings(noisy, beforehand, {"position": 0.05, "orientation": 2.5e-4}, "linear")
        accused += any(each.bad.any() for each in found)
    assert accused <= stats.binom.ppf(0.999, 150, 0.02)


# ------------------------------------------------------------------------------------------------ the choice of a loss


def test_linearised_folds_choose_what_real_fits_of_folds_would() -> None:
    """The same folds in full: held-out errors of three real fits, median against median."""
    for share, wanted in ((0.1, ("cauchy", "tukey")), (0.0, ("linear",))):
        case = draw(11, 60, "position", share)
        found = calibrate(case.model, None, case.spoilt, Options(loss="auto"))
        assert found.loss_choice is not None
        assert found.loss_choice.chosen == found.after.loss
        assert found.after.loss in wanted
        medians = {
            loss: np.median(
                cross_validate(case.model, case.spoilt, Options(loss=loss), 3, np.random.default_rng(1))["after"].size
            )
            for loss in ("linear", "tukey")
        }
        gain = found.loss_choice.gain["tukey"]
        if share:
            assert medians["tukey"] < 0.1 * medians["linear"]
            assert gain[0] > 5 * gain[1] > 0
        else:
            assert medians["tukey"] == pytest.approx(medians["linear"], rel=0.1)
            assert abs(gain[0]) < 0.2


def test_an_effect_that_the_model_lacks_is_not_robustly_hidden() -> None:
    """A sagging arm: the linear loss stays, whatever foretells the poses without sag better."""
    model = build_model(ARM, Task.of("position", frozenset({"base"}), {"P": (30.0, 20.0, 80.0)}))
    rng = np.random.default_rng(8)
    there = replace(model, setup=replace(model.setup, base=random_frame(rng, 1500.0)))
    data = measure(there, random_errors(model, rng), 60, rng, 0.02)
    z = data.z + 0.6 * np.sin(3 * data.q[:, [1, 2, 3]])
    found = calibrate(model, None, replace(data, z=z), Options(loss="auto"))
    assert found.after.loss == "linear"
    assert found.loss_choice is not None
    assert found.loss_choice.why


def test_a_choice_says_why() -> None:
    case = draw(2, 40)
    found = calibrate(case.model, None, case.spoilt, Options(loss="auto"))
    rows = rows_of(case.model.measurement, case.spoilt, found.setup, case.model.residuals)
    again = choose_loss(case.model, case.spoilt, rows, found.after.free, Options(), stated(case.model, found.setup))
    assert "foretells held-out poses clearly better" in again.why
    assert set(again.facts) == {"chosen", "why", "folds", "gain"}
    assert set(again.facts["gain"]) == set(ROBUST)
