"""Names from robot files as C identifiers, and as text that no comment, string or Markdown can mistake for syntax."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

LENGTH = 24
"""Characters of an identifier that comes from a name: with what is put behind it, readable and below C99's limits."""

_PLAIN = re.compile(r"[A-Za-z0-9 .,:+()_-]")  # no `*`, `/`, `?`, quotes or backslash: they could end a comment


def identifier(name: str, fallback: str) -> str:
    """Lower-case letters, digits and single underscores, starting with a letter; the fallback if nothing is left.

    It may be a keyword (`int`): it is always used with something behind or before it (`int_forward`).
    """
    ascii_only = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode("ascii").lower()
    plain = re.sub(r"[^a-z0-9]+", "_", ascii_only).strip("_")
    if not plain:
        return fallback
    if not plain[0].isalpha():
        plain = f"{fallback}_{plain}"
    return plain[:LENGTH].rstrip("_")


def identifiers(names: Iterable[str], fallback: str) -> tuple[str, ...]:
    """One identifier per name, all different: a number is put behind those that would repeat."""
    taken: list[str] = []
    for name in names:
        plain = candidate = identifier(name, fallback)
        number = 2
        while candidate in taken:
            candidate = f"{plain}_{number}"
            number += 1
        taken.append(candidate)
    return tuple(taken)


def printable(name: str, length: int = 60) -> str:
    """The name in plain ASCII, other characters as `<U+65E5>`; long ones cut and marked so."""
    shown = "".join(c if _PLAIN.match(c) else f"<U+{ord(c):04X}>" for c in name[:length])
    return shown + (" (cut)" if len(name) > length else "")
