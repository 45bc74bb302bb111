"""What a description holds, as a key: two of equal content are as good as one and the same."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np


class NoContentError(TypeError):
    """Something of which it is not known what it holds."""


@dataclass(frozen=True, slots=True)
class Content:
    """All that a value holds, by value: numbers with all their bits, arrays with shape and bytes."""

    key: Hashable


def content(value: Any) -> Content:
    """The content of plain data, arrays and dataclasses of them, to any depth.

    Raises:
        NoContentError: something else is in it.
    """
    return Content(_key(value))


def _key(value: Any) -> Hashable:
    kind = type(value)
    if value is None or kind in (str, int, bool):
        return (kind, value)  # True is 1 and 1 is 1.0, but not here
    if isinstance(value, np.generic):  # before float, which np.float64 is as well
        return (kind, value.tobytes())
    if isinstance(value, float):
        return (kind, value.hex())
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise NoContentError(f"an array of {value.dtype}")
        return (kind, value.shape, value.dtype.str, value.tobytes())
    if isinstance(value, Mapping):
        return (kind, tuple((_key(k), _key(v)) for k, v in value.items()))
    if isinstance(value, tuple | list):
        return (kind, tuple(_key(v) for v in value))
    if isinstance(value, set | frozenset):
        return (kind, frozenset(_key(v) for v in value))
    if is_dataclass(value) and not isinstance(value, type):
        return (kind, tuple(_key(getattr(value, f.name)) for f in fields(value)))
    raise NoContentError(f"a {kind.__name__}")
