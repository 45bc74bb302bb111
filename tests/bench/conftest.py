"""The package's own kernels for the arms of these tests, made once."""

from __future__ import annotations

import pytest

from symcal.bench.arms import handling_robot
from symcal.bench.case import Case, case_of


@pytest.fixture(scope="session")
def handling() -> Case:
    return case_of(handling_robot())
