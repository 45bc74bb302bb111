"""Fixtures that every test may use: a seeded generator, the shipped configs, measured data where it exists."""

from __future__ import annotations

import gc
import os
import signal
import sys
from pathlib import Path

# before NumPy is loaded: matrices here are small, and threads of several workers wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from symcal import cli

ROOT = Path(__file__).resolve().parent.parent

# derandomize: the same examples on every machine, so that a failure is a failure everywhere
settings.register_profile(
    "symcal",
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=30,
    # fixtures here are read-only, so it does not matter that the examples of one test share them
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
settings.load_profile("symcal")


def pytest_collection_finish() -> None:
    """What was imported and collected stays to the end: garbage is looked for among new objects, and as in commands."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(cli.OBJECTS, 50, 100)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20170829)


@pytest.fixture(scope="session")
def configs() -> Path:
    """The folder of shipped configs: `robots/*.yaml`, `real/*.yaml`, ..."""
    return ROOT / "configs"


@pytest.fixture(scope="session")
def symcal_data() -> Path:
    """The folder of measured sets: $SYMCAL_DATA, else shared/data beside the clone; skips where there is none."""
    named = os.environ.get("SYMCAL_DATA")
    folder = Path(named).expanduser() if named else ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"measured data not found: {folder} does not exist (set SYMCAL_DATA to the folder of the sets)")
    return folder


@pytest.fixture
def symcal(capsys, monkeypatch, tmp_path):
    """`symcal ARGS` in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}

    def call(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["symcal", *map(str, arguments)])
        try:
            cli.main()
            code = 0
        except SystemExit as exit_:
            code = exit_.code if isinstance(exit_.code, int) else int(exit_.code is not None)
        out, err = capsys.readouterr()
        return code, out, err

    yield call
    for number, handler in before.items():
        signal.signal(number, handler)
