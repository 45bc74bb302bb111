"""Shards on the workers of a Dask cluster (`pip install symcal[cluster]`)."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any

from symcal.errors import InputError, RefusedError
from symcal.trials.machine import Machine, this_machine
from symcal.trials.worker import Done, Shard, run_shard

_AHEAD = 4  # shards per worker thread that the scheduler holds
_KEPT = "what is done is kept, and the same command goes on, on a cluster or without"
_SAME_EVERYWHERE = "install the same versions everywhere"


@dataclass(frozen=True, slots=True)
class Cluster:
    """A connection to a scheduler. machine: what all its workers compute with."""

    client: Any
    machine: Machine
    workers: int

    def run(self, digest: str, data: bytes, shards: Iterable[Shard]) -> Iterator[Done]:
        """The shards as they are done, in whatever order; those of workers that are lost are computed again.

        Raises:
            RefusedError: the scheduler or all workers were lost, or workers die wherever a shard is computed.
        """
        from distributed import KilledWorker, as_completed
        from distributed.client import FutureCancelledError
        from distributed.comm import CommClosedError

        try:
            described = self.client.scatter(data, broadcast=True)
            pending = iter(shards)
            first = [self._submit(digest, described, s) for s in islice(pending, _AHEAD * max(self.workers, 1))]
            running = as_completed(first)
            for future in running:
                yield future.result()
                for shard in islice(pending, 1):
                    running.add(self._submit(digest, described, shard))
        except (FutureCancelledError, CommClosedError):
            raise RefusedError(f"the cluster lost its scheduler or its workers: {_KEPT}") from None
        except KilledWorker as killed:
            raise RefusedError(
                f"{killed.allowed_failures + 1} workers of the cluster died over the same trials, perhaps for want of "
                f"memory: {_KEPT}"
            ) from None

    def _submit(self, digest: str, described: Any, shard: Shard) -> Any:
        return self.client.submit(run_shard, digest, described, shard, pure=False)

    def close(self) -> None:
        self.client.close()


def connected(address: str, *, portable: bool) -> Cluster:
    """A cluster whose workers all compute alike.

    Raises:
        InputError: no `distributed` here, or nobody answers at the address. RefusedError: no workers, or such as do not
        compute alike or have another program than this process.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "a cluster needs the package 'distributed': pip install 'symcal[cluster]'", key="--scheduler"
        ) from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what it logs is raised too
    try:
        client = Client(address, timeout=10)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers there: {error}", key="--scheduler", found=address) from None
    try:
        machine = alike(client.run(this_machine, portable, on_error="return"), this_machine(portable), portable)
        threads = sum(client.nthreads().values())
    except BaseException:
        client.close()
        raise
    return Cluster(client, machine, threads)


def alike(found: Mapping[str, Machine | BaseException], here: Machine, portable: bool) -> Machine:
    """What all workers compute with.

    Args:
        found: by worker; an exception where it could not say. here: this process, which made what all trials share.
    Raises:
        RefusedError: there are none, two that differ, or one with another program than this process.
    """
    if not found:
        raise RefusedError("the cluster has no workers: start some with 'dask worker ADDRESS --nthreads 1'")
    machines: dict[str, Machine] = {}
    for name, machine in found.items():
        if not isinstance(machine, Machine):
            raise RefusedError(f"worker {name} cannot compute ({machine}): {_SAME_EVERYWHERE}")
        if machine.program != here.program:
            what = f"{machine.program}, here {here.program}"
            raise RefusedError(f"worker {name} has another program ({what}): {_SAME_EVERYWHERE}")
        machines[name] = machine
    (name, first), *others = machines.items()
    for other, machine in others:
        differences = first.differs(machine)
        if differences:
            advice = (
                _SAME_EVERYWHERE
                if portable
                else "the same bits come only from the same; '--portable' takes the one level of kernels that all have"
            )
            raise RefusedError(f"workers {name} and {other} do not compute alike ({'; '.join(differences)}): {advice}")
    return first
