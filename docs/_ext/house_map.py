"""The map of the house, from what is true: the import contract's floors and the first sentence of every room."""

import ast
import tomllib
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]


def rooms() -> list[tuple[str, str]]:
    """Every room and what it is for, from the bottom floor up."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    found = []
    for floor in reversed(contracts[0]["layers"]):
        for room in map(str.strip, floor.split("|")):
            place = ROOT / "symcal" / room
            source = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
            said = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
            found.append((room, " ".join(said.split("\n\n")[0].split())))
    return found


def write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "_made"
    folder.mkdir(exist_ok=True)
    lines = [f"| `{room}` | {said.replace('|', ' ').replace('[', '').replace(']', '')} |" for room, said in rooms()]
    table = "\n".join(["| room | what is in it |", "| --- | --- |", *lines])
    (folder / "rooms.md").write_text(table + "\n", encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True}
