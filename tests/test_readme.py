"""The README: its commands are those that continuous integration runs. Its example runs with the pages of docs/."""

import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_the_two_commands_name_files_that_are_there() -> None:
    commands = re.findall(r"^pip install .*$", README.read_text(encoding="utf-8"), re.M)
    assert len(commands) == 2
    assert (README.parent / commands[0].split()[-1]).is_file()
    assert commands[1].endswith("pytest -n auto")
