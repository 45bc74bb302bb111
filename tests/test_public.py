"""The public names: each is there, has an example that runs, and importing the package loads nothing heavy."""

import doctest
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import symcal as sc
from symcal.instruments import KINDS

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with the shipped configs; kinds of instruments that an example registers are forgotten."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    monkeypatch.chdir(tmp_path)
    before = dict(KINDS)
    yield tmp_path
    for name in set(KINDS) - set(before):
        KINDS.pop(name)


@pytest.mark.parametrize("name", sc.__all__)
@pytest.mark.usefixtures("folder")
def test_every_public_name_has_an_example_that_runs(name: str) -> None:
    said = inspect.getdoc(getattr(sc, name))
    assert said
    test = doctest.DocTestParser().get_doctest(said, {}, name, None, 0)
    assert test.examples, "no example"
    wrong: list[str] = []
    assert doctest.DocTestRunner(verbose=False).run(test, out=wrong.append).failed == 0, "".join(wrong)


def test_the_api_page_has_every_public_name_once() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\.\. auto\w+:: (\w+)$", page, re.M)) == sorted(sc.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        _ = sc.nonsense


def test_import_and_help_load_no_numerical_library() -> None:
    heavy = ("casadi", "matplotlib", "pandas", "cv2")
    code = f"import sys, symcal, symcal.cli; print([m for m in {heavy} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"
