"""Work shared with a copy of this process: the same results, errors and files as alone, and nothing left behind."""

from __future__ import annotations

import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from symcal.outputs import side_by_side as shared
from symcal.outputs.side_by_side import may_fork, side_by_side

forks = pytest.mark.skipif(not may_fork(), reason="no copy of this process is made here")


def _square(i: int) -> tuple[int, int]:
    time.sleep(0.02)
    return i * i, os.getpid()


@forks
def test_two_processes_share_the_work_and_results_keep_their_order() -> None:
    found = side_by_side([partial(_square, i) for i in range(12)])
    assert [value for value, _ in found] == [i * i for i in range(12)]
    assert len({process for _, process in found}) == 2


def test_alone_it_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared, "may_fork", lambda: False)
    assert side_by_side([partial(_square, i) for i in range(3)]) == [(i * i, os.getpid()) for i in range(3)]


@forks
@pytest.mark.parametrize("bad", range(6))
def test_an_error_is_raised_wherever_it_happened(bad: int) -> None:
    def piece(i: int) -> int:
        time.sleep(0.01)
        if i == bad:
            raise ValueError(f"piece {i}")
        return i

    with pytest.raises(ValueError, match=f"piece {bad}"):
        side_by_side([partial(piece, i) for i in range(6)])
    with pytest.raises(ChildProcessError):  # no copy is left to wait for
        os.waitpid(-1, os.WNOHANG)


@forks
def test_what_a_killed_copy_had_taken_is_done_again() -> None:
    here = os.getpid()

    def piece(i: int) -> int:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.05)
        return i

    assert side_by_side([partial(piece, i) for i in range(4)]) == [0, 1, 2, 3]


@forks
def test_the_copy_prints_nothing_and_leaves_no_files_open(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    print("once", end="")  # noqa: T201
    side_by_side([partial((tmp_path / str(i)).write_text, str(i)) for i in range(8)])
    assert sorted(path.name for path in tmp_path.iterdir()) == [str(i) for i in range(8)]
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    assert capfd.readouterr().out == "once"


@forks
def test_the_copy_dies_with_a_killed_parent(tmp_path: Path) -> None:
    """So that the locks of a killed run, which a copy has too, are free at once."""
    first = os.fork()
    if first == 0:
        here = os.getpid()

        def piece() -> None:
            if os.getpid() == here:
                time.sleep(0.5)
                os.kill(here, signal.SIGKILL)
            (tmp_path / "copy").write_text(str(os.getpid()))
            time.sleep(60)

        side_by_side([piece, piece])
        os._exit(0)
    os.waitpid(first, 0)
    copy = int((tmp_path / "copy").read_text())
    for _ in range(200):
        if not _runs(copy):
            return
        time.sleep(0.05)
    pytest.fail("the copy lives on")


def _runs(process: int) -> bool:
    try:
        return "State:\tZ" not in Path(f"/proc/{process}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
