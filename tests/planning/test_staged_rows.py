"""What a plan knows of a board: rows, values and slopes against all corners one by one; plans that beat random ones."""

from __future__ import annotations

import numpy as np
import pytest
from boards import LARGE, ROBOT, SMALL, board, built, errors, eye_in_hand, postures
from numpy.typing import NDArray

import symcal as sc
from symcal.calibration.calibrate import calibrate
from symcal.fit.estimation import Options
from symcal.model.model import Model, build_model
from symcal.planning.area import WorkingArea, draw
from symcal.planning.constraints import complaints, feasible
from symcal.planning.information import PoseInformation, pose_information
from symcal.planning.region import area_region
from symcal.planning.search import select_poses
from symcal.planning.staged_rows import StagedRows, measured_rows
from symcal.planning.visibility import View, within_limits

Array = NDArray[np.float64]
SIGMA = 0.1


def rows_of_all(model: Model) -> StagedRows:
    index = model.parameters.indices((*model.kinematic, *model.placement))
    sigma = np.full(model.measurement.rows, SIGMA)
    found = measured_rows(model.measurement, model.setup, sigma, index, model.parameters.scales[index])
    assert isinstance(found, StagedRows)
    return found


@pytest.fixture(scope="module")
def poses() -> Array:
    return postures(LARGE, 12, np.random.default_rng(0), spread=1.4)


def test_the_information_of_a_pose_is_that_of_the_corners_that_it_shows(poses: Array) -> None:
    model = built(LARGE)
    x = np.zeros(len(model.parameters))
    (jacobian,) = model.jacobian(poses, x, model.setup.vector)
    seen = np.isfinite(sc.simulate(model, {}, poses, sc.Noise(), np.random.default_rng(1)).z)
    assert 0 < (~seen).sum() < seen.size
    index = model.parameters.indices((*model.kinematic, *model.placement))
    wanted = np.where(seen[:, :, None], jacobian, 0.0)[:, :, index] * model.parameters.scales[index] / SIGMA
    information = wanted.swapaxes(1, 2) @ wanted
    rows = rows_of_all(model)
    ours = rows.full(poses)
    assert ours.shape[1] == rows.components == 15
    np.testing.assert_allclose(
        ours.swapaxes(1, 2) @ ours, information, rtol=1e-10, atol=1e-12 * np.abs(information).max()
    )
    weight = np.random.default_rng(2).normal(size=(len(index), len(index)))
    weight = weight @ weight.T
    traces = np.einsum("nij,ij->n", information, weight)
    np.testing.assert_allclose(rows.weighted(poses, weight), traces, rtol=1e-10)


def test_slopes_of_the_information_are_those_of_finite_differences(poses: Array) -> None:
    rows = rows_of_all(built(LARGE))
    n = rows.basis.shape[0]
    basis = np.linalg.qr(np.random.default_rng(3).normal(size=(n, n - 4)))[0]
    on, weight = rows.on(basis), np.diag(np.linspace(0.5, 2.0, n - 4))
    value, slope = on.weighted_gradient(poses, weight)
    np.testing.assert_allclose(value, on.weighted(poses, weight), rtol=1e-10)
    step = 1e-6
    sides = [[on.weighted(poses + s * step * e, weight) for s in (1, -1)] for e in np.eye(ROBOT.dof)]
    differences = np.stack([(up - down) / (2 * step) for up, down in sides], axis=1)
    smooth = np.abs(differences - slope).max(axis=1) < 1e-5 * np.abs(slope).max()
    assert smooth.sum() >= 10  # at the others a corner leaves the image within the step
    assert np.abs(slope).max() > 0


def test_a_board_and_a_tracker_add_up() -> None:
    (eye,) = eye_in_hand(board(SMALL)).observations
    smr = sc.Target("smr", sc.Place("flange"), {"P": (10.0, 20.0, 30.0)})
    tracker = sc.Observation(sc.Tracker(), "tracker", target=smr)
    model = build_model(ROBOT, sc.Task((eye, tracker)))
    rows = rows_of_all(model)
    q = postures(SMALL, 4, np.random.default_rng(4))
    assert rows.components == 12 + 3
    assert rows.written is not None
    weight = np.eye(rows.basis.shape[0])
    total = rows.weighted(q, weight)
    parts = rows.written.weighted(q, weight) + rows.staged[0].weighted(q, weight)
    np.testing.assert_allclose(total, parts)
    np.testing.assert_allclose(total, np.sum(rows.full(q) ** 2, axis=(1, 2)))
    assert (rows.weighted_gradient(q, weight)[1] != 0).any()


def test_poses_that_show_enough_of_a_board_are_feasible(poses: Array) -> None:
    """Those of which a simulation gives readings; the plan's own margins and depths on top."""
    rng = np.random.default_rng(5)
    tried = np.vstack([poses, rng.uniform(-2.2, 2.2, (300, ROBOT.dof))])
    for which in (LARGE, sc.parse_board("chessboard:11x8:30mm")):
        model = built(which)
        (constraint, *others) = within_limits(model)
        seen = np.isfinite(sc.simulate(model, {}, tried, sc.Noise(), rng).z).any(axis=1)
        np.testing.assert_array_equal(feasible((constraint, *others))(tried), seen)
        assert (len(others) == 0) == (which.kind == "charuco")
        assert complaints((constraint, *others), tried[~seen][:1])[0]
    model = built(LARGE)
    near, inside = feasible(within_limits(model, View(depth=(0.0, 450.0)))), feasible(within_limits(model, View(700.0)))
    loose = feasible(within_limits(model))(poses)
    assert near(poses).sum() < loose.sum()
    assert inside(poses).sum() < loose.sum()
    steep = feasible(within_limits(model, View(incidence=np.deg2rad(20.0))))
    assert steep(poses).sum() < loose.sum()


@pytest.fixture(scope="module")
def around() -> tuple[Model, WorkingArea, PoseInformation]:
    """Postures about one that looks at a small board."""
    model = built(SMALL)
    (middle,) = postures(SMALL, 1, np.random.default_rng(6), spread=0.1)
    area = WorkingArea(middle - 0.55, middle + 0.55)
    free, can = (*model.kinematic, *model.placement), feasible(within_limits(model))
    info = pose_information(model.measurement, model.setup, {"image": SIGMA}, free, area=area, feasible=can, poses=20)
    return model, area, info


@pytest.mark.long
def test_a_plan_beats_random_postures_as_it_foretold(around: tuple[Model, WorkingArea, PoseInformation]) -> None:
    """Errors of the camera's place over the region, after identifications of simulated data from both."""
    model, area, info = around
    rng, can = np.random.default_rng(7), feasible(within_limits(model))
    region = area_region(area, rng, feasible=can, count=200)
    plan = select_poses(
        info, 20, rng, method="exchange", region=region, aligned=True, feasible=can, sample=400, random=20
    )
    assert can(plan.poses).all()
    foretold = plan.prediction.mean_pose_rms_mm
    assert plan.random is not None
    random_foretold = plan.random.mean_pose_rms_mm
    assert foretold < 0.8 * random_foretold
    found: dict[str, list[float]] = {"plan": [], "random": []}
    for _ in range(8):
        truth = errors(rng, 0.5)
        where = {"plan": plan.poses, "random": draw(area, rng, 20, can)}
        for name, q in where.items():
            data = sc.simulate(model, truth, q, sc.Noise(image=SIGMA), rng)
            fit = calibrate(model, None, data, Options(sigma={"image": SIGMA}, scales="stated")).after
            true, _ = model.points(region.poses, model.parameters.vector(truth), model.setup.vector)
            ours, _ = model.points(region.poses, fit.x, fit.setup.vector)
            off = (ours - true).reshape(-1, 3)
            off = off - off.mean(axis=0)
            found[name].append(float(np.mean(np.sum(off**2, axis=1))))
    assert np.sqrt(np.mean(found["plan"])) < 0.9 * np.sqrt(np.mean(found["random"]))
