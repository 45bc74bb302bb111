"""What an arm looks like: the corners that its frames make."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SHORT = 0.5  # mm: a segment that is never longer is not drawn


def body(frames: Array, standard: bool) -> tuple[Array, list[int]]:
    """Corners of the body from base to tool, shape (N, m, 3), mm, and which of them is the origin of each frame.

    A link runs along its two axes, first d then a (standard convention) or first a then d (Craig's), so that an offset
    elbow is where the metal is and not on the chord between the frames.

    Args:
        frames: base, links, flange and tool at N postures, shape (N, dof + 3, 4, 4). standard: whether that is the
            convention of the links, or else Craig's.
    """
    nodes, at = [frames[:, 0, :3, 3]], [0]
    for i in range(1, frames.shape[1]):
        start, end = frames[:, i - 1, :3, 3], frames[:, i, :3, 3]
        if i < frames.shape[1] - 2:  # of a link: neither flange nor tool
            axis = frames[:, i - 1, :3, 2] if standard else -frames[:, i, :3, 2]
            foot, other = (start, end) if standard else (end, start)
            corner = foot + axis * np.sum((other - foot) * axis, axis=1, keepdims=True)
            if _apart(corner, start) and _apart(corner, end):
                nodes.append(corner)
        if _apart(end, nodes[-1]):
            nodes.append(end)
        at.append(len(nodes) - 1)
    return np.stack(nodes, axis=1), at


def _apart(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(a - b, axis=1).max(initial=0.0) > _SHORT)
