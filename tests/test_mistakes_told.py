"""Gross mistakes of other data than one full set of points or poses: known points, several instruments, missing
readings, two mistakes at once, instruments that read no point; and where they are said."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import ARM, handling, measure, random_errors
from known_truth import kind
from measured_arms import arm, write_experiment, write_long
from measured_arms import measure as campaign
from mistake_draws import accused, good
from scipy.spatial.transform import Rotation
from strategies import random_frame

import symcal as sc
from symcal import cli
from symcal.calibration.calibrate import calibrate
from symcal.calibration.mistakes.identified import told_by_identification
from symcal.calibration.mistakes.search import find_mistakes
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import Model, build_model, nominal_setup
from symcal.model.task import Task

BASE = frozenset({"base"})
TRIO = {"A": (60.0, 10.0, 130.0), "B": (-45.0, 50.0, 90.0), "C": (5.0, -110.0, 40.0)}


def moved(model: Model, rng: np.random.Generator) -> Model:
    return replace(model, setup=replace(model.setup, base=random_frame(rng, 2000.0)))


def points(poses: int = 40, estimate: frozenset[str] = BASE) -> tuple[Model, Dataset]:
    """Three points of a target that is known, on an arm that is off."""
    rng = np.random.default_rng(21)
    model = build_model(ARM, Task.of("position", estimate, TRIO))  # type: ignore[arg-type]
    return model, measure(moved(model, rng), random_errors(model, rng), poses, rng, 0.05)


def test_swapped_points_of_a_known_target_are_named_as_points() -> None:
    model, data = points()
    assert find_mistakes(model, data) == ()
    (found,) = find_mistakes(model, replace(data, z=data.z[:, [3, 4, 5, 0, 1, 2, 6, 7, 8]]))
    assert found.kind == "points"
    assert found.hypotheses == ("the points 'A' and 'B' are swapped",)
    model, data = points(estimate=BASE | {"tool"})  # how they lie to each other alone
    assert find_mistakes(model, data) == ()
    (found,) = find_mistakes(model, replace(data, z=data.z[:, [6, 7, 8, 3, 4, 5, 0, 1, 2]]))
    assert found.hypotheses == ("the points 'A' and 'C' are swapped",)
    metres = build_model(ARM, Task.of("position", BASE, {n: tuple(v / 1000 for v in p) for n, p in TRIO.items()}))
    (found,) = find_mistakes(metres, data)
    assert found.hypotheses == ("the target's points are in metres, given as millimetres",)


def test_a_sign_is_named_where_most_readings_are_missing() -> None:
    model, data = points()
    z = data.z.copy()
    z[np.random.default_rng(2).random(z.shape[0]) < 0.6, 3:6] = np.nan
    z[::3, :3] = np.nan
    assert find_mistakes(model, replace(data, z=z)) == ()
    (found,) = find_mistakes(model, replace(data, z=z, q=data.q * [1, -1, 1, 1, 1, 1]))
    assert "joint 2 counts the other way round (its sign)" in found.hypotheses


def test_two_signs_are_named_as_a_pair() -> None:
    model, data = points()
    (found,) = find_mistakes(model, replace(data, q=data.q * [1, -1, 1, 1, -1, 1]))
    assert any("joint 2 counts" in each and "joint 5 counts" in each for each in found.hypotheses)


def test_of_several_instruments_the_one_that_is_wrong_is_named() -> None:
    rng = np.random.default_rng(5)
    smr = sc.Target("smr", sc.Place("flange"), {"P": (40.0, 20.0, 90.0)})
    head = sc.Target("head", sc.Place("flange"))
    two = (
        sc.Observation(kind("position"), "tracker", target=smr),
        sc.Observation(kind("pose"), "mocap", at=sc.Place("world", unknown=True), target=head),
    )
    model = build_model(ARM, sc.Task(two, base=True))
    data = measure(moved(model, rng), random_errors(model, rng), 40, rng, 0.05, 2e-4)
    assert find_mistakes(model, data) == ()
    own = model.measurement.parts[1].readings
    z = data.z.copy()
    z[:, own] = np.hstack([z[:, own][:, :3], z[:, own][:, 3:] * [-1, -1, -1, 1]])
    (found,) = find_mistakes(model, replace(data, z=z))
    assert found.text.startswith("the data look as if mocap: the orientations are inverse")
    both = find_mistakes(model, replace(data, q=data.q * [1, 1, -1, 1, 1, 1]))
    assert [each.kind for each in both] == ["joint sign"]


# ------------------------------------------------------------------------------------------ by whole identifications


def wires(rng: np.random.Generator) -> tuple[Model, Dataset]:
    """Three draw-wires on the handling robot, anchors and the eye unknown."""
    eye = sc.Target("eye", sc.Place("flange"), {"P": None})
    anchors = ([2500.0, 900.0, 300.0], [-1200.0, 2600.0, 500.0], [300.0, -2300.0, 2200.0])
    found = []
    for name, xyz in zip("abc", anchors, strict=True):
        at = np.eye(4)
        at[:3, 3] = xyz
        found.append(sc.Observation(kind("distance"), name, at=sc.Place("world", at, unknown=True), target=eye))
    model = build_model(handling(), sc.Task(tuple(found)))
    setup = nominal_setup(model.robot, model.task)
    there = replace(model, setup=replace(setup, points=np.array([[40.0, 10.0, 60.0]])))
    return model, measure(there, random_errors(model, rng), 40, rng, 0.05)


def test_a_sign_is_named_by_distances_alone() -> None:
    model, data = wires(np.random.default_rng(8))
    assert find_mistakes(model, data) == ()  # distances are no points
    wrong = replace(data, q=data.q * [1, 1, -1, 1, 1])
    (found,) = told_by_identification(model, wrong) or ()
    assert "joint 3 counts the other way round (its sign)" in found.hypotheses
    assert found.after < 2.0 < 50.0 < found.before
    assert told_by_identification(model, data.take(np.arange(8))) is None
    assert calibrate(model, None, data, Options()).mistakes == ()


def short_of(robot: sc.Robot, seed: int) -> tuple[Model, Dataset]:
    """A point 40 mm off the last axis of an arm that is off by as much as the sign of this joint matters."""
    rng = np.random.default_rng(seed)
    model = build_model(robot, Task.of("position", BASE, {"P": (12.0, 8.0, 60.0)}))
    truth = {n: float(rng.normal() * (1.0 if n[:2] in ("a_", "d_") else 6e-3)) for n in model.kinematic}
    q = rng.uniform(robot.lower, robot.upper, (60, 6))
    return model, simulate(moved(model, rng), truth, q, Noise("normal", 0.05), rng)


def test_a_sign_that_matters_no_more_than_the_robot_is_off_is_named_by_the_identification() -> None:
    model, data = short_of(arm("ur", "standard"), 3)
    wrong = replace(data, q=data.q * [1, 1, 1, 1, 1, -1])
    assert find_mistakes(model, wrong) == ()
    found = calibrate(model, None, wrong, Options())
    assert "joint 6 counts the other way round (its sign)" in found.notes[0]
    assert "the identification does not explain goes from" in found.notes[0]
    assert calibrate(model, None, data, Options()).mistakes == ()


def test_a_small_arm_whose_robot_file_is_far_off_is_not_accused() -> None:
    """Nominal kinematics is off by an eighth of what was read; plausible corrections explain it."""
    assert accused(good(122)) == []


def test_what_no_mistake_explains_is_said_with_what_was_tried() -> None:
    model, data = points()
    small = replace(data, q=data.q + 0.25 * np.sin(7 * data.q[:, ::-1]))
    notes = calibrate(model, None, small, Options()).notes
    assert any("were tried one by one: none explains it" in note for note in notes), notes


# --------------------------------------------------------------------------------------------------- where it is said


def test_the_public_identification_says_it_first() -> None:
    model, data = points()
    with pytest.raises(RefusedError, match="joint 3 counts the other way round"):  # before what it could not do
        sc.identify(model.robot, replace(data, q=data.q * [1, 1, -1, 1, 1, 1]), model.task)
    found = sc.identify(model.robot, replace(data, q=data.q * [1, 1, 1, 1, 1, -1]), model.task)
    assert "joint 6 counts the other way round" in found.notes[0]


def test_validate_says_by_the_command_that_the_instrument_was_moved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "10000")
    measured = campaign("puma", "standard", np.random.default_rng(5), 40, 20)
    experiment = write_experiment(measured, tmp_path, "long")

    def symcal(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["symcal", *map(str, arguments)])
        try:
            cli.main()
        except SystemExit as end:
            return int(end.code or 0), "".join(capsys.readouterr())
        return 0, "".join(capsys.readouterr())

    assert symcal("identify", experiment, "--out", tmp_path / "out", "--quiet")[0] == 0
    z = measured.z[40:].reshape(-1, 2, 3)
    turned = Rotation.from_rotvec([0.1, 0.3, -0.2]).apply(z.reshape(-1, 3)) + np.array([300.0, -100.0, 50.0])
    later = replace(measured, q=measured.q[40:], z=turned.reshape(-1, 6), split=measured.split[40:])
    write_long(later, tmp_path / "later.csv")
    code, said = symcal(
        "validate", tmp_path / "out" / "calibrated.yaml", "--data", tmp_path / "later.csv", "--out", tmp_path / "v"
    )
    content = json.loads((tmp_path / "v" / "results.json").read_text(encoding="utf-8"))
    assert code == 1
    assert "was moved: fit it anew with --refit base" in said
    assert content["mistakes"][0]["kind"] == "moved between sets"
    assert content["warnings"][0] == content["mistakes"][0]["text"]
    assert not content["decision"]["accepted"]
    refit = symcal(
        "validate", tmp_path / "out" / "calibrated.yaml", "--data", tmp_path / "later.csv", "--refit", "base"
    )
    assert refit[0] == 0
    assert "was moved" not in refit[1]
