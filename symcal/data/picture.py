"""What was read, as a small drawing: by training and held-out poses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symcal.colors import FAINT, GREEN, VERMILION
from symcal.notebook import Dots, Panel, sketch

if TYPE_CHECKING:
    from symcal.data.dataset import Readings
    from symcal.instruments.protocol import Column

Array = NDArray[np.float64]

_MOST = 300  # dots of a panel and split
_PANELS = 3
_LOOKS = {"train": (GREEN, "disc", "training"), "test": (VERMILION, "square", "held out")}


def data_sketch(of: Sequence[Readings], z: Array, split: Sequence[str]) -> str:
    """An SVG element: of each observation the numbers of a reading over one another, or over the order of the poses
    where it is one number; empty where none was read.

    Args:
        z: what the instruments gave, shape (N, nz), NaN where nothing.
    """
    panels: list[Panel] = []
    parts, at = np.array(split), 0
    for each in of:
        columns = each.instrument.file_columns
        if columns:
            whole = z[:, at : at + each.width].reshape(len(z), each.width // len(columns), len(columns))
            named = _alike(columns)
            panels += _panels(each.name or each.kind, named, whole[..., : len(named)], parts, one=len(of) == 1)
        at += each.width
    return sketch("what was read, by training and held-out poses", panels[:_PANELS])


def _alike(columns: Sequence[Column]) -> list[str]:
    """The first numbers of a reading as far as they have one unit, three at most, in words."""
    unit = columns[0][1]
    return [f"{name} {unit}" if unit else name for name, _ in takewhile(lambda c: c[1] == unit, columns)][:3]


def _panels(name: str, columns: list[str], z: Array, split: NDArray[np.str_], *, one: bool) -> list[Panel]:
    """Two views of readings with three numbers where they are shown alone, else one; z (N, features, numbers)."""
    if len(columns) == 1:
        order = np.broadcast_to(np.arange(1, len(z) + 1)[:, None], z.shape[:2])
        z, columns = np.stack([order, z[..., 0]], axis=-1), ["number of the pose", *columns]
        pairs, equal = [(0, 1)], False
    else:
        pairs, equal = [(0, 1), (0, 2)][: min(len(columns) - 1, 2 if one else 1)], True
    return [Panel(name, columns[i], columns[j], tuple(_dots(z[..., [i, j]], split)), equal=equal) for i, j in pairs]


def _dots(points: Array, split: NDArray[np.str_]) -> list[Dots]:
    found = []
    for part in dict.fromkeys(split.tolist()):
        color, shape, words = _LOOKS.get(part, (FAINT, "ring", part))
        own = points[split == part].reshape(-1, 2)
        own = own[np.isfinite(own).all(axis=1)]
        some = np.linspace(0, len(own) - 1, min(len(own), _MOST)).astype(np.intp)
        found.append(Dots(own[some], color, shape, words))
    return found
