"""Names of files that are made of names of things: robots, instruments, sessions, images."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable

LONGEST = 100
"""Of a name without its suffix, in bytes of UTF-8; file systems take 255, some with a path before it less. Ours."""

_PLAIN = re.compile(r"\w(?:[\w .+-]*[\w+-])?")
_DEVICES = frozenset({"con", "prn", "aux", "nul", *(f"{port}{i}" for port in ("com", "lpt") for i in range(10))})


def file_name(name: str) -> str:
    """One component of a path that any file system takes: the name itself where it can be, else what can be kept of it
    with a hash of the whole.

    A name is kept that starts with a letter, digit or underscore, goes on with these, spaces, `.`, `+`, `-`, ends in no
    space or dot, is at most `LONGEST` bytes, and is none of the devices that Windows reserves. Whatever else is in a
    name (`/`, `..`, NUL, a drive) never reaches the file system.
    """
    if _PLAIN.fullmatch(name) and not _reserved(name) and len(name.encode("utf-8", "replace")) <= LONGEST:
        return name
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:10]
    words = re.sub(r"[^\w+-]+", "_", name).strip("_-+").encode("utf-8", "ignore")[: LONGEST - 11]
    kept = words.decode("utf-8", "ignore")
    return f"{kept}-{digest}" if _PLAIN.fullmatch(kept) else f"_{digest}"


def file_names(names: Iterable[str]) -> dict[str, str]:
    """`file_name` of every one; no two are alike, not even where capitals do not count."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in dict.fromkeys(names):
        stem = own = file_name(name)
        count = 1
        while own.casefold() in taken:
            count += 1
            own = f"{stem}-{count}"
        taken.add(own.casefold())
        found[name] = own
    return found


def _reserved(name: str) -> bool:
    return name.partition(".")[0].strip().casefold() in _DEVICES
