"""Names from robot files in exported C: identifiers, comments, and names that mean harm; unusual robots."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_build import needs_make, self_test
from c_robots import handling
from hypothesis import given
from hypothesis import strategies as st
from strategies import random_robot

from symcal.errors import InputError, RefusedError
from symcal.export.c import MANIFEST, export_c
from symcal.export.c.names import LENGTH, identifier, identifiers, printable
from symcal.robot.robot import Joint, Link, Robot

# ---------------------------------------------------------------------------------------------------- names and numbers

NASTY = [
    '"; rm -rf /',
    "int",
    "日本",
    "x" * 300,
    "q",
    "*/ #error",
    "??/",
    "a\\\nb",
    "limit",
    "q_out",
    "",
    "x" * 299 + "y",
]


@needs_make
@pytest.mark.parametrize("name", ['"; rm -rf ~ #$(touch harm)`touch harm`', "int", "日本\u202e*/", "math", "9" * 300])
def test_names_that_mean_harm(name: str, tmp_path: Path) -> None:
    one = handling()
    names = [*NASTY[:4], "q"] if name != "math" else ["LIMIT", "limit", "errors", "*/ int x; /*", "a\\"]
    links = tuple(Link(replace(link.joint, name=n), link.parameters) for link, n in zip(one.links, names, strict=True))
    export = export_c(replace(one, name=name, links=links), tmp_path / "out")
    assert self_test(export.folder, optimisation="-O0").count("self-test passed") == 2
    assert {path.name for path in tmp_path.iterdir()} == {"out"}
    assert not list(tmp_path.rglob("harm"))
    assert json.loads((export.folder / MANIFEST).read_text(encoding="utf-8"))["robot"] == name


def test_identifiers_differ() -> None:
    names = identifiers(NASTY, "joint")
    assert len(set(names)) == len(NASTY)
    assert names[1] == "int"
    assert names[2] == "joint"


@given(st.text(max_size=400))
def test_any_text_becomes_an_identifier(name: str) -> None:
    plain = identifier(name, "robot")
    assert re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", plain)
    assert len(plain) <= LENGTH
    assert identifier(plain, "robot") == plain


@given(st.text(max_size=400))
def test_any_text_can_stand_in_a_comment(name: str) -> None:
    shown = printable(name)
    assert shown.isascii()
    assert shown.isprintable() or not shown
    assert not set(shown) & set("*/\\?\"'`|$#@")
    assert len(shown) < 600


@needs_make
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_any_robot(seed: int, tmp_path: Path) -> None:
    """Signs, ratios, offsets, missing parameters, joints without limits."""
    self_test(
        export_c(
            random_robot(np.random.default_rng(seed), dof=2 + seed), tmp_path / "c", prefix="any", force=True
        ).folder,
        optimisation="-O0",
    )


@needs_make
def test_a_gantry_without_link_parameters(tmp_path: Path) -> None:
    one = Robot("gantry", "standard", tuple(Link(Joint("prismatic", n, -100.0, 100.0), {}) for n in "z"))
    self_test(export_c(one, tmp_path / "c").folder, optimisation="-O0")


def test_numbers_that_no_float_holds(tmp_path: Path) -> None:
    one = handling()
    links = (*one.links[:4], Link(one.links[4].joint, {**one.links[4].parameters, "d": 1e39}))
    with pytest.raises(RefusedError, match="single precision"):
        export_c(replace(one, links=links), tmp_path / "c")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("prefix", ["", "Robot", "a-b", "1a", "a__b", "a" * 30, "ä"])
def test_prefixes_that_are_no_identifiers(prefix: str, paper_robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="prefix"):
        export_c(paper_robot, tmp_path / "c", prefix=prefix)
