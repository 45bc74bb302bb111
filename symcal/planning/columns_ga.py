"""pymoo's genetic algorithm [Blank2020] on a population of columns.

pymoo keeps one object per individual and reads and writes them one by one, which takes ten times as long as the search
itself. Here a population is a table: genes, fitness and violation of all plans as arrays. Selection, survival and the
generations are pymoo's own and work on it unchanged; the real operators are pymoo's too. Binary genes are whole numbers
with one joint value each, and the two binary operators do to their bits what pymoo's do to an array of single bits.

Import it only where a search begins: it loads pymoo.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.config import Config
from pymoo.core.crossover import Crossover
from pymoo.core.mutation import Mutation
from pymoo.core.problem import Problem
from pymoo.core.variable import get
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.mutation.pm import PM
from pymoo.operators.selection.tournament import TournamentSelection

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class Columns:
    """A population as a table: what pymoo asks of one, for all individuals at once.

    genes: shape (P, n). fitness, violation: shape (P,), NaN and 0 until they are known.
    """

    def __init__(self, genes: NDArray[Any], fitness: Array | None = None, violation: Array | None = None) -> None:
        self.genes = genes
        self.fitness = np.full(len(genes), np.nan) if fitness is None else fitness
        self.violation = np.zeros(len(genes)) if violation is None else violation

    def __len__(self) -> int:
        return len(self.genes)

    def __getitem__(self, index: Any) -> Columns:
        return Columns(self.genes[index], self.fitness[index], self.violation[index])

    def get(self, *names: str) -> Any:
        """Columns by pymoo's names: X, F (P, 1), cv."""
        known = {"X": self.genes, "F": self.fitness[:, None], "cv": self.violation}
        found = tuple(known[name] for name in names)
        return found if len(found) > 1 else found[0]

    def set(self, *_: Any) -> None:
        """Generation numbers and ranks, which nobody reads."""

    def with_more(self, other: Columns) -> Columns:
        return Columns(
            np.concatenate([self.genes, other.genes]),
            np.concatenate([self.fitness, other.fitness]),
            np.concatenate([self.violation, other.violation]),
        )


class ColumnsGA(GA):  # type: ignore[misc]
    """`GA` whose populations are `Columns`: ask, fill in fitness and violation, tell.

    ``pop`` is sorted by violation, then fitness, from the second generation on.
    """

    def _initialize_infill(self) -> Columns:
        return Columns(self.initialization.sampling)

    def _initialize_advance(self, infills: Any = None, **_: Any) -> None:
        self.pop = self.survival.do(self.problem, infills, n_survive=len(infills), random_state=self.random_state)

    def _infill(self) -> Columns:
        random, mating = self.random_state, self.mating
        pairs = -(-self.n_offsprings // 2)
        parents = mating.selection.do(self.problem, self.pop, pairs, 2, to_pop=False, random_state=random)
        genes = self.pop.genes[parents.T]  # (2, pairs, n)
        cross = random.random(pairs) < get(mating.crossover.prob, size=pairs)
        children = np.where(
            cross[:, None], mating.crossover._do(self.problem, genes, random_state=random), genes
        ).reshape(2 * pairs, -1)[: self.n_offsprings]
        mutated = mating.mutation._do(self.problem, children, random_state=random)
        chosen = random.random(len(children)) <= get(mating.mutation.prob, size=len(children))
        return Columns(np.where(chosen[:, None], mutated, children))

    def _advance(self, infills: Any = None, **_: Any) -> None:
        self.pop = self.survival.do(
            self.problem, self.pop.with_more(infills), n_survive=self.pop_size, random_state=self.random_state
        )

    def _set_optimum(self) -> None:
        self.opt = self.pop[:1]


class BitCrossover(Crossover):  # type: ignore[misc]
    """Uniform crossover of bits: each of the ``bits`` lowest is exchanged with probability one half."""

    def __init__(self, bits: int) -> None:
        super().__init__(2, 2)
        self._bits = bits

    def _do(self, _: Any, x: Any, random_state: Any = None, **__: Any) -> Any:
        highest = np.iinfo(x.dtype).max if self._bits == 8 * x.itemsize else 2**self._bits - 1
        mask = random_state.integers(0, highest, size=x.shape[1:], dtype=x.dtype, endpoint=True)
        swap = (x[0] ^ x[1]) & mask
        return np.stack([x[0] ^ swap, x[1] ^ swap])


class BitFlips(Mutation):  # type: ignore[misc]
    """Every bit flips with the same probability: one bit of a plan on average."""

    def __init__(self, bits: int) -> None:
        super().__init__()
        self._bits = bits

    def _do(self, _: Any, x: Any, random_state: Any = None, **__: Any) -> Any:
        bits = self._bits * x.size
        # independent flips, as their number and then their places: nearly all bits stay, so few are drawn
        count = random_state.binomial(bits, min(0.5, 1.0 / (self._bits * x.shape[1])))
        where = random_state.choice(bits, size=count, replace=False, shuffle=False)
        flips = np.zeros(x.size, dtype=x.dtype)
        np.bitwise_xor.at(flips, where // self._bits, x.dtype.type(1) << (where % self._bits).astype(x.dtype))
        return x ^ flips.reshape(x.shape)


class PoseCrossover(Crossover):  # type: ignore[misc]
    """Exchange each pose of two plans with probability one half."""

    def __init__(self, poses: int) -> None:
        super().__init__(2, 2)
        self._poses = poses

    def _do(self, _: Any, x: Any, random_state: Any = None, **__: Any) -> Any:
        swap = random_state.random((x.shape[1], self._poses)) < 0.5
        swap = np.repeat(swap, x.shape[2] // self._poses, axis=1)
        return np.where(swap, x[::-1], x)


def columns_ga(
    genes: NDArray[Any],
    poses: int,
    bits: int | None,
    mixing: str,
    limits: tuple[Array, Array],
    generations: int,
    seed: int,
) -> ColumnsGA:
    """The algorithm, ready to be asked ``generations + 1`` times.

    Args:
        genes: the first population, shape (P, poses dof): joint values, or whole numbers of ``bits`` bits.
        bits: None for joint values. mixing: `gene` or `pose`. limits: of the genes of one pose, shape (dof,) each.
    """
    Config.warnings["not_compiled"] = False  # its notice goes to the terminal, which is not ours to write on
    real = bits is None
    by_gene = SBX() if bits is None else BitCrossover(bits)
    algorithm = ColumnsGA(
        pop_size=len(genes),
        sampling=genes,
        selection=TournamentSelection(func_comp=_fitter),
        crossover=by_gene if mixing == "gene" else PoseCrossover(poses),
        mutation=PM() if bits is None else BitFlips(bits),
        eliminate_duplicates=False,  # costs more than everything else together
        output=None,
    )
    lower, upper = (np.tile(limit, poses) for limit in limits)
    problem = Problem(n_var=genes.shape[1], xl=lower if real else None, xu=upper if real else None)
    algorithm.setup(problem, termination=("n_gen", generations + 2), seed=seed, verbose=False)
    return algorithm


def _fitter(pop: Columns, pairs: Indices, **_: Any) -> Indices:
    """Winners of binary tournaments, shape (n, 1): the smaller violation, then the smaller fitness."""
    rank = np.empty(len(pop), dtype=np.intp)
    rank[np.lexsort([pop.fitness, pop.violation])] = np.arange(len(pop))
    return np.asarray(pairs[np.arange(len(pairs)), np.argmin(rank[pairs], axis=1)][:, None], dtype=np.intp)
