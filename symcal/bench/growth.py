"""How times grow with postures, joints, parameters and trials: curves, and the power of the size that they follow."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from symcal.bench import own_fits
from symcal.bench.arms import handling_robot, random_errors, random_postures, revolute_arm
from symcal.bench.case import Case, case_of
from symcal.bench.contest import Progress
from symcal.bench.identifications import POSES, SIGMA, repeat
from symcal.bench.peers import casadi_map, numpy_batch, scipy_fit
from symcal.bench.positions import CASADI_C, NUMPY
from symcal.bench.rounds import Contender, Pace, measure
from symcal.kernels import batch_function
from symcal.robot.robot import Robot

SUBJECT = "growth"
OURS = "symcal"
_SCIPY = "SciPy lm, exact slopes (NumPy)"
_TAIL = 3  # last sizes, through which the power is fitted: where small ones are all overhead, it is no power yet


@dataclass(frozen=True, slots=True)
class Sizes:
    """How far each size goes. peers: postures, and trials, up to which peers are measured too."""

    postures: tuple[int, ...]
    fitted: tuple[int, ...]
    joints: tuple[int, ...]
    parameters: tuple[int, ...]
    trials: tuple[int, ...]
    peers: tuple[int, int]
    held: int = 1000


QUICK_SIZES = Sizes((10, 100, 1000, 10_000), (10, 100, 1000), (3, 6), (4, 12), (1, 10, 100, 1000), (1000, 3), 300)
FULL_SIZES = Sizes(
    (10, 100, 1000, 10_000, 100_000, 1_000_000),
    (10, 100, 1000, 10_000, 100_000),
    (3, 6, 7, 12),
    (4, 8, 16, 28),
    (1, 10, 100, 1000, 10_000, 100_000),
    (10_000, 10),
)


def run(sizes: Sizes, pace: Pace, progress: Progress) -> Iterator[dict[str, Any]]:
    """One panel for each size that grows.

    Yields:
        its content in bench.json.
    """
    held = f"of {sizes.held} postures"
    case = case_of(handling_robot())
    with casadi_map.compiled(case.function) as generated:

        def postures(count: int) -> Iterator[Contender]:
            return _positions(case, count, generated, peers=count <= sizes.peers[0])

        yield _panel("postures", "position and Jacobian", sizes.postures, pace, progress, postures)
    fitted, trials = partial(_fitted, case, sizes), partial(_trials, case, sizes)
    yield _panel("postures", "one identification", sizes.fitted, pace, progress, fitted)
    name = f"position and Jacobian {held}"
    yield _panel("joints", name, sizes.joints, pace, progress, lambda n: _held(revolute_arm(n), sizes))
    name += ", seven joints"
    yield _panel("parameters", name, sizes.parameters, pace, progress, lambda n: _held(revolute_arm(7, n), sizes))
    yield _panel("trials", f"identifications from {POSES} postures", sizes.trials, pace, progress, trials)


def power(sizes: tuple[int, ...], seconds: tuple[float, ...]) -> float | None:
    """Exponent k of seconds ~ size^k through the last sizes; None of fewer than two."""
    if len(sizes) < 2:
        return None
    tail = slice(-_TAIL, None)
    return float(np.polyfit(np.log(sizes[tail]), np.log(seconds[tail]), 1)[0])


def _panel(
    variable: str,
    name: str,
    sizes: tuple[int, ...],
    pace: Pace,
    progress: Progress,
    make: Callable[[int], Iterator[Contender]],
) -> dict[str, Any]:
    curves: dict[str, tuple[list[int], list[float]]] = {}
    for size in sizes:
        progress(f"growth of {name} with {variable}: {size}")
        contenders = tuple(make(size))
        for who, samples in measure(contenders, pace).items():
            own = curves.setdefault(who, ([], []))
            own[0].append(size)
            own[1].append(float(np.median(samples.cpu)))
    return {
        "name": name,
        "variable": variable,
        "curves": [
            {"name": who, "sizes": at, "seconds": seconds, "power": power(tuple(at), tuple(seconds))}
            for who, (at, seconds) in curves.items()
        ],
    }


def _held(robot: Robot, sizes: Sizes) -> Iterator[Contender]:
    case = case_of(robot)
    with casadi_map.compiled(case.function) as generated:
        yield from _positions(case, sizes.held, generated)


def _positions(case: Case, count: int, generated: ca.Function | None, *, peers: bool = True) -> Iterator[Contender]:
    rng = np.random.default_rng(4)
    q, x = random_postures(case.robot, count, rng), random_errors(case.names, rng)
    yield Contender(OURS, partial(batch_function(case.function), q, x, case.setup), 1)
    if not peers:
        return
    if generated is not None:
        yield Contender(CASADI_C, casadi_map.mapped(generated, (q,), (x, case.setup)), 1)
    yield Contender(NUMPY, partial(numpy_batch.positions_and_slopes, case.arm, q, x), 1)


def _fitted(case: Case, sizes: Sizes, count: int) -> Iterator[Contender]:
    """One identification from so many postures."""
    repeated = repeat(case, 1, count)
    yield Contender(OURS, own_fits.single(repeated.case, repeated.q, repeated.z, SIGMA, repeated.free), 1)
    if count <= sizes.peers[0]:
        slopes = partial(numpy_batch.positions_and_slopes, repeated.case.arm, repeated.q)
        yield Contender(_SCIPY, partial(scipy_fit.fit_exact, repeated.problem, slopes, "lm"), 1)


def _trials(case: Case, sizes: Sizes, count: int) -> Iterator[Contender]:
    """So many identifications in one call."""
    repeated = repeat(case, count)
    yield Contender(OURS, own_fits.many(repeated.case, repeated.q, repeated.z, SIGMA, repeated.free), 1)
    if count <= sizes.peers[1]:
        slopes = partial(numpy_batch.positions_and_slopes, repeated.case.arm, repeated.q)

        def one_by_one() -> None:
            for i in range(count):
                scipy_fit.fit_exact(repeated.of(i), slopes, "lm")

        yield Contender(_SCIPY, one_by_one, 1)
