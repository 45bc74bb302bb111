"""The short form of `python tests/kills.py`: commands of a single file and of two, killed at each of their steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from kills import Kills, write_inputs


@pytest.mark.parametrize("name", ["compensate", "export json"])
def test_a_command_killed_at_any_step_leaves_old_or_new(tmp_path: Path, name: str) -> None:
    inputs = tmp_path / "inputs"
    inputs.mkdir()
    write_inputs(inputs)
    kills = Kills(name, inputs)
    told = kills.at_steps()
    assert "'old'" in told
    assert "'new'" in told
    assert "whole; absent in 0 of" in kills.at_once(2, 1)
    assert "at 1 random moments" in kills.at_random(1, np.random.default_rng(1))
