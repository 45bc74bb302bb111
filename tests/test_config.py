"""Experiment files: each slip is one error at its place; numbers arrive in mm and rad."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from symcal.config import conversion as config
from symcal.config.experiment import experiment_type
from symcal.errors import InputError
from symcal.model.model import build_model
from symcal.robot.files import load_robot
from symcal.runs.load import load

ROBOT = """\
name: arm
convention: standard
units: {length: mm, angle: deg}
links:
  - {joint: revolute, name: turn, limits: [-170, 170], theta: 0, d: 300, a: 0, alpha: 90}
  - {joint: prismatic, name: reach, limits: [100, 400], d: 0, alpha: 90}
  - {joint: revolute, name: hand, theta: 0, d: 0, a: 200}
"""

GOOD = """\
schema: symcal/experiment/1
name: trial
seed: 4
units: {length: m, angle: deg}
robot: robot.yaml
measurement:
  type: position
  points: {P: [0.01, 0, 0.06]}
  estimate: [base]
  noise: {position: 5.0e-5}
plan:
  area: {turn: [-90, 90], hand: [0, 45]}
data:
  source: file
  file: data.csv
  split: {column: set, train: [a]}
identification:
  fix: [d_1]
  scales: {a_3: 0.002, theta_3: 1}
validation: {folds: 3}
"""


@pytest.fixture
def write(tmp_path):
    def files(text: str = GOOD, robot: str = ROBOT):
        (tmp_path / "robot.yaml").write_text(robot, encoding="utf-8")
        path = tmp_path / "experiment.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return files


def test_numbers_arrive_in_mm_and_rad(write):
    path = write()
    file, document = config.load_experiment(path)
    robot = load_robot(path.parent / "robot.yaml")
    task = config.task_of(file, document, robot)
    np.testing.assert_allclose(task.observations[0].target.points["P"], [10, 0, 60])
    assert task.scales == pytest.approx({"a_3": 2.0, "theta_3": np.pi / 180})
    assert task.fix == ("d_1",)
    assert config.options_of(file, build_model(robot, task).measurement).sigma == pytest.approx({"position": 0.05})
    lower, upper = config.area_of(file, document, robot)
    np.testing.assert_allclose(lower, [-np.pi / 2, 100, 0])
    np.testing.assert_allclose(upper, [np.pi / 2, 400, np.pi / 4])


CHANGES = [
    ("mesurement", "measurement:", "mesurement:", 6, "mesurement", "did you mean 'measurement'?"),
    ("key", "estimate:", "estimat:", 9, "measurement.estimat", "did you mean 'estimate'?"),
    ("value", "position\n", "positon\n", 7, "measurement.type", "did you mean 'position'?"),
    ("branch", "source: file", "source: fil", 14, "data.source", "allowed: file, bag, trajectory, pairs, images"),
    ("item", "[base]", "[bas]", 9, "measurement.estimate[0]", "did you mean 'base'?"),
    ("list", "[base]", "base", 9, "measurement.estimate", "expected a list"),
    ("number", "seed: 4", "seed: four", 3, "seed", "expected a whole number (found: four)"),
    ("fraction", "seed: 4", "seed: 1.5", 3, "seed", "expected a whole number"),
    ("negative", "seed: 4", "seed: -1", 3, "seed", "must be at least 0"),
    ("text", "0.01, 0, 0.06", "0.01, 0, 6 cm", 8, "measurement.points.P[2]", "expected a number"),
    ("pair", "[0.01, 0, 0.06]", "[0.01, 0]", 8, "measurement.points.P", "expected at least 3 items"),
    ("nan", "5.0e-5", ".nan", 10, "measurement.noise.position", "NaN is not a number"),
    ("zero", "5.0e-5", "0", 10, "measurement.noise.position", "must be greater than 0"),
    ("units", "units: {length: m, angle: deg}\n", "", 1, "units", "this key is missing"),
    ("unit", "length: m,", "length: metre,", 4, "units.length", "allowed: mm, m, um, cm, in"),
    ("robot", "robot.yaml", "robots.yaml", 5, "robot", "the robot file is not there"),
    ("variable", "robot.yaml", "$SYMCAL_NOWHERE/r.yaml", 5, "robot", "variable SYMCAL_NOWHERE in this path is not set"),
    ("name", "name: trial", "name: ../trial", 2, "name", "not a name that can be used here"),
    ("twice", "seed: 4", "name: again", 3, "name", "stands here twice (first in line 2)"),
    ("fix", "[d_1]", "[d_9]", 18, "identification.fix[0]", "no such parameter in this experiment"),
    ("scale", "a_3:", "a3:", 19, "identification.scales.a3", "did you mean 'a_3'?"),
    ("joint", "turn:", "trun:", 12, "plan.area.trun", "did you mean 'turn'?"),
    ("range", "[-90, 90]", "[-90, 900]", 12, "plan.area.turn", "within the joint's limits"),
    ("folds", "folds: 3", "folds: 1", 20, "validation.folds", "one fold leaves nothing to train with"),
    ("label", "train: [a]", "train: [test]", 16, "data.split", "stands under 'train' and under 'test'"),
    ("share", "train: [a]", "test_fraction: 0.2", 16, "data.split", "give 'column' or 'test_fraction', not both"),
    ("unknown", "[0.01, 0, 0.06]", "null", 8, "measurement.points.P", "add 'points' to 'estimate'"),
    ("both", "[base]", "[tool, points]", 9, "measurement.estimate", "cannot both be estimated"),
    ("inverted", "  estimate", "  invert: true\n  estimate", 9, "measurement.invert", "only pose measurements"),
    ("pose", "type: position", "type: pose", 8, "measurement.points", "a pose measurement has no points"),
]


def load_all(path):
    experiment = load(path)
    return config.area_of(experiment.file, experiment.document, experiment.robot)


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "words"), [c[1:] for c in CHANGES], ids=[change[0] for change in CHANGES]
)
def test_each_slip_is_one_error_at_its_place(write, old, new, line, key, words):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_all(path)
    assert (caught.value.file, caught.value.line, caught.value.key) == (path, line, key)
    assert words in str(caught.value)


def test_a_joint_without_limits_needs_a_range(write):
    path = write(GOOD.replace(", hand: [0, 45]", ""))
    with pytest.raises(InputError, match="has no limits in the robot file: give its range here"):
        load_all(path)


def test_a_robot_is_not_an_experiment(write):
    path = write()
    with pytest.raises(InputError, match="this is a robot file"):
        load(path.parent / "robot.yaml")


@pytest.mark.parametrize(
    ("override", "found"),
    [
        ("seed=7", {"seed": 7}),
        ("title=yes", {"title": "yes"}),  # text in YAML 1.2
        ("measurement.noise.position=1e-4", {"measurement": {"noise": {"position": 1e-4}}}),
        ("measurement.points.P=[1, 2, 3]", {"measurement": {"points": {"P": [1, 2, 3]}}}),
        ("identification.tolerances.iterations=5", {"identification": {"tolerances": {"iterations": 5}}}),
    ],
)
def test_overrides(write, override, found):
    file, _ = config.load_experiment(write(), [override])
    dumped = file.model_dump()
    while isinstance(found, dict):
        ((key, found),) = found.items()
        dumped = dumped[key]
    assert dumped == found


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("seed", "key '--set': expected key.path=value (found: seed)"),
        ("=3", "key '--set': expected key.path=value"),
        ("plan..poses=3", "key '--set': expected key.path=value"),
        ("seed=[1", "key '--set': the value is not YAML"),
        ("seed=many", "key '--set seed': expected a whole number (found: many)"),
        ("identification.solvr=ipopt", "key '--set identification.solvr': unknown key"),
        ("identification.solver=newton", "key '--set identification.solver': not one of the allowed values"),
        ("name.a.b=3", "key '--set name.a.b': 'name' has no keys of its own"),
        ("identification.fix=[q]", "key '--set identification.fix[0]': no such parameter"),
        ("robot=nowhere.yaml", "key '--set robot': the robot file is not there"),
    ],
)
def test_errors_of_overrides_blame_the_option(write, override, words):
    with pytest.raises(InputError) as caught:
        load(write(), overrides=[override])
    assert words in str(caught.value)
    assert caught.value.file is None


def test_an_override_mends_a_file(write):
    assert load(write(GOOD.replace("seed: 4", "seed: four")), overrides=["seed=4"]).seed == 4


def test_the_resolved_experiment_finds_its_files_from_elsewhere(write, tmp_path, monkeypatch):
    monkeypatch.setenv("HERE", str(tmp_path))
    path = write(GOOD.replace("data.csv", "$HERE/data.csv"))
    file, document = config.load_experiment(path)
    folder = tmp_path / "reports" / "trial"
    folder.mkdir(parents=True)
    data = config.resolved(file, document, folder)
    assert data["robot"] == "../../robot.yaml"
    assert data["data"]["file"] == "$HERE/data.csv"
    copy = folder / "experiment.resolved.yaml"
    copy.write_text(yaml.safe_dump(data))
    again = load(copy)
    assert again.file.model_dump(exclude={"robot"}) == file.model_dump(exclude={"robot"})


@pytest.mark.parametrize(
    "measurements",
    [
        {"a": {"instrument": "position", "nois": {}}},
        {"a": {"instrument": "pose", "noise": {"position": -1.0}}, "b": {"instrument": "distance", "at": 3}},
        {"a": {"instrument": "camra"}},
        {"a": {}},
        {"a": {"instrument": ["position"]}},
        {"a": 1},
        [],
        None,
    ],
)
def test_the_kinds_that_a_file_names_find_what_all_kinds_find(measurements: object) -> None:
    data = {"name": "x", "units": {"length": "mm", "angle": "deg"}, "robot": "r", "measurements": measurements}
    said = []
    for kind in (experiment_type(measurements), experiment_type()):
        with pytest.raises(ValidationError) as caught:
            kind.model_validate(data)
        said.append([(e["loc"], e["type"], e["msg"]) for e in caught.value.errors()])
    assert said[0] == said[1]
