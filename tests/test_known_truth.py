"""Any number of instruments against a model in NumPy: the short form of `python tests/known_truth.py 100`."""

from __future__ import annotations

import pytest
from known_truth import SCENARIOS, law, ranks

every_scenario = pytest.mark.parametrize("name", SCENARIOS)


@every_scenario
def test_the_rank_at_the_truth_is_that_of_an_independent_model(name: str) -> None:
    ours, theirs = ranks(name, seed=3)
    assert ours == theirs


@every_scenario
def test_errors_on_what_is_seen_follow_the_bound_of_cramer_and_rao(name: str) -> None:
    found = law(name, 10)
    assert found.converged
    assert abs(found.ratio - 1) < 4 * found.error
    assert found.p_value > 1e-4
