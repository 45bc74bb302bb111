"""Contenders measured in turn, round after round, so that what disturbs one disturbs all.

Ratios are taken within a round and then their median: a machine that slows down between two rounds spoils none.
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ENOUGH = 3  # rounds of what is too slow for all of them


@dataclass(frozen=True, slots=True)
class Contender:
    """What is measured. call: does ``items`` of the work, such as poses. what: in a few words, for people."""

    name: str
    call: Callable[[], object]
    items: int
    what: str = ""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long a round may be. rounds: how many. sample_s: of one sample at least, by repeated calls. slow_s: a call
    that takes longer is measured in three rounds alone."""

    rounds: int
    sample_s: float
    slow_s: float


QUICK = Pace(rounds=7, sample_s=0.003, slow_s=0.15)
FULL = Pace(rounds=31, sample_s=0.01, slow_s=1.0)


@dataclass(frozen=True, slots=True)
class Samples:
    """Seconds of one item in each round, shape (k,): of the processor (all threads of this process), of the clock."""

    cpu: Array
    wall: Array


def measure(contenders: tuple[Contender, ...], pace: Pace) -> dict[str, Samples]:
    """Seconds per item of every contender, round by round, after a call or two that do not count.

    What is compared is processor time: on a quiet machine it is that of the clock, on a busy one less is wrong with it.
    """
    repeats, rounds = {}, {}
    for one in contenders:
        seconds = _timed(one.call, 1)[0]
        if seconds <= pace.slow_s:  # the first time is longer
            seconds = _timed(one.call, 1)[0]
        repeats[one.name] = max(1, math.ceil(pace.sample_s / max(seconds, 1e-9)))
        rounds[one.name] = pace.rounds if seconds <= pace.slow_s else min(_ENOUGH, pace.rounds)
    found: dict[str, list[tuple[float, float]]] = {one.name: [] for one in contenders}
    with _no_collector():
        for i in range(pace.rounds):
            for one in contenders:
                if i < rounds[one.name]:
                    cpu, wall = _timed(one.call, repeats[one.name])
                    found[one.name].append((cpu / one.items, wall / one.items))
    return {name: Samples(*np.array(pairs).T) for name, pairs in found.items()}


def quartiles(values: Array) -> dict[str, float]:
    """Median, lower and upper quartile."""
    lower, median, upper = np.quantile(values, (0.25, 0.5, 0.75))
    return {"median": float(median), "lower": float(lower), "upper": float(upper)}


def ratio(reference: Samples, own: Samples) -> dict[str, float]:
    """How many times as fast as the reference: quartiles of the ratios of the rounds that both were in."""
    both = min(len(reference.cpu), len(own.cpu))
    return quartiles(reference.cpu[:both] / own.cpu[:both])


def summary(samples: Mapping[str, Samples], reference: str | None) -> dict[str, dict[str, object]]:
    """What is kept of the samples, by contender: seconds per item, and the ratio to the reference if there is one."""
    first = None if reference is None else samples.get(reference)
    kept: dict[str, dict[str, object]] = {}
    for name, own in samples.items():
        kept[name] = {
            "seconds": quartiles(own.cpu),
            "wall": quartiles(own.wall),
            "rounds": len(own.cpu),
            "ratio": None if first is None else ratio(first, own),
        }
    return kept


def _timed(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(repeats):
        call()
    return (time.process_time() - cpu) / repeats, (time.perf_counter() - wall) / repeats


@contextmanager
def _no_collector() -> Iterator[None]:
    was = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
