"""What makes a study this one and no other: a kept trial counts only if every word that decided its numbers stands."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from symcal.config.trials import StudyFile
from symcal.words import listed

_MOST = 4  # differences that are told


def identity(file: StudyFile, inputs: Sequence[Path], portable: bool) -> dict[str, str]:
    """What the files say, by key: of the study's own file the keys that decide numbers, of others every byte.

    Args:
        inputs: the study's own file, then those that it reads.
    """
    said: dict[str, Any] = file.model_dump(mode="json", by_alias=True, exclude={"title", "outputs", "name"})
    said["judge"] = {key: said["judge"][key] for key in ("test_poses", "against")}
    found = dict(_flat(said)) | {"--portable": json.dumps(portable)}
    for i, path in enumerate(path for path in inputs[1:] if path.is_file()):
        found[f"file {i + 1}, {path.name}"] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def _flat(said: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, str]]:
    for key, value in said.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", json.dumps(value)


def difference(kept: Mapping[str, str], now: Mapping[str, str]) -> str:
    """In what two studies differ, in words; empty if they are the same."""
    told = []
    for key in sorted(kept.keys() | now.keys()):
        if kept.get(key) == now.get(key):
            continue
        if key.startswith("file "):
            told.append(f"{key.partition(', ')[2]} has changed")
        else:
            told.append(f"{key} was {kept.get(key, 'not there')} and is {now.get(key, 'not there')}")
    more = len(told) - _MOST
    return listed(told[:_MOST] + ([f"{more} more"] if more > 0 else []))
