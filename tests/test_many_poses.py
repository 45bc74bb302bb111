"""Very many poses piece by piece: the same as all rows at once, by NumPy's own solvers, and in little memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from cases import TABLE_III, front_half, handling, handling_model, measure
from hypothesis import given, settings
from hypothesis import strategies as st

import symcal as sc
from symcal.calibration.calibrate import calibrate
from symcal.calibration.halves import two_halves
from symcal.calibration.left_out import left_out
from symcal.calibration.model_check import model_check
from symcal.calibration.outliers import outliers
from symcal.calibration.thinned import thinned, thinned_notes
from symcal.data import dataset as data_module
from symcal.data.dataset import Dataset, evenly
from symcal.fit import residual_rows
from symcal.fit.estimation import Fit, Options, fit, variance_model
from symcal.fit.held_out import folds_of, steps_without
from symcal.fit.residual_rows import Rows, rows_of
from symcal.fit.sandwich import sandwich
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.solvers.appended import appended

POSES = 230
SIGMA = 0.05


@contextmanager
def pieces_of(components: int | None) -> Iterator[None]:
    """Pieces of so many components where it is a number; all rows at once where it is None."""
    patch = pytest.MonkeyPatch()
    huge = 10**9
    patch.setattr(residual_rows, "FEW_POSES", huge if components is None else 0)
    patch.setattr(residual_rows, "FEW_COMPONENTS", huge if components is None else 0)
    patch.setattr(residual_rows, "_AT_ONCE", components or huge)
    patch.setattr(residual_rows, "_FEWEST", 1)
    try:
        yield
    finally:
        patch.undo()


def position() -> tuple[Model, Dataset]:
    model = handling_model()
    return model, measure(model, TABLE_III, POSES, np.random.default_rng(1), SIGMA)


def noise_of_the_file() -> tuple[Model, Dataset]:
    """Of some readings alone; that of the others must be found."""
    model, data = position()
    sigma = np.full(data.z.shape, np.nan)
    sigma[::3] = np.random.default_rng(2).uniform(0.03, 0.09, (len(sigma[::3]), 3))
    return model, replace(data, sigma=sigma)


def correlated() -> tuple[Model, Dataset]:
    model, data = position()
    half = np.random.default_rng(3).normal(0, SIGMA, (POSES, 3, 3)) + SIGMA * np.eye(3)
    return model, replace(data, covariance=half @ half.swapaxes(1, 2))


def several() -> tuple[Model, Dataset]:
    """A tracker and a wire; each has missed some poses."""
    smr = sc.Target("smr", sc.Place("flange"), {"P": (40.0, 0.0, 60.0), "Q": (0.0, 30.0, 20.0)})
    tracker = sc.Observation(sc.Tracker(), "tracker", target=smr)
    wire = sc.Observation(sc.Distance(offset=None), "wire", at=sc.Place("world", unknown=True), target=smr)
    model = build_model(handling(), sc.Task((tracker, wire), base=True))
    truth = {"theta_4": 0.002, "alpha_2": -0.004, "d_5": 0.3, "wire_x": 900.0, "wire_y": 1200.0, "wire_offset": 25.0}
    rng = np.random.default_rng(4)
    data = sc.simulate(model, truth, front_half(POSES, rng), sc.Noise(position=0.05, distance=0.03), rng)
    z = data.z.copy()
    z[::5, :3] = np.nan
    z[1::4, 6:] = np.nan
    setup = replace(model.setup, places={name: place.copy() for name, place in model.setup.places.items()})
    setup.places["wire"][:3, 3] += [900.0, 1200.0, 0.0]
    return replace(model, setup=setup), replace(data, z=z)


def whole_poses() -> tuple[Model, Dataset]:
    model = build_model(handling(), Task.of("pose", frozenset({"base"})))
    return model, measure(model, TABLE_III, POSES, np.random.default_rng(5), SIGMA, 2e-4)


CASES = {each.__name__: each for each in (position, noise_of_the_file, correlated, several, whole_poses)}


def rows_for(model: Model, data: Dataset) -> Rows:
    return rows_of(model.measurement, data, model.setup, model.residuals)


def fitted(model: Model, data: Dataset, options: Options) -> Fit:
    return fit(rows_for(model, data), model.parameters.names, options)


@given(st.integers(0, 40), st.integers(1, 60), st.integers(1, 7), st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_rows_appended_to_a_triangle_keep_all_norms(before: int, rows: int, n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(before, n)), rng.normal(size=(rows, n)) * 10.0 ** rng.integers(-3, 4)
    found = appended(appended(np.zeros((0, n)), first), second)
    stacked = np.vstack([first, second])
    assert found.shape == (n, n)
    assert not np.tril(found, -1).any()
    wanted = np.zeros(n)
    wanted[: min(n, len(stacked))] = np.linalg.svd(stacked, compute_uv=False)
    assert np.allclose(np.linalg.svd(found, compute_uv=False), wanted, rtol=1e-12, atol=1e-13 * wanted[0])
    y = rng.normal(size=n)
    assert np.linalg.norm(found @ y) == pytest.approx(np.linalg.norm(stacked @ y), rel=1e-12)


@pytest.mark.parametrize(
    ("case", "loss"),
    [(case, "linear") for case in CASES]
    + [(case, loss) for case in CASES if case != "correlated" for loss in ("huber", "tukey")],
)
def test_a_fit_in_pieces_is_that_of_all_rows(case: str, loss: str) -> None:
    model, data = CASES[case]()
    if loss != "linear":
        z = data.z.copy()
        z[7::40, 0] += 3.0
        data = replace(data, z=z)
    options = Options(loss=loss)  # type: ignore[arg-type]
    with pieces_of(None):
        whole = fitted(model, data, options)
    with pieces_of(97):
        found = fitted(model, data, options)
    assert found.converged == whole.converged is True
    assert np.abs((found.x - whole.x)[model.parameters.indices(whole.free)] / whole.posterior.sigmas).max() < 1e-4
    assert found.sigmas == pytest.approx(whole.sigmas, rel=1e-5)
    assert found.every_factor == pytest.approx(whole.every_factor, rel=1e-4)
    assert np.allclose(found.weights, whole.weights, atol=1e-4)
    assert found.dof == pytest.approx(whole.dof, rel=1e-6)
    assert found.chi_squared == pytest.approx(whole.chi_squared, rel=1e-5)
    for name, (squares, dof) in whole.by_group.items():
        assert found.by_group[name] == pytest.approx((squares, dof), rel=1e-5)
    assert found.identifiability.rank == whole.identifiability.rank
    assert np.allclose(found.identifiability.seen_values, whole.identifiability.seen_values, rtol=1e-4)
    outer = np.outer(whole.posterior.sigmas, whole.posterior.sigmas)
    assert np.allclose(found.posterior.covariance / outer, whole.posterior.covariance / outer, atol=1e-4)
    assert found.equations == whole.equations


@pytest.mark.parametrize("case", CASES)
def test_estimate_and_covariance_are_those_of_numpy_on_the_stacked_system(case: str) -> None:
    model, data = CASES[case]()
    with pieces_of(97):
        found = fitted(model, data, Options())
    rows = rows_for(model, data)
    system = variance_model(rows, found.free, Options())
    decorrelated = rows.decorrelated()
    r, jacobian = decorrelated(found.x)
    keep = decorrelated.seen
    spread = system.spread(found.variances)[keep]
    scales = model.parameters.scales[model.parameters.indices(found.free)]
    stacked = np.vstack(
        [
            np.column_stack([jacobian[keep][:, model.parameters.indices(found.free)] * scales, r[keep]])
            / spread[:, None],
            system.system.known_rows(found.x, found.every_factor),
        ]
    )
    y, _, rank, values = np.linalg.lstsq(stacked[:, :-1], -stacked[:, -1], rcond=None)
    assert rank == len(found.free)
    _, s, vt = np.linalg.svd(stacked[:, :-1], full_matrices=False)
    assert np.allclose(s, values, rtol=1e-9)
    covariance = np.outer(scales, scales) * (vt.T / s**2 @ vt)
    sigmas = np.sqrt(np.diag(covariance))
    assert np.abs(scales * y / sigmas).max() < 1e-4  # nothing is left to step
    root = system.at(found.x, found.variances)[0].root * scales[:, None]
    assert np.allclose(root @ root.T / np.outer(sigmas, sigmas), covariance / np.outer(sigmas, sigmas), atol=1e-9)
    assert found.chi_squared == pytest.approx(float(np.sum((r[keep] / spread) ** 2)), rel=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_the_size_of_a_piece_does_not_matter(case: str) -> None:
    """At one x, to rounding: norms by every direction, group by group, with weights."""
    model, data = CASES[case]()
    rows = rows_for(model, data)
    weights = np.random.default_rng(6).uniform(0.0, 1.0, rows.seen.shape) * rows.seen
    weights[::9] = 0.0
    x = 0.3 * model.parameters.scales * np.random.default_rng(7).normal(size=len(model.parameters))
    directions = np.random.default_rng(8).normal(size=(len(x) + 1, 5))
    found = []
    for size in (None, 3, 50, 97, 10**6):
        with pieces_of(size):
            system = variance_model(rows_for(model, data), model.parameters.names, Options())
            assert (system.triangles is None) == (size is None)
            variances = replace(system.first(x, {}, 1e-2), weights=weights)
            variances = replace(variances, sigmas={g.name: 0.1 for g in model.measurement.groups})
            names, blocks, fixed = system.linearised(x, variances)
            norms = [np.linalg.norm(block.rows @ directions, axis=0) for block in blocks]
            norms += [np.linalg.norm(each @ directions, axis=0) for each in system.group_rows(x, variances).values()]
            norms += [np.linalg.norm(system.rows_with(variances)(x) @ directions, axis=0)]
            found.append(
                (names, [b.count for b in blocks], np.array(norms), np.linalg.norm(fixed @ directions, axis=0))
            )
    for names, counts, norms, fixed in found[1:]:
        assert (names, counts) == found[0][:2]
        assert np.allclose(norms, found[0][2], rtol=1e-12)
        assert np.allclose(fixed, found[0][3], rtol=1e-12)


@pytest.mark.parametrize("case", ["noise_of_the_file", "several", "whole_poses"])
def test_what_is_left_out_and_the_robust_covariance_are_the_same_in_pieces(case: str) -> None:
    model, data = CASES[case]()
    with pieces_of(None):
        at = fitted(model, data, Options())
    results = []
    for size in (None, 40):
        with pieces_of(size):
            system = variance_model(rows_for(model, data), at.free, Options())
            folds = folds_of(system, 7)[:6]  # one is left that is in none
            steps = np.array([step for _, step in steps_without(system, at.x, at.variances, folds)])
            plain = system.spread(at.variances)
            cover = sandwich(system.system, at.x, plain, at.every_factor, "huber")
            results.append((steps, cover))
    (whole, whole_cover), (found, cover) = results
    assert np.abs((found - whole)[:, model.parameters.indices(at.free)] / at.posterior.sigmas).max() < 1e-7
    size = np.sqrt(np.diag(whole_cover))
    assert np.allclose(cover / np.outer(size, size), whole_cover / np.outer(size, size), atol=1e-8)


@pytest.mark.parametrize("case", ["position", "several"])
def test_outliers_are_the_same_in_pieces(case: str) -> None:
    model, data = CASES[case]()
    z = data.z.copy()
    z[[11, 46, 120], 3 if case == "several" else 0] += [0.6, -0.9, 40.0]
    data = replace(data, z=z)
    listed = []
    for size in (None, 40):
        with pieces_of(size):
            found = fitted(model, data, Options(sigma={g.name: 0.05 for g in model.measurement.groups}))
            listed.append(outliers(model, data, found, np.zeros(len(found.x))))
    whole, found = listed
    assert {each.pose for each in found.listed} >= {"11", "46", "120"}
    assert [each.pose for each in found.listed] == [each.pose for each in whole.listed]
    for ours, other in zip(found.listed, whole.listed, strict=True):
        assert ours.parameter == other.parameter
        assert (ours.off, ours.noises, ours.sigmas, ours.tool_mm) == pytest.approx(
            (other.off, other.noises, other.sigmas, other.tool_mm), rel=1e-5
        )
    assert found.dragged == whole.dragged
    assert found.scales == pytest.approx(whole.scales, rel=1e-5)


def test_borders_of_pieces_depend_on_the_number_of_poses_alone() -> None:
    model, data = several()
    with pieces_of(87):
        rows = rows_for(model, data)
        pieces = rows.pieces()
        assert [own.start for own, _ in pieces] == list(range(0, POSES, 10))
        assert pieces[-1][0].stop == POSES
        x = np.zeros(len(model.parameters))
        r, jacobian = rows(x)
        for own, part in pieces:
            assert not part.many or len(part.seen) == 10
            found_r, found = part(x)
            assert np.array_equal(found_r, r[own])
            assert np.array_equal(found, jacobian[own])
            for read, whole in zip(part.poses, rows.poses, strict=True):
                assert np.array_equal(read + own.start, whole[(whole >= own.start) & (whole < own.stop)])
        chosen = np.array([200, 3, 57, 58])
        assert np.array_equal(rows.take(chosen)(x)[0], r[chosen])


def test_memory_grows_with_the_arrays_and_not_with_the_jacobian() -> None:
    """By what NumPy says it has taken: far below one Jacobian, whose rows a fit takes several times."""
    model = build_model(handling(), Task.of("position", frozenset({"base"})))
    names = model.parameters.names
    peaks = []
    for count in (8_000, 24_000):
        data = measure(model, TABLE_III, count, np.random.default_rng(9), SIGMA)
        rows = rows_of(model.measurement, data, model.setup, model.residuals)
        tracemalloc.start()
        found = fit(rows, names, Options())
        outliers(model, data, found, np.zeros(len(names)))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    of_jacobian = 3 * len(names) * 8  # bytes of a pose
    of_arrays = 3 * 8
    assert (peaks[1] - peaks[0]) / 16_000 < min(0.6 * of_jacobian, 20 * of_arrays)
    assert peaks[1] < 24_000 * of_jacobian


def test_few_poses_are_evenly_spread_and_all_where_there_are_no_more() -> None:
    assert np.array_equal(evenly(7, 7), np.arange(7))
    found = evenly(1000, 37)
    assert (len(found), found[0], found[-1]) == (37, 0, 999)
    assert set(np.diff(found)) <= {27, 28}


def test_check_and_halves_of_very_many_poses_look_at_some_and_the_rest_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pattern that is missing is found in the poses that are looked at; the estimate is that of all."""
    model = build_model(handling(), Task.of("position", frozenset({"base"})))
    rng = np.random.default_rng(10)
    q = front_half(600, rng)
    bent = q.copy()
    bent[:, 0] += 4e-4 * np.sin(3 * q[:, 0])
    data = replace(sc.simulate(model, TABLE_III, bent, sc.Noise("normal", SIGMA), rng), q=q)
    options = Options(sigma={"position": SIGMA})
    whole = calibrate(model, None, data, options, mistakes=())
    monkeypatch.setattr(data_module, "SOME", 200)
    monkeypatch.setattr("symcal.calibration.thinned.SOME", 200)
    few, order = thinned(whole, data)
    assert (order.split.count("train"), order.split.count("unused")) == (200, 400)
    assert np.array_equal(few.after.x, whole.after.x)
    assert thinned_notes(data) != [] == thinned_notes(order)
    check = model_check(whole, data, options)
    assert len(check.q) == 200
    assert any(each.kind == "harmonic" and each.joint == 1 for each in check.causes)
    expected = whole.after.by_group["position"]
    (lack,) = check.lack
    assert (lack.ratio, lack.dof) == pytest.approx((np.sqrt(expected[0] / expected[1]), expected[1]))
    halves = two_halves(whole, data, options, np.random.default_rng(0))
    assert len(halves.division.first) == 200


def test_errors_of_poses_left_out_are_the_same_in_pieces() -> None:
    model, data = position()
    options = Options(sigma={"position": SIGMA})
    found = []
    for size in (None, 60):
        with pieces_of(size):
            own = calibrate(model, None, data, options, mistakes=())
            errors = left_out(own, data, options)
            assert errors is not None
            found.append(errors["after"].vectors)
    assert np.abs(found[1] - found[0]).max() < 1e-6 * SIGMA
