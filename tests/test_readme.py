"""The README: its example runs as it stands, and its commands are those that continuous integration runs."""

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_the_example_runs_and_says_what_it_found(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    code = code.replace('"configs/', f'"{README.parent.as_posix()}/configs/')
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"^\d+ of 25 directions seen, noise 0\.0\d\d mm$", done.stdout, re.M)
    assert (tmp_path / "calibrated.yaml").is_file()


def test_the_two_commands_name_files_that_are_there() -> None:
    commands = re.findall(r"^pip install .*$", README.read_text(encoding="utf-8"), re.M)
    assert len(commands) == 2
    assert (README.parent / commands[0].split()[-1]).is_file()
    assert commands[1].endswith("pytest -n auto")
