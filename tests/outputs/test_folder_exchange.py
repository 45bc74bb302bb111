"""Two folders change places, and where they cannot it is said."""

from __future__ import annotations

import ctypes
import errno
from pathlib import Path

import pytest

from symcal.outputs import exchange as module
from symcal.outputs.exchange import exchange


def test_folders_change_places(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(name)
    if not exchange(tmp_path / "a", tmp_path / "b"):
        pytest.skip("this file system cannot exchange")
    assert [(tmp_path / name / "file").read_text() for name in "ab"] == ["b", "a"]
    with pytest.raises(FileNotFoundError):
        exchange(tmp_path / "a", tmp_path / "missing")


@pytest.mark.parametrize("number", [errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EPERM])
def test_a_system_that_cannot_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refused(*_: bytes) -> int:
        ctypes.set_errno(number)
        return -1

    monkeypatch.setattr(module, "_call", lambda: refused)
    assert not exchange(tmp_path, tmp_path)
    monkeypatch.setattr(module, "_call", lambda: None)
    assert not exchange(tmp_path, tmp_path)
