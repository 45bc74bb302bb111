"""What a worker does: a few trials of one cell, from bytes of a description to results."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

from threadpoolctl import ThreadpoolController

from symcal.kernels.path import kernels_by
from symcal.trials.description import Description
from symcal.trials.draw import draw
from symcal.trials.identify import identify, refusal
from symcal.trials.judge import REFUSED, Result, judge
from symcal.trials.machine import Machine, kernels_of, this_machine
from symcal.trials.setting import description_of, setting_of

Shard = tuple[int, int]
"""The first trial, and the first one after the last; all of one cell."""


@dataclass(frozen=True, slots=True)
class Done:
    """A shard's results, and what they were computed with."""

    shard: Shard
    results: list[Result]
    machine: Machine


def run_shard(digest: str, data: bytes, shard: Shard) -> Done:
    """Compute some trials; the description is unpacked and its models are built once in a process."""
    description = description_of(digest, data)
    with _one_thread(), kernels_by(kernels_of(description.portable)):
        results = run_trials(description, range(*shard))
    return Done(shard, results, this_machine(description.portable))


def run_trials(description: Description, trials: Sequence[int]) -> list[Result]:
    """The results of trials of one cell: those of each do not depend on the others."""
    if not trials:
        return []
    cell = description.cell_of(trials[0])
    setting = setting_of(description, cell.task)
    why = _refusal(description, cell.number)
    if why:
        return [Result(trial, cell.number, REFUSED, why) for trial in trials]
    drawn = draw(description, setting, cell, trials)
    estimates = identify(description, setting, cell, drawn)
    return judge(description, setting, cell, list(trials), drawn, estimates)


_refusals: dict[tuple[str, int], str] = {}


def _refusal(description: Description, number: int) -> str:
    """Why a cell cannot be identified, looked at once in a process."""
    key = (description.digest, number)
    if key not in _refusals:
        cell = description.cells[number]
        _refusals[key] = refusal(description, setting_of(description, cell.task), cell)
    return _refusals[key]


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()


_threads = threading.RLock()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Linear algebra on one thread: with several its sums are taken in another order.

    One shard at a time in a process, whose limit is that of all its threads.
    """
    with _threads, _libraries().limit(limits=1):
        yield
