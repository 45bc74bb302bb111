"""Independent searches on two threads: nearly all of their time is in compiled code that holds no interpreter lock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import TypeVar

T = TypeVar("T")
Goon = Callable[[], None]
"""Called now and then by a job; raises where the job is no longer wanted."""

_THREADS = 2


class _Unwanted(Exception):
    """Another job failed, or somebody interrupted."""


def side_by_side(jobs: Sequence[Callable[[Goon], T]]) -> list[T]:
    """The results of all jobs in their order. Each has its own generator of random numbers: the order in which they run
    changes nothing. The first that fails ends the others."""
    stop = Event()

    def goon() -> None:
        if stop.is_set():
            raise _Unwanted

    with ThreadPoolExecutor(_THREADS) as pool:
        running = [pool.submit(job, goon) for job in jobs]
        try:
            return [each.result() for each in running]
        except BaseException:
            stop.set()
            for each in running:
                each.cancel()
            raise
