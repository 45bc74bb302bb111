"""Order blobs into the lattice of a circle grid, growing it from dot to dot: it may bend and shrink on the way."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board

Float = NDArray[np.float64]

_REACH = 0.3  # a dot is taken within this share of a step from where the last step leads
_TURNS = [np.array(m) for m in ([[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]])]
_FLIP = np.array([[1, 0], [0, -1]])


def order_blobs(blobs: Float, board: Board) -> Float | None:
    """Blobs in the order of `Board.points`, shape (n, 2), px; None unless exactly the board's dots form the lattice.

    Of the orders that a symmetric board allows, one that shows its face unmirrored is taken. Ours.

    Args:
        blobs: centres in any order, shape (m, 2), px.
        board: a circle grid.
    """
    if len(blobs) < len(board.points):
        return None
    nodes = _grow(blobs)
    plane = np.rint(board.points[:, :2] / board.square).astype(int)
    if board.kind == "asymmetric_circles":
        plane = np.stack([plane.sum(axis=1), plane[:, 0] - plane[:, 1]], axis=1) // 2
    wanted = plane - plane.min(axis=0)
    for flip in (np.eye(2, dtype=int), _FLIP):
        for turn in _TURNS:
            keys = np.array(list(nodes)) @ (turn @ flip).T
            found = dict(zip(map(tuple, (keys - keys.min(axis=0)).tolist()), nodes.values(), strict=True))
            if found.keys() == set(map(tuple, wanted.tolist())):
                ordered = blobs[[found[a, b] for a, b in wanted.tolist()]]
                if _unmirrored(ordered, board):
                    return ordered
    return None


def _grow(blobs: Float) -> dict[tuple[int, int], int]:
    """Lattice coordinates of the blobs that can be reached step by step from the middle one."""
    start = int(np.argmin(np.linalg.norm(blobs - np.median(blobs, axis=0), axis=1)))
    steps = _first_steps(blobs, start)
    if steps is None:
        return {(0, 0): start}
    nodes = {(0, 0): start}
    taken = {start}
    queue = deque([((0, 0), steps)])
    while queue:
        (i, j), (along, across) = queue.popleft()
        here = blobs[nodes[i, j]]
        for di, dj, step in ((1, 0, along), (-1, 0, -along), (0, 1, across), (0, -1, -across)):
            if (i + di, j + dj) in nodes:
                continue
            distance = np.linalg.norm(blobs - here - step, axis=1)
            best = int(np.argmin(distance))
            if best in taken or distance[best] > _REACH * np.linalg.norm(step):
                continue
            nodes[i + di, j + dj] = best
            taken.add(best)
            walked = (blobs[best] - here) * (di + dj)
            queue.append(((i + di, j + dj), (walked, across) if di else (along, walked)))
    return nodes


def _first_steps(blobs: Float, start: int) -> tuple[Float, Float] | None:
    """Steps from one blob to its nearest neighbour and to the nearest one across that direction."""
    offsets = blobs - blobs[start]
    near = offsets[np.argsort(np.linalg.norm(offsets, axis=1))[1:9]]
    for across in near[1:]:
        sine = (near[0, 0] * across[1] - near[0, 1] * across[0]) / np.linalg.norm(near[0]) / np.linalg.norm(across)
        if abs(sine) > 0.6:
            return near[0], across
    return None


def _unmirrored(ordered: Float, board: Board) -> bool:
    """Whether x and y of the board turn in the image as they do on the board's face."""
    plane = board.points[:, :2] - board.points[:, :2].mean(axis=0)
    slope = np.linalg.lstsq(plane, ordered - ordered.mean(axis=0), rcond=None)[0]
    return bool(np.linalg.det(slope) > 0)
