"""The README and the pages of docs/: every code block and command runs as it stands, page by page, from top to bottom.

A block with a caption is a file of that name. A command is run as a user would; those of blocks below a comment `long`
take their time (`pytest -m long`), and so do all blocks after it on that page.
"""

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
import typer.main
import yaml
from sybil import Example, Sybil
from sybil.evaluators.python import PythonEvaluator
from sybil.parsers.myst import CodeBlockParser

from symcal import cli
from symcal.camera.files import CameraFile
from symcal.config.experiment import experiment_type
from symcal.instruments import KINDS
from symcal.robot.schema import RobotFile
from symcal.runs.load import load
from symcal.words import number

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = [README, *(path for path in sorted(DOCS.rglob("*.md")) if "_made" not in path.parts)]
SLOW = "\n% long\n"
QUOTED = {"start.md": ("ur5e/practice", "eye/practice", "scara/practice")}  # runs whose errors stand on the page
FILES = (experiment_type(), RobotFile, CameraFile)
KEYS = {field.alias or name for file in FILES for name, field in file.model_fields.items()}


def _name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def _caption(example: Example) -> str | None:
    found = re.match(r".*\n:caption: (\S+)\n", example.document.text[example.start : example.end])
    return found[1] if found else None


def _keep(example: Example) -> None:
    name = _caption(example)
    if name is not None:
        Path(name).write_text(example.parsed, encoding="utf-8")


def _yaml(example: Example) -> None:
    said = yaml.safe_load(example.parsed)
    assert set(said) <= KEYS, f"keys that no file has: {set(said) - KEYS}"
    _keep(example)
    name = _caption(example)
    if name is not None and "measurements" in said:
        load(Path(name))


class _Page:
    """Runs the blocks of a page in a folder of its own; commands through the program itself."""

    def __init__(self, page: Path, symcal: Callable[..., tuple[int, str, str]]) -> None:
        self.symcal = symcal
        parsers = [
            CodeBlockParser("python", PythonEvaluator()),
            CodeBlockParser("yaml", _yaml),
            CodeBlockParser("text", _keep),
            CodeBlockParser("sh", self._commands),
        ]
        self.document = Sybil(parsers=parsers, path=str(page.parent)).parse(page)
        self.slow = self.document.text.find(SLOW) % (len(self.document.text) + 1)

    def _commands(self, example: Example) -> None:
        for command in example.parsed.replace("\\\n", " ").splitlines():
            words = shlex.split(command, comments=True)
            if not words or words[0] == "pip":  # continuous integration installs
                continue
            assert words[0] == "symcal", f"a command that nobody runs: {command}"
            code, out, err = self.symcal(*words[1:])
            assert code == 0, f"{command}\n{out}\n{err}"

    def run(self, *, to_the_end: bool) -> None:
        for example in self.document.examples():
            if to_the_end or example.start < self.slow:
                example.evaluate()


@pytest.fixture
def page(symcal, tmp_path):
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    return lambda path: _Page(path, symcal)


@pytest.mark.parametrize("path", [each for each in PAGES if each != README], ids=_name)
def test_what_a_page_says_runs(page, path: Path) -> None:
    page(path).run(to_the_end=False)


def test_the_twenty_lines_say_what_they_found(page, capsys) -> None:
    page(README).run(to_the_end=False)
    assert re.search(r"^\d+ of 25 directions seen, noise 0\.0\d\d mm$", capsys.readouterr().out, re.M)
    assert Path("calibrated.yaml").is_file()


@pytest.mark.long
@pytest.mark.parametrize("path", [each for each in PAGES if SLOW in each.read_text(encoding="utf-8")], ids=_name)
def test_what_takes_its_time_runs_too(page, path: Path) -> None:
    page(path).run(to_the_end=True)
    text = path.read_text(encoding="utf-8")
    for folder in QUOTED.get(path.name, ()):
        truth = json.loads(Path(folder, "results.json").read_text(encoding="utf-8"))["accuracy"]["truth"]
        for state in ("before", "after"):
            (size,) = (found["rms"] for quantity, found in truth[state].items() if quantity.endswith("_mm"))
            assert f"{number(size)} mm" in text, f"{folder}: {state} it is {number(size)} mm rms"


def test_every_kind_of_instrument_has_its_page() -> None:
    assert {path.stem for path in (DOCS / "instruments").glob("*.md")} == {*KINDS, "index"}


def test_every_command_has_its_place_on_the_page_of_commands() -> None:
    text = (DOCS / "commands.md").read_text(encoding="utf-8")
    names = typer.main.get_command(cli.app).commands
    assert not [name for name in names if f"`symcal {name}" not in text]


def test_pages_name_modules_that_are_there() -> None:
    for path in PAGES:
        for name in re.findall(r"`symcal/([\w/]+\.py)`", path.read_text(encoding="utf-8")):
            assert (ROOT / "symcal" / name).is_file(), f"{_name(path)} names symcal/{name}"
