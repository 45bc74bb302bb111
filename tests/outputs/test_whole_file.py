"""A file is whole or as it was: at a full disk, at any error, killed at any step, and with several writers."""

from __future__ import annotations

import errno
import os
import resource
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from cases import handling
from interrupted import count_steps, kill_at, together

from symcal.documents.document import write_document
from symcal.errors import InputError, RefusedError
from symcal.export.json import save_json
from symcal.export.urdf import save_urdf
from symcal.outputs import whole_file, whole_folder
from symcal.outputs.locks import try_lock
from symcal.outputs.whole_file import require_own, require_place, write_all_whole, write_whole
from symcal.robot.files import save_robot
from symcal.vision.images import write_image

NEW = "new\n" * 5000
WRITERS = {
    "text": lambda path: write_whole(path, NEW),
    "json": lambda path: save_json(handling(), path),
    "urdf": lambda path: save_urdf(handling(), path),
    "robot": lambda path: save_robot(handling(), path),
    "yaml": lambda path: write_document(path, {"a": list(range(3000))}),
    "image": lambda path: write_image(path, np.random.default_rng(1).integers(0, 255, (64, 64), dtype=np.uint8)),
}


@contextmanager
def small_disk(size: int) -> Iterator[None]:
    """No file may grow beyond a size, as on a full disk: the system itself refuses."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("name", WRITERS)
def test_what_does_not_fit_leaves_the_old_file_and_nothing_else(tmp_path: Path, name: str) -> None:
    path = tmp_path / "out"
    path.write_text("old")
    with small_disk(300), pytest.raises(InputError, match="cannot be written: File too large"):
        WRITERS[name](path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    WRITERS[name](path)
    assert path.stat().st_size > 300
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("call", ["write", "fsync", "replace"])
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO, errno.EROFS, errno.EDQUOT])
def test_an_error_of_any_step_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, number: int
) -> None:
    path = tmp_path / "out"
    path.write_text("old")

    def failing(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, call, failing)
    with pytest.raises(InputError, match=os.strerror(number)) as caught:
        write_whole(path, NEW)
    monkeypatch.undo()
    assert "\n" not in str(caught.value)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_system_without_flushing_is_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unable(_: int) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(os, "fsync", unable)
    write_whole(tmp_path / "out", NEW)
    assert (tmp_path / "out").read_text() == NEW


def test_a_short_write_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = os.write
    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:7]))
    write_whole(tmp_path / "out", NEW[:100])
    assert (tmp_path / "out").read_text() == NEW[:100]


def test_of_files_that_belong_together_all_are_written_or_none(tmp_path: Path) -> None:
    first, second = tmp_path / "a", tmp_path / "b"
    first.write_text("old")
    with small_disk(300), pytest.raises(InputError, match="too large"):
        write_all_whole({first: "short", second: NEW})
    assert first.read_text() == "old"
    assert list(tmp_path.iterdir()) == [first]
    write_all_whole({first: "short", second: NEW})
    assert (first.read_text(), second.read_text()) == ("short", NEW)


def test_killed_at_every_step_it_is_old_or_new_and_the_next_writer_sweeps(tmp_path: Path) -> None:
    path = tmp_path / "out"

    def work() -> None:
        write_whole(path, NEW)

    path.write_text("old")
    steps = count_steps(work, tmp_path)
    assert steps >= 5
    seen = set()
    for step in range(steps):
        path.write_text("old")
        assert kill_at(work, step, tmp_path)
        seen.add(path.read_text())
        work()
        assert list(tmp_path.iterdir()) == [path]
    assert seen == {"old", NEW}


def test_the_temporary_file_of_a_writer_that_lives_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, fsync = tmp_path / "out", os.fsync

    def another(descriptor: int) -> None:
        monkeypatch.setattr(os, "fsync", fsync)
        assert together([lambda: write_whole(path, "other")]) == [0]
        assert len(list(tmp_path.iterdir())) == 2
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", another)
    write_whole(path, NEW)
    assert path.read_text() == NEW
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_taken_for_dead_before_it_is_locked_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a sweeper that comes between the making of a temporary file, or of a folder's lock, and its locking."""
    swept = []

    def sweeper(descriptor: int) -> bool | None:
        if not swept:
            swept.extend(tmp_path.iterdir())
            swept[0].unlink()
            return False
        return try_lock(descriptor)

    for module in (whole_file, whole_folder):
        monkeypatch.setattr(module, "try_lock", sweeper)
    write_whole(tmp_path / "out", "new")
    assert (tmp_path / "out").read_text() == "new"
    (tmp_path / "out").unlink()
    swept.clear()
    with whole_folder.whole_folder(tmp_path / "run", lambda _: None) as folder:
        write_whole(folder / "file", "new")
    assert (tmp_path / "run" / "file").read_text() == "new"
    assert list(tmp_path.iterdir()) == [tmp_path / "run"]


def test_writers_at_the_same_time_leave_one_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "out"

    def writer(text: str) -> None:
        for _ in range(20):
            write_whole(path, text * 1000)

    assert together([lambda text=text: writer(text) for text in "abcd"]) == [0] * 4
    assert path.read_text() in {text * 1000 for text in "abcd"}
    assert list(tmp_path.iterdir()) == [path]


def test_permissions_are_the_umasks_or_those_that_were_there(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "out", "a")
        assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o640
        (tmp_path / "out").chmod(0o600)
        write_whole(tmp_path / "out", "b")
        assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o600
    finally:
        os.umask(before)


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "out").symlink_to("there/file")
    write_whole(tmp_path / "out", "a")  # to nothing as yet
    write_whole(tmp_path / "out", "b")
    assert (tmp_path / "out").is_symlink()
    assert (tmp_path / "there" / "file").read_text() == "b"
    assert [p.name for p in (tmp_path / "there").iterdir()] == ["file"]


def test_what_is_no_file_is_refused_before_and_while_writing(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    words = {
        "/dev/null": "a device or a pipe",
        "/dev/stdout": "name a file",
        "/proc/self/fd/1": "a stream",
        tmp_path / "pipe": "a device or a pipe",
        tmp_path: "this is a folder",
        tmp_path / ("x" * 300): "File name too long",
        tmp_path / "a\0b": "null",
        tmp_path / "loop": "symbolic links",
        tmp_path / "pipe" / "out": "Not a directory|make it first",
        tmp_path / "missing" / "out": "No such file|make it first",
    }
    for path, word in words.items():
        with pytest.raises(InputError, match=word):
            write_whole(path, "x")
        with pytest.raises(InputError, match=word):
            require_place(Path(path))
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_the_longest_name_can_be_written(tmp_path: Path) -> None:
    for name in ("x" * 255, "é" * 127):
        write_whole(tmp_path / name, "a")
        assert (tmp_path / name).read_text() == "a"


def test_a_file_that_the_command_reads_is_not_written_over(tmp_path: Path) -> None:
    data = tmp_path / "data.csv"
    data.write_text("a")
    (tmp_path / "link").symlink_to(data)
    require_place(tmp_path / "other.csv", (data,))
    for out in (data, tmp_path / "link", tmp_path / "." / "data.csv"):
        with pytest.raises(RefusedError, match=r"read by this command.*another --out"):
            require_place(out, (tmp_path / "missing", data))


def test_a_file_that_the_user_did_not_name_must_be_ours(tmp_path: Path) -> None:
    require_own(tmp_path / "robot.urdf", b"by symcal")
    (tmp_path / "robot.urdf").write_text("<!-- by symcal -->")
    require_own(tmp_path / "robot.urdf", b"by symcal")
    (tmp_path / "robot.urdf").write_text("<robot/>")
    with pytest.raises(RefusedError, match="was not written by this program"):
        require_own(tmp_path / "robot.urdf", b"by symcal")
