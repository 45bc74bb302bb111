"""The genetic algorithm: properties that hold for every fitness, and known optima."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symcal.errors import InputError
from symcal.planning.genetic import decode, encode, genetic

LOWER = np.array([-2.0, 850.0, 0.0])
UPPER = np.array([3.0, 1350.0, 700.0])
CODINGS = ("binary", "gray", "real")


def bowl(plans):
    """Zero where all poses are a third of the way between the limits."""
    return (((plans - LOWER) / (UPPER - LOWER) - 1 / 3) ** 2).sum(axis=(1, 2))


def run(coding="binary", seed=1, **options):
    arguments = {"population": 40, "generations": 30} | options
    return genetic(bowl, LOWER, UPPER, 4, np.random.default_rng(seed), coding=coding, **arguments)


@given(st.integers(1, 12), st.booleans())
def test_codes_reach_both_limits_and_every_step_between(count, gray):
    k = np.arange(2**count, dtype=np.min_scalar_type(2**count - 1))
    values = decode(np.repeat(k[:, None], 3, axis=1), LOWER, UPPER, count, gray=gray)
    assert values.min(axis=0).tolist() == LOWER.tolist()
    assert values.max(axis=0).tolist() == UPPER.tolist()
    steps = np.diff(np.sort(values, axis=0), axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to((UPPER - LOWER) / (2**count - 1), steps.shape), rtol=1e-9)


@given(st.integers(1, 12), st.booleans(), st.integers(0, 2**32 - 1))
def test_encoding_rounds_to_the_nearest_value(count, gray, seed):
    values = LOWER + (UPPER - LOWER) * np.random.default_rng(seed).random((5, 3))
    back = decode(encode(values, LOWER, UPPER, count, gray=gray), LOWER, UPPER, count, gray=gray)
    assert np.all(np.abs(back - values) <= 0.5 * (UPPER - LOWER) / (2**count - 1) + 1e-9)


def test_neighbours_in_gray_code_differ_in_one_bit():
    values = (LOWER + (UPPER - LOWER) * (np.arange(32) / 31)[:, None]).reshape(32, 3)
    codes = encode(values, LOWER, UPPER, 5, gray=True)
    assert np.all(np.bitwise_count(codes[1:] ^ codes[:-1]) == 1)


@pytest.mark.parametrize("coding", CODINGS)
def test_same_seed_same_plan_and_another_seed_another(coding):
    first, again, other = run(coding), run(coding), run(coding, seed=2)
    assert np.array_equal(first.poses, again.poses)
    assert np.array_equal(first.history, again.history)
    assert not np.array_equal(first.poses, other.poses)


def test_global_random_state_is_neither_used_nor_changed():
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    run()
    assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002


@pytest.mark.parametrize("coding", CODINGS)
def test_best_never_gets_worse_and_is_what_is_returned(coding):
    told = []
    result = run(coding, callback=lambda generation, best, poses: told.append((generation, best, bowl(poses[None])[0])))
    assert result.history.shape == (31,)
    assert np.all(np.diff(result.history) <= 0)
    assert result.fitness == result.history[-1] == pytest.approx(float(bowl(result.poses[None])[0]), abs=1e-15)
    assert [entry[:2] for entry in told] == list(enumerate(result.history))
    np.testing.assert_allclose([entry[2] for entry in told], result.history, atol=1e-15)
    assert np.all((result.poses >= LOWER) & (result.poses <= UPPER))
    assert result.violation == 0
    assert result.evaluations == 40 * 31


@pytest.mark.parametrize("coding", CODINGS)
def test_finds_the_bottom_of_a_bowl(coding):
    result = run(coding, generations=150)
    expected = 4 * 3 * (1 / 12 + (1 / 2 - 1 / 3) ** 2)  # of a random plan: variance and bias of twelve uniform shares
    assert result.fitness < 0.02 * expected


@pytest.mark.parametrize("coding", CODINGS)
def test_better_than_as_many_random_plans(coding):
    result = run(coding)
    random = LOWER + (UPPER - LOWER) * np.random.default_rng(7).random((result.evaluations, 4, 3))
    assert result.fitness < 0.5 * bowl(random).min()


@pytest.mark.parametrize("bits", [1, 5, 8, 12, 52])
def test_bits_of_children_come_from_their_parents_half_from_each(bits):
    from symcal.planning.columns_ga import BitCrossover

    rng = np.random.default_rng(0)
    kind = np.min_scalar_type(2**bits - 1)
    parents = rng.integers(0, 2**bits - 1, size=(2, 300, 40), dtype=kind, endpoint=True)
    children = BitCrossover(bits)._do(None, parents, random_state=rng)
    assert children.dtype == kind
    assert children.max() <= 2**bits - 1
    # bit by bit the two children hold what the two parents held
    assert np.array_equal(children[0] ^ children[1], parents[0] ^ parents[1])
    assert np.array_equal(children[0] & children[1], parents[0] & parents[1])
    different = np.bitwise_count(parents[0] ^ parents[1]).sum()
    exchanged = np.bitwise_count(children[0] ^ parents[0]).sum()
    assert abs(exchanged - different / 2) < 5 * np.sqrt(different) / 2


@pytest.mark.parametrize("bits", [1, 5, 8, 12, 52])
def test_one_bit_of_a_plan_flips_on_average_and_every_place_is_as_likely(bits):
    from symcal.planning.columns_ga import BitFlips

    rng = np.random.default_rng(0)
    plans, genes = 4000, 6
    before = np.zeros((plans, genes), dtype=np.min_scalar_type(2**bits - 1))
    flipped = BitFlips(bits)._do(None, before, random_state=rng)
    assert flipped.dtype == before.dtype
    assert flipped.max() <= 2**bits - 1
    share = min(0.5, 1.0 / (bits * genes))
    for bit in range(bits):
        count = int(((flipped >> flipped.dtype.type(bit)) & flipped.dtype.type(1)).sum())
        assert abs(count - plans * genes * share) < 6 * np.sqrt(plans * genes * share)


def test_starts_from_given_plans():
    best = np.broadcast_to(LOWER + (UPPER - LOWER) / 3, (1, 4, 3))
    result = run("real", generations=0, start=best)
    assert result.fitness == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize("coding", CODINGS)
def test_feasible_plans_win_over_better_ones(coding):
    def violation(plans):  # the bottom of the bowl is forbidden
        return np.maximum(1000.0 - plans[:, :, 1], 0.0).sum(axis=1) / 100

    result = run(coding, generations=100, violation=violation)
    assert result.violation == 0
    assert np.all(result.poses[:, 1] >= 1000.0)
    assert np.all(np.diff(result.violations) <= 0)


@pytest.mark.parametrize("coding", CODINGS)
def test_exchanging_poses_makes_no_new_ones_without_mutation(coding):
    values = decode(np.random.default_rng(0).integers(256, size=(40, 4, 3), dtype=np.uint8), LOWER, UPPER, 8)

    def violation(plans):  # any pose that is not one of the start's is infeasible
        poses = plans.reshape(-1, 1, 3)
        known = np.abs(poses - values.reshape(1, -1, 3)).max(axis=2).min(axis=1) < 1e-9
        return (~known).reshape(plans.shape[:2]).sum(axis=1).astype(float)

    result = run(coding, start=values, mixing="pose", violation=violation)
    assert result.violation == 0
    assert result.fitness < result.history[0]
    # by gene, hardly any child is made of known poses
    assert run(coding, start=values, violation=violation).fitness > result.fitness


def test_plans_without_a_value_lose():
    def broken(plans):
        return np.where(plans[:, 0, 0] > 0, np.nan, bowl(plans))

    result = genetic(broken, LOWER, UPPER, 2, np.random.default_rng(0), population=20, generations=10)
    assert result.poses[0, 0] <= 0
    assert np.isfinite(result.fitness)


def test_a_held_joint_stays_where_it_is():
    upper = np.array([3.0, 850.0, 700.0])
    for coding in CODINGS:
        result = genetic(
            lambda plans: plans[:, :, 0].sum(axis=1),
            LOWER,
            upper,
            2,
            np.random.default_rng(0),
            coding=coding,
            population=20,
            generations=5,
        )
        assert np.all(result.poses[:, 1] == 850.0)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"coding": "hex"}, "coding"),
        ({"mixing": "soup"}, "mixing"),
        ({"bits": 0}, "bits"),
        ({"bits": 60}, "bits"),
        ({"population": 1}, "population"),
    ],
)
def test_says_what_it_cannot_run(arguments, word):
    with pytest.raises(InputError) as caught:
        run(**arguments)
    assert caught.value.key == word


def test_infinite_limits_are_refused():
    with pytest.raises(InputError, match="finite"):
        genetic(bowl, LOWER, np.array([3.0, np.inf, 700.0]), 4, np.random.default_rng(0))
