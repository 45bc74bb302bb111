"""Shards on the cores of this machine: processes that live until the study's process does not.

On Linux they are copies of this process, which has built everything already; elsewhere they are started afresh. Each
has a pipe of its own: when the other end is closed, however the study's process ended, a worker ends too.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import warnings
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import cast

from symcal.errors import RefusedError
from symcal.trials.worker import Done, Shard, run_shard

_AHEAD = 2  # shards that a worker has been given: one that it computes, one that waits


def run_locally(digest: str, data: bytes, shards: Iterable[Shard], workers: int) -> Iterator[Done]:
    """The shards as they are done, in whatever order.

    Args:
        workers: how many processes; one: in this one.
    Raises:
        RefusedError: a worker died.
    """
    if workers == 1:
        for shard in shards:
            yield run_shard(digest, data, shard)
        return
    waiting = deque(shards)
    copied = sys.platform == "linux"
    context = multiprocessing.get_context("fork") if copied else multiprocessing.get_context("spawn")
    pipes: list[Connection] = []
    processes: list[BaseProcess] = []
    try:
        for _ in range(min(workers, len(waiting))):
            ours, theirs = context.Pipe()
            forked = [*pipes, ours] if copied else []
            process: BaseProcess = context.Process(target=_work, args=(theirs, forked, digest, data), daemon=True)
            with warnings.catch_warnings():
                # Python 3.12 warns of other threads, as of the progress bar: a copy touches none of their locks
                warnings.simplefilter("ignore", DeprecationWarning)
                process.start()
            theirs.close()
            pipes.append(ours)
            processes.append(process)
        yield from _served(pipes, waiting)
    finally:
        for pipe in pipes:
            pipe.close()
        for process in processes:
            process.join(timeout=0.2)
            if process.is_alive():
                process.kill()
                process.join()


def _served(pipes: list[Connection], waiting: deque[Shard]) -> Iterator[Done]:
    """Give shards out, one more to a worker than it computes, and take what is done."""
    given = dict.fromkeys(pipes, 0)

    def give(pipe: Connection) -> None:
        if waiting:
            with _alive():
                pipe.send(waiting.popleft())
            given[pipe] += 1

    for _ in range(_AHEAD):
        for pipe in pipes:
            give(pipe)
    while busy := [pipe for pipe in pipes if given[pipe]]:
        for pipe in cast("list[Connection]", wait(busy)):
            with _alive():
                done = pipe.recv()
            given[pipe] -= 1
            if isinstance(done, BaseException):
                raise done
            yield done
            give(pipe)


@contextmanager
def _alive() -> Iterator[None]:
    """Talking to a worker.

    Raises:
        RefusedError: it is gone.
    """
    try:
        yield
    except (EOFError, ConnectionError):
        raise RefusedError(
            "a worker of the study died, perhaps for want of memory: what is done is kept, and the same command goes "
            "on; fewer --workers may help"
        ) from None


def _work(pipe: Connection, others: list[Connection], digest: str, data: bytes) -> None:
    """A worker: shards in, results out, until the other end is closed.

    Args:
        others: ends of pipes that a copied process has too and must not hold open.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the study's process is interrupted, and ends the workers
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for other in others:
        other.close()
    try:
        while True:
            shard = pipe.recv()
            try:
                done: Done | BaseException = run_shard(digest, data, shard)
            except Exception as error:  # noqa: BLE001 - it is raised again where the study is
                done = error
            pipe.send(done)
    except (EOFError, OSError):
        os._exit(0)
