"""Names of things as names of files: one component, taken by every file system, and never two alike."""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from symcal.outputs.names import LONGEST, file_name, file_names

HOSTILE = [
    "",
    ".",
    "..",
    "/",
    "../../etc/passwd",
    "/etc/passwd",
    "C:\\x",
    "a\0b",
    "a\nb",
    "x" * 3000,
    "é" * 200,
    "con",
    "CON",
]
HOSTILE += [
    "Nul.csv",
    "com1",
    "a.",
    "a ",
    " a",
    ".hidden",
    "-rf",
    "~",
    "$HOME",
    "a:b",
    "a*?",
    "..\\..",
    "\ud800",
    "人" * 99,
]


@pytest.mark.parametrize("name", ["wire_a", "tracker", "pose 3", "image.01", "FR3-test+1", "Ünal", "_", "7"])
def test_a_plain_name_stays(name: str) -> None:
    assert file_name(name) == name


@given(st.one_of(st.sampled_from(HOSTILE), st.text(max_size=300), st.text("./\\\0:CONaux ", max_size=12)))
def test_any_name_is_one_component_that_every_system_takes(tmp_path: Path, name: str) -> None:
    made = file_name(name)
    own = f"{made}.csv"
    assert len(own.encode()) <= LONGEST + 4
    assert own not in (".", "..")
    assert Path(own).parts == (own,)
    windows = PureWindowsPath(own)
    assert (windows.name, windows.drive, windows.root) == (own, "", "")
    assert not windows.is_reserved()
    assert not set(made) & set('/\\:*?"<>|\0')
    assert made.isprintable()
    assert not made.startswith((".", "-", " ", "~"))
    assert not made.endswith((".", " "))
    assert file_name(made) == made
    file = tmp_path / own  # it can be made, in this folder and nowhere else
    file.write_text("x")
    assert [p.name for p in tmp_path.iterdir()] == [own]
    file.unlink()


@given(st.lists(st.one_of(st.sampled_from(HOSTILE), st.text("aA_/ .-", max_size=4)), max_size=20, unique=True))
def test_no_two_are_alike_even_where_capitals_do_not_count(names: list[str]) -> None:
    made = file_names(names)
    assert list(made) == names
    assert len({name.casefold() for name in made.values()}) == len(names)


def test_a_session_of_a_file_of_measurements_leaves_its_folder_nowhere(tmp_path: Path) -> None:
    made = file_names(["wire_../../x", "wire_monday", "wire_Monday"])
    assert made["wire_monday"] == "wire_monday"
    assert (tmp_path / made["wire_../../x"]).resolve().parent == tmp_path.resolve()
    assert made["wire_Monday"] == "wire_Monday-2"
