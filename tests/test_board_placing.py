"""Where camera and board stand, found from image points with the nominal robot: nobody types them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from boards import (
    CAMERA,
    LARGE,
    LYING,
    MOUNT,
    ROBOT,
    board,
    built,
    errors,
    eye_in_hand,
    flange_of,
    lying,
    measured,
    postures,
)
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import symcal as sc
from symcal.calibration.calibrate import calibrate
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.instruments import seen_by
from symcal.model.measurement import Setup
from symcal.model.model import Model, build_model
from symcal.placing.placement import placed
from symcal.spatial import inverse, look_at, transform

Array = NDArray[np.float64]


def off(found: Array, true: Array) -> tuple[float, float]:
    """mm and rad."""
    step = inverse(found) @ true
    return float(np.linalg.norm(step[:3, 3])), float(Rotation.from_matrix(step[:3, :3]).magnitude())


def near(setup: Setup, mm: float, rad: float) -> None:
    for name, true in (("eye", MOUNT), ("board", LYING)):
        if name in setup.places:
            shift, turn = off(setup.places[name], true)
            assert shift < mm, name
            assert turn < rad, name


@pytest.mark.parametrize(
    ("spread", "count", "sigma", "mm", "rad"),
    [(1.0, 30, 0.1, 0.3, 1e-3), (1.6, 12, 1.0, 1.0, 3e-3), (0.15, 20, 0.3, 25.0, 3e-2)],
    ids=["wide", "few, noisy and of a part", "narrow"],
)
def test_mount_and_board_are_found_where_neither_is_known(
    spread: float, count: int, sigma: float, mm: float, rad: float
) -> None:
    rng = np.random.default_rng(1)
    data = measured(LARGE, postures(LARGE, count, rng, spread), {}, sigma, rng)
    found = placed(built(LARGE, guess=False), data, Options())
    near(found.setup, mm, rad)
    assert not found.notes


def test_a_grid_of_tags_is_seen_from_its_own_printed_side() -> None:
    """Its z is out of the print, that of the other boards into it."""
    tags = sc.parse_board("aprilgrid:4x3:60mm:18mm")
    rng = np.random.default_rng(3)
    data = measured(tags, postures(tags, 20, rng), {}, 0.1, rng)
    found = placed(built(tags, guess=False), data, Options())
    for name, true in (("eye", MOUNT), ("board", lying(tags))):
        shift, turn = off(found.setup.places[name], true)
        assert shift < 0.5, name
        assert turn < 2e-3, name


def test_a_robot_that_is_off_is_no_obstacle() -> None:
    rng = np.random.default_rng(2)
    truth = errors(rng)
    data = measured(LARGE, postures(LARGE, 40, rng), truth, 0.1, rng)
    model = built(LARGE, guess=False)
    near(placed(model, data, Options()).setup, 15.0, 0.03)
    after = calibrate(model, None, data, Options(sigma={"image": 0.1})).after
    assert after.converged
    assert after.chi_squared == pytest.approx(after.dof, rel=5 * np.sqrt(2 / after.dof))


@pytest.mark.parametrize("known", ["eye", "board"])
def test_one_end_is_found_where_the_other_is_known(known: str) -> None:
    rng = np.random.default_rng(3)
    (o,) = eye_in_hand(board(), guess=False).observations
    o = (
        replace(o, at=sc.Place("flange", MOUNT))
        if known == "eye"
        else replace(o, target=replace(o.target, at=sc.Place("world", LYING)))
    )
    data = measured(LARGE, postures(LARGE, 2, rng), {}, 0.1, rng)  # two views do
    near(placed(build_model(ROBOT, sc.Task((o,))), data, Options(sigma={"image": 0.1})).setup, 0.5, 1e-3)


def in_hand(*, guess: bool) -> tuple[sc.Task, Array, dict[str, Array]]:
    """Two fixed cameras and a board on the flange; the first camera is the world, the base is unknown."""
    true = {
        "left": look_at(np.array([1200.0, -500.0, 500.0]), np.array([100.0, 0.0, 400.0])),
        "right": look_at(np.array([1200.0, 600.0, 700.0]), np.array([100.0, 0.0, 400.0])),
        "board": transform(np.diag([1.0, -1.0, -1.0]), np.array([-180.0, 130.0, 20.0])),
    }
    base = inverse(true["left"])
    target = sc.Target("board", sc.Place("flange", true["board"] if guess else None, True), board=LARGE)
    right = base @ true["right"]
    cameras = (
        sc.Observation(seen_by(CAMERA, calibrate=True), "left", at=sc.Place("world", np.eye(4)), target=target),
        sc.Observation(
            seen_by(CAMERA, calibrate=True),
            "right",
            at=sc.Place("world", right if guess else None, True),
            target=target,
        ),
    )
    return sc.Task(cameras, base=True), base, {"right": right, "board": true["board"]}


def looked_at(model: Model, rng: np.random.Generator, count: int) -> Dataset:
    """Random postures at which at least one camera sees the board; most see one alone."""
    kept: list[Dataset] = []
    while sum(len(k) for k in kept) < count:
        q = rng.uniform(-2.2, 2.2, (400, ROBOT.dof))
        data = sc.simulate(model, {}, q, sc.Noise(image=0.2), rng)
        kept.append(data.take(np.isfinite(data.z).any(axis=1)))
    q = np.vstack([k.q for k in kept])[:count]
    return sc.simulate(model, {}, q, sc.Noise(image=0.2), rng)


def test_two_fixed_cameras_and_the_board_in_the_hand_are_found() -> None:
    rng = np.random.default_rng(5)
    task, base, true = in_hand(guess=True)
    told = build_model(ROBOT, task)
    data = looked_at(replace(told, setup=replace(told.setup, base=base)), rng, 40)
    found = placed(build_model(ROBOT, in_hand(guess=False)[0]), data, Options())
    for frame, wanted in ((found.setup.base, base), *((found.setup.places[n], true[n]) for n in true)):
        shift, turn = off(frame, wanted)
        assert shift < 1.0
        assert turn < 1e-3


def test_views_that_disagree_are_named() -> None:
    rng = np.random.default_rng(6)
    data = measured(LARGE, postures(LARGE, 20, rng), errors(rng), 0.1, rng)
    q, odd = data.q.copy(), np.flatnonzero(np.isfinite(data.z).all(axis=1))[:2]
    q[odd] += 0.2  # readings of other poses
    found = placed(built(LARGE, guess=False), replace(data, q=q), Options())
    (note,) = found.notes
    assert "2 views of 'eye' disagree" in note
    assert f"{odd[0]}, {odd[1]}" in note or f"{odd[1]}, {odd[0]}" in note
    near(found.setup, 30.0, 0.05)


def test_too_few_views_are_refused() -> None:
    rng = np.random.default_rng(7)
    data = measured(LARGE, postures(LARGE, 2, rng), {}, 0.1, rng)
    with pytest.raises(RefusedError, match="3 are needed"):
        placed(built(LARGE, guess=False), data, Options())


def test_postures_look_at_the_board() -> None:
    """The helper of these tests does what it says."""
    q = postures(LARGE, 3, np.random.default_rng(8), 0.1)
    seen = inverse(flange_of(built(LARGE))(q) @ MOUNT) @ LYING
    middle = seen[:, :3, :3] @ LARGE.points.mean(axis=0) + seen[:, :3, 3]
    assert (np.hypot(middle[:, 0], middle[:, 1]) < 0.2 * middle[:, 2]).all()
