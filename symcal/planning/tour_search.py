"""The shortest path through all nodes from the first one, its end left open: a local search that is fast at a thousand.

Nearest neighbour, then 2-opt and Or-opt moves ([Croes1958], [Or1976]) between a node and its nearest neighbours, only
where something has changed since the last look; then again and again a random exchange of two neighbouring pieces with
the same repair, kept if it is shorter (iterated local search, [Johnson1997]). At last every 2-opt and Or-opt move there
is, whole matrices at a time, until none helps: a local optimum of both, not a proven shortest path.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_NEIGHBOURS = 12  # of a node, between which moves are looked for
_LONGEST_MOVED = 3  # nodes that an Or-opt move takes along
_KICKS = 8  # per node
_MOST_KICKS = 8000
_PIECE = 50  # nodes of a piece that a kick exchanges, at most
_LITTLE = 1e-12  # of the costs: less is no gain


def shortest_path(cost: Array) -> Index:
    """An order of all nodes that begins with node 0, shape (n,); the same costs give the same path.

    Args:
        cost: of going from one to another, symmetric, shape (n, n).
    """
    n = len(cost)
    path = _nearest(cost)
    if n <= 2:
        return path
    search = _Search(cost, path.tolist())
    search.repair(list(range(n)))
    search.kick(np.random.default_rng(0), min(_KICKS * n, _MOST_KICKS))
    return _settled(np.array(search.path[:-1], dtype=np.intp), cost)


def _nearest(cost: Array) -> Index:
    """From node 0 always to the nearest node that is left."""
    path = np.zeros(len(cost), dtype=np.intp)
    left = np.ones(len(cost), dtype=np.bool_)
    left[0] = False
    for i in range(1, len(cost)):
        path[i] = np.argmin(np.where(left, cost[path[i - 1]], np.inf))
        left[path[i]] = False
    return path


def _padded(cost: Array) -> Array:
    """The costs with a node n that is everywhere for nothing: behind the open end of a path."""
    return np.pad(cost, ((0, 1), (0, 1)))


class _Search:
    """A path under change, in plain lists: at ten neighbours they are faster than arrays. Lives in `shortest_path`.

    path: the nodes in order, and the node that is everywhere for nothing behind the end. at: the place of each.
    """

    def __init__(self, cost: Array, path: list[int]) -> None:
        n = len(cost)
        self.path = [*path, n]
        self.at = [0] * (n + 1)
        self._place(0, n)
        self._cost: list[list[float]] = _padded(cost).tolist()
        self._eps = _LITTLE * (1.0 + float(cost.max()))
        masked = cost + np.diag(np.full(n, np.inf))
        self._near: list[list[int]] = np.argsort(masked, axis=1, kind="stable")[:, : min(_NEIGHBOURS, n - 1)].tolist()

    def repair(self, nodes: list[int]) -> float:
        """Make moves around these nodes, and around those that a move touches, until none helps; what it saved."""
        queue, waiting, saved = nodes[::-1], set(nodes), 0.0
        while queue:
            node = queue.pop()
            waiting.discard(node)
            gain, touched = self._two_opt(node)
            if gain <= 0.0:
                gain, touched = self._or_opt(node)
            if gain > 0.0:
                saved += gain
                for other in (node, *touched):
                    if other not in waiting and other < len(self._near):
                        queue.append(other)
                        waiting.add(other)
        return saved

    def kick(self, rng: np.random.Generator, count: int) -> None:
        """Exchange two neighbouring pieces, repair, and take it back unless the path became shorter."""
        n = len(self.path) - 1
        if n < 4:
            return
        longest = min(_PIECE, (n - 1) // 2)
        draws = rng.random((count, 3))
        for u, v, w in draws.tolist():
            first, second = 1 + int(v * longest), 1 + int(w * longest)
            i = 1 + int(u * (n - first - second))
            j, k = i + first, i + first + second
            path, at, cost = self.path[:], self.at[:], self._cost
            a, b, c, d, e, f = path[i - 1], path[i], path[j - 1], path[j], path[k - 1], path[k]
            before = cost[a][b] + cost[c][d] + cost[e][f]
            self.path[i:k] = path[j:k] + path[i:j]
            self._place(i, k - 1)
            change = cost[a][d] + cost[e][b] + cost[c][f] - before
            saved = self.repair([node for node in (a, b, c, d, e, f) if node < n])
            if saved - change <= self._eps:
                self.path, self.at = path, at

    def _place(self, first: int, last: int) -> None:
        path, at = self.path, self.at
        for i in range(first, last + 1):
            at[path[i]] = i

    def _reverse(self, i: int, j: int) -> None:
        self.path[i : j + 1] = self.path[i : j + 1][::-1]
        self._place(i, j)

    def _two_opt(self, a: int) -> tuple[float, tuple[int, ...]]:
        """Join ``a`` to a near node by reversing a part of the path; what it saves (0: nothing did), and the ends."""
        path, at, cost = self.path, self.at, self._cost
        i, row = at[a], cost[a]
        b = path[i + 1]
        for z in self._near[a]:
            gain = row[b] - row[z]
            if gain <= self._eps:
                break
            j = at[z]
            y = path[j + 1]
            gain += cost[z][y] - cost[b][y]
            if gain > self._eps:
                self._reverse(min(i, j) + 1, max(i, j))
                return gain, (b, z, y)
        if i == 0:
            return 0.0, ()
        b = path[i - 1]
        for z in self._near[a]:
            gain = row[b] - row[z]
            if gain <= self._eps:
                break
            j = at[z]
            if j == 0:
                continue
            y = path[j - 1]
            gain += cost[z][y] - cost[b][y]
            if gain > self._eps:
                self._reverse(min(i, j), max(i, j) - 1)
                return gain, (b, z, y)
        return 0.0, ()

    def _or_opt(self, a: int) -> tuple[float, tuple[int, ...]]:
        """Move a short piece that ends with ``a`` beside a near node; what it saves (0: nothing did), and the ends."""
        path, at, cost = self.path, self.at, self._cost
        n, row = len(path) - 1, cost[a]
        for length in range(1, _LONGEST_MOVED + 1):
            for side in (1,) if length == 1 else (1, -1):
                # the piece path[i..k]; ``a`` is its first node (side 1) or its last
                i = at[a] if side == 1 else at[a] - length + 1
                k = i + length - 1
                if i < 1 or k > n - 1:
                    continue
                left, right, other = path[i - 1], path[k + 1], path[k if side == 1 else i]
                freed = cost[left][path[i]] + cost[path[k]][right] - cost[left][right]
                for z in self._near[a]:
                    room = freed - row[z]
                    if room <= self._eps:
                        break
                    j = at[z]
                    if i <= j <= k:
                        continue
                    for y in (path[j + 1], path[j - 1] if j else -1):
                        if y < 0 or i <= at[y] <= k:
                            continue
                        gain = room - cost[other][y] + cost[z][y]
                        if gain > self._eps:
                            self._move(i, k, min(j, at[y]), (at[y] > j) == (side == 1))
                            return gain, (other, left, right, z, y)
        return 0.0, ()

    def _move(self, i: int, k: int, gap: int, straight: bool) -> None:
        """Take path[i..k] to between path[gap] and path[gap + 1], straight or turned round."""
        piece = self.path[i : k + 1]
        if not straight:
            piece.reverse()
        if gap > k:
            self.path[i : gap + 1] = self.path[k + 1 : gap + 1] + piece
            self._place(i, gap)
        else:
            self.path[gap + 1 : k + 1] = piece + self.path[gap + 1 : i]
            self._place(gap + 1, k)


def _settled(path: Index, cost: Array) -> Index:
    """The path after every 2-opt and Or-opt move that still helps, the best one first."""
    while True:
        for move in (_two_opt, _or_opt):
            better = move(path, cost)
            if better is not None:
                path = better
                break
        else:
            return path


def _two_opt(path: Index, cost: Array) -> Index | None:
    """Reverse the part of the path that saves most; None if none saves."""
    p = np.append(path, len(cost))
    c = _padded(cost)[np.ix_(p, p)]
    step = np.diagonal(c, 1)
    # reverses p[i..j], 1 <= i < j: the start stays
    change = c[:-2, 1:-1] + c[1:-1, 2:] - step[:-1, None] - step[None, 1:]
    change = np.where(np.tri(len(change), k=0, dtype=np.bool_), 0.0, change)
    if not change.size:
        return None
    i, j = divmod(int(np.argmin(change)), change.shape[1])
    if change[i, j] >= -_LITTLE * (1.0 + cost.max()):
        return None
    better = path.copy()
    better[i + 1 : j + 2] = path[i + 1 : j + 2][::-1]
    return better


def _or_opt(path: Index, cost: Array) -> Index | None:
    """Move up to three neighbouring nodes elsewhere, either way round, where it saves most; None if nowhere."""
    n = len(path)
    p = np.append(path, len(cost))
    c = _padded(cost)[np.ix_(p, p)]
    step = np.diagonal(c, 1)
    best, found = -_LITTLE * (1.0 + cost.max()), None
    for length in range(1, min(_LONGEST_MOVED, n - 2) + 1):
        first = np.arange(1, n - length + 1)  # pieces p[first..last], and gaps between p[g] and p[g + 1]
        last = first + length - 1
        freed = step[first - 1] + step[last] - c[first - 1, last + 1]
        gaps = np.arange(n)
        inside = (gaps >= first[:, None] - 1) & (gaps <= last[:, None])
        for head, tail, turn in ((first, last, 1), (last, first, -1)):
            change = c[gaps, head[:, None]] + c[tail[:, None], gaps + 1] - step[gaps] - freed[:, None]
            change = np.where(inside, np.inf, change)
            piece, gap = divmod(int(np.argmin(change)), n)
            if change[piece, gap] < best:
                best, found = float(change[piece, gap]), (int(first[piece]), int(last[piece]), gap, turn)
    if found is None:
        return None
    i, k, gap, turn = found
    moved, rest = path[i : k + 1][::turn], np.delete(path, slice(i, k + 1))
    cut = gap + 1 if gap < i else gap + 1 - len(moved)
    return np.concatenate([rest[:cut], moved, rest[cut:]])
