"""Every key that a docstring cites is in the list of references, and every entry is cited."""

import re
from pathlib import Path

import symcal

PACKAGE = Path(symcal.__file__).parent


def test_cited_keys_and_references_are_the_same() -> None:
    cited = {
        key
        for path in PACKAGE.rglob("*")
        if path.suffix in (".py", ".typ")
        for key in re.findall(r"\[([A-Z][A-Za-z]+(?:19|20)\d{2})\]", path.read_text(encoding="utf-8"))
    }
    listed = set(re.findall(r"^\| (\w+\d{4}) \|", (PACKAGE / "REFERENCES.md").read_text(encoding="utf-8"), re.M))
    assert cited == listed
