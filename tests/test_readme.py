"""The README: its commands are those that continuous integration runs, and its numbers are those that configs give."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from goldens import FOLDER, REAL, key

from symcal.words import number

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"


def test_the_two_commands_name_files_that_are_there() -> None:
    commands = re.findall(r"^pip install .*$", README.read_text(encoding="utf-8"), re.M)
    assert len(commands) == 2
    assert (README.parent / commands[0].split()[-1]).is_file()
    assert commands[1].endswith("pytest -n auto")


def test_what_it_links_to_and_shows_is_there() -> None:
    linked = re.findall(r"\]\((?!https?:)([^)#]+)\)", README.read_text(encoding="utf-8"))
    assert linked
    assert not [name for name in linked if not (ROOT / name).is_file()]


def golden(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((FOLDER / f"{key(name)}.json").read_text(encoding="utf-8"))
    return found


def test_every_real_arm_has_its_row_with_the_numbers_that_its_command_gives() -> None:
    rows = re.findall(r"^\|(.+)\| `symcal run configs/(real/\w+)\.yaml` \|$", README.read_text(encoding="utf-8"), re.M)
    assert sorted(name for _, name in rows) == sorted(REAL)
    for line, name in rows:
        _, read_by, poses, before, _, after = (cell.strip(" *") for cell in line.split("|")[:6])
        accuracy, decision = (golden(name)[part] for part in ("accuracy", "decision"))
        part = accuracy.get("test", accuracy.get("cross_validation"))
        sizes = [part[state]["position_mm"] for state in ("before", "after")]
        said = [f"{number(size['mean'])} / {number(size['rms'])}" for size in sizes]
        assert [before, after.removesuffix(", refused")] == said
        assert after.endswith("refused") == decision.startswith("refused")
        points = int((re.findall(r"(\d+) markers", read_by) or ["1"])[0])
        counts = [accuracy["train"]["after"]["position_mm"]["count"], sizes[1]["count"]]
        told = [int(count) for count in re.findall(r"\d+", poses)]
        assert told == [count // points for count in counts][: len(told)]


@pytest.mark.parametrize(
    ("page", "name", "numbers"),
    [
        (
            "pose",
            "franka_fr3",
            {"after position_mm rms": "1.41", "before position_mm rms": "4.74", "after orientation_deg rms": "0.207"},
        ),
        ("position", "ur5_tracker", {"after position_mm mean": "0.0867", "before position_mm mean": "0.487"}),
        ("fixed_point", "panda_1", {"after position_mm mean": "0.642", "before position_mm mean": "8.63"}),
    ],
)
def test_the_pages_of_instruments_quote_them_too(page: str, name: str, numbers: dict[str, str]) -> None:
    text = (ROOT / "docs" / "instruments" / f"{page}.md").read_text(encoding="utf-8")
    test = golden(f"real/{name}")["accuracy"]["test"]
    for place, said in numbers.items():
        state, quantity, statistic = place.split()
        assert number(test[state][quantity][statistic]) == said
        assert said in text
