"""What a run leaves behind and later commands read: calibrated.yaml, results.json, manifest.json."""

from __future__ import annotations

import io
import json
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

import symcal as sc

_EXPERIMENT = """
name: finished
seed: 3
units: {length: mm, angle: deg}
robot: arm.yaml
measurement: {type: position, points: {P: [40, 0, 60]}, estimate: [base]}
data: {source: file, file: given.csv, columns: {pose: nr}, split: {column: part, train: [train], test: [test]}}
outputs: {figures: false, report: false}
"""


@cache
def _kept() -> tempfile.TemporaryDirectory[str]:
    """A folder that goes with the process."""
    return tempfile.TemporaryDirectory(prefix="symcal-fuzz")


@cache
def finished(arm: bytes) -> Path:
    """The folder of a whole run on a file whose columns have names of their own; beside it `new.csv`, other poses."""
    from symcal.data.saved_measurements import save_measurements
    from symcal.runs.run import run

    folder = Path(_kept().name)
    (folder / "arm.yaml").write_bytes(arm)
    robot, rng = sc.load_robot(folder / "arm.yaml"), np.random.default_rng(3)
    task = sc.Task.of("position", ("base",), {"P": (40.0, 0.0, 60.0)})
    for name, poses in (("given", 24), ("new", 6)):
        q = rng.uniform(robot.lower, robot.upper, (poses, robot.dof))
        truth = {"theta_1": 0.01, "d_1": 0.5, "a_3": -0.4}
        data = sc.simulate(sc.build_model(robot, task), truth, q, sc.Noise(position=0.05), rng)
        save_measurements(data, robot, folder / f"{name}.csv")
    head, *rows = (folder / "given.csv").read_text().splitlines()
    assert head.startswith("pose,")
    split = [f"{row},{'test' if i % 4 == 0 else 'train'}" for i, row in enumerate(rows)]
    (folder / "given.csv").write_text("\n".join([f"nr{head[4:]},part", *split]) + "\n")
    (folder / "experiment.yaml").write_text(_EXPERIMENT)
    return run(folder / "experiment.yaml", folder / "run")[0]


def beside(arm: bytes, folder: Path, name: str) -> list[bytes]:
    """A copy of the run in a folder, ready for one of its files to be made worse; that file."""
    shutil.copytree(finished(arm), folder / "run", dirs_exist_ok=True)
    return [(folder / "run" / name).read_bytes()]


def in_place(path: Path, name: str) -> Path:
    """The run beside a mutated file, which takes the place of the run's own."""
    run = path.parent / "run"
    shutil.copyfile(path, run / name)
    return run


def read_results(arm: bytes, path: Path) -> object:
    """As `symcal compare` does, with everything that it says and draws from numbers, but for the drawing."""
    from rich.console import Console

    from symcal.cli import terminal
    from symcal.cli.compare import print_comparison
    from symcal.runs.compare import _tables, compare_runs

    content = compare_runs([finished(arm), in_place(path, "results.json")])
    json.dumps(content, allow_nan=False)
    said, before = io.StringIO(), terminal.output
    terminal.output = lambda: Console(file=said)  # type: ignore[assignment]
    try:
        print_comparison(content)
    finally:
        terminal.output = before
    return _tables(content), said.getvalue()


def read_calibrated(arm: bytes, path: Path) -> object:
    """As validate, compare, export and compensate do, one after the other: each may refuse what it needs."""
    from symcal.export.gate import doubts
    from symcal.export.json import json_text
    from symcal.runs.compare import compare_runs
    from symcal.runs.validate import validate_robot

    robot = sc.load_robot(path)
    for use in (
        lambda: doubts(robot),
        lambda: json_text(robot),
        lambda: compare_runs([finished(arm), path]),
        lambda: validate_robot(path, finished(arm).parent / "new.csv"),
    ):
        _tried(use)
    return robot.nominal()


def _tried(use: Callable[[], object]) -> None:
    from symcal.errors import SymcalError

    try:
        use()
    except SymcalError as error:
        if not fine(str(error)):
            raise AssertionError(repr(str(error))) from None


def fine(text: str) -> bool:
    """Whether a refusal can be shown to people: no characters that steer a terminal, and not a book."""
    return all(c.isprintable() or c == "\n" for c in text) and len(text) < 20_000


def read_manifest(path: Path) -> None:
    """As every command that replaces a folder does."""
    from symcal.runs.folder import require_replaceable

    require_replaceable(in_place(path, "manifest.json"))
