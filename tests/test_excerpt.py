"""The line that an error is about, with a mark under the key."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

from symcal.documents.excerpt import excerpt
from symcal.errors import InputError

TEXT = (
    "name: arm\n"
    "units: {length: mm, angle: grad}\n"
    "links:\n"
    "  - {joint: revolute, name: '大腕', theta: 0, alfa: 90}   # a comment\n"
    "  - 'joint': revolute\n"
    "\tkey: 1\x1b[2J\n"
    "\n"
    f"long: [{', '.join(str(i) for i in range(60))}, bad, {', '.join(str(i) for i in range(60))}]\n"
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def shown(error: InputError, width: int = 80) -> tuple[str, str]:
    found = excerpt(error, width)
    assert found is not None
    return found.lines()


def marked(error: InputError) -> str:
    text, mark = shown(error)
    return text[mark.index("^") : mark.rindex("^") + 1]


@pytest.mark.parametrize(
    ("line", "key", "found", "what"),
    [
        (1, "name", None, "name"),
        (2, "units.angle", "grad", "angle"),
        (2, "units", None, "units"),
        (5, "links[1].joint", None, "'joint'"),
        (3, "links[0]", None, "links"),
        (2, "--set units.angle", "grad", "angle"),
        (2, "missing", "grad", "grad"),
        (5, "links[1].d", None, "'joint': revolute"),
        (2, None, None, "units: {length: mm, angle: grad}"),
    ],
)
def test_the_mark_is_under_the_key_else_the_value_else_the_line(
    file: Path, line: int, key: str | None, found: str | None, what: str
) -> None:
    assert marked(InputError("wrong", file=file, line=line, key=key, found=found)) == what


def test_wide_characters_take_two_columns(file: Path) -> None:
    text, mark = shown(InputError("wrong", file=file, line=4, key="links[0].alfa"))
    assert text == "    4 |   - {joint: revolute, name: '大腕', theta: 0, alfa: 90}   # a comment"
    assert mark.index("^") == text.index("alfa") + 2
    assert mark.count("^") == 4


def test_nothing_in_a_line_steers_the_terminal(file: Path) -> None:
    text, mark = shown(InputError("wrong", file=file, line=6, key="key"))
    assert text == "    6 |  key: 1\\x1b[2J"
    assert mark.index("^") == text.index("key")


@pytest.mark.parametrize("width", [40, 80, 120])
def test_of_a_long_line_the_part_with_the_mark_is_shown(file: Path, width: int) -> None:
    text, mark = shown(InputError("wrong", file=file, line=8, key="nothing", found="bad"), width)
    assert len(text) <= width
    assert text[mark.index("^") : mark.rindex("^") + 1] == "bad"
    assert text.endswith("...")
    assert text.startswith("    8 | ...")


def test_errors_that_name_no_line_of_a_yaml_file_have_none(file: Path) -> None:
    table = file.with_suffix(".csv")
    table.write_text("q1_deg\n1\n")
    for error in (
        InputError("wrong"),
        InputError("wrong", file=file),
        InputError("wrong", file=file, line=99),
        InputError("wrong", file=file, line=7),
        InputError("wrong", file=file.with_name("gone.yaml"), line=1),
        InputError("wrong", file=table, line=1, column="q1"),
    ):
        assert excerpt(error, 80) is None


def test_on_a_terminal_the_line_stands_below_the_message(file: Path) -> None:
    """A pseudo-terminal; piped, the message stays alone."""
    command = [sys.executable, "-m", "symcal.cli", "check", str(file)]
    file.write_text(TEXT.partition("\t")[0], encoding="utf-8")
    alone = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (alone.returncode, alone.stderr.count("\n")) == (1, 1)
    ours, theirs = pty.openpty()
    where = os.environ | {"COLUMNS": "200", "TERM": "xterm", "NO_COLOR": "1"}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs, env=where) as process:
        os.close(theirs)
        said = b""
        while True:
            try:
                piece = os.read(ours, 65536)
            except OSError:  # the other end is closed
                break
            if not piece:
                break
            said += piece
    os.close(ours)
    assert b"31m" not in said  # bold is no colour, red is one
    first, line, mark = re.sub(r"\x1b\[\d*m", "", said.decode()).splitlines()
    assert (process.returncode, first) == (1, alone.stderr.rstrip("\n"))
    assert line.endswith("theta: 0, alfa: 90}   # a comment")
    assert mark.strip(" |") == "^^^^"
