"""Docstrings are plain text for people who read the source; here they become reStructuredText.

Formulas in them are indented and hold bars, stars and underscores that would be markup.
"""

import re

from sphinx.application import Sphinx

_SECTION = re.compile(r"(Args|Attributes|Example|Raises|Returns|Source|Yields):")
_ERROR = re.compile(r"\w+Error: ")
_MARKUP = re.compile(r"(`+)([^`]+)\1|[|*\\]|_(?=\W|$)")


def _escaped(line: str) -> str:
    """A line of which nothing is markup but names between backticks, which are code."""
    return _MARKUP.sub(lambda m: f"``{m[2]}``" if m[1] else f"\\{m[0]}", line)


def _plain(_app: Sphinx, _what: str, _name: str, _thing: object, _options: object, lines: list[str]) -> None:
    out: list[str] = []
    sample = section = raises = False  # within an example, shown as it is; 'Args:' and the like, which napoleon reads
    for line in lines:
        if not line.strip():
            sample = False
        elif line.lstrip().startswith(">>>"):
            sample = True
        if _SECTION.fullmatch(line):
            section, raises = True, line.startswith("Raises")
        elif line.strip() and not line.startswith(" "):
            section = raises = False
        text = line if sample else _escaped(line)
        if raises and line.startswith(" ") and not _ERROR.match(line.lstrip()):
            text = "    " + text  # goes on with a sentence, and is no other error
        # an indented line that goes on with a sentence; after an empty line it is a formula and keeps its place
        out.append(text.lstrip() if not (section or sample) and out and out[-1].strip() else text)
    lines[:] = out


def setup(app: Sphinx) -> dict[str, bool]:
    # before napoleon, which makes sections of 'Args:' and would have its own markup escaped
    app.connect("autodoc-process-docstring", _plain, priority=100)
    return {"parallel_read_safe": True}
