from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from symcal.kernels import path


@pytest.fixture(scope="session", autouse=True)
def kernel_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of this session's own, so that a test never sees what an earlier version of the program compiled."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        patch.delenv("SYMCAL_KERNELS", raising=False)
        yield folder / "symcal" / "kernels"


@pytest.fixture(autouse=True)
def same_environment() -> Iterator[None]:
    before = dict(os.environ)
    path._say_once.cache_clear()
    yield
    os.environ.clear()
    os.environ.update(before)
