"""bench.json, its tables, the comparison with an earlier run, the figure and the command."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from symcal.bench import bench, commands, growth, positions
from symcal.bench import write as write_module
from symcal.bench.against import against, read_bench
from symcal.bench.contest import Progress
from symcal.bench.figure import growth_figure
from symcal.bench.machine import machine, one_core
from symcal.bench.processes import run_process
from symcal.bench.rounds import Pace
from symcal.bench.tables import duration, markdown, tables, times
from symcal.cli.app import app
from symcal.errors import InputError

SHORT = Pace(rounds=2, sample_s=0.0, slow_s=10.0)
SIZES = growth.Sizes((4, 8), (10, 20), (2, 3), (3, 6), (1, 4), (8, 4), held=4)

QUARTILES = {"median", "lower", "upper"}


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    """A whole bench, of next to nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench, "QUICK", SHORT)
        patch.setattr(bench, "_FEWEST", SHORT)
        patch.setattr(positions, "QUICK_SIZES", (1, 3))
        patch.setattr(growth, "QUICK_SIZES", SIZES)
        patch.setattr(bench.identifications, "BATCH", 4)
        patch.setattr(commands, "_commands", lambda *_, **__: ({commands.ALONE: _python("pass")}, {"x": "left out"}))
        return bench.run_bench(quick=True)


def _python(code: str) -> list[str]:
    import sys

    return [sys.executable, "-c", code]


def test_everything_is_there_and_json(content: dict[str, Any]) -> None:
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    assert content["schema"] == "symcal/bench/1"
    assert {"processor", "flags", "cores", "compiler", "kernels", "python", "packages", "load"} <= set(
        content["machine"]
    )
    assert set(content["peers"]) == {"jax", "pin", "figaroh", "robotkinecal"}
    subjects = [contest["subject"] for contest in content["contests"]]
    assert subjects == ["positions", "positions", "identifications", "commands"]
    for contest in content["contests"]:
        names = [entry["name"] for entry in contest["entries"]]
        assert contest["reference"] in names
        assert len(set(names)) == len(names)
        for entry in contest["entries"]:
            assert set(entry["seconds"]) == set(entry["wall"]) == set(entry["ratio"]) == QUARTILES
            assert 0 < entry["seconds"]["lower"] <= entry["seconds"]["median"] <= entry["seconds"]["upper"]
        own = next(entry for entry in contest["entries"] if entry["name"] == contest["reference"])
        assert own["ratio"] == {"median": 1.0, "lower": 1.0, "upper": 1.0}
    assert [panel["variable"] for panel in content["growth"]] == [
        "postures",
        "postures",
        "joints",
        "parameters",
        "trials",
    ]
    for panel in content["growth"]:
        assert panel["curves"][0]["name"] == "symcal"
        for curve in panel["curves"]:
            assert len(curve["sizes"]) == len(curve["seconds"]) > 0


def test_tables_say_what_the_file_says(content: dict[str, Any]) -> None:
    text = markdown(content, [])
    for contest in content["contests"]:
        assert f"## {contest['name']}" in text
        for entry in contest["entries"]:
            assert f"| {entry['name']} | {duration(entry['seconds']['median'])} |" in text
        for name, why in contest["absent"].items():
            assert f"{name}: {why}" in text
    for table in tables(content):
        assert all(len(row) == len(table.heads) for row in table.rows)
    assert content["machine"]["processor"] in text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (1.5e-9, "1.5 ns"),
        (999e-9, "999 ns"),
        (1e-6, "1 µs"),
        (0.0123, "12.3 ms"),
        (2.0, "2 s"),
        (123.4, "123 s"),
        (5e3, "5000 s"),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(("value", "text"), [(182.3, "182"), (8.527, "8.53"), (0.5036, "0.504"), (0.00023, "0.0002")])
def test_times_as_fast(value: float, text: str) -> None:
    assert times(value) == text


def test_a_power_is_found_at_the_largest_sizes() -> None:
    sizes = (1, 10, 100, 1000)
    assert growth.power(sizes, tuple(3.0 * n**1.5 for n in sizes)) == pytest.approx(1.5)
    assert growth.power(sizes, (7.0, 2.0, 4.0, 8.0)) == pytest.approx(np.log10(2))
    assert growth.power((10,), (1.0,)) is None


def test_an_earlier_run_beside_this_one(content: dict[str, Any], tmp_path: Path) -> None:
    """Of a machine that was half as fast in all: twice as fast now, and beside its reference as before."""
    old = _slower(content, 2.0)
    old["machine"]["compiler"] = "tcc"
    path = tmp_path / "old.json"
    path.write_text(json.dumps(old), encoding="utf-8")
    table = against(content, read_bench(path))
    entries = sum(len(contest["entries"]) for contest in content["contests"])
    points = sum(len(curve["sizes"]) for panel in content["growth"] for curve in panel["curves"])
    assert len(table.rows) == entries + points
    assert {row[3] for row in table.rows} == {"2"}
    assert {row[4] for row in table.rows} == {"1", ""}
    assert table.notes == (f"another compiler: tcc, now {content['machine']['compiler']}",)


def _slower(content: Mapping[str, Any], factor: float) -> dict[str, Any]:
    old = json.loads(json.dumps(content))
    for contest in old["contests"]:
        for entry in contest["entries"]:
            entry["seconds"]["median"] *= factor
    for panel in old["growth"]:
        for curve in panel["curves"]:
            curve["seconds"] = [factor * seconds for seconds in curve["seconds"]]
    return dict(old)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"schema": "symcal/bench/1"}', '{"schema": "symcal/bench/1", "contests": 3}']
)
def test_what_is_no_bench_is_refused_by_name(text: str, tmp_path: Path) -> None:
    path = tmp_path / "old.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"old\.json: this is no bench\.json"):
        read_bench(path)
    path.write_text('{"schema": "symcal/bench/9"}', encoding="utf-8")
    with pytest.raises(InputError, match="not a bench of this version"):
        read_bench(path)


def test_the_figure_draws_every_curve(content: dict[str, Any]) -> None:
    drawn = growth_figure(content["growth"])
    panels = [axes for axes in drawn.figure.axes if axes.get_title("left")]
    assert len(panels) == len(content["growth"])
    for axes, panel in zip(panels, content["growth"], strict=True):
        assert axes.get_xscale() == axes.get_yscale() == "log"
        for line, curve in zip(axes.lines, panel["curves"], strict=False):
            np.testing.assert_array_equal(line.get_xdata(), curve["sizes"])
            np.testing.assert_array_equal(line.get_ydata(), curve["seconds"])
    assert "grey: proportional growth" in drawn.caption


def test_the_command_leaves_a_folder(content: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def found(*, quick: bool, only: str | None, progress: Progress) -> dict[str, Any]:
        assert quick
        assert only == "growth"
        progress("measured")
        return content

    monkeypatch.setattr(write_module, "run_bench", found)
    old = tmp_path / "old.json"
    old.write_text(json.dumps(content), encoding="utf-8")
    out = tmp_path / "bench"
    arguments = ["bench", "--out", str(out), "--quick", "--only", "growth", "--against", str(old)]
    ended = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert ended.exit_code == 0
    assert "against the earlier run" in ended.output
    assert "position and Jacobian by 15 parameters, 3 postures" in ended.output
    made = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert made == {"bench.json", "bench.md", "manifest.json", "figures/growth.pdf", "figures/growth.png"}
    assert json.loads((out / "bench.json").read_text(encoding="utf-8")) == content
    with pytest.raises(InputError, match="no such file"):
        CliRunner().invoke(app, [*arguments[:-1], str(tmp_path / "none.json")], catch_exceptions=False)


def test_an_unknown_subject_is_an_error_before_anything_is_done() -> None:
    with pytest.raises(InputError, match="allowed: positions, identifications, commands, growth"):
        bench.run_bench(only="joints")


def test_commands_that_end_badly_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {commands.ALONE: _python("pass"), "broken": _python("raise SystemExit('no luck')")}
    monkeypatch.setattr(commands, "_commands", lambda *_, **__: (given, {}))
    held = commands.run(1, lambda _: None, slow=False)
    assert [entry["name"] for entry in held["entries"]] == [commands.ALONE]
    assert held["absent"] == {"broken": "ended with 1: no luck"}


def test_the_commands_measured_are_commands(tmp_path: Path) -> None:
    """The experiment that is written for them can be checked, and identified where all are asked for."""
    quick, absent = commands._commands(commands._experiment(tmp_path), tmp_path, slow=False)
    slow, _ = commands._commands(tmp_path / "experiment.yaml", tmp_path, slow=True)
    assert "symcal identify" in absent
    assert "symcal identify" in slow
    assert run_process(quick["symcal check"], folder=tmp_path).status == 0


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="memory of children is told elsewhere")
def test_memory_and_time_are_those_of_the_child() -> None:
    """Not of this process, which is large, nor of its start."""
    held = bytearray(300_000_000)
    small = run_process(_python("pass"))
    large = run_process(_python("held = bytearray(200_000_000); held[::4096] = b'x' * len(held[::4096])"))
    assert small.peak is not None
    assert large.peak is not None
    assert small.peak < 60
    assert 200 < large.peak < 290
    busy = run_process(_python("import time\nwhile time.process_time() < 0.3: pass"))
    assert busy.cpu is not None
    assert 0.3 <= busy.cpu < 2
    assert len(held) > 0


def test_one_core_is_given_back() -> None:
    import os

    before = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
    with one_core():
        if before:
            assert len(os.sched_getaffinity(0)) == 1
    assert not before or os.sched_getaffinity(0) == before


def test_the_machine_has_a_name() -> None:
    facts = machine()
    assert facts["processor"]
    assert facts["cores"] >= 1
    assert set(facts["packages"]) == {"symcal", "numpy", "scipy", "casadi"}


def test_sizes_of_a_full_run_go_as_far_as_they_say() -> None:
    full = growth.FULL_SIZES
    assert full.postures[-1] == 10**6
    assert full.joints == (3, 6, 7, 12)
    assert full.trials[-1] == 10**5
