# ruff: noqa: SIM905 - lists of words are read more easily as text
"""Inputs made worse: bytes flipped, lines moved, words replaced by nasty ones, files cut and spliced; in documents
values of another kind, which every parser takes."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml

Rng = np.random.Generator

NASTY = (
    *"1e308 -1e308 1e400 1e-320 1e12 1e16 -0 0 -1 1 nan .nan inf .inf -.inf 999999999999999999 2147483648".split(),
    *"4294967296 1_000 0x10 1,5 1e q1_deg pose x_mm deg '' null ~ true no [] {} [[]] *x &x !!int !x << | > ---".split(),
    *"... ../../../etc/passwd /dev/zero / ~nobody/x $HOME/x $UNSET/x ${x} {{x}} %s%n &amp; &lol; <x> </robot>".split(),
    *("[1, 2, 3]", "{a: 1}", "&x [*x]", "!!python/object/apply:os.system [ls]", "? ", "- ", ": ", "# ", "%YAML 9.9"),
    *("[" * 60 + "]" * 60, "[" * 5000, "{" * 5000, "- " * 3000, "a: " * 500, "9" * 400, "9" * 5000, "x" * 10_000),
    *("1" * 100_000 + "x", "<!DOCTYPE x [<!ENTITY a 'b'>]>", "<![CDATA[", "a\x00b", "\x1b[31m", "ß" * 300, "٣", "²"),
    *("\u202e", "\u2028", "\x85", "\ufeff", "\ufffe", "\t", "\r", "\r\n", ",", ";", "\n", '"', "'", '""'),
)

_WORD = re.compile(rb"[A-Za-z0-9_.+\-]+")


def mutated(rng: Rng, seeds: Sequence[bytes]) -> bytes:
    """One of the seeds after one to four mutations, of text or of bytes."""
    data = seeds[rng.integers(len(seeds))]
    for _ in range(rng.integers(1, 5)):
        data = _MUTATIONS[rng.integers(len(_MUTATIONS))](rng, data, seeds)
    return data


def _flip(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    out = bytearray(data)
    for _i in range(rng.integers(1, 9)):
        if out:
            out[rng.integers(len(out))] = rng.integers(256)
    return bytes(out)


def _cut(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    return data[: rng.integers(len(data) + 1)]


def _delete(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    a, b = sorted(rng.integers(len(data) + 1, size=2))
    return data[:a] + data[min(b, a + rng.integers(1, 200)) :]


def _lines(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    i, j = rng.integers(len(lines), size=2)
    match rng.integers(4):
        case 0:
            lines[i], lines[j] = lines[j], lines[i]
        case 1:
            del lines[i]
        case 2:
            lines.insert(j, lines[i])
        case _:
            lines[i] = lines[i] * int(rng.integers(2, 300))
    return b"".join(lines)


def _token(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    """A word replaced by a nasty one, or by another word of the file."""
    words = list(_WORD.finditer(data))
    if not words:
        return data
    at = words[rng.integers(len(words))]
    nasty = NASTY[rng.integers(len(NASTY))].encode("utf-8", "surrogatepass")
    new = nasty if rng.random() < 0.75 else words[rng.integers(len(words))].group()
    return data[: at.start()] + new + data[at.end() :]


def _insert(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    at = rng.integers(len(data) + 1)
    return data[:at] + NASTY[rng.integers(len(NASTY))].encode("utf-8", "surrogatepass") + data[at:]


def _number(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    """A number of another size or sign: what passes every parser and must be caught by meaning."""
    numbers = list(re.finditer(rb"(?<![A-Za-z_])\d+(?:\.\d+)?", data))
    if not numbers:
        return data
    at = numbers[rng.integers(len(numbers))]
    value = float(at.group()[:300]) * float(rng.choice([-1, 0, 1e-12, 1e-3, 10, 1e3, 1e6, 1e11])) + float(
        rng.choice([0, 0, 1e-9, 1])
    )
    return data[: at.start()] + f"{value:.12g}".encode() + data[at.end() :]


def _splice(rng: Rng, data: bytes, seeds: Sequence[bytes]) -> bytes:
    other = seeds[rng.integers(len(seeds))]
    return data[: rng.integers(len(data) + 1)] + other[rng.integers(len(other) + 1) :]


def _encoded(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    text = data.decode("utf-8", "replace")
    return text.encode(str(rng.choice(["utf-16", "utf-8-sig", "latin-1", "utf-32"])), "replace")


_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 3, 0.5, 1e12, -1e-300, "", "x", "position", [], {}, [[]], [{}], {"x": 1}, [1.0, 2.0]),
    *([None], [3, 4, 5], ["x", "x"], {"": None}, {"rms": None}, [[1.0, 0.0], [0.0, 1.0]], {"theta_1": "x"}),
)


def _value(rng: Rng, data: bytes, _: Sequence[bytes]) -> bytes:
    """A value of a document taken out, changed for one of another kind, or for another of the same document."""
    document = _document(data)
    if not isinstance(document, (dict, list)) or not document:
        return data
    inside, key = _place(rng, document)
    match rng.integers(4):
        case 0:
            del inside[key]
        case 1:
            other, its = _place(rng, document)
            inside[key] = json.loads(json.dumps(other[its]))
        case _:
            inside[key] = _VALUES[rng.integers(len(_VALUES))]
    return json.dumps(document, indent=1).encode()


def _document(data: bytes) -> Any:
    """What JSON or YAML says, as far as JSON can say it; None where it is neither."""
    if data.lstrip()[:1] not in (b"{", b"[") and b": " not in data[:2000]:
        return None
    for read in (json.loads, lambda text: yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))):
        try:
            document = read(data)
            json.dumps(document)
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError, yaml.YAMLError):
            continue
        return document
    return None


def _place(rng: Rng, document: Any) -> tuple[Any, Any]:
    """A mapping or list in a document and one of its keys, reached from the top: what is rare is met as often as what
    is long."""
    inside = document
    while True:
        key = list(inside)[rng.integers(len(inside))] if isinstance(inside, dict) else int(rng.integers(len(inside)))
        deeper = inside[key]
        if not isinstance(deeper, (dict, list)) or not deeper or rng.random() < 0.3:
            return inside, key
        inside = deeper


_MUTATIONS = (
    *(_value,) * 5,
    *(_token,) * 5,
    *(_number,) * 4,
    *(_lines,) * 3,
    *(_flip,) * 2,
    *(_insert,) * 2,
    *(_splice, _cut, _delete),
    _encoded,
)
