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


class Loader(yaml.SafeLoader):
    """SafeLoader with YAML 1.2's scalars: 1e-3 is a number, 010 is ten; `on`, `yes` and 12:30 stay text.

    Tags and aliases are refused: files here need neither, and they are how YAML runs code and how a small file becomes
    a huge one.
    """

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            raise _refused("aliases are not used here: write it out", event)
        if getattr(event, "tag", None):
            raise _refused(f"tags are not used here ({event.tag})", event)
        return super().compose_node(parent, index)


def _refused(problem: str, event: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)


Loader.yaml_implicit_resolvers = {}
Loader.add_implicit_resolver(TAG + "null", re.compile(r"^(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""])
Loader.add_implicit_resolver(TAG + "int", re.compile(r"^[-+]?[0-9]{1,18}$"), list("-+0123456789"))
Loader.add_implicit_resolver(TAG + "float", _FLOAT, list("-+.0123456789"))
Loader.add_implicit_resolver(TAG + "bool", re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF"))
Loader.add_constructor(TAG + "int", lambda _, node: int(node.value))


def parse_value(text: str) -> Any:
    """A value as it would be read behind a key of a file.

    Raises:
        yaml.YAMLError: not YAML.
    """
    return Loader(text).get_single_data()


class Dumper(yaml.SafeDumper):
    """SafeDumper that writes short lists in one line and numbers with all their digits."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


def _represent_list(dumper: yaml.SafeDumper, data: Sequence[Any]) -> yaml.Node:
    flat = all(isinstance(item, (int, float, str)) for item in data)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flat)


def _represent_numpy(dumper: yaml.SafeDumper, data: np.generic) -> yaml.Node:
    return dumper.represent_data(data.item())


Dumper.add_implicit_resolver(TAG + "float", _FLOAT, list("-+.0123456789"))  # so that the string '1e-3' is quoted
Dumper.add_representer(list, _represent_list)
Dumper.add_representer(tuple, _represent_list)
Dumper.add_multi_representer(np.generic, _represent_numpy)  # type: ignore[type-abstract]
