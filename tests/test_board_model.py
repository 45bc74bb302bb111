"""A board in two stages against the same corners written out in one expression, and against numbers of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from boards import CAMERA, LARGE, LYING, MOUNT, ROBOT, SMALL, board, built, errors, eye_in_hand, postures, written_out
from numpy.typing import NDArray

import symcal as sc
from symcal.calibration.evaluate import evaluate
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.fit.robust import Loss
from symcal.instruments import kind_named, seen_by
from symcal.model.model import Model, State, build_model
from symcal.model.stages import alike

Array = NDArray[np.float64]
SIGMA = 0.1


@pytest.fixture(scope="module")
def both() -> tuple[Model, Model, Dataset]:
    """The same six corners in stages and written out, with views some of whose corners are missing."""
    rng = np.random.default_rng(4)
    staged = replace(built(SMALL))
    written = build_model(ROBOT, eye_in_hand(written_out(SMALL)))
    assert staged.measurement.parts[0].staged is not None
    assert written.measurement.parts[0].staged is None
    data = sc.simulate(staged, errors(rng), postures(SMALL, 30, rng), sc.Noise(image=SIGMA), rng)
    z = data.z.reshape(30, 6, 2)
    z[rng.uniform(size=(30, 6)) < 0.15] = np.nan
    return staged, written, replace(data, z=z.reshape(30, 12))


def x_of(model: Model, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.asarray(rng.normal(size=len(model.parameters)) * 0.3 * np.minimum(model.parameters.scales, 5.0))


def close(found: Array, wanted: Array) -> None:
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())


def test_residuals_and_slopes_are_those_of_the_one_expression(both: tuple[Model, Model, Dataset]) -> None:
    staged, written, data = both
    assert staged.parameters.names == written.parameters.names
    x = x_of(staged, 1)
    found, wanted = (rows_of(m.measurement, data, m.setup, m.residuals)(x) for m in (staged, written))
    for ours, theirs in zip(found, wanted, strict=True):
        close(ours, theirs)


@pytest.mark.parametrize("weighted", [False, True])
def test_the_triangle_of_compressed_rows_is_that_of_all_rows(
    both: tuple[Model, Model, Dataset], weighted: bool
) -> None:
    """With robust weights and missing corners; rows of a weak prior make the triangle unique."""
    staged, written, data = both
    x, n = x_of(staged, 2), len(staged.parameters)
    rng, index = np.random.default_rng(3), np.arange(n)
    triangles = []
    weight = rng.uniform(0.2, 1.0, (30, 6)).repeat(2, axis=1) if weighted else np.ones((30, 12))
    for model in (staged, written):
        rows = rows_of(model.measurement, data, model.setup, model.residuals)
        spread = np.where(rows.seen, SIGMA / np.sqrt(weight), np.inf)
        found = rows.at(x).weighted(spread, index, model.parameters.scales)
        stacked = np.vstack([found, np.eye(n, n + 1)])
        triangle = np.linalg.qr(stacked, mode="r")
        triangles.append(triangle * np.sign(np.diag(triangle))[:, None])
        if model is staged:
            assert len(found) <= 30 * (6 + 9 + 1)
    np.testing.assert_allclose(*triangles, rtol=0, atol=1e-12 * np.abs(triangles[1]).max())


@pytest.mark.parametrize("loss", ["linear", "huber", "cauchy", "tukey"])
def test_an_identification_is_the_same(both: tuple[Model, Model, Dataset], loss: Loss) -> None:
    """Estimate, unknown noise, equations, degrees of freedom, chi-squared and weights."""
    staged, written, data = both
    found = [
        fit(rows_of(m.measurement, data, m.setup, m.residuals), m.parameters.names, Options(loss=loss))
        for m in (staged, written)
    ]
    ours, theirs = found
    assert ours.converged
    assert ours.equations == theirs.equations == int(np.isfinite(data.z).sum())
    sigma = theirs.posterior.sigmas
    assert np.abs((ours.x - theirs.x) / sigma).max() < 1e-4
    assert ours.sigmas["image"] == pytest.approx(theirs.sigmas["image"], rel=1e-6)
    assert ours.dof == pytest.approx(theirs.dof, rel=1e-6)
    assert ours.chi_squared == pytest.approx(theirs.chi_squared, rel=1e-5)
    np.testing.assert_allclose(ours.weights, theirs.weights, atol=1e-4)
    np.testing.assert_allclose(ours.posterior.covariance, theirs.posterior.covariance, rtol=1e-4, atol=1e-12)


def test_readings_slopes_and_errors_are_those_of_the_one_expression(both: tuple[Model, Model, Dataset]) -> None:
    staged, written, data = both
    x, setup = x_of(staged, 5), staged.setup.vector
    close(staged.jacobian(data.q, x, setup)[0], written.jacobian(data.q, x, written.setup.vector)[0])
    found, wanted = (evaluate(State(m, m.setup, x), data) for m in (staged, written))
    close(found.vectors, wanted.vectors)
    np.testing.assert_array_equal(found.point, wanted.point)
    assert (found.unit, found.names) == ("mm", ("x", "y", "z"))


def test_trackers_read_many_points_in_stages_too() -> None:
    """A kind without numbers of its own, whose noise is by axis or not: thirteen spheres on a plate."""
    rng = np.random.default_rng(6)
    points = {f"P{i}": tuple(p) for i, p in enumerate(rng.uniform(-100, 100, (13, 3)).tolist())}
    few = dict(list(points.items())[:12])
    models = []
    for chosen in (points, few):
        target = sc.Target("plate", sc.Place("flange", np.eye(4), True), chosen)
        models.append(build_model(ROBOT, sc.Task((sc.Observation(sc.Tracker(), "tracker", target=target),), base=True)))
    many, written = models
    assert many.measurement.parts[0].staged is not None
    assert written.measurement.parts[0].staged is None
    q, x = rng.uniform(-2, 2, (7, 6)), x_of(many, 7)
    z = rng.normal(size=(7, 39)) * 500
    r, jacobian = many.residual(q, x, many.setup.vector, z)
    wanted, slopes = written.residual(q, x, written.setup.vector, z[:, :36])
    close(r[:, :36], wanted)
    close(jacobian[:, :36], slopes)


def test_one_board_is_read_by_two_cameras_and_a_tracker_beside_them() -> None:
    """Staged and written observations side by side keep their columns."""
    target = replace(board(SMALL), at=sc.Place("flange", MOUNT, True))
    smr = sc.Target("smr", sc.Place("flange"), {"P": (10.0, 20.0, 30.0)})
    cameras = [
        sc.Observation(seen_by(CAMERA, calibrate=True), name, at=sc.Place("world", LYING, True), target=target)
        for name in ("left", "right")
    ]
    tracker = sc.Observation(sc.Tracker(), "tracker", target=smr)
    model = build_model(ROBOT, sc.Task((cameras[0], tracker, cameras[1]), base=True))
    q, x = np.random.default_rng(8).uniform(-2, 2, (5, 6)), np.zeros(len(model.parameters))
    (jacobian,) = model.jacobian(q, x, model.setup.vector)
    assert jacobian.shape == (5, 12 + 3 + 12, len(x))
    names = model.parameters.names
    left, right = (np.array([n.startswith(f"{name}_") for n in names]) for name in ("left", "right"))
    assert not np.abs(jacobian[:, :12, right]).any()
    assert not np.abs(jacobian[:, 15:, left]).any()
    assert not np.abs(jacobian[:, 12:15, left | right]).any()
    np.testing.assert_allclose(jacobian[:, :12, left], jacobian[:, 15:, right], rtol=1e-12)


def test_few_points_stand_for_many() -> None:
    rng = np.random.default_rng(9)
    for points in (LARGE.points, rng.normal(size=(40, 3)) * [50, 20, 80]):
        few = alike(points)
        motion = rng.normal(size=(3, 4))
        moved = [np.c_[p, np.ones(len(p))] @ motion.T for p in (points, few)]
        rms = [np.sqrt(np.mean(np.sum(m**2, axis=1))) for m in moved]
        assert rms[0] == pytest.approx(rms[1], rel=1e-12)
    assert len(alike(LARGE.points)) == 4


def test_boards_are_seen_from_their_printed_side_and_not_too_obliquely() -> None:
    """Margins of every corner against an arithmetic of its own."""
    model, rng = built(SMALL), np.random.default_rng(10)
    q = rng.uniform(-2.2, 2.2, (400, 6))
    kernel = model.measurement.parts[0].staged
    assert kernel is not None
    margins = kernel.margins(q, np.zeros(len(model.parameters)), model.setup.vector)
    flange = model.flange(q, np.zeros(len(model.parameters)), np.r_[np.eye(4)[:3].ravel("F"), np.eye(4)[:3].ravel("F")])
    seen = np.linalg.inv(flange[0] @ MOUNT) @ LYING
    p = np.einsum("nij,kj->nki", seen, np.c_[SMALL.points, np.ones(6)])[:, :, :3]
    cosine = np.einsum("ni,nki->nk", seen[:, :3, 2], p) / np.linalg.norm(p, axis=2)
    np.testing.assert_allclose(margins[:, :, 0], p[:, :, 2], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(margins[:, :, 2], np.deg2rad(75.0) - np.arccos(cosine), atol=1e-7)
    behind = margins[:, :, 2].max(axis=1) < np.deg2rad(75.0) - np.pi / 2
    assert behind.any()


def test_simulated_views_show_part_of_a_board_or_nothing() -> None:
    """A coded board counts in part, a chessboard whole or not at all; nothing is seen from behind."""
    rng = np.random.default_rng(11)
    q = np.vstack([postures(LARGE, 12, rng, spread=1.6), rng.uniform(-2.2, 2.2, (60, 6))])
    chess = sc.parse_board("chessboard:11x8:30mm")
    counts = {}
    for which in (LARGE, chess):
        data = sc.simulate(built(which), {}, q, sc.Noise(image=0.1), rng)
        counts[which.kind] = np.isfinite(data.z[:, ::2]).sum(axis=1)
    assert set(counts["chessboard"]) == {0, 88}
    partly = counts["charuco"]
    assert partly[partly > 0].min() >= 22
    assert ((partly > 22) & (partly < 88)).any()
    least = replace(board(), least=60)
    fewer = sc.simulate(build_model(ROBOT, eye_in_hand(least)), {}, q, sc.Noise(image=0.1), rng)
    counted = np.isfinite(fewer.z[:, ::2]).sum(axis=1)
    assert counted[counted > 0].min() >= 60


def test_a_kind_that_reads_frames_knows_the_board_as_a_frame() -> None:
    target = replace(board(SMALL), at=sc.Place("world", LYING, True))
    pose = sc.Observation(kind_named("pose")(), "pose", at=sc.Place("tool"), target=target)
    assert build_model(ROBOT, sc.Task((pose,))).measurement.parts[0].staged is None
