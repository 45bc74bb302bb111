"""The configs give what they gave when their goldens were recorded: the quick ones here, the others in long form."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from goldens import PLANS, QUICK, RUNS, compare, differences

SLOW = [name for name in (*RUNS, *PLANS) if name not in QUICK]


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(name, marks=pytest.mark.long) for name in SLOW)])
def test_a_config_gives_what_it_gave(name: str) -> None:
    if name.startswith("real/") and not Path(os.environ.get("SYMCAL_DATA", "/nowhere")).is_dir():
        pytest.skip("the measured sets are not here: set SYMCAL_DATA")
    assert compare(name) == []


def test_differences_are_found() -> None:
    golden = {"a": {"b": 1.0, "singular_values": [100.0, 1e-9]}, "rows": ["x"]}
    assert list(differences(golden, {"a": {"b": 1.0 + 1e-8, "singular_values": [100.0, 2e-9]}, "rows": ["x"]})) == []
    assert list(differences(golden, {"a": {"b": 1.001, "singular_values": [100.1, 0.0]}, "rows": ["y"]})) == [
        ".a.b: 1.0 became 1.001",
        ".a.singular_values[0]: 100.0 became 100.1",
        ".rows[0]: 'x' became 'y'",
    ]
    assert list(differences(golden, {"rows": []})) == [".a is gone", ".rows: 1 entries became 0"]
