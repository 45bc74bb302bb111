"""YAML as the files here use it: the scalars of YAML 1.2, no tags, no aliases; nothing in a file can run code."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml

TAG = "tag:yaml.org,2002:"
_FLOAT = re.compile(
    r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$|^[-+]?\.(?:inf|Inf|INF)$|^\.(?:nan|NaN|NAN)$"
)


_DEEPEST = 50
"""Levels of lists and keys within each other; files here have at most ten."""

_MOST = 200_000
"""Values in a file: its lines are kept too, and a million values would take a GB."""

_HAND_WRITTEN = 2**16
"""Characters up to which a file is read again where libyaml does not understand it."""


class _Dialect(yaml.composer.Composer, yaml.constructor.SafeConstructor, yaml.resolver.Resolver):
    """SafeLoader with YAML 1.2's scalars: 1e-3 is a number, 010 is ten; `on`, `yes` and 12:30 stay text.

    Tags and aliases are refused: files here need neither, and they are how YAML runs code and how a small file becomes
    a huge one. So are more levels and more values than any file here has.
    """

    def __init__(self) -> None:
        yaml.composer.Composer.__init__(self)
        yaml.constructor.SafeConstructor.__init__(self)
        yaml.resolver.Resolver.__init__(self)
        self._depth = self._values = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[attr-defined]
        if isinstance(event, yaml.AliasEvent):
            raise _refused("aliases are not used here: write it out", event)
        if getattr(event, "tag", None):
            raise _refused(f"tags are not used here ({event.tag})", event)
        self._values += 1
        if self._values > _MOST:
            raise _refused(f"more than {_MOST} values", event)
        if self._depth == _DEEPEST:
            raise _refused("nested too deeply", event)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


class Loader(_Dialect, yaml.reader.Reader, yaml.scanner.Scanner, yaml.parser.Parser):
    """The dialect by PyYAML's own parser: it takes `{a:, b: 1}`, and says well what is wrong."""

    def __init__(self, text: str) -> None:
        yaml.reader.Reader.__init__(self, text)
        yaml.scanner.Scanner.__init__(self)
        yaml.parser.Parser.__init__(self)
        _Dialect.__init__(self)


if yaml.__with_libyaml__:
    from yaml.cyaml import CParser  # type: ignore[attr-defined]

    class _FastLoader(_Dialect, CParser):
        """The dialect by libyaml, five times as fast."""

        def __init__(self, text: str) -> None:
            CParser.__init__(self, text)
            _Dialect.__init__(self)

else:  # pragma: no cover - PyYAML built without its C library
    _FastLoader = Loader  # type: ignore[misc, assignment]


def compose(text: str) -> tuple[_Dialect, yaml.Node | None]:
    """The node of the one document in a text, None if there is none; and what makes plain data of it.

    Raises:
        yaml.YAMLError: not YAML, or what the dialect refuses.
    """
    odd = yaml.reader.Reader.NON_PRINTABLE.search(text)
    if odd:  # before libyaml counts in bytes, or meets half a character
        raise yaml.reader.ReaderError("", odd.start(), ord(odd.group()), "unicode", "a control character")
    loader: _Dialect = _FastLoader(text)
    try:
        return loader, loader.get_single_node()
    except yaml.MarkedYAMLError:
        if len(text) > _HAND_WRITTEN:
            raise
    loader = Loader(text)
    return loader, loader.get_single_node()


def _refused(problem: str, event: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)


_Dialect.yaml_implicit_resolvers = {}
_Dialect.add_implicit_resolver(TAG + "null", re.compile(r"^(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""])
_Dialect.add_implicit_resolver(TAG + "int", re.compile(r"^[-+]?[0-9]{1,18}$"), list("-+0123456789"))
_Dialect.add_implicit_resolver(TAG + "float", _FLOAT, list("-+.0123456789"))
_Dialect.add_implicit_resolver(TAG + "bool", re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF"))
_Dialect.add_constructor(TAG + "int", lambda _, node: int(node.value))


def parse_value(text: str) -> Any:
    """A value as it would be read behind a key of a file.

    Raises:
        yaml.YAMLError: not YAML.
    """
    loader, node = compose(text)
    return None if node is None else loader.construct_document(node)


class _Readable:
    """Short lists in one line, and numbers with all their digits."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


class Dumper(_Readable, yaml.SafeDumper):
    """SafeDumper for people: takes any text."""


class _FastDumper(_Readable, yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper):  # type: ignore[misc]
    """The same by libyaml, five times as fast; takes no half of a surrogate pair."""


def written(data: Any) -> str:
    """Plain data as YAML."""
    how: Any = {"sort_keys": False, "allow_unicode": True, "width": 120}
    try:
        return str(yaml.dump(data, Dumper=_FastDumper, **how))
    except UnicodeEncodeError:
        return str(yaml.dump(data, Dumper=Dumper, **how))


def _represent_list(dumper: yaml.SafeDumper, data: Sequence[Any]) -> yaml.Node:
    flat = all(isinstance(item, (int, float, str)) for item in data)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flat)


def _represent_numpy(dumper: yaml.SafeDumper, data: np.generic) -> yaml.Node:
    return dumper.represent_data(data.item())


for _kind in (Dumper, _FastDumper):
    _kind.add_implicit_resolver(TAG + "float", _FLOAT, list("-+.0123456789"))  # so that the string '1e-3' is quoted
    _kind.add_representer(list, _represent_list)
    _kind.add_representer(tuple, _represent_list)
    _kind.add_multi_representer(np.generic, _represent_numpy)  # type: ignore[type-abstract]
