"""A few sets of each kind; many of them: decision_draws.py."""

from __future__ import annotations

import pytest
from decision_draws import KINDS, accepted


@pytest.mark.parametrize("kind", ["15 poses", "noise of half a millimetre"])
def test_good_calibrations_are_accepted(kind: str) -> None:
    assert accepted(KINDS[kind], 5) == (5, 0)


def test_a_robot_without_errors_gives_nothing_to_accept() -> None:
    """Of 100 sets of it none was accepted."""
    assert accepted(KINDS["a perfect robot"], 5)[0] == 0
