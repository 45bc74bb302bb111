"""A run beside an earlier one: what became faster."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from symcal.bench.bench import SCHEMA
from symcal.bench.tables import TextTable, duration, times
from symcal.documents.read import TABLE_LIMIT, read_text
from symcal.errors import InputError

_SAME = ("processor", "compiler", "kernels", "python")


def read_bench(path: Path) -> dict[str, Any]:
    """The content of a bench.json.

    Raises:
        InputError: it cannot be read or is none.
    """
    text = read_text(path, TABLE_LIMIT)
    try:
        content = json.loads(text)
        if content["schema"] != SCHEMA:
            raise InputError(
                "not a bench of this version", file=path, key="schema", found=content["schema"], allowed=[SCHEMA]
            )
        list(_times(content))
        {key: content["machine"][key] for key in (*_SAME, "packages")}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError("this is no bench.json of `symcal bench`", file=path) from None
    return dict(content)


def against(new: Mapping[str, Any], old: Mapping[str, Any]) -> TextTable:
    """Times of both, and how many times as fast the new one is; the second such number is over the reference of its
    own run, and so without what the two machines differ by."""
    before = {key: (seconds, ratio) for key, seconds, ratio in _times(old)}
    rows = []
    for key, seconds, ratio in _times(new):
        if key not in before:
            continue
        was, was_ratio = before[key]
        relative = times(ratio / was_ratio) if ratio and was_ratio else ""
        rows.append((": ".join(key), duration(was), duration(seconds), times(was / seconds), relative))
    notes = [
        f"another {key}: {old['machine'][key]}, now {new['machine'][key]}"
        for key in _SAME
        if old["machine"][key] != new["machine"][key]
    ]
    if old["machine"]["packages"] != new["machine"]["packages"]:
        notes.append(f"other packages: {_versions(old)}, now {_versions(new)}")
    if not rows:
        notes.append("the two runs have nothing in common")
    heads = ("", "before", "now", "times as fast", "beside its reference")
    return TextTable("against the earlier run", heads, tuple(rows), tuple(notes))


def _versions(content: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {found}" for name, found in content["machine"]["packages"].items())


def _times(content: Mapping[str, Any]) -> Iterator[tuple[tuple[str, str], float, float | None]]:
    for contest in content["contests"]:
        for entry in contest["entries"]:
            ratio = entry["ratio"]
            own = None if ratio is None or contest["subject"] == "commands" else float(ratio["median"])
            yield (str(contest["name"]), str(entry["name"])), float(entry["seconds"]["median"]), own
    for panel in content["growth"]:
        for curve in panel["curves"]:
            for size, seconds in zip(curve["sizes"], curve["seconds"], strict=True):
                yield (f"{panel['name']}, {size} {panel['variable']}", str(curve["name"])), float(seconds), None
