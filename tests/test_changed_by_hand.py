"""What a run left behind and somebody changed: one error with the key, or the sentence of who needs it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from fuzz.finished import finished
from fuzz.readers import ARM

import symcal as sc
from symcal.errors import InputError
from symcal.runs.compare import compare_runs
from symcal.runs.validate import validate_robot

GONE = object()


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished(ARM), tmp_path / "run"))


def put(content: Any, key: str, value: object) -> None:
    *inside, last = key.split(".")
    for part in inside:
        content = content[part]
    if value is GONE:
        del content[last]
    else:
        content[last] = value


def changed(run: Path, name: str, key: str, value: object) -> Path:
    """A copy of the run with one value of a file changed; the file."""
    path = run / name
    content = yaml.safe_load(path.read_text()) if name.endswith(".yaml") else json.loads(path.read_text())
    put(content, key, value)
    path.write_text(yaml.safe_dump(content) if name.endswith(".yaml") else json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("key", "value", "at"),
    [
        ("size_factor", [1], "size_factor"),
        ("size_factors", {"x": 0.0}, "size_factors.x"),
        ("dof", "many", "dof"),
        ("dof", float("inf"), "dof"),
        ("learnt.theta_1", "x", "learnt.theta_1"),
        ("loss", ["linear"], "loss"),
        ("priors", [1], "priors"),
        ("noise_sigma", 3, "noise_sigma"),
        ("noise_estimated", None, "noise_estimated"),
        ("accuracy", [], "accuracy"),
        ("accuracy.test", 3, "accuracy.test"),
        ("measurements.position", 3, "measurements.position"),
        ("measurements.position.unknown", {"place": True, "points": []}, "measurements.position.unknown.target"),
        ("measurements.position.unknown.points", "P", "measurements.position.unknown.points"),
        ("measurements.position.target", GONE, "measurements.position.target"),
        ("measurements.position.names", {"place": 3, "prefix": ""}, "measurements.position.names.place"),
        ("layout.position.columns", [3], "layout"),
        ("layout", {"position": 3}, "layout"),
        ("notes", {"deep": [1, float("nan")]}, "notes.deep[1]"),
    ],
)
def test_what_a_calibration_says_of_itself(run: Path, key: str, value: object, at: str) -> None:
    path = changed(run, "calibrated.yaml", f"calibration.provenance.{key}", value)
    with pytest.raises(InputError) as caught:
        sc.load_robot(path)
    assert caught.value.key == f"calibration.provenance.{at}"
    assert caught.value.line is not None


@pytest.mark.parametrize(
    "key", ["measurements.position.unknown", "size_factor", "noise_sigma", "dof", "learnt", "loss"]
)
def test_what_is_missing_is_said_where_it_is_needed(run: Path, key: str) -> None:
    """As in files of earlier versions: the robot is judged, and only the second calibration left out."""
    path = changed(run, "calibrated.yaml", f"calibration.provenance.{key}", GONE)
    content = validate_robot(path, finished(ARM).parent / "new.csv")
    assert "accuracy" in content
    assert "earlier version" in json.dumps(content["halves"])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("identification.parameters.theta_1", 3),
        ("identification.parameters.theta_1.error", None),
        ("identification.noise", {"x": {"sigma": "1", "unit": "mm"}}),
        ("measurement.poses", [3]),
        ("measurement.poses.train", "many"),
        ("decision.accepted", "yes"),
        ("decision.reasons", [3]),
        ("decision", []),
        ("title", {"a": 1}),
        ("accuracy", []),
    ],
)
def test_results_that_no_run_writes(run: Path, key: str, value: object) -> None:
    changed(run, "results.json", key, value)
    with pytest.raises(InputError, match=r"results\.json: key '.*': this is not what a run writes"):
        compare_runs([finished(ARM), run])


def test_text_in_results_that_steers_a_terminal(run: Path) -> None:
    changed(run, "results.json", "title", "\x1b[2J")
    with pytest.raises(InputError, match="control character"):
        compare_runs([finished(ARM), run])


@pytest.mark.parametrize("value", [None, {}, {"rms": "x", "p95": 1.0}, 3])
def test_errors_that_are_none_are_not_compared(run: Path, value: object) -> None:
    part = "test.after.position_mm"
    changed(run, "results.json", f"accuracy.{part}", value)
    runs = compare_runs([finished(ARM), run])["runs"]
    assert [facts["accuracy"] is None for facts in runs.values()] == [False, True]


@pytest.mark.parametrize(
    ("key", "value"), [("decision", True), ("decision.reasons", 3), ("identification", "x"), ("measurement", [1])]
)
def test_what_a_lone_calibration_says_is_compared_as_far_as_it_is_that(
    run: Path, tmp_path: Path, key: str, value: object
) -> None:
    """Without the results.json beside it."""
    lone = tmp_path / "lone"
    lone.mkdir()
    shutil.copy(run / "calibrated.yaml", lone)
    changed(lone, "calibrated.yaml", f"calibration.provenance.{key}", value)
    found = compare_runs([run, lone / "calibrated.yaml"])
    (pair,) = found["comparison"]
    assert pair["identical"]
    assert (found["runs"]["lone"]["reasons"] == []) is key.startswith("decision")
