"""Shards on the workers of a Dask cluster (`pip install symcal[cluster]`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from symcal.errors import InputError, RefusedError
from symcal.trials.machine import Machine, this_machine
from symcal.trials.worker import Done, Shard, run_shard

_AHEAD = 4  # shards per worker thread that the scheduler holds


@dataclass(frozen=True, slots=True)
class Cluster:
    """A connection to a scheduler. machine: what all its workers compute with."""

    client: Any
    machine: Machine
    workers: int

    def run(self, digest: str, data: bytes, shards: Iterable[Shard]) -> Iterator[Done]:
        """The shards as they are done, in whatever order; those of workers that are lost are computed again.

        Raises:
            RefusedError: whoever gets a shard dies of it, or the scheduler is gone.
        """
        from concurrent.futures import CancelledError

        from distributed import as_completed
        from distributed.scheduler import KilledWorker

        described = self.client.scatter(data, broadcast=True)
        pending = iter(shards)
        first = [self._submit(digest, described, s) for s in islice(pending, _AHEAD * max(self.workers, 1))]
        running = as_completed(first)
        for future in running:
            try:
                done: Done = future.result()
            except (KilledWorker, CancelledError, OSError) as error:
                raise RefusedError(
                    f"the cluster lost its workers or its scheduler ({_first_line(error)}): what is done is kept, and "
                    "the same command goes on"
                ) from None
            yield done
            for shard in islice(pending, 1):
                running.add(self._submit(digest, described, shard))

    def _submit(self, digest: str, described: Any, shard: Shard) -> Any:
        return self.client.submit(run_shard, digest, described, shard, pure=False)

    def close(self) -> None:
        self.client.close()


def _first_line(error: BaseException) -> str:
    """An error's own words, which for some are none and for some a page."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def connected(address: str, *, portable: bool) -> Cluster:
    """A cluster whose workers all compute alike.

    Raises:
        InputError: no `distributed` here, or nobody answers at the address. RefusedError: no workers, or such as do not
        compute alike.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "a cluster needs the package 'distributed': pip install 'symcal[cluster]'", key="--scheduler"
        ) from None
    try:
        client = Client(address, timeout=10)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers there: {error}", key="--scheduler", found=address) from None
    try:
        found: dict[str, Machine] = client.run(this_machine, portable)
        machine = alike(found, portable=portable)
        threads = sum(client.nthreads().values())
    except BaseException:
        client.close()
        raise
    return Cluster(client, machine, threads)


def alike(found: dict[str, Machine], *, portable: bool) -> Machine:
    """What all workers compute with.

    Raises:
        RefusedError: there are none, or two that differ.
    """
    if not found:
        raise RefusedError("the cluster has no workers: start some with 'dask worker ADDRESS --nthreads 1'")
    (name, first), *others = found.items()
    for other, machine in others:
        differences = first.differs(machine)
        if differences:
            advice = (
                "install the same versions everywhere"
                if portable
                else "the same bits come only from the same; '--portable' takes the one level of kernels that all have"
            )
            raise RefusedError(f"workers {name} and {other} do not compute alike ({'; '.join(differences)}): {advice}")
    return first
