"""Mistakes in the section `plan`: each named with its line, its key and what would do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from symcal.config.plan import PlanConfig
from symcal.errors import InputError, RefusedError
from symcal.planning.nominal_noise import nominal_noise
from symcal.planning.plan_problem import PlanProblem, plan_problem
from symcal.runs.load import load

BOX = {"name": "press", "xyz": [0, 700, 1100], "size": [300, 300, 300]}


@pytest.fixture(scope="module")
def planning(configs) -> Path:
    return configs / "plan_position.yaml"


def problem(path: Path, *overrides: str) -> PlanProblem:
    experiment = load(path, overrides=overrides)
    return plan_problem(experiment.file, experiment.document, experiment.model, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("override", "key", "hint"),
    [
        ("plan.metod=certified", "plan.metod", "method"),
        ("plan.method=cetrified", "plan.method", "certified"),
        ("plan.criterion=F", "plan.criterion", "cond"),
        ("plan.area={waits: [-90, 90]}", "plan.area.waits", "waist"),
        ("plan.area={waist: [-90, 300]}", "plan.area.waist", "within the joint's limits"),
        ("plan.start=[0, 1100, 0]", "plan.start", "5 joint readings"),
        ("plan.start=[0, 100, 0, 90, 0]", "plan.start", "joint 'lift'"),
        ("plan.speeds={lift: 100, waste: 1}", "plan.speeds.waste", "waist"),
        ("plan.required=[[0, 1100, 0, 90, 0], [0, 1100, 0, 900, 0]]", "plan.required[1]", "elbow"),
        ("plan.required=nowhere.csv", "plan.required", "not there"),
        ("plan.candidates=nowhere.csv", "plan.candidates", "not there"),
        ("plan.margins={angle: 100}", "plan.margins", "elbow"),
        ("plan.margins={length: 300}", "plan.margins", "lift"),
        ("plan.region={type: ball}", "plan.region.type", "box"),
        ("plan.genetic={coding: trinary}", "plan.genetic", "binary"),
        ("plan.poses=0", "plan.poses", "at least 1"),
        ("plan.noise={position: -1}", "plan.noise", "greater"),
        ("plan.constraints={keep_out: [{name: a, xyz: [0, 0, 0], size: [1, 1]}]}", "plan.constraints", "at least 3"),
        ("plan.constraints={planes: [{name: a, point: [0, 0, 0], normal: [0, 0, 0]}]}", "planes[0].normal", "zero"),
        ("plan.constraints={planes: [{name: a, point: [0, 0, 0], normal: [0, 0, 1], first_link: 9}]}", "link", "such"),
        ("plan.constraints={coverage: {share: 0.5}}", "plan.constraints", "position"),
    ],
)
def test_mistakes_are_named(planning, override, key, hint):
    with pytest.raises(InputError) as caught:
        problem(planning, override)
    assert key in str(caught.value)
    assert hint in str(caught.value)


def test_a_mistake_in_the_file_has_its_line(planning, tmp_path, configs):
    text = planning.read_text(encoding="utf-8").replace("robots/", f"{configs}/robots/")
    lines = text.replace("  criterion", "  kriterion").replace("  area: {waist", "  area: {waits").splitlines()
    bad = tmp_path / "bad.yaml"
    bad.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        problem(bad)
    assert caught.value.line == next(i for i, line in enumerate(lines, start=1) if "waits" in line)


CAMERA = (
    "plan.constraints={camera: {width: 2448, height: 2048, intrinsics: {fx: 4638, fy: 4638, cx: 1223.5, cy: 1023.5}, "
    "placement: {position: [300, 3000, 1200], look_at: [0, 500, 1100]}, "
    "target: {triangle: {side: 200}, disc_radius: 15, mount: {rpy: [0, 45, 0]}}, depth: [1500, 3500]}}"
)


def test_a_camera_is_placed_and_limits_what_can_be_measured(planning):
    made = problem(planning, CAMERA)
    assert made.view is not None
    np.testing.assert_allclose(made.view.T_world_camera[:3, 3], [300, 3000, 1200])
    view = made.view.T_world_camera[:3, :3] @ [0, 0, 1]
    np.testing.assert_allclose(view, np.array([-300, -2500, -100]) / np.linalg.norm([300, 2500, 100]), atol=1e-12)
    seen = made.feasible(made.area.even(2000))
    assert 0.02 < seen.mean() < 0.6


@pytest.mark.parametrize(
    ("old", "new", "hint"),
    [
        (
            "placement: {position: [300, 3000, 1200], look_at: [0, 500, 1100]}",
            "placement: {look_at: [0, 0, 0]}",
            "position",
        ),
        ("width: 2448, ", "", "width"),
        ("triangle: {side: 200}, ", "", "triangle"),
        ("look_at: [0, 500, 1100]", "look_at: [300, 3000, 0]", "parallel"),
        ("depth: [1500, 3500]", "depth: [3500, 1500]", "lower < upper"),
        ("depth: [1500, 3500]", "depht: [1500, 3500]", "depth"),
    ],
)
def test_cameras_that_are_none(planning, old, new, hint):
    with pytest.raises(InputError, match=hint):
        problem(planning, CAMERA.replace(old, new))


def test_noise_is_needed_and_found_where_it_is_stated(planning, configs):
    with pytest.raises(RefusedError, match=r"plan\.noise\.position"):
        problem(planning, "plan.noise={}")
    experiment = load(planning, overrides=["measurement.noise={position: 0.2}"])
    assert nominal_noise(experiment.file, experiment.model) == {"position": 0.2}
    simulated = load(configs / "simulated_arm.yaml")
    assert nominal_noise(simulated.file, simulated.model)["position"] == pytest.approx(0.1 / np.sqrt(3))


def test_units_are_converted_once(planning):
    made = problem(
        planning,
        "units={length: cm, angle: rad}",
        "plan.area={waist: [-1, 1], lift: [90, 100]}",
        "plan.noise={position: 0.01}",
        "plan.start=[0.5, 95, 10, 1, 0]",
        "plan.speeds={waist: 1, lift: 20, reach: 40, elbow: 1.5, wrist: 2}",
        "plan.margins={angle: 0.1, length: 1}",
        "plan.required=[[0.1, 95, 20, 1.5, -1]]",
    )
    assert made.info.sigmas == {"position": pytest.approx(0.1)}
    np.testing.assert_allclose(made.area.lower, [-1, 900, 10, 0.1, np.deg2rad(-175) + 0.1])
    np.testing.assert_allclose(made.area.upper, [1, 1000, 690, np.deg2rad(175) - 0.1, np.deg2rad(175) - 0.1])
    np.testing.assert_allclose(made.start, [0.5, 950, 100, 1, 0])
    np.testing.assert_allclose(made.speeds, [1, 200, 400, 1.5, 2])
    np.testing.assert_allclose(made.required, [[0.1, 950, 200, 1.5, -1]])


def test_required_poses_that_cannot_be_measured_are_named_with_the_reason(planning):
    blocked = "plan.constraints={keep_out: [{name: press, xyz: [0, 700, 1100], size: [300, 300, 300]}]}"
    with pytest.raises(RefusedError) as caught:
        problem(planning, blocked, "plan.required=[[0, 1100, 0, 90, 0], [0, 1100, 600, 0, 0]]")
    assert "required 2" in str(caught.value)
    assert "required 1 " not in str(caught.value)
    assert "clear of press" in str(caught.value)


def test_regions(planning, tmp_path):
    poses = tmp_path / "task.csv"
    poses.write_text("pose,waist_deg,lift_mm,reach_mm,elbow_deg,wrist_deg\na,10,1000,100,45,5\nb,20,1100,200,90,5\n")
    made = problem(planning, f"plan.region={{type: csv, file: {poses}}}").region
    np.testing.assert_allclose(made.poses[:, 1], [1000, 1100])
    box = problem(planning, "plan.region={type: box, lower: [-200, 300, 900], upper: [200, 800, 1200]}")
    at = box.arm.motion(box.region.poses)[0]
    assert (at >= [-200.001, 299.999, 899.999]).all()
    assert (at <= [200.001, 800.001, 1200.001]).all()
    narrow = problem(planning, "plan.region={type: area, area: {wrist: [0, 10]}}").region
    assert narrow.poses[:, 4].min() >= 0
    assert narrow.poses[:, 4].max() <= np.deg2rad(10)


def test_a_bad_row_of_candidates_has_its_line(planning, tmp_path):
    poses = tmp_path / "candidates.csv"
    poses.write_text("pose,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\n1,0,1000,100,45,5\n2,0,1000,100,forty,5\n")
    with pytest.raises(InputError, match=r"candidates\.csv:3"):
        problem(planning, f"plan.candidates={poses}")


def test_defaults_are_those_of_the_small_form():
    small = PlanConfig.model_validate({"poses": 40, "area": {"waist": [-90.0, 90.0]}})
    assert small.method is None
    assert small.candidates is None
