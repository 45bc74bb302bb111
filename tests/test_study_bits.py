"""A study has the same bits for any number of workers, shards and interruptions; it is kept or refused whole."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import sqlite3
import sys
import time
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from studies import CONFIGS, killed_half_way, write_study

from symcal.documents.document import read_document
from symcal.errors import InputError, RefusedError
from symcal.kernels.compile import load_library
from symcal.kernels.compiler import find_compiler
from symcal.trials import study as running
from symcal.trials.cluster import alike
from symcal.trials.description import packed
from symcal.trials.load import load_study
from symcal.trials.machine import Machine, this_machine
from symcal.trials.setting import description_of
from symcal.trials.store import STATE
from symcal.trials.study import Execution, Interrupted, run_study
from symcal.trials.worker import run_shard, run_trials


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
    settings = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0", "processes": True}
    with distributed.LocalCluster(**settings) as cluster:
        execution = Execution(scheduler=cluster.scheduler_address, shard=9)
        assert table(small / "study.yaml", small / "dask", execution) == (small / "one/trials.csv").read_bytes()


def _dies(*_: object) -> None:
    os._exit(1)


def test_a_cluster_whose_workers_die_is_one_sentence(small, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="a Dask cluster needs symcal[cluster]")
    monkeypatch.setattr("symcal.trials.cluster.run_shard", _dies)
    settings = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", "processes": True}
    with distributed.LocalCluster(**settings) as cluster, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        execution = Execution(scheduler=cluster.scheduler_address, shard=200)
        with pytest.raises(RefusedError, match=r"the cluster lost .*the same command goes on"):
            run_study(small / "study.yaml", small / "dies", execution=execution)


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


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("seed: 5", "seed: 6", "seed was 5 and is 6"),
        ("repetitions: 40", "repetitions: 41", "repetitions was 40 and is 41"),
        ("test_poses: 50", "test_poses: 51", "judge.test_poses was 50 and is 51"),
        ("poses: [12, 20]", "poses: [12, 21]", "vary.poses was [12, 20] and is [12, 21]"),
        (
            "poses: [12, 20]",
            "noise: {position: 0.1}",
            "vary.noise.position was not there and is [0.1] and vary.poses was",
        ),
    ],
)
def test_another_study_is_refused_in_its_folder(small, tmp_path, old, new, said):
    other = tmp_path / "study.yaml"
    other.write_text((small / "study.yaml").read_text().replace(old, new))
    before = (small / "one/trials.csv").read_bytes()
    with pytest.raises(RefusedError, match=r"holds another study \(" + re.escape(said)):
        run_study(other, small / "one", execution=Execution(1))
    assert (small / "one/trials.csv").read_bytes() == before


def test_another_experiment_or_level_is_another_study(tmp_path):
    """Every byte of what a study reads counts; removing the state, as is advised, begins again."""
    text = (CONFIGS / "simulated_arm.yaml").read_text().replace("robots/", f"{CONFIGS}/robots/")
    (tmp_path / "arm.yaml").write_text(text)
    study, out = write_study(tmp_path, 3, "{poses: 12}", experiment=tmp_path / "arm.yaml"), tmp_path / "out"
    run_study(study, out, execution=Execution(1))
    with pytest.raises(RefusedError, match=r"another study \(--portable was false and is true\); it has 3 of 3 trials"):
        run_study(study, out, execution=Execution(1, portable=True))
    (tmp_path / "arm.yaml").write_text(text + "# looked at\n")
    with pytest.raises(RefusedError, match=r"another study \(arm\.yaml has changed\)"):
        run_study(study, out, execution=Execution(1))
    (out / STATE).unlink()
    run_study(study, out, execution=Execution(1))


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
        with pytest.raises(RefusedError, match=r"the cluster lost .*the same command goes on"):
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


@pytest.mark.skipif(find_compiler() is None, reason="no compiler")
def test_all_of_a_portable_study_is_portable(tmp_path, monkeypatch):
    """Models are shared within a process: that others were built before, for this processor, changes nothing."""
    study = write_study(tmp_path, 4, "{poses: 12}")
    run_study(study, tmp_path / "native", execution=Execution(1))
    asked = []

    def load(source, optimisation, entry, *, portable=False):
        asked.append((entry, portable))
        return load_library(source, optimisation, entry, portable=portable)

    monkeypatch.setattr("symcal.kernels.compiled.load_library", load)
    run_study(study, tmp_path / "portable", execution=Execution(1, portable=True))
    assert {entry for entry, _ in asked} == {"symcal_fit", "symcal_kernel"}
    assert all(portable for _, portable in asked), asked


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


def test_the_lock_of_who_came_next_is_kept(tmp_path):
    """A finished study's folder is exchanged for a new one: the next process may be in it before this one is out."""
    from symcal.trials.store import LOCK, opened

    folder = tmp_path / "study"
    with opened(folder):
        folder.rename(tmp_path / "old")
        folder.mkdir()
        (folder / LOCK).write_text("")
    assert (folder / LOCK).exists()
    with opened(folder):
        assert (folder / LOCK).exists()
    assert not (folder / LOCK).exists()


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
    assert [path.name for path in out.iterdir()] == [STATE]


@pytest.mark.skipif(sys.platform != "linux", reason="workers are copies of this process on Linux only")
@pytest.mark.parametrize("after", [0, 1])
def test_a_dead_worker_is_one_sentence(small, monkeypatch, after):
    """Killed at its first shard, or while it has been given one and more wait for it; what was done is kept."""
    here, done = os.getpid(), []

    def dying(digest, data, shard):
        if os.getpid() != here and len(done) >= after:
            os.kill(os.getpid(), signal.SIGKILL)
        done.append(shard)
        return run_shard(digest, data, shard)

    monkeypatch.setattr("symcal.trials.local.run_shard", dying)
    out = small / f"dead{after}"
    with pytest.raises(RefusedError, match=r"a worker of the study died.*the same command goes on"):
        run_study(small / "study.yaml", out, execution=Execution(2, shard=5))
    monkeypatch.undo()
    assert table(small / "study.yaml", out, Execution(1)) == (small / "one/trials.csv").read_bytes()


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
