"""Joint terms that the data ask for: kept, named, summed, left out; against simulated truths and measured arms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from extension_draws import CASES, Case, arm, draw, models, true_values

from symcal.calibration.calibrate import baseline_model, calibrate
from symcal.calibration.candidates import candidates
from symcal.calibration.extend import calibrate_extended, with_directions
from symcal.calibration.identify import identify
from symcal.calibration.simulate import simulate
from symcal.data.conditions import directions_from_order
from symcal.errors import InputError
from symcal.fit.estimation import Options
from symcal.fit.groups import enough
from symcal.instruments.noise import Noise
from symcal.joints.backlash import Backlash
from symcal.joints.gravity import Gravity
from symcal.joints.harmonics import Harmonics
from symcal.model.model import build_model
from symcal.model.task import Task


@pytest.fixture(scope="module")
def elastic():
    return [draw(CASES["physics"], seed) for seed in range(3)]


def groups(found):
    return {group.name: group for group in found.calibration.extension.groups}


def test_waves_and_compliance_are_kept_and_named(elastic):
    for found in elastic:
        kept = groups(found)
        assert found.calibration.extension.kept == ("gravity", "harmonics 1")
        assert {1, 3} <= {joint.joint for joint in kept["harmonics 1"].joints if joint.named}
        assert {2, 3} <= {joint.joint for joint in kept["gravity"].joints if joint.named}


def test_amplitude_and_phase_are_those_of_the_truth(elastic):
    for found in elastic:
        for joint in groups(found)["harmonics 1"].joints:
            if joint.joint in (1, 3):
                amplitude, phase = true_values(found, joint.joint)
                assert abs(joint.amplitude - amplitude) < 4 * joint.amplitude_sigma
                turn = (joint.phase - phase + np.pi) % (2 * np.pi) - np.pi
                assert abs(turn) < 4 * joint.phase_sigma
                assert joint.amplitude > 5 * joint.amplitude_sigma


def test_the_error_to_the_truth_is_near_the_bound_of_the_true_model(elastic):
    ratio = np.sqrt(np.mean([d.squared_error for d in elastic]) / np.mean([d.bound for d in elastic]))
    assert ratio < 1.45  # 1.30 over a hundred draws


def test_the_first_harmonic_of_joint_2_is_one_with_the_moment_of_its_own_link(elastic):
    for found in elastic:
        assert [each.joint for each in found.calibration.extension.shared] == [2]
        (second,) = (joint for joint in groups(found)["harmonics 1"].joints if joint.joint == 2)
        assert second.summed
        assert not second.named


def test_on_a_wall_joint_1_is_summed_too():
    robot = replace(arm(), down=(1.0, 0.0, 0.0))
    model = build_model(robot, Task.of("position", ("base", "tool"), {"P": (0.0, 0.0, 0.0)}))
    true = build_model(replace(robot, terms=(Harmonics(1, True, k=(1,)),)), model.task)
    rng = np.random.default_rng(1)
    q = rng.uniform(-2.5, 2.5, (60, 6))
    data = simulate(true, {"q1_sin_1": 1e-3}, q, Noise("normal", 0.05), rng)
    found = calibrate_extended(model, baseline_model(model), data, Options(), ("gravity", "harmonics 1"))
    (first,) = (each for each in found.extension.shared if each.joint == 1)
    assert first.amplitude == pytest.approx(1e-3, abs=4 * first.amplitude_sigma)
    assert abs(first.phase) < 4 * first.phase_sigma


def test_without_any_term_the_robot_is_the_one_of_geometry_alone():
    found = draw(CASES["nothing"], 1)
    model, _ = models(CASES["nothing"])
    assert found.calibration.extension.kept == ()
    assert found.calibration.model is model
    assert not found.calibration.robot.terms


def test_a_wave_that_a_point_near_its_axis_does_not_show_is_unseen():
    robot = arm()
    tool = robot.tool.copy()
    tool[:3, 3] = [2.0, 0.0, 100.0]
    robot = replace(robot, tool=tool)
    model = build_model(robot, Task.of("position", ("base", "tool"), {"P": (0.0, 0.0, 0.0)}))
    true = build_model(replace(robot, terms=(Harmonics(6, True, k=(1,)),)), model.task)
    rng = np.random.default_rng(2)
    data = simulate(true, {"q6_sin_1": 0.2e-3}, rng.uniform(-2.5, 2.5, (100, 6)), Noise("normal", 0.05), rng)
    found = calibrate_extended(model, baseline_model(model), data, Options(), ("auto",))
    waves = next(group for group in found.extension.groups if group.name == "harmonics 1")
    assert [joint.joint for joint in waves.joints if joint.unseen] == [6]
    assert not waves.kept


def test_terms_of_the_robot_file_are_fitted_and_not_tried_again():
    model, true = models(Case(0.5e-3))
    own = build_model(replace(model.robot, terms=(Harmonics(1, True, k=(1,)), Harmonics(3, True, k=(1,)))), model.task)
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.4, 2.4, (80, 6))
    data = simulate(true, {"q1_sin_1": 5e-4, "q3_cos_1": 5e-4}, q, Noise("normal", 0.05), rng)
    found = calibrate(own, baseline_model(own), data, Options()).after
    errors = dict(zip(own.parameters.names, found.x, strict=True))
    sigmas = dict(zip(found.free, found.posterior.sigmas, strict=True))
    for name, value in (("q1_sin_1", 5e-4), ("q1_cos_1", 0.0), ("q3_sin_1", 0.0), ("q3_cos_1", 5e-4)):
        assert abs(errors[name] - value) < 4 * sigmas[name]
    assert {p.name for t in candidates(own.robot, ("auto",), ()) for p in t.parameters}.isdisjoint(
        own.robot.term_parameters
    )


def test_candidates_are_asked_for_by_name():
    robot = arm()
    with pytest.raises(InputError, match="no such group"):
        candidates(robot, ("waves",), ())
    with pytest.raises(InputError, match="q1_direction"):
        candidates(robot, ("backlash",), ())
    names = {t.kind for t in candidates(robot, ("gravity", "harmonics 3"), ())}
    assert names == {"gravity", "harmonics"}
    assert not any(isinstance(t, Gravity) and t.joint == 1 for t in candidates(robot, ("gravity",), ()))


def test_enough_is_the_two_percent_point_of_the_law_of_a_variance_that_is_zero():
    rng = np.random.default_rng(0)  # half of the draws gain nothing, the other half chi-squared of one
    gains = np.where(rng.random((200_000, 4)) < 0.5, 0.0, rng.normal(size=(200_000, 4)) ** 2)
    assert np.mean(gains.max(axis=1) > enough(4)) == pytest.approx(0.02, abs=0.002)


def test_backlash_takes_directions_from_the_order_where_no_column_says_them():
    model, _ = models(CASES["nothing"])
    true = build_model(replace(model.robot, terms=(Backlash(2, True), Backlash(4, True))), model.task)
    rng = np.random.default_rng(4)
    q = rng.uniform(-2.4, 2.4, (80, 6))
    empty = simulate(model, {}, q, Noise("normal", 0.05), rng)
    came = directions_from_order(empty, model.robot).conditions
    truth = {"q2_backlash": 4e-4, "q4_backlash": 4e-4}
    data = simulate(true, truth, q, Noise("normal", 0.05), rng, conditions=came)
    bare = replace(data, conditions={})
    assert with_directions(bare, model.robot, ("gravity",)) is bare
    found = identify(model.robot, bare, model.task, extend=("backlash",))
    (group,) = found.extension.groups
    assert group.kept
    assert {joint.joint for joint in group.joints if joint.named} == {2, 4}
    for joint in group.joints:
        if joint.named:
            assert abs(joint.values[0] - 4e-4) < 4 * joint.sigmas[0]


def test_too_few_poses_for_joint_terms_leave_geometry_and_say_so():
    model, _ = models(CASES["nothing"])
    rng = np.random.default_rng(5)
    data = simulate(model, {}, rng.uniform(-2.4, 2.4, (13, 6)), Noise("normal", 0.05), rng)
    found = identify(model.robot, data, model.task, extend="auto")
    tried = found.extension is not None
    assert tried != any("nothing beyond geometry was tried" in note for note in found.notes)
    assert not found.robot.terms
