"""Several calibrations of one robot beside each other: what differs beyond the uncertainty, and how good each is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from symcal.calibration import results
from symcal.calibration.robot_difference import RobotDifference, robot_difference
from symcal.documents.read import TABLE_LIMIT, read_text
from symcal.errors import InputError, RefusedError
from symcal.report.comparison import cautions
from symcal.report.measured import judged
from symcal.report.verdict import judging_part
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot
from symcal.runs.folder import require_replaceable, run_folder, write_json, write_table
from symcal.runs.results_file import read_results, size_of

MOST = 8
"""Runs in one comparison: more are not told apart in a figure."""

_DATA = 2  # inputs before these are the experiment and the robot


@dataclass(frozen=True, slots=True)
class Run:
    """One calibration. content: of its results.json, or as much of it as the calibrated robot records."""

    name: str
    file: Path
    robot: Robot
    content: Mapping[str, Any]

    @property
    def provenance(self) -> Mapping[str, Any]:
        assert self.robot.record is not None
        return self.robot.record.provenance


def compare_runs(
    paths: Sequence[Path], out: Path | None = None, progress: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Compare calibrations of one robot with the first of them; the content of results.json.

    Args:
        paths: folders of runs, or calibrated.yaml files. out: the folder to write numbers, tables and the figure into.
    Raises:
        InputError: one of them is no calibration, or its files do not belong together.
        RefusedError: fewer than two or more than eight, or calibrations of different robots.
    """
    if len(paths) < 2:
        raise RefusedError("one run has nothing to be compared with: name two or more")
    if len(paths) > MOST:
        raise RefusedError(f"{len(paths)} runs: compare at most {MOST} at once")
    if out is not None:
        require_replaceable(out, paths)
    progress("reading the runs")
    runs = [_read(path, name) for path, name in zip(paths, _names(paths), strict=True)]
    first, *others = runs
    pairs = []
    for other in others:
        progress(f"comparing {other.name} with {first.name}")
        try:
            pairs.append(_pair(first, other, robot_difference(first.robot, other.robot)))
        except RefusedError as error:
            raise RefusedError(f"{first.name} and {other.name}: {error}") from None
    title = f"Comparison of {len(runs)} calibrations of {first.robot.name}"
    content = {
        **results.header(first.robot.name, title, 0, [run.file for run in runs], Path.cwd()),
        "robot": results.robot_facts(first.robot),
        "runs": {run.name: _facts(run) for run in runs},
        "comparison": pairs,
    }
    content["warnings"] = cautions(content)
    if out is not None:
        _write(content, out, paths, progress)
    return content


def _read(path: Path, name: str) -> Run:
    file = path / "calibrated.yaml" if path.is_dir() else path
    if path.is_dir() and not file.is_file():
        message = "this folder holds no calibrated.yaml: compare takes folders of identifications, or such a file"
        raise InputError(message, file=path)
    robot = load_robot(file)
    if robot.record is None:
        raise InputError("this robot has no 'calibration': compare takes the calibrated.yaml of a run", file=file)
    return Run(name, file, robot, _content(file, robot))


def _content(file: Path, robot: Robot) -> Mapping[str, Any]:
    """The results.json beside a calibrated robot; without one what the robot records.

    Raises:
        InputError: it cannot be read, is of another version, or of another calibration.
    """
    assert robot.record is not None
    beside = file.parent / "results.json"
    if not beside.is_file():
        return robot.record.provenance
    content = read_results(beside)
    found = {name: each["error"] for name, each in content["identification"]["parameters"].items()}
    if found != dict(robot.record.errors):
        message = f"these are the results of another calibration than {file.name} beside it: compare whole runs"
        raise InputError(message, file=beside)
    return content


def _names(paths: Sequence[Path]) -> list[str]:
    """What runs are called: by their folders, with as many parents as tell them apart; same paths by numbers."""
    folders = [(p if p.is_dir() else p.parent if p.name == "calibrated.yaml" else p).absolute() for p in paths]
    shown = [folder.name for folder in folders]
    for depth in range(2, max(len(folder.parts) for folder in folders)):
        known = dict(zip(folders, shown, strict=True))  # one folder twice has one name
        twice = {name for name in known.values() if list(known.values()).count(name) > 1}
        shown = ["/".join(f.parts[-depth:]) if n in twice else n for n, f in zip(shown, folders, strict=True)]
    return [f"{n} ({shown[: i + 1].count(n)})" if shown.count(n) > 1 else n for i, n in enumerate(shown)]


def _facts(run: Run) -> dict[str, Any]:
    """How good a run is, as far as it says; numbers that an older run does not have are None."""
    content, own = run.content, run.provenance
    identified, measured, seen, decision = (
        _part(content, name) for name in ("identification", "measurement", "identifiability", "decision")
    )
    facts: dict[str, Any] = {
        "file": str(run.file),
        "title": content.get("title", run.robot.name),
        "poses": measured.get("poses", {}),
        "rank": own.get("rank"),
        "parameters": seen.get("parameters"),
        "noise": identified.get("noise", {}),
        "size_factor": own.get("size_factor"),
        "trouble": own.get("trouble", ""),
        "accepted": decision.get("accepted"),
        "reasons": _texts(decision.get("reasons")),
        "accuracy": None,
    }
    try:
        what, part = judged(content), judging_part(content)
        facts["accuracy"] = {
            "part": part,
            "quantity": what.key,
            "unit": what.unit,
            "against": content.get("against"),
            **{state: size_of(content, part, state, what.key) for state in ("before", "after")},
        }
    except (
        KeyError,
        TypeError,
        ValueError,
        AttributeError,
        StopIteration,
    ):  # a robot that was calibrated by other means says nothing of it
        pass
    return facts


def _part(content: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Some of what a run says; nothing where that is nothing of its kind, as in a file that was changed by hand."""
    found = content.get(name)
    return found if isinstance(found, Mapping) else {}


def _texts(reasons: object) -> list[str]:
    found = reasons if isinstance(reasons, list) else []
    return [str(reason["text"]) for reason in found if isinstance(reason, Mapping) and "text" in reason]


def _pair(first: Run, other: Run, found: RobotDifference) -> dict[str, Any]:
    numbers, differing = found.numbers, found.differing
    columns = {
        "first": found.first,
        "second": found.second,
        "difference": numbers.values,
        "sigma": numbers.sigmas,
        "half_width_95": numbers.half_widths,
        "told": numbers.told,
        "p": numbers.each,
        "p_adjusted": numbers.adjusted,
    }
    return {
        "first": first.name,
        "second": other.name,
        "identical": found.same,
        "shared": _shared(first, other),
        "p": numbers.p,
        "statistic": numbers.statistic,
        "directions": numbers.directions,
        "dof": numbers.dof,
        "differing": list(differing),
        "tool_mm": {
            "rms": found.tool.rms,
            "p95": found.tool.p95,
            "max": found.tool.largest,
            "expected_rms": found.tool.expected,
            "aligned": list(found.tool.aligned),
            "at": found.tool.at.tolist(),
        },
        "parameters": {
            name: {"unit": found.units[name]}
            | {key: None if np.isnan(of[i]) else float(of[i]) for key, of in columns.items()}
            | {"differs": name in differing}
            for i, name in enumerate(found.names)
        },
        "left_out": dict(found.left_out),
    }


def _shared(first: Run, other: Run) -> str | None:
    """What makes two runs dependent on each other, as far as they say; None if nothing does."""
    inputs = [dict(run.provenance.get("inputs") or {}) for run in (first, other)]
    files = [list(each.values()) for each in inputs]
    rows = [_rows(run.file.parent) for run in (first, other)]
    if all(rows):
        common = len(rows[0] & rows[1])
        if common:
            return f"{common} of the same measurements"
    elif data := set(files[0][_DATA:]) & set(files[1][_DATA:]):
        return f"the file {next(Path(name).name for name, of in inputs[0].items() if of in data)}"
    seeds = [run.provenance.get("seed") for run in (first, other)]
    if all(files) and not any(each[_DATA:] for each in files) and files[0][0] == files[1][0] and seeds[0] == seeds[1]:
        return "the seed of one simulation"
    return None


def _rows(folder: Path) -> set[str]:
    """The measurements that a run kept, a line each; none where it is no run's folder."""
    found: set[str] = set()
    for file in (folder / "measurements.csv", *sorted(folder.glob("measurements/*.csv"))):
        if file.is_file():
            try:
                lines = [line for line in read_text(file, TABLE_LIMIT).splitlines() if not line.startswith("#")]
            except InputError:
                continue
            found |= set(lines[1:])
    return found


def _write(content: Mapping[str, Any], out: Path, inputs: Sequence[Path], progress: Callable[[str], None]) -> None:
    from symcal.plots.comparison import comparison
    from symcal.plots.save import save_figure

    with run_folder(out, inputs) as folder:
        write_json(folder / "results.json", content)
        (folder / "tables").mkdir()
        for name, rows in _tables(content).items():
            write_table(folder / "tables" / f"{name}.csv", rows)
        progress("drawing")
        (folder / "figures").mkdir()
        save_figure(comparison(content), folder / "figures")


def _tables(content: Mapping[str, Any]) -> dict[str, list[dict[str, Any]]]:
    differences, pairs, runs = [], [], []
    for pair in content["comparison"]:
        named = {"first": pair["first"], "second": pair["second"]}
        tool = {f"tool_{k}_mm": pair["tool_mm"][k] for k in ("rms", "p95", "max", "expected_rms")}
        pairs.append(named | {k: pair[k] for k in ("p", "statistic", "directions", "dof")} | tool)
        for name, facts in pair["parameters"].items():
            moved = {"first_error": facts["first"], "second_error": facts["second"]}
            rest = {k: v for k, v in facts.items() if k not in ("first", "second")}
            differences.append({"parameter": name, **named, **moved, **rest})
    for name, facts in content["runs"].items():
        row = {"run": name, **{k: facts[k] for k in ("rank", "parameters", "size_factor", "accepted")}}
        accuracy = facts["accuracy"] or {}
        row |= {k: accuracy.get(k) for k in ("part", "quantity")}
        row |= {f"{state}_{k}": accuracy.get(state, {}).get(k) for state in ("before", "after") for k in ("rms", "p95")}
        runs.append(row)
    return {"differences": differences, "pairs": pairs, "runs": runs}
