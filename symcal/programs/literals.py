"""Targets of a controller's program that stand in it as numbers, and those that do not.

A target is corrected only where its meaning is plain: numbers in a motion instruction, or a name that is given numbers
once and of which every use is directly the target of a motion instruction. Everything else (variables, offsets,
arithmetic, relative motions) is left and listed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal as One

Kind = One["joints", "frame"]
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass(frozen=True, slots=True)
class Literal:
    """Numbers of a target in a text.

    start, end: where they stand. values: as they are written. posture: what the target says of the arm's posture, by
    joint from 0: the range of its angle in deg. text: what is written there.
    """

    kind: Kind
    start: int
    end: int
    values: tuple[float, ...]
    text: str
    posture: Mapping[int, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Left:
    """A target that is left as it was: its line, what stands there, and why."""

    line: int
    text: str
    why: str


@dataclass(frozen=True, slots=True)
class Found:
    """Targets of a program in the order of its text."""

    literals: tuple[Literal, ...]
    left: tuple[Left, ...]


@dataclass(frozen=True, slots=True)
class Grammar:
    """How a language writes motions; patterns ignore case where the language does.

    comment: what starts one. motion: an instruction up to its first target. target: finds the numbers of a target at a
    place, if there are any. declaration: a name that is given a target, up to that. stop: what follows a target that is
    a name. relative: motions by so much.
    """

    comment: str
    motion: re.Pattern[str]
    target: Callable[[str, int], Literal | None]
    declaration: re.Pattern[str]
    stop: re.Pattern[str]
    relative: re.Pattern[str]
    ignore_case: bool


def find_literals(text: str, grammar: Grammar) -> Found:
    """All targets of a program."""
    code = _without_words(text, grammar.comment)
    given: dict[str, list[tuple[str, Literal]]] = {}
    for match in grammar.declaration.finditer(code):
        literal = grammar.target(code, match.end())
        if literal is not None:
            given.setdefault(_key(match["name"], grammar), []).append((match["name"], literal))
    literals: list[Literal] = []
    left: list[Left] = []
    direct = dict.fromkeys(given, 0)
    for motion in grammar.motion.finditer(code):
        for at in _targets(code, motion, grammar):
            name = re.compile(r"[\w$]+").match(code, at)
            key = None if name is None or not grammar.stop.match(code, name.end()) else _key(name[0], grammar)
            inline = grammar.target(code, at)
            if grammar.relative.match(motion[0]):
                left.append(Left(line_of(text, motion.start()), _said(text, code, motion.start()), "a relative motion"))
            elif inline is not None:
                literals.append(inline)
            elif key in direct:
                direct[key] += 1
            else:
                unknown = "not numbers, nor a name that is given numbers in this file"
                left.append(Left(line_of(text, motion.start()), _said(text, code, motion.start()), unknown))
    for key, places in given.items():
        why = _why_left(code, places, direct[key], grammar)
        if why is None:
            literals.append(places[0][1])
        else:
            left.append(Left(line_of(text, places[0][1].start), places[0][1].text, why))
    return Found(tuple(sorted(literals, key=lambda each: each.start)), tuple(sorted(left, key=lambda each: each.line)))


def _why_left(code: str, places: Sequence[tuple[str, Literal]], direct: int, grammar: Grammar) -> str | None:
    """Why a name's numbers are not corrected; None where they are.

    Args:
        direct: how many motions go to it.
    """
    name = places[0][0]
    mentions = re.findall(rf"(?<![\w$]){re.escape(name)}(?![\w$])", code, re.I if grammar.ignore_case else 0)
    if len(places) > 1:
        return f"{name} is given numbers {len(places)} times"
    if not direct:
        return f"nothing in this file moves to {name}"
    if len(mentions) > 1 + direct:
        return f"{name} is used or changed elsewhere than as the target of a motion"
    return None


def numbers(text: str, count: int) -> tuple[float, ...] | None:
    """Exactly so many numbers between commas; None where there is anything else."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != count or not all(re.fullmatch(NUMBER, part) for part in parts):
        return None
    return tuple(float(part) for part in parts)


def _targets(code: str, motion: re.Match[str], grammar: Grammar) -> Sequence[int]:
    """Where the targets of a motion begin: circular ones have two."""
    at = motion.end()
    if not re.search(r"(?:MoveC|movec|CIRC)\b", motion[0], re.IGNORECASE):
        return (at,)
    first = grammar.target(code, at)
    end = first.end if first is not None else at
    comma = re.compile(r"[^,;\n]*,\s*").match(code, end)
    return (at,) if comma is None else (at, comma.end())


def line_of(text: str, at: int) -> int:
    """The line of a place in a text, from 1."""
    return text.count("\n", 0, at) + 1


def _said(text: str, code: str, start: int) -> str:
    """The instruction, in a line and not too long."""
    end = min((place for place in (code.find("\n", start), code.find(";", start)) if place >= 0), default=len(code))
    said = " ".join(text[start:end].split())
    return said if len(said) <= 80 else said[:77] + "..."


def _without_words(text: str, comment: str) -> str:
    """The text with comments and strings blanked, every other letter in its place."""
    pattern = re.compile(rf'"(?:[^"\n]*)"|{re.escape(comment)}[^\n]*')
    return pattern.sub(lambda found: " " * len(found[0]), text)


def _key(name: str, grammar: Grammar) -> str:
    return name.casefold() if grammar.ignore_case else name
