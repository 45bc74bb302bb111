"""Joint terms on their way out: carried to the last digit, or refused, or left out with a cost that is stated."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from arms_with_terms import puma_with_terms, six_axis, usual_terms
from hypothesis import given, settings
from json_arm import tool_pose
from strategies import generators, random_robot, readings, with_terms

from symcal.errors import RefusedError
from symcal.export import export_robot
from symcal.export.carries import CARRIES, check_carries, left_out
from symcal.export.corrections import corrections
from symcal.export.gate import doubts
from symcal.export.json import robot_json, save_json
from symcal.export.urdf import save_urdf, urdf_text
from symcal.joints import TERMS
from symcal.joints.backlash import Backlash
from symcal.joints.gravity import Gravity
from symcal.joints.payload import PayloadTerm
from symcal.kernels.batch import batch_function
from symcal.kinematics import chain, forward, frame_vector
from symcal.parameters import ParameterSet
from symcal.robot.robot import Robot
from symcal.robot.urdf import load_urdf


def poses(robot: Robot, q: np.ndarray) -> np.ndarray:
    """T_base_tool, shape (N, 4, 4), at nominal conditions."""
    kernel = batch_function(forward(chain(robot, ParameterSet(()))), evaluations=0)
    return np.asarray(kernel(q, np.zeros(0), frame_vector(np.eye(4), robot.tool))[0])


def apart(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances, mm, and angles, rad."""
    cosine = (np.einsum("nij,nij->n", a[:, :3, :3], b[:, :3, :3]) - 1) / 2
    return np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1), np.arccos(np.clip(cosine, -1, 1))


# ---------------------------------------------------------------------------------------------------------------- JSON


@given(rng=generators)
@settings(max_examples=12)
def test_json_alone_gives_the_pose(rng: np.random.Generator) -> None:
    """An evaluation that knows the file and nothing else agrees with the symbolic chain, conditions included."""
    robot = with_terms(rng, replace(random_robot(rng), record=None), 5.0)
    data = json.loads(json.dumps(robot_json(robot)))
    model = chain(robot, ParameterSet(()), conditions=True)
    q, conditions = readings(rng, robot), {name: float(rng.uniform(-1, 1)) for name in robot.conditions}
    at = ca.Function("pose", [model.q, model.frames, model.conditions], [model.tool])
    expected = np.asarray(at(q, frame_vector(np.eye(4), robot.tool), list(conditions.values())))
    found = tool_pose(data, q, conditions)
    reach = max(robot.reach, np.abs(q).max(), 1.0)
    np.testing.assert_allclose(found[:3, 3], expected[:3, 3], rtol=0, atol=1e-12 * reach)
    np.testing.assert_allclose(found[:3, :3], expected[:3, :3], rtol=0, atol=1e-12)


def test_json_says_what_terms_are(tmp_path: Path) -> None:
    robot = puma_with_terms()
    save_json(robot, tmp_path / "robot.json")
    data = json.loads((tmp_path / "robot.json").read_text())
    assert data["schema"] == "symcal/robot-json/2"
    assert [term["kind"] for term in data["terms"]] == [term.kind for term in robot.terms]
    assert all(term["delta_i"] == TERMS[term["kind"]].definition for term in data["terms"])
    assert "tool is then up to" in data["corrections_leave_out"]
    wave = data["parameters"]["q2_sin_1"]
    assert (wave["unit"], wave["identified"]) == ("rad", robot.term_parameters["q2_sin_1"].value)
    assert data["terms"][1]["numbers"]["sin_1"]["value"] == wave["identified"]
    assert robot_json(six_axis())["terms"] == []
    assert robot_json(six_axis())["corrections_leave_out"] is None


def test_every_kind_is_defined_in_words() -> None:
    assert all(kind.definition for kind in TERMS.values())


# ---------------------------------------------------------------------------------------------------------------- URDF


def test_urdf_refuses_terms_by_name(tmp_path: Path) -> None:
    robot = puma_with_terms()
    with pytest.raises(RefusedError, match=r"harmonics 1 and 2 of axis 1, .* gravity of axis 5 with weights at"):
        save_urdf(robot, tmp_path / "r.urdf")
    with pytest.raises(RefusedError, match=r"mm and .* deg off \(searched\).*--approximate"):
        export_robot(robot, "urdf", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_an_approximate_urdf_states_an_error_that_nothing_exceeds(tmp_path: Path, rng: np.random.Generator) -> None:
    robot = puma_with_terms()
    left = save_urdf(robot, tmp_path / "r.urdf", approximate=True)
    assert left is not None
    text = (tmp_path / "r.urdf").read_text()
    assert left.text in text
    again = load_urdf(tmp_path / "r.urdf", "base_link", "tool")
    q = rng.uniform(robot.lower, robot.upper, (100_000, robot.dof))
    mm, rad = apart(poses(robot, q), poses(again, q))
    assert 0.7 * left.mm < mm.max() <= left.mm
    assert 0.7 * left.rad < rad.max() <= left.rad + 1e-8


def test_a_constant_part_goes_into_the_joint_zeros(tmp_path: Path, rng: np.random.Generator) -> None:
    """An arm that is always loaded the same way: most of its gravity is a shift of its zeros, and that is said."""
    robot = six_axis()
    links = list(robot.links)
    links[1] = replace(links[1], joint=replace(links[1].joint, lower=-0.3, upper=0.3))
    robot = replace(robot, links=tuple(links), terms=(Gravity(2, True, {"gravity_x": 3e-3}, ("x",)),))
    left = save_urdf(robot, tmp_path / "r.urdf", approximate=True)
    assert left is not None
    assert "joint zeros were fitted by least squares to make up for it: " in left.text.lower()
    q = rng.uniform(robot.lower, robot.upper, (20_000, robot.dof))
    written = apart(poses(robot, q), poses(load_urdf(tmp_path / "r.urdf", "base_link", "tool"), q))[0].max()
    plain = apart(poses(robot, q), poses(replace(robot, terms=()), q))[0].max()
    assert written <= left.mm < 0.1 * plain


def test_sides_and_loads_count_too(rng: np.random.Generator) -> None:
    """Play moves the tool by its width times the lever, a kg by its term: both are found; C has them at nominal."""
    robot = replace(six_axis(), terms=(Backlash(1, True, {"backlash": 1e-3}), PayloadTerm(2, True, {"payload": 1e-3})))
    q = rng.uniform(robot.lower, robot.upper, (50_000, robot.dof))
    at = poses(robot, q)[:, :3, 3]
    lever = np.linalg.norm(at[:, :2], axis=1).max()
    for way in ("c", "commands", "urdf"):
        left = left_out(robot, way)
        assert left is not None
        assert left.mm == pytest.approx(1e-3 * lever, rel=0.02)
        assert left.rad == pytest.approx(1e-3, rel=1e-6)
        assert left.per_kg is not None
        assert left.per_kg[0] > 1
    kept = check_carries(robot, "c")  # no reason to refuse
    assert kept is not None
    assert "keeps at nominal: backlash of axis 1 and yielding of axis 2 to payloads" in kept.text
    with pytest.raises(RefusedError, match="backlash of axis 1"):
        urdf_text(robot)


def test_terms_that_do_nothing_go_anywhere() -> None:
    robot = replace(six_axis(), terms=usual_terms())  # all zero
    for way in CARRIES:
        assert left_out(robot, way) is None
    assert urdf_text(robot) == urdf_text(six_axis())
    assert left_out(puma_with_terms(), "json") is None
    assert left_out(puma_with_terms(), "c") is None


def test_names_do_not_break_the_comment(tmp_path: Path) -> None:
    robot = puma_with_terms()
    links = tuple(replace(k, joint=replace(k.joint, name=f"a---<>{i}--")) for i, k in enumerate(robot.links))
    save_urdf(replace(robot, links=links), tmp_path / "r.urdf", approximate=True)
    assert load_urdf(tmp_path / "r.urdf", "base_link", "tool").joints[0].name == "a---<>0--"


# ------------------------------------------------------------------------------------------------ corrections and gate


def test_corrections_list_numbers_of_terms() -> None:
    robot = puma_with_terms()
    assert robot.record is not None
    table = corrections(robot).set_index("parameter")
    row = table.loc["q2_sin_1"]
    assert (row["joint"], row["quantity"], row["unit"], row["nominal"]) == ("axis 2", "sin 1", "deg", 0.0)
    assert row["correction"] == pytest.approx(math.degrees(robot.record.errors["q2_sin_1"]))
    assert row["sigma"] == pytest.approx(math.degrees(1e-4))
    found = left_out(robot, "table")
    assert found is not None
    assert found.zeros == {}
    assert found.text.startswith("A table of zero offsets and lengths leaves out: harmonics")


def test_terms_are_judged_by_their_own_sizes() -> None:
    robot = puma_with_terms()
    assert doubts(robot) == ()
    assert robot.record is not None
    wild = replace(robot, record=replace(robot.record, errors={**robot.record.errors, "q3_cos_2": 0.02}))
    (doubt,) = doubts(wild)
    assert doubt.text == "q3_cos_2 is off by 1.15 deg, more than 10 times its plausible 0.0286 deg"
