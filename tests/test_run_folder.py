"""A run's folder: whole or not at all, and never somebody else's."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from symcal.errors import InputError, RefusedError
from symcal.runs.folder import require_place, require_replaceable, run_folder, write_json


def write(target: Path, text: str) -> None:
    with run_folder(target) as folder:
        (folder / "results.json").write_text(text)
        (folder / "tables").mkdir()
        (folder / "tables" / "errors.csv").write_text(text)


def test_a_second_run_replaces_the_first_and_leaves_nothing_beside(tmp_path):
    target = tmp_path / "new" / "run"
    write(target, "first")
    (target / "report.pdf").write_text("of the first run")
    write(target, "second")
    assert (target / "tables" / "errors.csv").read_text() == "second"
    assert not (target / "report.pdf").exists()
    assert list(target.parent.iterdir()) == [target]
    assert target.stat().st_mode & 0o777 == 0o755


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
        assert (target / "results.json").read_text() == "first"


def test_a_full_disk_is_an_error_of_the_folder(tmp_path):
    def full() -> None:
        with run_folder(tmp_path / "run"):
            raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match="No space left on device"):
        full()
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_while_the_folders_change_places_brings_the_old_one_back(tmp_path, monkeypatch):
    target = tmp_path / "run"
    write(target, "first")
    rename = Path.rename

    def interrupted(self: Path, other: Path) -> Path:
        if other == target and self.parent == tmp_path:
            raise KeyboardInterrupt
        return rename(self, other)

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(target, "second")
    assert (target / "results.json").read_text() == "first"
    assert list(tmp_path.iterdir()) == [target]


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
    with pytest.raises(InputError, match="cannot be written"):
        write(foreign / "chapter1.tex" / "run", "x")
    assert (foreign / "chapter1.tex").read_text() == "years of work"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link", "thesis"]


def test_an_empty_folder_is_filled(tmp_path):
    write(tmp_path, "first")
    assert (tmp_path / "results.json").read_text() == "first"


def test_json_has_no_nan(tmp_path):
    path = tmp_path / "results.json"
    write_json(path, {"ö": [1.5, None]})
    assert json.loads(path.read_text(encoding="utf-8")) == {"ö": [1.5, None]}
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(path, {"a": math.nan})


def test_a_file_needs_a_folder_before_the_work_is_done(tmp_path: Path) -> None:
    require_place(tmp_path / "camera.yaml")
    with pytest.raises(InputError, match="make it first"):
        require_place(tmp_path / "missing" / "camera.yaml")
    with pytest.raises(InputError, match="name a file"):
        require_place(tmp_path)
    assert list(tmp_path.iterdir()) == []
