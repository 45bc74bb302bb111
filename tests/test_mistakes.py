"""A gross mistake is named, or the class of those that the data cannot tell; good sets raise no alarm.

Mistakes are planted by code of its own (planted_mistakes.py); which of them are the same to a set is found by the
search on exact measurements of the nominal robot at the same poses.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases import ARM, measure, random_errors
from measured_arms import arm
from mistake_draws import accused, good, measured
from planted_mistakes import Planted, planted, relocated
from scipy.spatial.transform import Rotation
from strategies import random_frame

from symcal.calibration.calibrate import Calibration, calibrate
from symcal.calibration.claims import optimism
from symcal.calibration.evaluate import evaluate
from symcal.calibration.held_out_outliers import held_out_outliers
from symcal.calibration.mistakes.hypotheses import joint_hypotheses
from symcal.calibration.mistakes.moved import moved_between
from symcal.calibration.mistakes.rotation_fit import Channel, form, least, least_left, left, sums
from symcal.calibration.mistakes.scene import AS_GIVEN, joints_tried, readings_tried, scene_of
from symcal.calibration.mistakes.search import find_mistakes
from symcal.data.dataset import Dataset
from symcal.data.measurement_file import load_measurements
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Options
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.placing.placement import placed_by

BOTH = frozenset({"base", "tool"})
DATA = os.environ.get("SYMCAL_DATA")
SETS = {"fr3": "franka_fr3", "positioner": "two_axis_positioner"}


@cache
def scene(name: str) -> tuple[Model, Dataset, str]:
    """A good set: model, data, and whether it is of positions or poses."""
    if name in SETS:
        if DATA is None:
            pytest.skip("SYMCAL_DATA does not say where the measured sets are")
        from symcal.runs.data import measurements
        from symcal.runs.load import load

        path = Path(__file__).resolve().parent.parent / "configs" / "real" / f"{SETS[name]}.yaml"
        e = load(path)
        rng = np.random.default_rng(1)
        data = measurements(e.file, e.document, e.model, rng, data=None, planned=None, progress=lambda _: None).data
        return e.model, data.take(np.arange(60)), "pose"
    model = build_model(arm("puma", "craig"), Task.of("position", BOTH))
    rng = np.random.default_rng(3)
    q = rng.uniform(model.robot.lower, model.robot.upper, (40, 6))
    return model, measured(model, q, 5.0, 0.1, rng), "position"


def kinds(name: str) -> list[Planted]:
    model, data, kind = scene(name)
    every = planted(model.robot, kind)
    return [
        *(every if len(every) < 30 else every[:: 2 if len(every) > 50 else 1]),
        Planted("moved", "from pose", relocated(len(data) // 3)),
    ]


def same(model: Model, data: Dataset) -> tuple[bool, set[str]]:
    """Whether exact data are explained as they are, and the mistakes whose undoing explains them."""
    found = scene_of(model, data)
    assert found is not None
    tried = joints_tried(found, (AS_GIVEN, *joint_hypotheses(model.robot)))
    read = readings_tried(found, 0, found.sights[0].hypotheses)
    undone = {h.text for h, s in zip(tried.hypotheses, tried.score, strict=True) if s < 1e-4}
    undone |= {h.text for h, s in zip(read.hypotheses, read.score, strict=True) if s < 1e-4}
    return "" in undone, undone - {""}


@pytest.mark.parametrize("name", ["fr3", "positioner", "puma"])
def test_planted_mistakes_are_named_or_unseen(name: str) -> None:
    model, data, _ = scene(name)
    assert find_mistakes(model, data) == ()
    exact = measured(model, data.q, 0.0, 0.0, np.random.default_rng(2))
    counts = {"named": 0, "unseen": 0}
    every = kinds(name)
    assert len(every) >= 25
    for each in every:
        unseen, undone = same(model, each.plant(exact))
        found = find_mistakes(model, each.plant(data))
        if unseen and not (found and each.kind == "unit"):  # a size may be told by the arm's length all the same
            counts["unseen"] += 1
            assert found == (), each
            continue
        counts["named"] += 1
        assert found, each
        named = {text for mistake in found for text in mistake.hypotheses}
        assert any(each.told in text for text in named), (each.told, named)
        if each.kind not in ("moved", "unit"):
            assert undone <= named
    assert counts["named"] >= 16


def test_the_least_of_the_form_is_that_of_a_plain_fit() -> None:
    """Against SciPy: rotation, shift and point of least squares, from 12 starts."""
    from scipy.optimize import least_squares

    rng = np.random.default_rng(4)
    rotation, position = Rotation.random(12, rng=rng).as_matrix(), rng.normal(size=(12, 3)) * 300
    read = rng.normal(size=(12, 3)) * 300
    seen = np.arange(12) != 5
    _, cost = least(form([(sums(rotation, position, Channel(read, seen, True)).sum(axis=0), True)]))

    def residual(v: np.ndarray) -> np.ndarray:
        base = Rotation.from_rotvec(v[:3])
        point = position + rotation @ (100 * v[6:])
        return np.asarray(((base.apply(point) + 100 * v[3:6]) - read)[seen].ravel())

    best = min(2 * least_squares(residual, rng.normal(size=9)).cost for _ in range(12))
    assert float(cost) == pytest.approx(best, rel=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_good_sets_are_not_accused(seed: int) -> None:
    assert accused(good(seed + 300), whole=seed < 3) == []


# --------------------------------------------------------------------------------------------- in an identification


@cache
def model_of(kind: str) -> Model:
    return build_model(ARM, Task.of(kind, BOTH, {"P": (30.0, 20.0, 80.0)}))  # type: ignore[arg-type]


@cache
def clean(kind: str, poses: int = 60) -> Dataset:
    rng = np.random.default_rng(1)
    model = model_of(kind)
    moved = replace(model, setup=replace(model.setup, base=random_frame(rng, 2000.0)))
    return measure(moved, random_errors(model, rng), poses, rng, 0.05, 1e-4)


def identified(kind: str, data: Dataset, **options: object) -> Calibration:
    return calibrate(model_of(kind), None, data, Options(**options))  # type: ignore[arg-type]


def test_conjugate_quaternions_are_named_and_judged_by_their_turn() -> None:
    data = clean("pose")
    z = data.z.copy()
    z[:, 3:6] *= -1
    with pytest.raises(RefusedError, match="inverse \\(conjugate quaternions\\)"):
        identified("pose", replace(data, z=z))


def test_a_flipped_joint_is_named_first_of_all() -> None:
    data = clean("position")
    found = identified("position", replace(data, q=data.q * [1, 1, -1, 1, 1, 1]))
    assert "joint 3 counts the other way round" in found.notes[0]
    assert found.mistakes[0].text == found.notes[0]


@pytest.mark.parametrize("size", [500.0, 5000.0])
def test_one_gross_slip_is_named_alone(size: float) -> None:
    """With the noise stated the linear fit is dragged by it until every pose is off."""
    data = clean("position", 40)
    z = data.z.copy()
    z[7] += size * np.array([0.6, 0.64, 0.48])
    spoilt = replace(data, z=z)
    if size > 1000.0:
        with pytest.raises(RefusedError, match=r"1 pose \(7\) spoils the identification"):
            identified("position", spoilt, sigma={"position": 0.05})
        return
    found = identified("position", spoilt, sigma={"position": 0.05})
    assert {each.pose for each in found.outliers} == {"7"}
    assert not any("20 times" in note or "times the stated noise" in note for note in found.notes)


def halves(data: Dataset) -> Dataset:
    return replace(data, split=("train",) * (len(data) // 2) + ("test",) * (len(data) - len(data) // 2))


def test_a_slip_in_a_test_pose_is_listed_and_no_reason_for_more_poses() -> None:
    data = halves(clean("position"))
    z = data.z.copy()
    z[41] += [30.0, 32.0, 24.0]
    data = replace(data, z=z)
    found = identified("position", data)
    (slip,) = held_out_outliers(found, data.part("test"))
    assert (slip.pose, slip.split) == ("41", "test")
    assert slip.off == pytest.approx(50.0, abs=1.0)
    errors = {part: {n: evaluate(s, data.part(part)) for n, s in found.states.items()} for part in ("train", "test")}
    said = "; ".join(optimism(errors))
    assert "made by 1 pose alone" in said
    assert "more poses would help" not in said
    assert held_out_outliers(found, halves(clean("position")).part("test")) == ()


@pytest.mark.parametrize(("kind", "end"), [("position", "base"), ("pose", "base"), ("pose", "tool")])
def test_a_moved_instrument_or_target_is_told_between_sets(kind: str, end: str) -> None:
    data = halves(clean(kind))
    found = identified(kind, data)
    test = data.part("test")
    assert moved_between(found.states["after"], test) == ()
    turn, shift = Rotation.from_rotvec([0.3, -0.2, 0.5]), np.array([100.0, -50.0, 20.0])
    z = test.z.copy()
    if end == "base":
        z[:, :3] = turn.apply(z[:, :3]) + shift
        if kind == "pose":
            z[:, 3:] = (turn * Rotation.from_quat(z[:, 3:])).as_quat()
    else:
        own = Rotation.from_quat(z[:, 3:])
        z[:, :3] += own.apply(shift)
        z[:, 3:] = (own * turn).as_quat()
    (mistake,) = moved_between(found.states["after"], replace(test, z=z))
    assert f"--refit {end}" in mistake.text
    assert len(mistake.hypotheses) == 1
    assert mistake.after < 0.2 < 20.0 < mistake.before


def test_a_point_that_no_training_pose_shows_is_placed_by_the_others() -> None:
    task = Task.of("position", frozenset({"base", "points"}), {"A": (30.0, 20.0, 80.0), "B": (-40.0, 10.0, 60.0)})
    model = build_model(ARM, task)
    rng = np.random.default_rng(5)
    data = halves(measure(model, {}, 40, rng, 0.05))
    z = data.z.copy()
    z[:20, 3:] = np.nan
    data = replace(data, z=z)
    assert "tool_B_x" not in placed_by(model, data.part("train"))
    blind = build_model(
        ARM, Task.of("position", frozenset({"base", "points"}), {"A": (30.0, 20.0, 80.0), "B": (0.0, 0.0, 0.0)})
    )
    found = calibrate(blind, None, data, Options())
    assert any("no training pose tells where tool_B is" in note for note in found.notes)
    assert evaluate(found.states["after"], data.part("test")).statistics.rms < 1.0


def test_a_joint_column_too_many_is_refused(tmp_path: Path) -> None:
    head = ",".join([*(f"q{i}_deg" for i in range(1, 8)), "x_mm", "y_mm", "z_mm"])
    path = tmp_path / "data.csv"
    rows = np.random.default_rng(1).uniform(-90, 90, (5, 10))
    np.savetxt(path, rows, delimiter=",", header=head, comments="")
    with pytest.raises(InputError, match="6 joints, and this is a column of another one") as error:
        load_measurements(path, ARM, "position")
    assert error.value.column == "q7_deg"
    rows[:, 6] = 3.0
    np.savetxt(path, rows, delimiter=",", header=head, comments="")
    assert any("q7_deg" in note for note in load_measurements(path, ARM, "position").notes)


@pytest.mark.parametrize("name", ["puma", "fr3"])
def test_what_cannot_explain_the_data_is_not_fitted(name: str) -> None:
    """A limit on the score leaves all scores below it as they are, and its short cut is never above what rotations
    leave, whichever are tried."""
    model, data, _ = scene(name)
    found = scene_of(model, data)
    assert found is not None
    hypotheses = joint_hypotheses(model.robot)
    every = joints_tried(found, hypotheses)
    for above in np.quantile(every.score, [0.1, 0.5]):
        cut = joints_tried(found, hypotheses, above=float(above))
        below = every.score < above
        np.testing.assert_allclose(cut.score[below], every.score[below], rtol=1e-9)
        np.testing.assert_allclose(cut.rms[below], every.rms[below], rtol=1e-9)
        assert (cut.score[~below] >= above).all()
        assert np.isinf(cut.score).any()
    (sight, *_), z, at = found.sights, found.z[0], np.ones((1, len(found.q)), dtype=bool)
    quadratic = form(
        [(of.sum(axis=-2), located) for of, located in sight.sums(sight.chain(found.q[None]), z[None], at)]
    )
    turns = Rotation.random(500, rng=1).as_matrix()
    assert float(least_left(quadratic)[0]) <= left(quadratic, turns).min()
    assert float(least_left(quadratic)[0]) <= float(least(quadratic)[1][0])
