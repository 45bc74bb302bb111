"""The results.json of an identification, as far as other commands read it again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from symcal.calibration import results
from symcal.documents.document import Loose, dotted
from symcal.documents.read import CONTROL, DOCUMENT_LIMIT, read_text
from symcal.errors import InputError


class _Parameter(Loose):
    error: float


class _Noise(Loose):
    sigma: float
    unit: str


class _Identification(Loose):
    parameters: dict[str, _Parameter]
    noise: dict[str, _Noise] = Field(default_factory=dict)


class _Identifiability(Loose):
    parameters: int | None = None


class _Measurement(Loose):
    poses: dict[str, int] = Field(default_factory=dict)
    quantity: str = ""
    unit: str = ""


class _Reason(Loose):
    text: str


class _Decision(Loose):
    accepted: bool
    reasons: list[_Reason]


class _Statistics(Loose):
    rms: float
    p95: float


class _Results(Loose):
    title: str = ""
    against: str | None = None
    identification: _Identification
    identifiability: _Identifiability = _Identifiability()
    measurement: _Measurement = _Measurement()
    decision: _Decision | None = None
    accuracy: dict[str, dict[str, Any]] = Field(default_factory=dict)


def read_results(path: Path) -> Mapping[str, Any]:
    """The content of a results.json of an identification.

    Raises:
        InputError: it cannot be read, is of another version or of another command, or was changed into something that
            no run writes.
    """
    text = read_text(path, DOCUMENT_LIMIT)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("this is not the JSON that a run writes", file=path) from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != results.SCHEMA:
        message = "these are not results that this version of symcal reads"
        raise InputError(message, file=path, key="schema", found=schema, allowed=(results.SCHEMA,))
    if not isinstance(content.get("identification"), dict):
        raise InputError("these are not the results of an identification", file=path)
    try:
        _Results.model_validate(content)
    except ValidationError as error:
        problem = error.errors()[0]
        message = f"this is not what a run writes ({problem['msg'].lower()})"
        raise InputError(message, file=path, key=dotted(problem["loc"])) from None
    if any(CONTROL.search(each) for each in _texts(content)):
        raise InputError("a control character in this text", file=path)
    return dict(content)


def _texts(value: object) -> list[str]:
    if isinstance(value, str):
        return [value]
    items = [*value, *value.values()] if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [text for inside in items for text in _texts(inside)]


def size_of(content: Mapping[str, Any], part: str, state: str, quantity: str) -> dict[str, float]:
    """Statistics of errors, mm or deg as the quantity's name says.

    Raises:
        KeyError, TypeError, ValueError: the results have none.
    """
    facts = content["accuracy"][part][state][quantity]
    return _Statistics.model_validate(facts).model_dump()
