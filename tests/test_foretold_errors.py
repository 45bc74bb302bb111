"""Errors that a decision foretells, against drawn robots, refits and formulas of others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identifications import Case, simulated

from symcal.calibration.calibrate import baseline_model, calibrate
from symcal.calibration.evaluate import evaluate, expected_position_rms, position_slopes
from symcal.calibration.foretold_errors import foremost, open_errors, uncalibrated
from symcal.calibration.left_out import FOLDS, left_out
from symcal.fit.estimation import Options
from symcal.fit.held_out import folds_of
from symcal.model.model import State, build_model


@pytest.fixture(scope="module")
def case(configs) -> Case:
    return simulated(configs, "pose", train=40, test=12)


def test_what_is_open_is_what_the_posterior_expects(case: Case) -> None:
    """The rms of draws is that of the covariance; 95 % and the largest are further off."""
    calibration, data, _ = case
    q = data.part("test").q
    expected = float(np.sqrt(np.mean(expected_position_rms(calibration.model, calibration.after, q) ** 2)))
    found = {of: open_errors(calibration.model, calibration.after, q, of) for of in ("rms", "p95", "max")}
    assert found["rms"].mm == pytest.approx(expected, rel=0.12)
    assert found["rms"].mm < found["p95"].mm < found["max"].mm
    turns = calibration.model.flange(q, calibration.after.x, calibration.after.setup.vector[:24])[2][:, 3:]
    turns = turns[:, :, calibration.model.parameters.indices(calibration.after.free)]
    variance = np.einsum("pki,ij,pkj->p", turns, calibration.after.posterior.covariance, turns)
    assert found["rms"].deg == pytest.approx(np.degrees(np.sqrt(variance.mean())), rel=0.12)


def test_the_foremost_parameter_takes_most_away_when_it_is_known(case: Case) -> None:
    calibration, data, _ = case
    slopes = position_slopes(calibration.model, calibration.after, data.q)[0].reshape(-1, len(calibration.after.free))
    covariance = calibration.after.posterior.covariance

    def left(i: int) -> float:
        rest = covariance - np.outer(covariance[i], covariance[i]) / covariance[i, i]
        return float(np.einsum("ki,ij,kj->", slopes, rest, slopes))

    best = int(np.argmin([left(i) for i in range(len(covariance))]))
    assert foremost(calibration.model, calibration.after, data.q) == calibration.after.free[best]


def test_a_robot_that_was_never_calibrated(case: Case, rng: np.random.Generator) -> None:
    """Against robots whose errors are drawn as large as is plausible, each beside the nominal one."""
    calibration, data, _ = case
    model, q = calibration.model, data.part("test").q
    state = State(model, calibration.setup, np.zeros(len(model.parameters)))
    squares: list[list[float]] = [[], []]
    at = model.points(q, state.x, state.setup.vector)[0]
    turned = model.flange(q, state.x, state.setup.vector[:24])[0]
    index = model.parameters.indices(model.kinematic)
    for _ in range(200):
        x = state.x.copy()
        x[index] = 0.1 * model.parameters.scales[index] * rng.normal(size=len(index))  # small: slopes are exact there
        squares[0].append(float(np.mean((model.points(q, x, state.setup.vector)[0] - at) ** 2) * 3))
        rotation = model.flange(q, x, state.setup.vector[:24])[0][:, :3, :3] @ turned[:, :3, :3].swapaxes(1, 2)
        angle = np.arccos(np.clip((np.trace(rotation, axis1=1, axis2=2) - 1) / 2, -1, 1))
        squares[1].append(float(np.mean(angle**2)))
    found = uncalibrated(state, q)
    assert found.mm == pytest.approx(10 * np.sqrt(np.mean(squares[0])), rel=0.1)
    assert found.deg == pytest.approx(10 * np.degrees(np.sqrt(np.mean(squares[1]))), rel=0.1)
    stated = replace(model.task, scales=dict.fromkeys(model.kinematic, 1e-6))
    other = build_model(model.robot, stated)
    assert uncalibrated(State(other, calibration.setup, state.x), q).mm == pytest.approx(found.mm)
    assert uncalibrated(state, q, noise_mm=30.0).mm == pytest.approx(np.hypot(found.mm, 30.0))


@pytest.mark.parametrize("kind", ["pose", "position"])
def test_poses_left_out_in_closed_form_are_those_of_refits(configs, kind: str) -> None:
    """Three of the folds identified again without their poses, everything found anew."""
    calibration, data, _ = simulated(configs, kind, train=40, test=0)
    train = data.part("train")
    found = left_out(calibration, data, Options())
    assert found is not None
    assert len(found["after"].size) == len(found["before"].size) == 40
    order = np.argsort(found["after"].pose)
    baseline = baseline_model(calibration.model)
    for fold in [np.sort(np.random.default_rng(0).permutation(40)[i::FOLDS]) for i in range(3)]:
        labels = tuple("test" if i in fold else "train" for i in range(40))
        again = calibrate(calibration.model, baseline, replace(train, split=labels), Options())
        expected = evaluate(again.states["after"], train.take(fold)).size
        np.testing.assert_allclose(found["after"].size[order][fold], expected, rtol=0.1, atol=0.01)
    inside = evaluate(calibration.states["after"], train).statistics.rms
    assert found["after"].statistics.rms > 1.1 * inside


def test_places_that_only_one_fold_tells_are_left_out_together(configs) -> None:
    """Every pose is in one fold."""
    calibration, data, _ = simulated(configs, "position", train=33, test=0)
    from symcal.fit.estimation import variance_model
    from symcal.fit.residual_rows import rows_of

    rows = rows_of(calibration.model.measurement, data, calibration.after.setup, calibration.model.residuals, ())
    found = folds_of(variance_model(rows, calibration.after.free, Options()), FOLDS)
    assert sorted(np.concatenate(found).tolist()) == list(range(33))
