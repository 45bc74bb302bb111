"""Folds start where all data have placed things, and end where their own data lead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import ARM, anywhere, handling, measure, random_errors

from symcal import Distance, Noise, Observation, Place, Target, Task, Tracker, build_model, simulate
from symcal.calibration.calibrate import Calibration, baseline_model, calibrate, calibrate_near
from symcal.calibration.compare import cross_validate, folds
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.model.model import Model, State
from symcal.placing.placement import from_other


def pose_case() -> tuple[Model, Dataset]:
    rng = np.random.default_rng(2)
    model = build_model(ARM, Task.of("pose", {"base", "tool"}))
    moved = replace(model, setup=replace(model.setup, base=_frame(rng), tool=_frame(rng)))
    return model, measure(moved, random_errors(model, rng), 40, rng, 0.1, 2e-4)


def _frame(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = q * np.sign(np.linalg.det(q)), rng.normal(size=3) * 500.0
    return frame


def two_instruments(fix: tuple[str, ...] = ()) -> tuple[Model, Dataset]:
    """A tracker with the base known and a wire whose place is searched for: the baseline is another model."""
    rng = np.random.default_rng(3)
    smr = Target("smr", Place("flange"), {"P": (40.0, 0.0, 60.0)})
    wire = Observation(Distance(), "wire", at=Place("world", unknown=True), target=smr)
    model = build_model(handling(), Task((Observation(Tracker(), "tracker", target=smr), wire), fix=fix))
    truth = {"theta_4": 2e-3, "alpha_2": -4e-3, "d_5": 0.3, "wire_x": 900.0, "wire_y": 1200.0, "wire_z": 300.0}
    truth = {name: value for name, value in truth.items() if name not in fix}
    data = simulate(model, truth, anywhere(handling(), 40, rng), Noise(position=0.05, distance=0.03), rng)
    return model, data


def _shift(one: State, other: State) -> float:
    """By how much frames and points of two states differ, mm (turns at a metre)."""
    a, b = (state.model.moved(state.setup, state.x) for state in (one, other))
    pairs = [(a.base, b.base), (a.tool, b.tool), *((a.places[name], b.places[name]) for name in a.places)]
    frames = max(float(np.abs((m - n) * np.array([1e3, 1e3, 1e3, 1.0])).max()) for m, n in pairs)
    return max(frames, float(np.abs(a.points - b.points).max(initial=0.0)))


@pytest.mark.parametrize("case", [pose_case, two_instruments])
def test_the_minimum_of_a_fold_is_that_of_a_full_search(case) -> None:
    model, data = case()
    baseline = baseline_model(model)
    whole = calibrate(model, baseline, data, Options(), mistakes=())
    for held_out in folds(data, 4, np.random.default_rng(0)):
        split = tuple("test" if i in held_out else "train" for i in range(len(data)))
        labelled = replace(data, split=split)
        full = calibrate(model, baseline, labelled, Options(), mistakes=())
        near = calibrate_near(model, baseline, labelled, Options(), whole)
        for name, state in full.states.items():
            assert _shift(state, near.states[name]) < 1e-4, name
        links = model.parameters.indices(model.kinematic)
        sigma = np.array([full.after.posterior.sigmas[full.after.free.index(name)] for name in model.kinematic])
        # searches end where the cost changes by 1e-14 of itself: sqrt(2e-14 * 100) of a standard deviation, twice
        assert np.all(np.abs(full.after.x - near.after.x)[links] < 3e-6 * sigma)


def test_held_out_poses_tell_a_fold_no_more_than_where_to_start() -> None:
    model, data = pose_case()
    whole = calibrate(model, None, data, Options(), mistakes=())
    found = cross_validate(model, data, Options(), 4, np.random.default_rng(5), near=whole)
    for held_out in folds(data, 4, np.random.default_rng(5)):
        z = data.z.copy()
        z[held_out, :3] += 1e4
        split = tuple("test" if i in held_out else "train" for i in range(len(data)))
        other = calibrate(model, None, replace(data, z=z, split=split), Options(), mistakes=())
        spoilt = calibrate_near(model, None, replace(data, z=z, split=split), Options(), whole)
        assert _shift(other.states["after"], spoilt.states["after"]) < 1e-4
        mine = found["after"].vectors[np.isin(found["after"].pose, held_out)]
        (h,) = other.model.accuracy(
            data.q[held_out], other.after.x, other.setup.vector, np.nan_to_num(data.z[held_out])
        )
        assert np.allclose(mine, h[:, :3], atol=1e-6)


def test_a_start_far_off_leads_to_the_same_place() -> None:
    """What is taken of the whole is but a start: one that is off by centimetres and degrees ends where others do."""
    model, data = pose_case()
    whole = calibrate(model, None, data, Options(), mistakes=())
    off = np.eye(4)
    c, s = np.cos(0.05), np.sin(0.05)
    off[:2, :2], off[:3, 3] = [[c, -s], [s, c]], [30.0, -20.0, 10.0]
    far: Calibration = replace(whole, setup=replace(whole.setup, base=whole.setup.base @ off))
    near = calibrate_near(model, None, data, Options(), far)
    assert _shift(near.states["after"], whole.states["after"]) < 1e-4
    assert _shift(near.states["before"], whole.states["before"]) < 1e-4


@pytest.mark.parametrize("loss", ["linear", "huber", "tukey"])
def test_variances_far_off_lead_to_the_same_place(loss) -> None:
    """So are the variances of the whole fit: noise that is off by factors of ten and a third changes nothing."""
    model, data = pose_case()
    options = Options(loss=loss)
    whole = calibrate(model, None, data, options, mistakes=())
    (train, *_) = folds(data, 3, np.random.default_rng(1))
    part = data.take(np.setdiff1d(np.arange(len(data)), train))
    full = calibrate(model, None, part, options, mistakes=())
    fits = {}
    for name in ("offsets", "after"):
        own = getattr(whole, name)
        sigmas = {group: sigma * factor for (group, sigma), factor in zip(own.sigmas.items(), (10.0, 0.3), strict=True)}
        fits[name] = replace(own, sigmas=sigmas, factor=own.factor * 2)
    near = calibrate_near(model, None, part, options, replace(whole, **fits))
    for name, state in full.states.items():
        assert _shift(state, near.states[name]) < 1e-3, name
    for group, sigma in full.after.sigmas.items():
        assert near.after.sigmas[group] == pytest.approx(sigma, rel=1e-5)
    assert near.after.factor == pytest.approx(full.after.factor, rel=1e-4)


def test_errors_from_another_setup_are_the_same_robot_and_places() -> None:
    model, data = two_instruments()
    rng = np.random.default_rng(8)
    found = calibrate(model, baseline_model(model), data, Options(), mistakes=())
    other, x = found.setup, found.after.x
    setup = other.moved({"wire_x": 40.0, "wire_y": -5.0, "wire_rz": 0.2}, model.measurement.points_called)
    again = from_other(model, x, other, setup)
    q = rng.uniform(-1, 1, (20, model.robot.dof))
    z = np.nan_to_num(data.z[:20])
    for kernel_z, kernel in zip(
        (z[:, part.readings] for part in model.measurement.parts), model.residuals, strict=True
    ):
        (first, _), (second, _) = kernel(q, x, other.vector, kernel_z), kernel(q, again, setup.vector, kernel_z)
        np.testing.assert_allclose(first, second, atol=1e-8)


def test_what_is_held_stays_as_it_was() -> None:
    model, data = two_instruments(("wire_x",))
    whole = calibrate(model, baseline_model(model), data, Options(), mistakes=())
    near = calibrate_near(model, baseline_model(model), data, Options(), whole)
    for found in (whole, near):
        there = model.moved(found.setup, found.after.x).places["wire"]
        assert there[0, 3] == model.setup.places["wire"][0, 3]
    assert _shift(near.states["after"], whole.states["after"]) < 1e-4
