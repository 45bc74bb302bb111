"""Strict YAML documents: read without running code, each value with its line, one clear error when a thing is wrong."""

from __future__ import annotations

import math
import os
import re
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from symcal.documents.read import CONTROL, DOCUMENT_LIMIT, read_text
from symcal.documents.yaml_dialect import TAG, compose, written
from symcal.errors import InputError
from symcal.outputs.whole_file import write_whole

Key = tuple[str | int, ...]

LARGEST = 1e15
"""Beyond this nothing in a file is a length, an angle or a pixel, in whatever unit, nor the square of one that is not
known; its powers would overflow."""

_LONGEST_KEY = 20  # parts; `measurements.wire.target.points.P` has five
Model = TypeVar("Model", bound=BaseModel)


class Strict(BaseModel):
    """Base of every file schema: unknown keys refused, no coercion of strings to numbers, NaN and infinity refused.

    Schemas are built when a file is read with them (`defer_build`). So that none is built earlier, a default that is a
    model is written `Model.model_construct()`. Schemas go without `from __future__ import annotations`: types would be
    texts that pydantic has to read back, and the modules would take a third longer to load.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, populate_by_name=True, defer_build=True
    )


class Loose(BaseModel):
    """Base of what a run leaves, as far as it is read again: known keys checked as strictly, others kept."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)


@dataclass(frozen=True, slots=True)
class Document:
    """A YAML file as plain data, with the line of every key and item; line 0: set on the command line."""

    path: Path
    data: dict[str, Any]
    lines: Mapping[Key, int]

    def with_value(self, key: Key, value: object) -> Document:
        """This document with a value from the command line (`--set`), which errors then blame.

        Raises:
            InputError: a part of the key holds a plain value, or the key has more parts than any that means something.
        """
        if len(key) > _LONGEST_KEY:
            raise InputError(f"a key of more than {_LONGEST_KEY} parts", key="--set", found=dotted(key))

        def put(data: object, n: int) -> object:
            if n == len(key):
                return value
            if not isinstance(data, dict):
                raise InputError(f"'{dotted(key[:n])}' has no keys of its own", key=f"--set {dotted(key)}")
            return data | {key[n]: put(data.get(key[n], {}), n + 1)}

        lines = {k: line for k, line in self.lines.items() if k[: len(key)] != key}
        lines |= {key[:n]: 0 for n in range(1, len(key) + 1) if key[:n] not in lines}
        return Document(self.path, typing.cast("dict[str, Any]", put(self.data, 0)), lines)

    def line(self, key: Key) -> int | None:
        """Line of the value at ``key``, or of the nearest parent that stands in the file."""
        while key not in self.lines and key:
            key = key[:-1]
        return self.lines.get(key)

    def error(self, message: str, key: Key, *, found: object = None, allowed: typing.Iterable[str] = ()) -> InputError:
        """An `InputError` that names this file, the key and its line, or the option that set it."""
        line = self.line(key)
        if line == 0:
            return InputError(message, key=f"--set {dotted(key)}", found=found, allowed=allowed)
        return InputError(message, file=self.path, line=line, key=dotted(key), found=found, allowed=allowed)

    def resolve(self, path: str, key: Key) -> Path:
        """A path written in this file: environment variables expanded, relative to the file's folder.

        Raises:
            InputError: a variable is not set, or the text cannot be a path.
        """
        expanded = os.path.expandvars(path)
        missing = re.search(r"\$\{?(\w+)\}?", expanded)
        if missing:
            raise self.error(f"the environment variable {missing.group(1)} in this path is not set", key, found=path)
        try:
            return (self.path.parent / Path(expanded).expanduser()).resolve()
        except (OSError, RuntimeError, ValueError) as error:
            raise self.error(f"not a path that can be used: {error}", key, found=path) from None


def dotted(key: Key) -> str:
    """`('links', 2, 'alpha')` as `links[2].alpha`."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def read_document(path: Path | str, listed: str | None = None) -> Document:
    """Read a YAML mapping; never runs code.

    Args:
        listed: key that a list at the top is taken to stand under; without it, none may stand there.
    Raises:
        InputError: no such file, not text, not YAML, a key twice, or not a mapping at the top.
    """
    path = Path(path)
    text = read_text(path, DOCUMENT_LIMIT)
    try:
        loader, node = compose(text)
        under: Key = (listed,) if listed is not None and isinstance(node, yaml.SequenceNode) else ()
        if not isinstance(node, yaml.SequenceNode if under else yaml.MappingNode):
            raise InputError("expected 'key: value' lines at the top of the file", file=path, line=1)
        lines: dict[Key, int] = {(): 1} if under else {}
        _walk(node, under, lines, path)
        data = loader.construct_document(node)
        if under:
            data = {listed: data}
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError("a control character in the text: is this a YAML file?", file=path, line=line) from None
    except yaml.MarkedYAMLError as error:
        raise _invalid(error, text, path) from None
    return Document(path, data, lines)


LINE_END = re.compile("\r\n|[\r\n\x85\u2028\u2029]")
"""What ends a line, as YAML counts them."""


def _invalid(error: yaml.MarkedYAMLError, text: str, path: Path) -> InputError:
    """The parser's error in words that help."""
    mark, problem = error.problem_mark, str(error.problem)
    if mark is None:
        return InputError(f"not valid YAML: {problem}", file=path)
    if "nesting" in problem:  # libyaml's own limit
        problem = "nested too deeply"
    elif any(line.lstrip(" ").startswith("\t") for line in LINE_END.split(text)[mark.line : mark.line + 1]):
        problem = "indent with spaces, not tabs"
    return InputError(f"not valid YAML: {problem}", file=path, line=mark.line + 1)


def _walk(node: yaml.Node, key: Key, lines: dict[Key, int], path: Path) -> None:
    lines.setdefault(key, node.start_mark.line + 1)
    if isinstance(node, yaml.MappingNode):
        for name, value in node.value:
            if not isinstance(name, yaml.ScalarNode):
                raise InputError("a key must be a plain word", file=path, line=name.start_mark.line + 1)
            name.tag = TAG + "str"  # `1:` and `true:` are text as keys
            inner, line = (*key, name.value), name.start_mark.line + 1
            if inner in lines:
                message = f"this key stands here twice (first in line {lines[inner]})"
                raise InputError(message, file=path, line=line, key=dotted(inner))
            lines[inner] = line
            _walk(value, inner, lines, path)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            _walk(value, (*key, index), lines, path)


def validate(document: Document, model: type[Model]) -> Model:
    """The document as a checked, frozen schema object.

    Raises:
        InputError: a number beyond `LARGEST`, a control character; else the first thing wrong, with its line, key and
        the allowed values (further ones are counted).
    """
    _insist_on_plain_values(document, document.data, ())
    try:
        return model.model_validate(document.data)
    except ValidationError as error:
        problems = [p for p in error.errors() if p["type"] == "extra_forbidden"] or error.errors()
        first = min(problems, key=lambda p: document.line(_existing(document, p["loc"])) or 0)
        raise _explain(document, model, first, len(error.errors()) - 1) from None


def _insist_on_plain_values(document: Document, data: object, key: Key) -> None:
    """No number beyond `LARGEST`, but for names of what is random (a seed); no text that steers a terminal."""
    if isinstance(data, dict):
        for name, value in data.items():
            _insist_on_plain_values(document, name, (*key, name))
            _insist_on_plain_values(document, value, (*key, name))
    elif isinstance(data, list):
        for index, value in enumerate(data):
            _insist_on_plain_values(document, value, (*key, index))
    elif isinstance(data, str):
        if CONTROL.search(data):
            raise document.error("a control character in this text", key, found=data)
    elif isinstance(data, (int, float)) and math.isfinite(data) and abs(data) > LARGEST and key[-1:] != ("seed",):
        raise document.error(f"no number here can be larger than {LARGEST:g}", key, found=data)


def _existing(document: Document, loc: Key) -> Key:
    """The loc without the union branch names that pydantic inserts; a branch may be called like a key beside it."""
    found: dict[Key, int] = {(): -1}
    for n, part in enumerate(loc):
        found |= {(*key, part): n for key in found if (*key, part) in document.lines}
    return max(found, key=lambda key: (found[key], len(key)))


_EXPECTED = {
    "too_short": "expected at least {min_length} items",
    "too_long": "expected at most {max_length} items",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "string_too_short": "nothing stands behind this key",
    "string_pattern_mismatch": "not a name that can be used here (pattern {pattern})",
    "finite_number": "the number must be finite",
    "float_type": "expected a number, with neither unit nor quotes",
    "int_type": "expected a whole number",
    "bool_type": "expected true or false",
    "string_type": "expected text (in quotes if it looks like a number)",
    "list_type": "expected a list",
    "dict_type": "expected keys with values",
    "model_type": "expected keys with values",
}


def _explain(document: Document, model: type[BaseModel], problem: ErrorDetails, more: int) -> InputError:
    loc, kind, context = problem["loc"], problem["type"], problem.get("ctx", {})
    key = _existing(document, loc)
    allowed: tuple[str, ...] = ()
    found: object = problem.get("input")
    message = problem["msg"].removeprefix("Value error, ")
    if kind == "extra_forbidden":
        owner = _model_at(model, loc[:-1])
        allowed = tuple(f.alias or name for name, f in owner.model_fields.items()) if owner else ()
        message, found = "unknown key", loc[-1]
    elif kind == "missing":
        owner = _model_at(model, loc[:-1])
        allowed = _choices(owner, loc[-1]) if owner else ()
        # what is missing may be called like a key beside the one that it is missing in
        key, message, found = (*_existing(document, loc[:-1]), loc[-1]), "this key is missing", None
    elif kind in ("literal_error", "enum"):
        message, allowed = "not one of the allowed values", _listed(context["expected"])
    elif kind == "union_tag_invalid":
        key, found = (*key, str(context["discriminator"]).strip("'")), context["tag"]
        message, allowed = "not one of the allowed values", _listed(context["expected_tags"])
    elif kind == "union_tag_not_found":
        key, message, found = (*key, str(context["discriminator"]).strip("'")), "this key is missing", None
    elif isinstance(found, float) and math.isnan(found):
        message = "NaN is not a number that can be used"
    elif kind in _EXPECTED:
        message = _EXPECTED[kind].format(**context) if found is not None else "nothing stands behind this key"
    if isinstance(found, dict) or (isinstance(found, list) and any(isinstance(item, (dict, list)) for item in found)):
        found = None
    if more and kind != "extra_forbidden":
        message += f" ({more} more problem{'s' if more > 1 else ''} in this file)"
    return document.error(message, key, found=found, allowed=allowed)


def _listed(expected: object) -> tuple[str, ...]:
    """The values in pydantic's `'mm', 'm' or 'in'`, or `1 or -1`."""
    return tuple(part.strip("' ") for part in re.split(r",| or ", str(expected)))


def _choices(model: type[BaseModel], part: object) -> tuple[str, ...]:
    """What a field accepts, when its schema lists it."""
    for name, field in model.model_fields.items():
        if part in (name, field.alias) and typing.get_origin(field.annotation) is typing.Literal:
            return tuple(map(str, typing.get_args(field.annotation)))
    return ()


def _model_at(model: type[BaseModel], loc: Key) -> type[BaseModel] | None:
    """The schema class that validates the value at ``loc``; None if no single one does."""
    current: list[Any] = [model]
    for part in loc:
        nxt: list[Any] = []
        for kind in current:
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                for name, field in kind.model_fields.items():
                    if part in (name, field.alias):
                        nxt.extend(_leaves(field.annotation))
        # a loc part that is an index, a mapping's key or a union's branch name keeps the candidates
        current = nxt or current
        tagged = [k for k in current if isinstance(k, type) and issubclass(k, BaseModel) and part in _tags(k)]
        current = tagged or current
    found = [kind for kind in current if isinstance(kind, type) and issubclass(kind, BaseModel)]
    return found[0] if len(found) == 1 else None


def _tags(kind: type[BaseModel]) -> set[object]:
    return {
        value
        for field in kind.model_fields.values()
        if typing.get_origin(field.annotation) is typing.Literal
        for value in typing.get_args(field.annotation)
    } | {kind.__name__}


def _leaves(annotation: Any) -> list[Any]:
    origin = typing.get_origin(annotation)
    if origin is None:
        return [annotation]
    if origin is typing.Literal:
        return []
    arguments = typing.get_args(annotation)
    if origin in (typing.Union, types.UnionType, list, tuple, dict, typing.Annotated):
        return [leaf for argument in arguments for leaf in _leaves(argument)]
    return []


def json_schema(model: type[BaseModel]) -> dict[str, Any]:
    """What may stand in a file, for editors; of every schema of its family first built what was left for later.

    pydantic before 2.14 cannot write a default that is an object of a schema that nobody built.
    """
    families: list[type[BaseModel]] = [Strict, Loose]
    for each in families:
        families.extend(each.__subclasses__())
        each.model_rebuild()
    return model.model_json_schema()


def write_document(path: Path | str, data: Mapping[str, Any]) -> None:
    """Write a YAML mapping that `read_document` reads back to the same numbers.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, document_text(data))


def document_text(data: Mapping[str, Any]) -> str:
    """A mapping as YAML that `read_document` reads back to the same numbers."""
    return written(dict(data))
