"""A run's folder: whole or as it was, killed wherever it may be, and never somebody else's."""

from __future__ import annotations

import errno
import json
import math
import os
import resource
import shutil
import tempfile
import threading
from pathlib import Path

import pytest
from interrupted import cannot_exchange, count_steps, kill_at, together

from symcal.errors import InputError, RefusedError
from symcal.outputs import whole_folder as module
from symcal.outputs.manifest import MANIFEST, foreign_files
from symcal.outputs.whole_file import write_whole
from symcal.runs.folder import require_replaceable, run_folder, write_json


def write(target: Path, text: str, size: int = 1) -> None:
    with run_folder(target) as folder:
        write_whole(folder / "results.json", text * size)
        (folder / "tables").mkdir()
        write_whole(folder / "tables" / "errors.csv", text * size)


def text_of(target: Path) -> str:
    """What a whole folder says; an error if it is not whole."""
    assert foreign_files(target) == []
    listed = json.loads((target / MANIFEST).read_text())["files"]
    assert set(listed) == {"results.json", "tables/errors.csv"}
    first, second = (target / name for name in listed)
    assert first.read_text() == second.read_text()
    return first.read_text()


@pytest.fixture(params=["exchange", "two renames"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """How folders change places: in one step, or as on a file system that cannot."""
    if request.param == "two renames":
        monkeypatch.setattr(module, "exchange", cannot_exchange)
    return request.param


@pytest.mark.usefixtures("way")
def test_a_second_run_replaces_the_first_and_leaves_nothing_beside(tmp_path):
    target = tmp_path / "new" / "run"
    with run_folder(target) as folder:
        write_whole(folder / "report.pdf", "of the first run")
    write(target, "second")
    assert text_of(target) == "second"
    assert not (target / "report.pdf").exists()
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o755), (0o027, 0o750), (0o077, 0o700)])
def test_permissions_are_those_of_the_umask(tmp_path, umask, mode):
    before = os.umask(umask)
    try:
        write(tmp_path / "run", "first")
    finally:
        os.umask(before)
    for path in (tmp_path / "run", tmp_path / "run" / "tables"):
        assert path.stat().st_mode & 0o777 == mode
    assert (tmp_path / "run" / MANIFEST).stat().st_mode & 0o777 == mode & 0o666


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, ZeroDivisionError, RefusedError])
@pytest.mark.parametrize("old", [True, False])
def test_an_interrupted_run_changes_nothing(tmp_path, error, old):
    target = tmp_path / "run"
    if old:
        write(target, "first")

    def interrupted() -> None:
        with run_folder(target) as folder:
            (folder / "results.json").write_text("half")
            raise error

    with pytest.raises(error):
        interrupted()
    assert list(tmp_path.iterdir()) == ([target] if old else [])
    if old:
        assert text_of(target) == "first"


def test_a_full_disk_is_an_error_of_the_file_in_its_place(tmp_path):
    write(tmp_path / "run", "first")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(InputError, match="File too large") as caught:
            write(tmp_path / "run", "second", 1000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.file == tmp_path / "run" / "results.json"  # not one with a hidden name that is gone
    assert text_of(tmp_path / "run") == "first"
    assert list(tmp_path.iterdir()) == [tmp_path / "run"]


def test_an_interrupt_while_the_folders_change_places_brings_the_old_one_back(tmp_path, monkeypatch):
    target = tmp_path / "run"
    write(target, "first")
    rename = Path.rename

    def interrupted(self: Path, other: Path) -> Path:
        if other == target and not self.name.endswith(".old"):
            raise KeyboardInterrupt
        return rename(self, other)

    monkeypatch.setattr(module, "exchange", cannot_exchange)
    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(target, "second")
    assert text_of(target) == "first"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("old", [True, False])
def test_killed_at_every_step_it_is_old_or_new_and_the_next_run_mends(tmp_path, way, old):
    """Before it starts its work, the next run puts back what was there and removes what was left."""
    seen = set()
    (tmp_path / "model").mkdir()
    if old:
        write(tmp_path / "model" / "run", "first")

    def fresh() -> Path:
        return Path(shutil.copytree(tmp_path / "model", tempfile.mkdtemp(dir=tmp_path), dirs_exist_ok=True))

    place = fresh()
    steps = count_steps(lambda: write(place / "run", "second"), place)
    assert steps > 15
    gaps = 0
    for step in range(steps):
        place = fresh()
        assert kill_at(lambda place=place: write(place / "run", "second"), step, place)
        gaps += not (place / "run").exists()
        require_replaceable(place / "run")
        there = (place / "run").exists()
        assert there or not old
        seen.add(text_of(place / "run") if there else "nothing")
        assert list(place.iterdir()) == ([place / "run"] if there else [])
    assert seen == {"first" if old else "nothing", "second"}
    if old:
        assert (gaps > 0) == (way == "two renames")


def test_what_a_living_run_has_made_is_not_swept(tmp_path):
    target = tmp_path / "run"
    with run_folder(target) as folder:
        write_whole(folder / "results.json", "first")
        assert together([lambda: require_replaceable(target)]) == [0]
        assert (folder / "results.json").read_text() == "first"
        assert len(list(tmp_path.iterdir())) == 2
    assert list(tmp_path.iterdir()) == [target]


def test_hidden_folders_of_others_are_not_swept(tmp_path):
    """Another target's, whose name starts alike, and what only looks like a left-over."""
    for name in (".run-abc", ".run-0123456789ab", ".run-2-0123456789ab"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "thesis.tex").write_text("years of work")
    (tmp_path / ".run-2-0123456789ab.lock").write_text("")
    before = sorted(tmp_path.iterdir())
    require_replaceable(tmp_path / "run")
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("old", [True, False])
def test_runs_at_the_same_time_leave_one_whole_folder(tmp_path, old):
    target = tmp_path / "run"
    if old:
        write(target, "first")

    def again(text: str) -> None:
        for _ in range(8):
            write(target, text)

    assert together([lambda text=text: again(text) for text in "abcd"]) == [0] * 4
    assert text_of(target) in set("abcd")
    assert list(tmp_path.iterdir()) == [target]


def test_there_is_no_moment_without_a_folder(tmp_path, way):
    if way == "two renames":
        pytest.skip("where folders cannot be exchanged there is one")
    target, done, absent, looks = tmp_path / "run", threading.Event(), 0, 0
    write(target, "first")

    def look() -> None:
        nonlocal absent, looks
        while not done.is_set():
            absent += not os.path.lexists(target / "results.json")
            looks += 1

    looker = threading.Thread(target=look)
    looker.start()
    for _ in range(15):
        assert together([lambda: write(target, "second")]) == [0]
    done.set()
    looker.join()
    assert looks > 1000
    assert absent == 0


# ----------------------------------------------------------------------------------------------- whose folder it is


def test_files_of_the_user_at_any_depth_are_kept(tmp_path):
    target = tmp_path / "run"
    write(target, "first")
    for name in ("notes.txt", "tables/my_thesis.txt", "figures/deep/er/photo.png", ".hidden"):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_text("mine")
        with pytest.raises(RefusedError, match=rf"{name}.*choose another --out"):
            require_replaceable(target)
        with pytest.raises(RefusedError):
            write(target, "second")
        assert (target / name).read_text() == "mine"
        (target / name).unlink()
    write(target, "second")
    assert text_of(target) == "second"
    assert list(tmp_path.iterdir()) == [target]


def test_a_file_that_the_user_changed_is_kept(tmp_path):
    target = tmp_path / "run"
    write(target, "first")
    (target / "tables" / "errors.csv").write_text("First")  # as many bytes
    with pytest.raises(RefusedError, match=r"changed since \(tables/errors\.csv\)"):
        write(target, "second")
    assert (target / "tables" / "errors.csv").read_text() == "First"
    (target / "tables" / "errors.csv").unlink()  # what is gone cannot be lost
    write(target, "second")
    assert text_of(target) == "second"


def test_a_folder_without_a_manifest_is_refused_even_with_a_runs_names(tmp_path):
    target = tmp_path / "s4"
    target.mkdir()
    (target / "measurements.csv").write_text("a day of work")
    with pytest.raises(RefusedError, match=r"no manifest\.json that says a run made them \(measurements\.csv\)"):
        write(target, "x")
    for manifest in ("", "{}", "[]", '{"files": 3}', "null"):
        (target / MANIFEST).write_text(manifest)
        with pytest.raises(RefusedError, match="measurements"):
            write(target, "x")
    assert (target / "measurements.csv").read_text() == "a day of work"


def test_what_make_made_of_the_code_goes_with_it_and_nothing_else(tmp_path):
    target = tmp_path / "run"
    write(target, "first")
    (target / "c" / "build").mkdir(parents=True)
    for name in ("arm_kinematics.double.o", "libarm_kinematics.a", "selftest.float"):
        (target / "c" / "build" / name).write_bytes(b"built")
    for name in ("c/build/notes.txt", "c/mine.o", "build/mine.o", "c/build/deep/mine.o"):
        (target / name).parent.mkdir(exist_ok=True)
        (target / name).write_text("mine")
        with pytest.raises(RefusedError, match=name):
            write(target, "second")
        (target / name).unlink()
    write(target, "second")
    assert text_of(target) == "second"
    assert not (target / "c").exists()


def test_who_has_a_folder_of_an_earlier_version_is_told_what_to_do(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "results.json").write_text("{}")
    with pytest.raises(RefusedError, match=r"remove the folder if a version before"):
        require_replaceable(tmp_path / "run")


def test_a_big_folder_is_refused_without_being_read_through(tmp_path, monkeypatch):
    target = tmp_path / "home"
    for i in range(30):
        (target / f"{i:02d}").mkdir(parents=True)
        for k in range(20):
            (target / f"{i:02d}" / f"{k}.txt").write_text("mine")
    looked, scandir = [], os.scandir
    monkeypatch.setattr(os, "scandir", lambda path: looked.append(path) or scandir(path))
    monkeypatch.setattr("symcal.outputs.manifest._digest", lambda path: pytest.fail(f"{path} was read"))
    with pytest.raises(RefusedError, match=r"\(00/0\.txt, 00/1\.txt, 00/10\.txt, \.\.\.\)"):
        require_replaceable(target)
    assert len(looked) < 10


def test_links_and_devices_are_nobodys_and_never_followed(tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "results.json").write_text("mine")
    target = tmp_path / "run"
    write(target, "first")
    for make in (
        lambda path: path.symlink_to(outside),
        lambda path: path.symlink_to(outside / "results.json"),
        os.mkfifo,
    ):
        make(target / "thing")
        with pytest.raises(RefusedError, match="thing"):
            write(target, "second")
        (target / "thing").unlink()
    with run_folder(target) as folder:  # a run that makes a link to a folder: only the link goes with it
        (folder / "link").symlink_to(outside)
    (target / "link").unlink()
    write(target, "second")
    assert (outside / "results.json").read_text() == "mine"


def test_what_file_managers_leave_does_not_count(tmp_path):
    target = tmp_path / "run"
    write(target, "first")
    (target / ".DS_Store").write_bytes(b"\0")
    (target / "tables" / "Thumbs.db").write_bytes(b"\0")
    write(target, "second")
    assert text_of(target) == "second"


@pytest.mark.usefixtures("way")
def test_what_comes_into_the_folder_while_the_run_works_is_kept_and_so_is_the_result(tmp_path):
    target = tmp_path / "run"
    write(target, "first")

    def worked() -> None:
        with run_folder(target) as folder:
            write_whole(folder / "results.json", "second")
            (target / "thesis.tex").write_text("mine")

    with pytest.raises(RefusedError, match=r"thesis\.tex.*the result is in .*run-1"):
        worked()
    assert (target / "thesis.tex").read_text() == "mine"
    assert (target / "results.json").read_text() == "first"
    assert (tmp_path / "run-1" / "results.json").read_text() == "second"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run", "run-1"]


@pytest.mark.usefixtures("way")
def test_what_comes_in_at_the_last_moment_is_kept_too(tmp_path, monkeypatch):
    """After the last look at the old folder, before it is removed."""
    target = tmp_path / "run"
    write(target, "first")
    exchange = module.exchange

    def late(a: Path, b: Path) -> bool:
        if not (target / "thesis.tex").exists() and (target / "results.json").read_text() == "first":
            (target / "thesis.tex").write_text("mine")
        return exchange(a, b)

    monkeypatch.setattr(module, "exchange", late)
    with pytest.raises(RefusedError, match="thesis"):
        write(target, "second")
    assert (target / "thesis.tex").read_text() == "mine"
    assert text_of(tmp_path / "run-1") == "second"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run", "run-1"]


def test_a_folder_that_cannot_be_moved_keeps_its_place_and_the_result_is_beside(tmp_path, monkeypatch):
    """As one of a lower layer of an overlay, in a container."""
    target = tmp_path / "run"
    write(target, "first")
    rename = Path.rename

    def immovable(self: Path, other: Path) -> Path:
        if self == target:
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))
        return rename(self, other)

    monkeypatch.setattr(module, "exchange", cannot_exchange)
    monkeypatch.setattr(Path, "rename", immovable)
    with pytest.raises(InputError, match=r"Invalid cross-device link; it is untouched, and the result is in .*run-1"):
        write(target, "second")
    assert text_of(target) == "first"
    assert text_of(tmp_path / "run-1") == "second"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run", "run-1"]


def test_an_input_inside_the_target_is_refused(tmp_path):
    target = tmp_path / "s4"
    write(target, "first")
    (tmp_path / "link").symlink_to(target)
    for inside in (target / "results.json", target / "tables", target, tmp_path / "link" / "results.json"):
        with pytest.raises(RefusedError, match="is read by this run and lies in"):
            require_replaceable(target, [tmp_path / "other", inside])
    with pytest.raises(RefusedError, match="is read by this run"), run_folder(target, [target / "results.json"]):
        pass
    require_replaceable(target, [tmp_path / "s4b" / "x", tmp_path])
    assert text_of(target) == "first"


def test_what_is_not_a_run_is_not_replaced(tmp_path):
    foreign = tmp_path / "thesis"
    foreign.mkdir()
    (foreign / "chapter1.tex").write_text("years of work")
    with pytest.raises(RefusedError, match=r"chapter1\.tex"):
        write(foreign, "x")
    with pytest.raises(RefusedError, match="is not a folder"):
        write(foreign / "chapter1.tex", "x")
    (tmp_path / "link").symlink_to(foreign)
    with pytest.raises(RefusedError, match="is not a folder"):
        require_replaceable(tmp_path / "link")
    with pytest.raises(InputError, match="cannot be"):
        write(foreign / "chapter1.tex" / "run", "x")
    for strange in (Path("/"), tmp_path / "a\0b"):
        with pytest.raises(InputError, match="cannot be"):
            write(strange, "x")
    assert (foreign / "chapter1.tex").read_text() == "years of work"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link", "thesis"]


@pytest.mark.parametrize("protected", ["run", "."])
def test_a_protected_folder_is_an_error_before_the_work(tmp_path, monkeypatch, protected):
    """Whoever protects a result, or the folder around it, wants it kept."""
    write(tmp_path / "run", "first")
    monkeypatch.setattr(os, "access", lambda path, _: Path(path) != tmp_path / protected)
    with pytest.raises(InputError, match="cannot be written: Permission denied"):
        require_replaceable(tmp_path / "run")
    assert text_of(tmp_path / "run") == "first"


def test_where_a_file_system_is_mounted_is_refused_before_the_work(tmp_path, monkeypatch):
    """A volume of a container cannot be exchanged, and what stands beside it is lost with the container."""
    assert os.path.ismount("/proc") or os.path.ismount("/dev")
    mounted = Path("/proc" if os.path.ismount("/proc") else "/dev")
    with pytest.raises(RefusedError, match=rf"mounted.* choose a folder in it, such as {mounted}/run"):
        require_replaceable(mounted)
    write(tmp_path / "volume" / "run", "first")
    monkeypatch.setattr(os.path, "ismount", lambda path: Path(path) == tmp_path / "volume")
    write(tmp_path / "volume" / "run", "second")
    assert text_of(tmp_path / "volume" / "run") == "second"


def test_an_empty_folder_is_filled(tmp_path):
    write(tmp_path, "first")
    assert text_of(tmp_path) == "first"


def test_a_name_as_long_as_names_may_be(tmp_path):
    for name in ("x" * 255, "é" * 127):
        write(tmp_path / name, "first")
        write(tmp_path / name, "second")
        assert text_of(tmp_path / name) == "second"
    with pytest.raises(InputError, match="File name too long"):
        write(tmp_path / ("x" * 256), "x")
    assert len(list(tmp_path.iterdir())) == 2


def test_json_has_no_nan(tmp_path):
    path = tmp_path / "results.json"
    write_json(path, {"ö": [1.5, None]})
    assert json.loads(path.read_text(encoding="utf-8")) == {"ö": [1.5, None]}
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(path, {"a": math.nan})
