"""What is told about the package agrees with pyproject.toml, and whatever is read at run time is shipped."""

from __future__ import annotations

import re
import tomllib
from fnmatch import fnmatch
from itertools import chain
from pathlib import Path

import yaml
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def _lowest(requirement: Requirement) -> str:
    (bound,) = (each.version for each in requirement.specifier if each.operator == ">=")
    return bound


def test_the_oldest_packages_are_those_of_the_bounds() -> None:
    optional = chain.from_iterable(PROJECT["project"]["optional-dependencies"].values())
    required = [Requirement(text) for text in PROJECT["project"]["dependencies"]]
    bounds = {each.name: each for each in map(Requirement, optional)} | {each.name: each for each in required}
    lines = (ROOT / ".ci" / "constraints-lowest.txt").read_text(encoding="utf-8").splitlines()
    tried = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert {each.name for each in required} <= tried.keys()
    assert tried == {name: _lowest(bounds[name]) for name in tried}


def test_the_citation_is_of_this_package() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    asked = {"cff-version", "message", "title", "authors"}  # by the schema of 1.2.0
    assert asked <= cited.keys()
    told = PROJECT["project"]
    assert (cited["title"], cited["version"], cited["license"]) == (told["name"], told["version"], told["license"])


def test_every_file_that_is_no_module_is_shipped() -> None:
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["symcal"]
    room = ROOT / "symcal"
    others = [p.relative_to(room) for p in room.rglob("*") if p.is_file() and p.suffix not in (".py", ".pyc")]
    for name in others:
        shapes = [p.replace("**/", "") for p in patterns if "**/" in p] + patterns
        assert any(fnmatch(name.name, p) or fnmatch(name.as_posix(), p) for p in shapes), name


def test_the_contributors_page_names_files_that_are_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:symcal|tests|\.ci)/[\w./-]+)`", text)
    assert named
    assert not [name for name in named if not (ROOT / name).exists()]
