"""Every peer against the package on random arms: two forward kinematics that share no line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import generators, random_robot

from symcal.bench.arms import handling_robot, random_errors, random_postures, revolute_arm
from symcal.bench.case import Case, case_of, identifiable
from symcal.bench.peers import casadi_map, numpy_batch, numpy_loop, pinocchio_arm
from symcal.bench.peers.elements import elements
from symcal.bench.positions import EXACT, difference
from symcal.errors import RefusedError
from symcal.joints.harmonics import Harmonics
from symcal.robot.files import load_robot

POINT = (40.0, -20.0, 60.0)


def drawn(case: Case, rng: np.random.Generator, count: int = 5) -> tuple[np.ndarray, np.ndarray]:
    return random_postures(case.robot, count, rng), random_errors(case.names, rng)


def by_package(case: Case, q: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Through CasADi's virtual machine, one posture after the other."""
    p, slopes = zip(*(case.function(own, x, case.setup) for own in q), strict=True)
    return np.array(p)[..., 0], np.array([np.array(each) for each in slopes])


@settings(max_examples=20)
@given(generators)
def test_numpy_and_pinocchio_agree_on_any_arm(rng: np.random.Generator) -> None:
    """Both conventions, both kinds of joints, any parameters, signs, ratios, offsets, base and tool."""
    case = case_of(random_robot(rng), POINT)
    q, x = drawn(case, rng)
    wanted = by_package(case, q, x)
    assert difference(wanted, numpy_batch.positions_and_slopes(case.arm, q, x)) < EXACT
    assert difference(wanted, pinocchio_arm.positions_and_slopes(case.arm)(q, x)) < EXACT
    np.testing.assert_allclose(numpy_batch.positions(case.arm, q, x), wanted[0], atol=1e-9)


@settings(max_examples=8)
@given(generators)
def test_one_posture_after_the_other_agrees_to_its_step(rng: np.random.Generator) -> None:
    case = case_of(random_robot(rng, dof=3), POINT)
    q, x = drawn(case, rng, 2)
    p, slopes = numpy_loop.position_and_slopes(case.arm, q, x)
    wanted = by_package(case, q, x)
    np.testing.assert_allclose(p, wanted[0], atol=1e-9)
    assert difference(wanted, (p, slopes)) < 1e-5


def test_jax_agrees() -> None:
    pytest.importorskip("jax")
    from symcal.bench.peers import jax_arm

    rng = np.random.default_rng(7)
    case = case_of(random_robot(rng, dof=5), POINT)
    q, x = drawn(case, rng)
    p, slopes = jax_arm.positions_and_slopes(case.arm)(q, x)
    assert difference(by_package(case, q, x), (np.asarray(p), np.asarray(slopes))) < EXACT


@pytest.mark.parametrize("generate", [False, True])
def test_the_map_of_casadi_fills_the_same_arrays_again(handling: Case, generate: bool) -> None:
    rng = np.random.default_rng(8)
    (q, x), again = drawn(handling, rng, 33), random_postures(handling.robot, 33, rng)
    with casadi_map.compiled(handling.function) as generated:
        if generate and generated is None:
            pytest.skip("no C compiler on this machine")
        call = casadi_map.mapped(generated if generate else handling.function, (q,), (x, handling.setup))
        p, slopes = call()
        assert difference(by_package(handling, q, x), (p, slopes.swapaxes(1, 2))) < EXACT
        q[:] = again
        call()
    assert difference(by_package(handling, again, x), (p, slopes.swapaxes(1, 2))) < EXACT


def test_arms_with_joint_terms_and_other_parameters_are_refused() -> None:
    robot = handling_robot()
    bent = replace(robot, terms=(Harmonics(1, (1,), {"sin_1": 0.01, "cos_1": 0.0}),))
    with pytest.raises(RefusedError, match="joint terms"):
        elements(bent, ())
    with pytest.raises(RefusedError, match="not of base_x"):
        elements(robot, ("theta_1", "base_x"))


def test_the_handling_robot_is_that_of_the_configs(configs) -> None:
    ours, file = handling_robot(), load_robot(configs / "robots" / "handling_robot.yaml")
    assert ours.convention == file.convention
    np.testing.assert_allclose(ours.lower, file.lower)
    np.testing.assert_allclose(ours.upper, file.upper)
    assert ours.link_parameters.keys() == file.link_parameters.keys()
    assert ours.link_parameters == pytest.approx(file.link_parameters)


@given(st.integers(1, 12), st.integers(0, 48))
def test_an_arm_has_as_many_parameters_as_asked_for(joints: int, count: int) -> None:
    assert len(revolute_arm(joints).link_parameters) == 4 * joints
    assert len(revolute_arm(joints, min(count, 4 * joints)).link_parameters) == min(count, 4 * joints)


def test_eleven_of_fifteen_are_identifiable(handling: Case) -> None:
    """Their columns have full rank, by singular values, and a twelfth adds none; as [Ding2017]'s arm was measured."""
    rng = np.random.default_rng(9)
    free = identifiable(handling, rng)
    assert len(free) == 11
    q = random_postures(handling.robot, 60, rng)
    _, slopes = numpy_batch.positions_and_slopes(handling.arm, q, np.zeros(15))
    wide = slopes.reshape(-1, 15) * handling.model.parameters.scales
    own = [handling.names.index(name) for name in free]
    assert np.linalg.matrix_rank(wide[:, own], rtol=1e-8) == 11
    assert np.linalg.matrix_rank(wide, rtol=1e-8) == 11
