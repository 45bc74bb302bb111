"""`symcal study`: a study file in, a folder out; what was computed before it was interrupted is not computed again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symcal.errors import InputError, RefusedError
from symcal.kernels.path import kernels_by
from symcal.outputs.names import file_name
from symcal.outputs.side_by_side import cores
from symcal.runs.folder import require_replaceable, run_folder
from symcal.trials.description import Description, packed
from symcal.trials.identify import one_by_one
from symcal.trials.identity import difference
from symcal.trials.load import Study, load_study
from symcal.trials.machine import Machine, kernels_of, this_machine
from symcal.trials.setting import description_of, setting_of
from symcal.trials.store import BESIDE, SCHEMA, STATE, Store, opened
from symcal.trials.worker import Done, Shard

AT_ONCE, ONE_BY_ONE = 256, 4
"""Trials in a shard, as they are identified."""

Progress = Callable[[str], None]
Advance = Callable[[int, int], None]
"""(done, of) trials."""


@dataclass(frozen=True, slots=True)
class Execution:
    """Where trials run. workers: processes of this machine; scheduler: address of a Dask scheduler instead.

    portable: only the one level of kernels that every machine has. shard: trials that are computed together; chosen
    when None. parquet: whether the table is written as Parquet too.
    """

    workers: int = 1
    scheduler: str | None = None
    portable: bool = False
    shard: int | None = None
    parquet: bool = False


class Interrupted(RefusedError):
    """The study was interrupted; what is done is kept."""


def run_study(
    path: Path,
    out: Path | None = None,
    *,
    seed: int | None = None,
    overrides: Sequence[str] = (),
    execution: Execution | None = None,
    report: bool = True,
    progress: Progress = lambda _: None,
    advance: Advance = lambda _, __: None,
) -> tuple[Path, Mapping[str, Any]]:
    """Run a study, or what is missing of it, and write its folder; `reports/<name>` when ``out`` is None.

    Returns:
        the folder, and the content of its results.json.
    Raises:
        InputError: anything wrong in the files. RefusedError: the folder holds another study or one that was begun with
        another program or on another machine, or workers do not compute alike. Interrupted: a keyboard interrupt.
    """
    execution = execution or Execution(cores())
    progress("reading the study")
    with kernels_by(kernels_of(execution.portable)):  # plans and test poses are part of the numbers
        study = load_study(path, seed=seed, overrides=overrides, portable=execution.portable, progress=progress)
    target = out or Path("reports") / file_name(study.file.name)
    if execution.parquet:
        _insist_on_parquet()
    require_replaceable(target, study.inputs, BESIDE)
    digest, data = packed(study.description)
    description = description_of(digest, data)
    with closing(_computing(execution, digest, data)) as computing, opened(target) as store:
        _continue(store, study, computing.machine, target)
        missing = shards(store.gaps(description.trials), description, execution.shard or _shard(description))
        progress("computing")
        try:
            _compute(store, computing, missing, description.trials, advance)
        except KeyboardInterrupt:
            raise Interrupted(
                f"interrupted: {store.count()} of {description.trials} trials are kept in {target}; the same command "
                "goes on from there"
            ) from None
        return target, _written(study, description, store, computing.machine, target, execution, report, progress)


def _shard(description: Description) -> int:
    """Trials that are computed together: so many that starting one costs nothing, and so few that little is lost."""
    slow = any(one_by_one(description, setting_of(description, task)) for task in range(len(description.tasks)))
    return ONE_BY_ONE if slow else AT_ONCE


def shards(gaps: Sequence[tuple[int, int]], description: Description, size: int) -> list[Shard]:
    """What is missing, cut by the trials' numbers and where a cell ends."""
    found = []
    for first, last in gaps:
        while first < last:
            end = (first // description.repetitions + 1) * description.repetitions
            stop = min(last, end, (first // size + 1) * size)
            found.append((first, stop))
            first = stop
    return found


@dataclass(frozen=True, slots=True)
class _Local:
    """This machine's cores."""

    digest: str
    data: bytes
    workers: int
    machine: Machine

    def run(self, missing: Sequence[Shard]) -> Iterator[Done]:
        from symcal.trials.local import run_locally

        description = description_of(self.digest, self.data)
        for task in sorted({description.cell_of(first).task for first, _ in missing}):
            setting_of(description, task)  # built before workers are copied from this process
        return run_locally(self.digest, self.data, missing, self.workers)

    def close(self) -> None:
        pass


@dataclass(frozen=True, slots=True)
class _Remote:
    """A cluster's."""

    digest: str
    data: bytes
    cluster: Any

    @property
    def machine(self) -> Machine:
        found: Machine = self.cluster.machine
        return found

    def run(self, missing: Sequence[Shard]) -> Iterator[Done]:
        found: Iterator[Done] = self.cluster.run(self.digest, self.data, missing)
        return found

    def close(self) -> None:
        self.cluster.close()


def _computing(execution: Execution, digest: str, data: bytes) -> _Local | _Remote:
    if execution.scheduler is None:
        return _Local(digest, data, execution.workers, this_machine(execution.portable))
    from symcal.trials.cluster import connected

    return _Remote(digest, data, connected(execution.scheduler, portable=execution.portable))


def _continue(store: Store, study: Study, machine: Machine, target: Path) -> None:
    """Begin the study, or see that what is there is the same one.

    Raises:
        RefusedError: it is another one, or its numbers would not be the same bits here.
    """
    if store.fact("schema") is None:
        facts = {
            "schema": SCHEMA,
            "identity": study.identity,
            "name": study.file.name,
            "trials": study.description.trials,
            "portable": study.description.portable,
            "machine": machine.facts(),
        }
        store.begin(facts, study.description.cells)
        return
    kept = f"it has {store.count()} of {store.fact('trials')} trials. Choose another --out, or remove {target / STATE}"
    if store.fact("schema") != SCHEMA:
        raise RefusedError(f"{target} holds a study of another version of the program; {kept}")
    other = difference(store.fact("identity"), study.identity)
    if other:
        raise RefusedError(f"{target} holds another study ({other}); {kept}")
    before = Machine(**store.fact("machine"))
    differences = before.differs(machine)
    if differences:
        raise RefusedError(
            f"{target} holds this study as it was begun with other means, whose numbers are not the same to the last "
            f"bit ({'; '.join(differences)}); {kept}"
        )


def _compute(store: Store, computing: _Local | _Remote, missing: Sequence[Shard], total: int, advance: Advance) -> None:
    done = total - sum(last - first for first, last in missing)
    advance(done, total)
    if not missing:
        return
    for found in computing.run(missing):
        differences = computing.machine.differs(found.machine)
        if differences:
            raise RefusedError(
                f"a worker that came later does not compute as the others do ({'; '.join(differences)}): what is done "
                "is kept; take it away, and the same command goes on"
            )
        store.add(found.results)
        done += len(found.results)
        advance(done, total)


def _insist_on_parquet() -> None:
    from importlib.util import find_spec

    if find_spec("pyarrow") is None:
        raise InputError("Parquet needs the package 'pyarrow': pip install 'symcal[cluster]'", key="--parquet")


def _written(
    study: Study,
    description: Description,
    store: Store,
    machine: Machine,
    target: Path,
    execution: Execution,
    report: bool,
    progress: Progress,
) -> Mapping[str, Any]:
    """Everything that a finished study leaves, whole; its state goes with it."""
    from symcal.trials.folder import write

    progress("summarising")
    with run_folder(target, study.inputs, BESIDE) as folder:
        content = write(study, description, store, machine, folder, execution.parquet, report, progress)
        store.copy(folder / STATE)
    return content
