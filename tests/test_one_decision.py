"""The same decision wherever it is asked for: terminal, report, results, exit code, and every way to a controller."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_arms import Measured, measure, write_experiment
from scipy.spatial.transform import Rotation

import symcal as sc
from symcal import cli
from symcal.calibration.identify import identify
from symcal.calibration.simulate import simulate
from symcal.config import conversion as config
from symcal.data.dataset import Dataset
from symcal.errors import InputError, RefusedError
from symcal.export import export_c, save_json, save_urdf
from symcal.export.delivery import deliver_c
from symcal.export.gate import check_exportable, doubts
from symcal.instruments.noise import Noise
from symcal.model.model import build_model
from symcal.model.task import Task
from symcal.report.identification import identification_text
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Robot
from symcal.runs.run import run

EXPORTS: dict[str, Callable[[Robot, Path], Any]] = {
    "export_c": lambda robot, folder: export_c(robot, folder / "c"),
    "save_urdf": lambda robot, folder: save_urdf(robot, folder / "robot.urdf"),
    "save_json": lambda robot, folder: save_json(robot, folder / "robot.json"),
    "check_exportable": lambda robot, _: check_exportable(robot),
}


@dataclass(frozen=True)
class Said:
    code: int
    out: str
    err: str


@pytest.fixture
def symcal(capsys, monkeypatch) -> Callable[..., Said]:
    """`symcal ARGS` with lines as wide as they are."""
    monkeypatch.setenv("COLUMNS", "100000")

    def call(*arguments: object) -> Said:
        monkeypatch.setattr(sys, "argv", ["symcal", *map(str, arguments)])
        code = 0
        try:
            cli.main()
        except SystemExit as exit_:
            code = int(exit_.code or 0)
        return Said(code, *capsys.readouterr())

    return call


def tracked(folder: Path, spoilt: Callable[[Measured], None] = lambda _: None, tail: str = "") -> Path:
    """A tracker campaign on the Puma, 30 poses and 20 held out; the experiment's path."""
    measured = measure("puma", "standard", np.random.default_rng(5), 30, 20)
    spoilt(measured)
    path = write_experiment(measured, folder, "long")
    path.write_text(path.read_text() + tail)
    return path


def moved(measured: Measured) -> None:
    """The tracker was moved before the held-out poses."""
    held_out = np.array(measured.split) == "test"
    measured.z[held_out] += np.tile([400.0, -300.0, 100.0], 2)


def reasons(content: Any) -> list[str]:
    return [reason["text"] for reason in content["decision"]["reasons"]]


def test_a_refusal_is_the_same_everywhere(tmp_path: Path, symcal: Callable[..., Said]) -> None:
    folder = tmp_path / "out"
    said = symcal("run", tracked(tmp_path, moved), "--out", folder, "--set", "outputs.c=true", "--quiet")
    content = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    why = reasons(content)
    assert {reason["kind"] for reason in content["decision"]["reasons"]} == {"mistake", "worthless", "no_gain"}
    # exit code and terminal
    assert said.code == 1
    assert all(text in said.err for text in why)
    assert said.out == ""
    assert str(folder) in said.err
    # results and report
    assert content["decision"]["sentence"] == f"refused: {'; '.join(why)}"
    page = identification_text(content)
    assert page["usable"] is False
    assert page["decision"]["title"].startswith("Refused")
    assert page["decision"]["lines"] == [f"{text[0].upper()}{text[1:]}." for text in why]
    assert not any(text in sentence for text in why for sentence in page["verdict"])
    assert "refused" in page["handover"]["gate"]
    # the C code of the run
    assert not (folder / "c").exists()
    assert content["controller"]["code"] == {"written": False, "doubts": why}
    assert [w for w in content["warnings"] if "no C code" in w] == [
        "no C code was written, because the calibration is refused"
    ]
    # the file, and every way out of it
    robot = load_robot(folder / "calibrated.yaml")
    assert [doubt.text for doubt in doubts(robot)] == why
    for name, way in EXPORTS.items():
        with pytest.raises(RefusedError, match="should not go to a controller") as error:
            way(robot, tmp_path)
        assert all(text in str(error.value) for text in why), name
    exported = symcal("export", folder / "calibrated.yaml", "--to", "json", "--out", tmp_path / "no")
    assert exported.code == 1
    assert all(text in exported.err for text in why)
    assert not (tmp_path / "no" / "robot.json").exists()
    forced = symcal("export", folder / "calibrated.yaml", "--to", "json", "--out", tmp_path / "no", "--force")
    assert forced.code == 0
    assert forced.err.splitlines() == [f"doubt overridden: {text}" for text in why]
    assert json.loads((tmp_path / "no" / "robot.json").read_text())["provenance"]["decision"]["accepted"] is False


def test_an_acceptance_is_the_same_everywhere(tmp_path: Path, symcal: Callable[..., Said]) -> None:
    folder = tmp_path / "out"
    said = symcal("run", tracked(tmp_path), "--out", folder)
    content = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    decision = content["decision"]
    assert said.code == 0
    assert decision["accepted"]
    assert decision["reasons"] == []
    assert decision["sentence"] in said.out
    page = identification_text(content)
    assert page["usable"]
    assert page["decision"]["lines"] == [f"{decision['basis'][0].upper()}{decision['basis'][1:]}."]
    assert page["handover"]["gate"] == "The calibration is accepted: it may go to a controller."
    robot = load_robot(folder / "calibrated.yaml")
    assert doubts(robot) == ()
    save_urdf(robot, tmp_path / "robot.urdf")
    assert symcal("export", folder / "calibrated.yaml", "--to", "c", "--out", tmp_path).code == 0


@pytest.mark.parametrize(
    ("tolerance", "kinds"),
    [
        ({"position": 0.5, "of": "max"}, set()),
        ({"position": 0.1, "orientation": 1e-4}, {"position", "unseen"}),
    ],
)
def test_a_tolerance_of_the_file_decides(tmp_path: Path, tolerance: dict[str, Any], kinds: set[str]) -> None:
    """Errors are those of 0.05 mm per axis; nothing tells the last joint's zero from the reflectors' places."""
    _, content = run(tracked(tmp_path), tmp_path / "out", overrides=[f"validation.tolerance={json.dumps(tolerance)}"])
    assert {reason["kind"] for reason in content["decision"]["reasons"]} == kinds
    assert content["decision"]["tolerance"]["position_mm"] == tolerance["position"]
    again = config.load_experiment(tmp_path / "out" / "experiment.resolved.yaml")[0].validation.tolerance
    assert again is not None
    assert again.position == tolerance["position"]


def test_the_tolerance_is_in_the_units_of_the_file(tmp_path: Path) -> None:
    path = tracked(tmp_path, tail="validation: {tolerance: {position: 0.0004, orientation: 0.002}}\n")
    path.write_text(path.read_text().replace("units: {length: mm, angle: deg}", "units: {length: m, angle: rad}"))
    found = config.tolerance_of(config.load_experiment(path)[0])
    assert found is not None
    assert (found.position, found.orientation) == pytest.approx((0.4, 0.002))
    path.write_text(path.read_text().replace("{position: 0.0004, orientation: 0.002}", "{of: rms}"))
    with pytest.raises(InputError, match="say how far off the tool may be"):
        config.load_experiment(path)


def test_poses_of_a_corner_do_not_cover_the_working_area(tmp_path: Path) -> None:
    """Measured within a tenth of the joints' ranges, asked for over all of them."""
    measured = measure("puma", "standard", np.random.default_rng(5), 60, 20)
    small = replace(measured, q=0.1 * measured.q)
    model = build_model(measured.robot, Task.of("position", points={"SMR1": (60, 10, 130), "SMR2": (-45, 50, 90)}))
    z = simulate(model, measured.truth, small.q, Noise("normal", 0.05), np.random.default_rng(6)).z
    path = write_experiment(replace(small, z=z), tmp_path, "long")
    area = ", ".join(f"A{i}: [-140, 140]" for i in range(1, 7))
    path.write_text(f"{path.read_text()}validation: {{tolerance: {{position: 50}}}}\nplan: {{area: {{{area}}}}}\n")
    _, content = run(path, tmp_path / "out")
    assert {reason["kind"] for reason in content["decision"]["reasons"]} == {"coverage"}


def test_without_folds_and_test_poses_poses_are_left_out_in_turn(tmp_path: Path) -> None:
    path = write_experiment(measure("puma", "standard", np.random.default_rng(5), 30, 0), tmp_path, "long")
    _, content = run(path, tmp_path / "out", overrides=["validation.folds=0"])
    assert content["decision"]["accepted"]
    assert content["decision"]["basis"].startswith("on poses left out in turn")
    assert content["decision"]["cautions"]
    strict = ["validation.folds=0", "validation.tolerance={position: 5}"]
    _, content = run(path, tmp_path / "out", overrides=strict)
    assert [reason["kind"] for reason in content["decision"]["reasons"]] == ["unjudged"]


# ----------------------------------------------------------------------------------------------------- new measurements


@pytest.fixture(scope="module")
def validated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a calibrated robot and new measurements, good ones and those of a tracker that was moved."""
    folder = tmp_path_factory.mktemp("validated")
    run(tracked(folder), folder / "out")
    for name, spoilt in (("good", lambda _: None), ("moved", moved)):
        (folder / name).mkdir()
        tracked(folder / name, spoilt)
        table = (folder / name / "data.csv").read_text().splitlines()
        kept = [table[0], *(row for row in table[1:] if row.endswith("test"))]
        (folder / f"{name}.csv").write_text("\n".join(kept) + "\n")
    return folder


@pytest.mark.parametrize(
    ("data", "options", "code", "words"),
    [
        ("good", (), 0, "accepted: on the test poses it is better than"),
        ("good", ("--tolerance", "0.5mm"), 0, "the tolerance is 0.500 mm"),
        ("good", ("--tolerance", "0.05mm"), 1, "beyond the tolerance of 0.0500 mm"),
        ("good", ("--tolerance", "0.0005m", "--of", "rms"), 0, "the tolerance is 0.500 mm"),
        ("good", ("--tolerance", "0.5"), 1, "each with its unit, such as 0.5mm,0.1deg"),
        ("moved", (), 1, "better by no more than chance than the nominal one"),
        ("moved", ("--tolerance", "0.5mm"), 1, "beyond the tolerance of 0.500 mm"),
    ],
)
def test_new_measurements_accept_or_refuse(
    validated: Path, symcal: Callable[..., Said], data: str, options: tuple[str, ...], code: int, words: str
) -> None:
    said = symcal("validate", validated / "out" / "calibrated.yaml", "--data", validated / f"{data}.csv", *options)
    assert said.code == code
    assert words in (said.err if code else said.out)


# ------------------------------------------------------------------------------------------------- worthless, in Python


@dataclass(frozen=True)
class Posed:
    """Poses of a six-axis arm's tool in a part of its ranges, 40 to train with and 20 that are held out."""

    robot: Robot
    task: Task
    data: Dataset


@pytest.fixture(scope="module")
def posed() -> Posed:
    measured = measure("puma", "standard", np.random.default_rng(5), 40, 20)
    robot, task = measured.robot, Task.of("pose", frozenset({"base", "tool"}))
    truth = {name: error for name, error in measured.truth.items() if name != "theta_1"}
    noise = Noise(position=0.05, orientation=1e-4)
    data = simulate(build_model(robot, task), truth, 0.05 * measured.q, noise, np.random.default_rng(1))
    return Posed(robot, task, replace(data, split=measured.split))


def conjugate(data: Dataset) -> Dataset:
    z = data.z.copy()
    z[:, 3:6] *= -1
    return replace(data, z=z)


def turned(data: Dataset) -> Dataset:
    """Held-out poses of a target that was turned on its mount."""
    z, held_out = data.z.copy(), np.array(data.split) == "test"
    z[held_out, 3:] = (Rotation.from_quat(z[held_out, 3:]) * Rotation.from_rotvec([0.3, 0, 0])).as_quat()
    return replace(data, z=z)


def moved_poses(data: Dataset) -> Dataset:
    z = data.z.copy()
    z[np.array(data.split) == "test", :3] += [400, -300, 100]
    return replace(data, z=z)


def noise(data: Dataset) -> Dataset:
    """An instrument of 40 mm: nothing that it read tells the errors of the robot."""
    z = data.z.copy()
    z[:, :3] += 40 * np.random.default_rng(3).normal(size=(len(z), 3))
    return replace(data, z=z)


@pytest.mark.parametrize("spoilt", [conjugate, turned, moved_poses, noise])
def test_what_is_worthless_reaches_no_controller(
    posed: Posed, spoilt: Callable[[Dataset], Dataset], tmp_path: Path
) -> None:
    """Each is identified without a word of complaint."""
    robot = identify(posed.robot, spoilt(posed.data), posed.task).robot
    why = [doubt.text for doubt in doubts(robot)]
    assert why
    save_robot(robot, tmp_path / "calibrated.yaml")
    assert [doubt.text for doubt in doubts(load_robot(tmp_path / "calibrated.yaml"))] == why
    for way in (sc.save_json, sc.save_urdf):
        with pytest.raises(RefusedError, match="should not go to a controller"):
            way(robot, tmp_path / "out")
    with pytest.raises(RefusedError, match="should not go to a controller"):
        sc.export_c(robot, tmp_path / "c")
    assert [doubt.text for doubt in deliver_c(robot, tmp_path / "c", np.random.default_rng(1)).doubts] == why
    assert not (tmp_path / "out").exists()
    sc.save_json(robot, tmp_path / "out", force=True)


def test_what_is_good_does(posed: Posed, tmp_path: Path) -> None:
    for data in (posed.data, posed.data.part("train")):
        robot = identify(posed.robot, data, posed.task).robot
        assert doubts(robot) == ()
        sc.save_urdf(robot, tmp_path / "robot.urdf")


# ---------------------------------------------------------------------------------------------------------- older files


def test_files_of_before_there_were_decisions(posed: Posed) -> None:
    """Their errors and how their fit ended still tell something."""
    robot = identify(posed.robot, posed.data, posed.task).robot
    assert robot.record is not None
    old = {k: v for k, v in robot.record.provenance.items() if k != "decision"}

    def found(**provenance: Any) -> list[str]:
        return [
            doubt.kind for doubt in doubts(replace(robot, record=replace(robot.record, provenance=old | provenance)))
        ]

    def accuracy(before: float, after: float, part: str = "test") -> dict[str, Any]:
        both = {"before": before, "after": after}
        return {
            part: {state: {"position_mm": {"rms": rms}, "orientation_deg": {"rms": 1}} for state, rms in both.items()}
        }

    assert found() == ["unjudged"]
    assert found(trouble="stopped") == ["unsettled"]
    assert found(accuracy=accuracy(4.0, 1.0)) == []
    assert found(accuracy=accuracy(4.0, 1.0, "cross_validation")) == []
    assert found(accuracy=accuracy(4.0, 3.99)) == ["no_gain"]
    assert found(accuracy=accuracy(4.0, 1.0, "train")) == ["unjudged"]
    assert found(accuracy={"test": {"after": {}}}) == ["unjudged"]
    assert found(decision={"accepted": True}) == ["unjudged"]  # no decision that anybody made
