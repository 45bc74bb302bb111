"""Whether the check of a model is right about what it lacks: against textbook formulas, and about what was planted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import model_check_draws as drawn
import numpy as np
import pytest
from cases import ARM, measure, random_errors
from numpy.typing import NDArray
from scipy import stats

from symcal.calibration.calibrate import calibrate
from symcal.calibration.lack_of_fit import postures
from symcal.calibration.model_check import Found, ModelCheck, foremost, lacks_physics, model_check
from symcal.calibration.model_words import model_check_facts, model_sentence, model_warnings
from symcal.calibration.patterns import joint_patterns, joint_rows
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.fit.pose_rows import Displacement, PoseRows, pose_rows
from symcal.fit.residual_rows import rows_of
from symcal.fit.score import score_of
from symcal.joints.harmonics import Harmonics
from symcal.model.model import build_model
from symcal.plots.model_check import residuals_by_joint
from symcal.report.model_check import model_check_text

Array = NDArray[np.float64]


# -------------------------------------------------------------------------------------------- the statistics themselves


def made(poses: int, rng: np.random.Generator, n: int = 6) -> tuple[PoseRows, Array]:
    """Rows of a position of every pose, and slopes by n parameters."""
    pose = np.repeat(np.arange(poses), 3)
    jacobian = rng.normal(size=(3 * poses, n))
    along = np.tile(np.eye(3), (poses, 1))
    rows = PoseRows(
        jacobian,
        rng.normal(size=3 * poses),
        pose,
        np.zeros_like(pose),
        (Displacement("position", ("x", "y", "z"), "mm", along),),
    )
    return rows, jacobian


def test_without_priors_it_is_the_f_test_of_added_variables() -> None:
    rng = np.random.default_rng(1)
    rows, jacobian = made(12, rng)
    column = rng.normal(size=(36, 2))
    score = score_of(rows, jacobian, np.zeros((0, 7)), rng.normal(size=(36, 6)))
    assert score is not None
    found = score.test(column)
    assert found is not None
    (rest,), (more,) = (
        np.linalg.lstsq(own, rows.r, rcond=None)[1] for own in (jacobian, np.hstack([jacobian, column]))
    )
    f = (rest - more) / 2 / (more / (36 - 8))
    assert found.p == pytest.approx(float(stats.f.sf(f, 2, 36 - 8)), rel=1e-9)
    wanted = np.linalg.lstsq(np.hstack([jacobian, column]), -rows.r, rcond=None)[0][-2:]
    np.testing.assert_allclose(found.coefficients, wanted, rtol=1e-9)


def test_with_priors_it_is_the_score_of_the_marginal_likelihood() -> None:
    """c^T V^-1 r over its standard deviation, V = I + J S J^T written out."""
    rng = np.random.default_rng(2)
    rows, jacobian = made(12, rng)
    sizes = rng.uniform(0.05, 2.0, 6)
    known = np.column_stack([np.diag(1 / sizes), np.zeros(6)])
    column = rng.normal(size=(36, 1))
    score = score_of(rows, jacobian, known, rng.normal(size=(36, 6)))
    assert score is not None
    found = score.test(column)
    assert found is not None
    scaled = score.scales
    covariance = np.eye(36) + (jacobian * scaled[:, None] * sizes**2) @ (jacobian * scaled[:, None]).T
    inverse = np.linalg.inv(covariance)
    r, c = rows.r * scaled, column[:, 0] * scaled
    statistic = (c @ inverse @ r) ** 2 / (c @ inverse @ c)
    share = statistic / (score.variance * score.dof)
    assert found.p == pytest.approx(float(stats.beta.sf(share, 0.5, (score.dof - 1) / 2)), rel=1e-9)
    assert score.dof == pytest.approx(float(np.trace(inverse)), rel=1e-9)


def test_the_correlation_of_neighbours_has_the_moments_of_residuals() -> None:
    """p of white noise is uniform although fitted parameters make residuals alike."""
    rng = np.random.default_rng(3)
    found = []
    for _ in range(150):
        rows, jacobian = made(20, rng, n=12)
        score = score_of(rows, jacobian, np.zeros((0, 13)), rng.normal(size=(60, 6)))
        assert score is not None
        told = score.neighbours(rows.displacements[0])
        assert told is not None
        found.append(told[1])
    assert stats.kstest(found, "uniform").pvalue > 0.005


# ------------------------------------------------------------------------------------------------- the columns of terms


def test_the_column_of_a_term_is_that_of_a_model_that_has_it() -> None:
    rng = np.random.default_rng(4)
    model = drawn.model_of(ARM, "position")
    data = measure(model, random_errors(model, rng), 10, rng, 0.05)
    x = rng.normal(size=len(model.parameters)) * 1e-3
    rows = rows_of(model.measurement, data, model.setup, model.residuals)
    own = pose_rows(rows, x, np.ones((10, 3)))
    joints = joint_rows(model.robot, model.parameters.names, own)
    patterns = {p.name: p for p in joint_patterns(model.robot, data, data, own, joints)}
    for joint, k in ((3, 1), (5, 4)):
        robot = replace(ARM, terms=(Harmonics(joint, True, k=(k,)),))
        richer = build_model(robot, model.task)
        values = model.parameters.mapping(x)
        _, jacobian = rows_of(richer.measurement, data, richer.setup)(richer.parameters.vector(values))
        index = [richer.parameters.index(f"q{joint}_{wave}_{k}") for wave in ("sin", "cos")]
        found = patterns[f"a wave of joint {joint}, {k} to a turn"].columns
        np.testing.assert_allclose(found, jacobian[:, :, index].reshape(30, 2), rtol=1e-9, atol=1e-9)


def test_terms_that_the_robot_has_are_not_tried() -> None:
    rng = np.random.default_rng(5)
    model = build_model(replace(ARM, terms=(Harmonics(3, True, k=(1,)),)), drawn.model_of(ARM, "position").task)
    errors = {n: e for n, e in random_errors(model, rng).items() if not n.startswith("q3")}
    data = measure(model, errors, 40, rng, 0.05)
    names = {test.name for test in model_check(calibrate(model, None, data, Options()), data, Options()).tests}
    assert "a wave of joint 3, 1 to a turn" not in names
    assert "a wave of joint 3, 2 to a turn" in names


# -------------------------------------------------------------------------------------------------------- lack of fit


def repeated(rng: np.random.Generator, sag: float) -> tuple[ModelCheck, Dataset]:
    """25 postures measured twice; joint 2 sags by so much beyond the model."""
    model = drawn.model_of(ARM, "position")
    data = measure(model, random_errors(model, rng), 25, rng).take(np.repeat(np.arange(25), 2))
    bent = data.z + sag * np.sin(3 * data.q[:, 1:2]) * [1.0, 0.0, 0.0]
    data = replace(data, z=bent + 0.05 * rng.normal(size=data.z.shape))
    return model_check(calibrate(model, None, data, Options()), data, Options()), data


def test_postures_measured_again_judge_the_fit() -> None:
    good, _ = repeated(np.random.default_rng(6), 0.0)
    bad, _ = repeated(np.random.default_rng(6), 0.5)
    for check in (good, bad):
        (own,) = check.lack
        assert own.against == "repeatability"
        assert own.repeated == 75
    assert good.lack[0].p is not None
    assert good.lack[0].p > 0.01
    assert bad.lacking
    assert not good.lacking
    assert model_warnings(bad)


def test_stated_noise_judges_the_fit_and_nothing_else_does() -> None:
    rng = np.random.default_rng(7)
    model = drawn.model_of(ARM, "position")
    data = measure(model, random_errors(model, rng), 40, rng, 0.05)
    stated = Options(sigma={"position": 0.025})
    (told,) = model_check(calibrate(model, None, data, stated), data, stated).lack
    assert told.against == "stated noise"
    assert told.ratio == pytest.approx(2.0, rel=0.2)
    assert told.p is not None
    assert told.p < 1e-10
    silent = model_check(calibrate(model, None, data, Options()), data, Options())
    assert silent.lack[0].against is None
    assert "not judged" in model_sentence(silent)
    assert not model_warnings(silent)


def test_postures_are_found_whatever_their_rounding() -> None:
    q = np.array([[0.0, 1.0], [0.5, 1.0], [1e-5, 1.0 - 1e-5], [0.5, 1.001]])
    assert postures(q).tolist() == [0, 1, 0, 2]


# ---------------------------------------------------------------------------------------------------------------- draws


@cache
def good() -> list[ModelCheck]:
    return drawn.draws("position", 60)


@pytest.mark.long
def test_good_data_have_uniform_probabilities() -> None:
    assert drawn.uniform(good()) > 1e-3
    assert sum(lacks_physics(check) for check in good()) <= 3


def test_halved_probabilities_would_be_noticed() -> None:
    """The witness can fail: halved p-values are not uniform."""
    halved = [replace(c, tests=tuple(replace(t, p=t.p / 2) for t in c.tests)) for c in good()]
    assert drawn.uniform(halved) < 1e-3


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("wave", "joint 3, once to a turn"),
        ("sag", "follow gravity at joint 2"),
        ("play", "the direction from which joint 4 came"),
        ("drift", "follow the order of the measurements"),
    ],
)
def test_what_was_planted_is_named(what: str, words: str) -> None:
    found = drawn.draws(what, 5, seed=1)
    right = [check for check in found if check.causes and check.causes[0].name == drawn.PLANTED[what]]
    assert len(right) >= 4
    assert words in model_sentence(right[0])
    assert lacks_physics(right[0])
    advice = {"play": "q4_direction", "drift": "reference posture"}.get(what, "extend: auto")
    assert advice in model_sentence(right[0])


@pytest.mark.parametrize("what", ["wave", "drift"])
def test_amplitudes_are_those_that_were_planted(what: str) -> None:
    size = {"wave": 0.5e-3, "drift": 0.2}[what]
    causes = [check.causes[0] for check in drawn.draws(what, 5, seed=1) if check.causes]
    sizes = [cause.amplitude for cause in causes]
    assert np.median([s for s in sizes if s is not None]) == pytest.approx(size, rel=0.3)


@pytest.mark.parametrize("case", ["one_pin", "three_planes", "two_cameras_board", "three_wires", "position, 15 poses"])
def test_every_kind_of_instrument_is_checked_without_a_false_word(case: str) -> None:
    for check in drawn.draws(case, 2, seed=3):
        facts = model_check_facts(check)
        assert "pattern" in facts["sentence"]
        assert not lacks_physics(check)
        assert check.tests


# ------------------------------------------------------------------------------------------------------- what is shown


def test_the_figure_and_the_report_say_what_was_found() -> None:
    check = drawn.planted("wave", np.random.default_rng(8))
    shown = residuals_by_joint(check, ARM)
    assert shown is not None
    assert len(shown.figure.axes) == 6
    assert "they follow joint 3" in shown.caption
    assert "of it, a fitted wave" in [text.get_text() for text in shown.figure.legends[0].get_texts()]
    text = model_check_text(model_check_facts(check))
    assert text is not None
    assert text["rows"][0][0] == "a wave of joint 3, 1 to a turn"
    assert "mrad" in text["rows"][0][1]
    assert model_check_text(None) is None


def test_the_figure_draws_residuals_along_the_joint() -> None:
    """The wave that was planted is in them, as large as its lever makes it."""
    check = drawn.planted("wave", np.random.default_rng(8))
    turn = check.q[:, 2]
    waves = np.column_stack([np.sin(turn), np.cos(turn), np.ones_like(turn)])
    rest = np.linalg.lstsq(waves, check.along[:, 2], rcond=None)[1]
    assert float(rest[0]) < 0.6 * float(np.sum((check.along[:, 2] - check.along[:, 2].mean()) ** 2))
    assert np.sqrt(np.mean(check.along**2)) == pytest.approx(0.1, rel=0.6)


@pytest.mark.parametrize("shift", [-1e-13, 0.0, 1e-13])
def test_one_and_the_same_column_is_told_by_its_cause_whatever_is_rounded(shift: float) -> None:
    found = [
        Found(kind, kind, 0.0, 0.0, weight=weight) for kind, weight in (("harmonic", 2.0), ("gravity", 2.0 + shift))
    ]
    assert foremost(found).kind == "gravity"
    more = replace(found[0], weight=2.001)
    assert foremost([more, found[1]]) is more


def test_postures_of_joints_that_never_repeat_are_told_without_a_tree() -> None:
    q = np.random.default_rng(2).uniform(-1, 1, (50, 3))
    assert np.array_equal(postures(q), np.arange(50))
    repeated = np.vstack([q, q[[3, 3, 7]] + 1e-6])
    same = postures(repeated)
    assert same[50] == same[51] == same[3]
    assert same[52] == same[7]
    assert len(set(same.tolist())) == 50
