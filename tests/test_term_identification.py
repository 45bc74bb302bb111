"""Joint terms of simulated arms are found, with errors as large as is said; what the data cannot tell is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import ARM
from term_law import RAD, SETS, identified, law, measured, model_of
from term_witness import SIZES, random_terms

from symcal.calibration.simulate import simulate
from symcal.data.conditions import directions_from_order
from symcal.instruments.noise import Noise
from symcal.joints import TERMS
from symcal.joints.arm import Mass
from symcal.joints.backlash import Backlash
from symcal.joints.compliance import Compliance
from symcal.joints.harmonics import Harmonics
from symcal.joints.payload import PayloadTerm
from symcal.model.model import build_model
from symcal.model.task import Task


def test_every_kind_is_among_those_identified():
    assert {term.kind for terms in SETS.values() for term in terms} == set(TERMS)


@pytest.mark.parametrize("name", SETS)
def test_errors_follow_the_law_of_their_covariance(name):
    ratio, tail = law(name, 15)
    assert tail > 1e-4, ratio


def test_a_term_that_is_left_out_is_missed():
    """So that the test above can fail: without waves the same measurements do not fit."""
    model, rng = model_of("waves and ratios"), np.random.default_rng(0)
    truth = {name: p.scale for name, p in model.robot.term_parameters.items()}
    q = rng.uniform(ARM.lower, ARM.upper, (50, 6))
    data = measured(model.robot, truth, q, rng)
    bare = build_model(replace(ARM, terms=()), Task.of("pose"))
    left = [identified(each, data).after for each in (model, bare)]
    assert left[0].chi_squared / left[0].dof < 1.3
    assert left[1].chi_squared / left[1].dof > 5


@pytest.mark.parametrize("seed", range(3))
def test_simulated_measurements_are_the_witness_s(seed):
    rng = np.random.default_rng(seed)
    robot = replace(ARM, terms=random_terms(rng, ARM, 0.3), masses=(Mass(3, 5.0, (100.0, 0.0, 0.0)),))
    model = build_model(robot, Task.of("pose"))
    truth = {p.name: float(0.1 * rng.normal() * SIZES[p.unit]) for p in model.parameters.items}
    q = rng.uniform(ARM.lower, ARM.upper, (4, 6))
    given = {n: rng.uniform(0, 5, 4) if n == "payload" else rng.choice([-1.0, 0, 1], 4) for n in robot.conditions}
    found = simulate(model, truth, q, Noise("normal", 0.0, 0.0), rng, conditions=given)
    wanted = measured(robot, truth, q, rng, given, noise=0.0)
    assert found.conditions == given
    np.testing.assert_allclose(found.z[:, :3], wanted.z[:, :3], atol=1e-8)
    turns = np.abs(np.sum(found.z[:, 3:] * wanted.z[:, 3:], axis=1))  # quaternions of either sign
    np.testing.assert_allclose(turns, 1.0, atol=1e-12)


def test_what_is_identified_predicts_with_the_terms_in_it():
    """The calibrated robot carries the terms' numbers: at zero errors it stands where it was measured."""
    model, rng = model_of("compliance, backlash and payload"), np.random.default_rng(5)
    truth = {name: 0.8 * p.scale for name, p in model.robot.term_parameters.items()}
    q = rng.uniform(ARM.lower, ARM.upper, (60, 6))
    given = {
        n: 5.0 * rng.integers(0, 2, 60) if n == "payload" else rng.choice([-1.0, 1], 60) for n in model.robot.conditions
    }
    data = measured(model.robot, truth, q, rng, given, noise=0.01)
    robot = identified(model, data, sigma=False).robot
    exact = measured(robot, {}, q, rng, given, noise=0.0)
    assert np.abs(exact.z[:, :3] - data.z[:, :3]).max() < 0.01
    for name, value in truth.items():
        assert robot.parameters[name] == pytest.approx(value, rel=0.05)


# ------------------------------------------------------------------------------------------- what cannot be told apart


def shared(payloads: bool) -> tuple[object, float]:
    """A joint whose own link's weight bends it as a wave of its reading would: fit, and correlation of the two."""
    robot = replace(
        ARM,
        terms=(Harmonics(2, True, k=(1,)), Compliance(2, True)),
        masses=(Mass(2, 25.0, (-250.0, 0.0, 0.0)),),
    )
    model, rng = build_model(robot, Task.of("pose")), np.random.default_rng(3)
    truth = {"q2_cos_1": 4e-4, "q2_sin_1": -3e-4, "q2_compliance": 3e-8}
    q = rng.uniform(ARM.lower, ARM.upper, (60, 6))
    given = {"payload": 8.0 * rng.integers(0, 2, 60)} if payloads else {}
    found = identified(model, measured(robot, truth, q, rng, given)).after
    names = list(found.posterior.names)
    pair = [names.index(n) for n in ("q2_cos_1", "q2_compliance")]
    correlation = float(found.posterior.correlation()[pair[0], pair[1]])
    if payloads:
        for name, value in truth.items():
            k = names.index(name)
            assert abs(model.parameters.mapping(found.x)[name] - value) < 4 * found.posterior.sigmas[k]
            assert found.posterior.sigmas[k] < 0.2 * abs(value)
    return found, correlation


def test_a_second_payload_tells_the_weight_of_a_link_from_a_wave():
    with_two, apart = shared(True)
    assert abs(apart) < 0.9
    assert not any("q2_compliance" in d.text for d in with_two.identifiability.unseen())
    alone, together = shared(False)
    assert abs(together) > 0.95
    texts = [d.text for d in alone.identifiability.unseen() if "q2_compliance" in d.text]
    assert len(texts) == 1
    assert "q2_cos_1" in texts[0]
    assert "µrad/(N m) of q2_compliance" in texts[0]


def test_without_their_conditions_backlash_and_payload_keep_their_size():
    robot = replace(ARM, terms=(Backlash(2, True), PayloadTerm(3, True)))
    model, rng = build_model(robot, Task.of("pose")), np.random.default_rng(4)
    q = rng.uniform(ARM.lower, ARM.upper, (40, 6))
    found = identified(model, measured(robot, {}, q, rng)).after
    texts = {d.text for d in found.identifiability.unseen()}
    assert {"q2_backlash cannot be seen", "q3_payload cannot be seen"} <= texts
    learnt = dict(zip(found.posterior.names, found.posterior.learnt, strict=True))
    assert learnt["q2_backlash"] == pytest.approx(0, abs=1e-6)


def test_backlash_is_found_from_the_order_of_the_poses():
    robot = replace(ARM, terms=tuple(Backlash(j, True) for j in range(1, 7)))
    model, rng = build_model(robot, Task.of("pose")), np.random.default_rng(6)
    q = rng.uniform(ARM.lower, ARM.upper, (60, 6))
    change = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    truth = {f"q{j}_backlash": 2e-4 * j for j in range(1, 7)}
    given = {f"q{j}_direction": change[:, j - 1] for j in range(1, 7)}
    said = measured(robot, truth, q, rng, given)
    data = directions_from_order(replace(said, conditions={}), robot)
    found = identified(model, data).after
    for name, value in truth.items():
        k = found.posterior.names.index(name)
        assert abs(model.parameters.mapping(found.x)[name] - value) < 4 * found.posterior.sigmas[k]
        assert found.posterior.sigmas[k] < 3 * RAD


def test_small_numbers_are_known_no_better_than_the_data_tell():
    """One payload number, a fifth of its size and half of what the data tell: seen as nothing, it is not known."""
    robot = replace(ARM, terms=(PayloadTerm(5, True),))
    model = build_model(robot, Task.of("pose"))
    worst = 0.0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        q = rng.uniform(ARM.lower, ARM.upper, (50, 6))
        data = measured(robot, {"q5_payload": 1.5e-5}, q, rng, {"payload": 5.0 * rng.integers(0, 2, 50)})
        found = identified(model, data).after
        k = found.posterior.names.index("q5_payload")
        worst = max(worst, abs(model.parameters.mapping(found.x)["q5_payload"] - 1.5e-5) / found.posterior.sigmas[k])
    assert worst < 5
