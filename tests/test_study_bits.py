"""A study has the same bits for any number of workers, shards and interruptions; it is kept or refused whole."""

from __future__ import annotations

import csv
import json
import signal
import sqlite3
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from studies import killed_half_way, write_study

from symcal.documents.document import read_document
from symcal.errors import InputError, RefusedError
from symcal.trials import study as running
from symcal.trials.cluster import alike
from symcal.trials.description import packed
from symcal.trials.load import load_study
from symcal.trials.machine import Machine, this_machine
from symcal.trials.setting import description_of
from symcal.trials.store import STATE
from symcal.trials.study import Execution, Interrupted, run_study
from symcal.trials.worker import run_trials


def table(study: Path, out: Path, execution: Execution) -> bytes:
    run_study(study, out, execution=execution)
    return (out / "trials.csv").read_bytes()


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    """A study of four cells, and its table by one process in `one`."""
    folder = tmp_path_factory.mktemp("study")
    study = write_study(folder)
    table(study, folder / "one", Execution(1))
    return folder


def test_shards_do_not_matter(small, rng):
    study = load_study(small / "study.yaml")
    digest, data = packed(study.description)
    description = description_of(digest, data)
    whole = [r for cell in range(4) for r in run_trials(description, range(40 * cell, 40 * cell + 40))]
    pieces = []
    for cell in range(4):
        cuts = sorted({0, 40, *rng.integers(1, 40, 5).tolist()})
        pieces += [range(40 * cell + a, 40 * cell + b) for a, b in pairwise(cuts)]
    shuffled = [r for i in rng.permutation(len(pieces)) for r in run_trials(description, pieces[i])]
    assert sorted(shuffled, key=lambda r: r.trial) == whole


def test_two_processes_are_as_one(small):
    assert table(small / "study.yaml", small / "two", Execution(2, shard=7)) == (small / "one/trials.csv").read_bytes()


def test_a_cluster_is_as_one(small):
    distributed = pytest.importorskip("distributed", reason="a Dask cluster needs symcal[cluster]")
    settings = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "processes": True}
    with distributed.LocalCluster(**settings) as cluster:
        execution = Execution(scheduler=cluster.scheduler_address, shard=9)
        assert table(small / "study.yaml", small / "dask", execution) == (small / "one/trials.csv").read_bytes()


def test_a_killed_study_goes_on(small):
    """SIGKILL when half is kept: the same command computes the rest, and the table is the same to the byte."""
    out = small / "killed"
    assert killed_half_way(small / "study.yaml", out) == -signal.SIGKILL
    with sqlite3.connect(out / STATE) as connection:
        (kept,) = connection.execute("SELECT count(*) FROM trials").fetchone()
    assert 80 <= kept < 160
    assert not (out / "trials.csv").exists()
    seen = []
    run_study(
        small / "study.yaml",
        out,
        execution=Execution(2, shard=5),
        advance=lambda done, total: seen.append((done, total)),
    )
    assert seen[0] == (kept, 160)
    assert seen[-1] == (160, 160)
    assert (out / "trials.csv").read_bytes() == (small / "one/trials.csv").read_bytes()
    assert sorted(p.name for p in out.iterdir()) == sorted(p.name for p in (small / "one").iterdir())


def test_an_interrupt_keeps_what_is_done(small):
    def interrupt(done: int, _: int) -> None:
        if done >= 60:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match=r"of 160 trials are kept in .*the same command goes on"):
        run_study(small / "study.yaml", small / "interrupted", execution=Execution(2, shard=10), advance=interrupt)
    assert table(small / "study.yaml", small / "interrupted", Execution(1)) == (small / "one/trials.csv").read_bytes()


def test_a_finished_study_is_not_computed_again(small, monkeypatch):
    before = {p.name: p.read_bytes() for p in (small / "one").iterdir()}
    monkeypatch.setattr("symcal.trials.worker.run_trials", None)
    run_study(small / "study.yaml", small / "one", execution=Execution(1))
    assert {p.name: p.read_bytes() for p in (small / "one").iterdir()} == before


def test_the_table_is_sorted_and_exact(small):
    with (small / "one/trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["trial"]) for row in rows] == list(range(160))
    with sqlite3.connect(small / "one" / STATE) as connection:
        kept = connection.execute("SELECT rms, p95, probe FROM trials ORDER BY trial").fetchall()
    assert [(float(r["rms_mm"]), float(r["p95_mm"]), float(r["probe"])) for r in rows] == kept


def test_parquet_holds_the_same(small):
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet needs symcal[cluster]")
    run_study(small / "study.yaml", small / "columns", execution=Execution(1, parquet=True))
    found = parquet.read_table(small / "columns/trials.parquet")
    assert found.schema.metadata[b"symcal.kernels"].decode() == this_machine().kernels
    with (small / "one/trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert found.column_names == list(rows[0])
    assert found["rms_mm"].to_pylist() == [float(row["rms_mm"]) for row in rows]


@pytest.mark.parametrize("change", ["seed: 6", "repetitions: 41", "test_poses: 51", "poses: [12, 21]"])
def test_another_study_is_refused_in_its_folder(small, tmp_path, change):
    key = change.partition(":")[0]
    old = {
        "seed": "seed: 5",
        "repetitions": "repetitions: 40",
        "test_poses": "test_poses: 50",
        "poses": "poses: [12, 20]",
    }
    other = tmp_path / "study.yaml"
    other.write_text((small / "study.yaml").read_text().replace(old[key], change))
    before = (small / "one/trials.csv").read_bytes()
    with pytest.raises(RefusedError, match="holds another study"):
        run_study(other, small / "one", execution=Execution(1))
    assert (small / "one/trials.csv").read_bytes() == before


def test_what_only_asks_is_no_other_study(small):
    """A tolerance changes no trial: the kept ones answer it."""
    overrides = ("judge.tolerance=0.05", "judge.of=rms", "title=asked")
    _, content = run_study(small / "study.yaml", small / "two", execution=Execution(1), overrides=overrides)
    assert content["question"]["tolerance_mm"] == 0.05
    assert content["cells"][0]["within"]["of"] == 40


def test_another_machine_is_refused(small, monkeypatch):
    here = this_machine()
    elsewhere = Machine("another", here.kernels, here.bits.replace(here.processor, "another"), here.program)
    assert here.bits != elsewhere.bits
    monkeypatch.setattr(running, "this_machine", lambda _: elsewhere)
    with pytest.raises(RefusedError, match=r"not the same to the last bit \(kernels: .*another"):
        run_study(small / "study.yaml", small / "one", execution=Execution(1))


def test_mixed_clusters_are_refused():
    one = Machine("A", "C", "C on A", "symcal 1")
    assert alike({"x": one, "y": one}, Machine("C", "numpy", "numpy on C", "symcal 1"), portable=False) is one
    with pytest.raises(
        RefusedError, match=r"workers x and y do not compute alike \(kernels: C on A and C on B\).*--portable"
    ):
        alike({"x": one, "y": Machine("B", "C", "C on B", "symcal 1")}, one, portable=False)
    portable = Machine("A", "portable", "portable on x86_64", "symcal 1")
    there = Machine("B", "portable", portable.bits, "symcal 1")
    assert alike({"x": portable, "y": there}, portable, portable=True) is portable
    with pytest.raises(RefusedError, match=r"workers x and y .*same versions"):
        alike({"x": portable, "y": Machine("B", "portable", "numpy 1", "symcal 1")}, portable, portable=True)
    with pytest.raises(RefusedError, match="no workers"):
        alike({}, one, portable=False)


def test_workers_with_another_program_are_refused():
    """What all trials share is made here, and read there."""
    one = Machine("A", "C", "C on A", "symcal 1")
    other = Machine("A", "C", "C on A", "symcal 2")
    for found in ({"x": other, "y": other}, {"x": one, "y": other}):
        with pytest.raises(RefusedError, match=r"has another program \(symcal 2, here symcal 1\): .*same versions"):
            alike(found, one, portable=False)
    with pytest.raises(RefusedError, match=r"worker y cannot compute \(No module named 'symcal'\): .*same versions"):
        alike({"x": one, "y": ModuleNotFoundError("No module named 'symcal'")}, one, portable=False)


def test_a_study_whose_scheduler_is_lost_goes_on_here(small):
    distributed = pytest.importorskip("distributed", reason="a Dask cluster needs symcal[cluster]")
    settings = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None, "processes": False}
    out = small / "lost"
    with distributed.LocalCluster(**settings) as cluster:
        execution = Execution(scheduler=cluster.scheduler_address, shard=1)
        with pytest.raises(RefusedError, match=r"the scheduler was lost.*the same command goes on"):
            run_study(
                small / "study.yaml", out, execution=execution, advance=lambda done, _: done == 5 and cluster.close()
            )
    assert not (out / "trials.csv").exists()
    assert table(small / "study.yaml", out, Execution(1)) == (small / "one/trials.csv").read_bytes()


def test_portable_kernels_are_said(small):
    _, content = run_study(small / "study.yaml", small / "portable", execution=Execution(1, portable=True))
    assert content["machine"]["portable"]
    assert content["machine"]["kernels"].startswith("portable")
    assert any("one level of kernels" in warning for warning in content["warnings"])
    names = ("mean_mm", "rms_mm", "p95_mm", "max_mm")
    tables = []
    for folder in ("one", "portable"):
        with (small / folder / "trials.csv").open() as file:
            tables.append(np.array([[float(row[name]) for name in names] for row in csv.DictReader(file)]))
    np.testing.assert_allclose(*tables, rtol=1e-5)


def test_a_worker_that_differs_later_is_refused(small, monkeypatch):
    from symcal.trials import worker

    other = Machine("another", "C", "other bits", "symcal")
    monkeypatch.setattr(worker, "this_machine", lambda _: other)
    with pytest.raises(RefusedError, match="a worker that came later"):
        run_study(small / "study.yaml", small / "later", execution=Execution(1))


def test_one_process_at_a_time(small):
    from symcal.trials.store import opened

    with opened(small / "locked"), pytest.raises(RefusedError, match="another process computes"):
        run_study(small / "study.yaml", small / "locked", execution=Execution(1))


def test_what_is_somebody_elses_is_kept(small, tmp_path):
    out = tmp_path / "mine"
    out.mkdir()
    (out / "notes.txt").write_text("keep")
    with pytest.raises(RefusedError, match=r"notes\.txt"):
        run_study(small / "study.yaml", out, execution=Execution(1))
    (out / "notes.txt").rename(out / STATE)
    with pytest.raises(InputError, match="state of the study cannot be read"):
        run_study(small / "study.yaml", out, execution=Execution(1))
    assert (out / STATE).read_text() == "keep"
    (out / STATE).unlink()
    with sqlite3.connect(out / STATE) as connection:
        connection.execute("CREATE TABLE addresses (name TEXT)")
    with pytest.raises(InputError, match="no state of a study"):
        run_study(small / "study.yaml", out, execution=Execution(1))


def test_orphans_end(small):
    """Workers of a study that was killed do not go on: whatever opens the pipes is gone."""
    out = small / "orphans"
    killed_half_way(small / "study.yaml", out, share=0.1)
    marks = str(out).encode()
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        alive = []
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                alive += [path] if marks in path.read_bytes() else []
            except OSError:
                continue
        if not alive:
            return
        time.sleep(0.1)
    pytest.fail(f"still there: {alive}")


def test_the_folder_says_what_made_it(small):
    manifest = json.loads((small / "one/manifest.json").read_text())
    assert set(manifest["files"]) == {"results.json", "study.resolved.yaml", STATE, "trials.csv"}
    content = json.loads((small / "one/results.json").read_text())
    assert content["machine"] == {**this_machine().facts(), "portable": False}
    assert read_document(small / "one/study.resolved.yaml").data["seed"] == 5
