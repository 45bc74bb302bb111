"""Any number of instruments against a model in NumPy: the short form of `python tests/known_truth.py 100`."""

from __future__ import annotations

import numpy as np
import pytest
from known_truth import SCENARIOS, law, ranks, slopes

every_scenario = pytest.mark.parametrize("name", SCENARIOS)


@every_scenario
def test_the_rank_at_the_truth_is_that_of_an_independent_model(name: str) -> None:
    ours, theirs = ranks(name, seed=3)
    assert ours == theirs


@every_scenario
def test_slopes_are_those_of_complex_steps_in_an_independent_model(name: str) -> None:
    """By the information of every pose, which does not ask how the two choose the axes of a residual."""
    ours, theirs = slopes(name, seed=5)
    information = [j.swapaxes(1, 2) @ j for j in (ours, theirs)]
    np.testing.assert_allclose(*information, rtol=1e-9, atol=1e-9 * np.abs(information[1]).max())


@every_scenario
def test_errors_on_what_is_seen_follow_the_bound_of_cramer_and_rao(name: str) -> None:
    found = law(name, 4)
    assert found.converged
    assert abs(found.ratio - 1) < 4 * found.error
    assert found.p_value > 1e-4
