"""Position and Jacobian of one arm at N postures, with errors and setup shared: the work under everything else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.bench.arms import handling_robot, random_errors, random_postures
from symcal.bench.case import Case, case_of
from symcal.bench.contest import LEFT_OUT, Contest, Entry, Progress, hold
from symcal.bench.peers import casadi_map, jax_arm, numpy_batch, numpy_loop, pinocchio_arm
from symcal.bench.rounds import Contender, Pace
from symcal.kernels import BatchFunction, batch_function

Array = NDArray[np.float64]
Found = tuple[Array, Array]

SUBJECT = "positions"
SIZES = (1, 40, 1000, 100_000)
QUICK_SIZES = (1, 40, 1000)

EXACT = 1e-9
"""Largest difference of exact slopes, over the largest slope: rounding of some twenty turns, and room."""
DIFFERENCES = 1e-4
"""The same of finite differences."""

CASADI_C, CASADI_VM = "CasADi, generated C", "CasADi, virtual machine"
NUMPY, LOOP, JAX, PINOCCHIO = "NumPy, all poses at once", "NumPy, pose by pose", "JAX", "pinocchio"

_FEW, _MOST = 40, 1000  # postures of those that go pose by pose: more show nothing new
WITHOUT_COMPILER: tuple[Literal["numpy", "vm"], ...] = ("numpy", "vm")
_OURS = {"c": "symcal", "numpy": "symcal, NumPy", "vm": "symcal, virtual machine"}


def run(sizes: tuple[int, ...], pace: Pace, progress: Progress, *, slow: bool = True) -> Iterator[dict[str, Any]]:
    """One contest for each number of postures of the handling robot; ``slow``: see `contest`.

    Yields:
        its content in bench.json.
    """
    case = case_of(handling_robot())
    with casadi_map.compiled(case.function) as generated:
        for size in sizes:
            progress(f"position and Jacobian, {size} postures")
            yield hold(contest(case, size, generated, slow=slow), pace)


def contest(case: Case, size: int, generated: ca.Function | None, *, slow: bool = True, seed: int = 1) -> Contest:
    """Everybody's result at the same postures, compared with ours, and how to measure them.

    Args:
        generated: the case's function as CasADi's own C; None where there is no compiler.
        slow: with what takes seconds: JAX, which has to compile, and a thousand postures one by one.
    """
    rng = np.random.default_rng(seed)
    q, x = random_postures(case.robot, size, rng), random_errors(case.names, rng)
    ours = own_paths(case)
    wanted = _by_rows(next(iter(ours.values()))(q, x, case.setup))
    entries, absent = [], {}

    def enter(name: str, call: Callable[[], Any], what: str, found: Found, allowed: float) -> None:
        entries.append(Entry(Contender(name, call, size, what), difference(wanted, found), allowed))

    for backend, batch in ours.items():
        call = partial(batch, q, x, case.setup)
        enter(_OURS[backend], call, "one call, fresh results", _by_rows(call()), EXACT)
        filled = batch.prepared(q, x, case.setup)
        name = f"{_OURS[backend]}, in place"
        enter(name, filled, "prepared(), results allocated beforehand", _by_rows(filled()), EXACT)
    for name, function in {CASADI_C: generated, CASADI_VM: case.function}.items():
        if function is None:
            absent[name] = "no C compiler"
        else:
            many = casadi_map.mapped(function, (q,), (x, case.setup))
            p, slopes = many()
            enter(name, many, "map(N) through buffer()", (p, slopes.swapaxes(1, 2)), EXACT)
    enter(
        NUMPY,
        partial(numpy_batch.positions_and_slopes, case.arm, q, x),
        "stacks of 4x4 matrices, geometric Jacobian",
        numpy_batch.positions_and_slopes(case.arm, q, x),
        EXACT,
    )
    if size <= (_MOST if slow else _FEW):
        each = partial(numpy_loop.position_and_slopes, case.arm, q, x)
        enter(LOOP, each, "4x4 matrices, finite differences", each(), DIFFERENCES)
    peers: tuple[tuple[str, Callable[..., Callable[[Array, Array], tuple[Any, Any]]], str], ...] = (
        (JAX, jax_arm.positions_and_slopes, "jit, vmap, jacrev"),
        (PINOCCHIO, pinocchio_arm.positions_and_slopes, "a joint for every turn and shift, pose by pose"),
    )
    for name, make, what in peers:
        if name == PINOCCHIO and size > _MOST:
            continue
        if name == JAX and not slow:
            absent[name] = LEFT_OUT
            continue
        try:
            one = partial(make(case.arm), q, x)
        except ImportError:
            absent[name] = "not installed"
            continue
        enter(name, one, what, _by_rows(one()), EXACT)
    name = f"position and Jacobian by {len(case.names)} parameters, {size} {'posture' if size == 1 else 'postures'}"
    return Contest(
        SUBJECT,
        name,
        size,
        "posture",
        CASADI_C if generated else CASADI_VM,
        "positions and slopes",
        tuple(entries),
        absent,
    )


def own_paths(case: Case) -> dict[str, BatchFunction]:
    """Our function on every path that this machine and this version have, the usual one first."""
    usual = batch_function(case.function)
    paths = {usual.backend: usual}
    for backend in WITHOUT_COMPILER:
        paths.setdefault(backend, batch_function(case.function, backend=backend))
    return paths


def difference(wanted: Found, found: Found) -> float:
    """Largest difference of positions and of slopes, over the largest of each."""
    return float(max(np.max(np.abs(a - b)) / np.max(np.abs(a)) for a, b in zip(wanted, found, strict=True)))


def _by_rows(found: tuple[Any, ...]) -> Found:
    p, slopes = found
    return np.asarray(p), np.asarray(slopes)
