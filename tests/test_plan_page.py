"""report.html of a plan: the numbers of its results, a tour that is the motion of the plan, and names that are text."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_reader import NASTY, Page
from quick_plans import ABOVE_A_TABLE, quick_plan

from symcal.page.around import around as what_is_around
from symcal.page.assembled import CAP
from symcal.page.plan import PlanShown, plan_headline, plan_page
from symcal.page.tour import moved, tour
from symcal.planning.plan_constraints import separate_camera
from symcal.planning.pose_worth import pose_worth
from symcal.planning.surroundings import Plane
from symcal.runs.load import load
from symcal.runs.plan import PlanOutcome, write
from symcal.words import number


@pytest.fixture(scope="module")
def made(configs: Path) -> PlanOutcome:
    return quick_plan(configs / "plan_position.yaml", *ABOVE_A_TABLE)


def shown_of(made: PlanOutcome, **changes: Any) -> PlanShown:
    return replace(PlanShown(made.content, made.findings, made.experiment.model), **changes)


@pytest.fixture(scope="module")
def whole(made: PlanOutcome) -> str:
    return plan_page(shown_of(made))


@pytest.fixture(scope="module")
def shown(whole: str) -> Page:
    return Page(whole)


def test_numbers_are_those_of_the_results(shown: Page, made: PlanOutcome) -> None:
    plan, seen = made.content["plan"], made.content["identifiability"]
    assert f"{number(plan['mean_pose_rms_mm'])} mm foretold rms error of the tool over" in shown.text
    assert f"{number(plan['worst_pose_rms_mm'])} mm" in shown.text
    assert f"{int(1000 * plan['d_efficiency_lower_bound']) / 10:.1f} %" in shown.text
    assert all(entry["text"].replace("-", "\N{MINUS SIGN}") in shown.text for entry in seen["unseen"])
    cells = {cell for rows in shown.cells.values() for row in rows for cell in row}
    for row in made.content["promise"]["table"]:
        assert {str(row["poses"]), number(row["best_mean_mm"]), number(row["bound_mean_mm"])} <= cells
    assert "clear of table" in cells


def test_a_row_for_every_pose(shown: Page, made: PlanOutcome) -> None:
    planned, problem = made.findings.planned, made.findings.problem
    head, *rows = shown.cells["points"]
    assert [row[0] for row in rows] == list(planned.names)
    read = np.array([[float(cell.replace("\N{MINUS SIGN}", "-")) for cell in row[1:-2]] for row in rows])
    tool = problem.arm.motion(planned.plan.poses)[0]
    assert read[:, head.index("x / mm") - 1 : head.index("z / mm")] == pytest.approx(tool, abs=0.051)
    errors = made.findings.accuracy.at(planned.plan.poses, problem.info.posterior(planned.plan.poses))
    assert read[:, head.index("foretold / mm") - 1] == pytest.approx(errors, rel=0.01)
    assert [row[-2] for row in rows] == [{"line": "straight", "joint": "joints"}[kind] for kind in planned.motion.kinds]
    assert float(rows[3][-1]) == pytest.approx(planned.motion.segments[3].time, abs=0.006)


def test_what_a_pose_is_worth_is_what_is_lost_without_it(made: PlanOutcome) -> None:
    """Against the posterior of every plan with one pose less."""
    found, poses = made.findings, made.findings.planned.plan.poses
    info = found.problem.info
    worth = pose_worth(info, found.accuracy, poses)
    whole = info.posterior(poses)
    for i in range(len(poses)):
        less = info.posterior(np.delete(poses, i, axis=0))
        assert worth.mean_mm[i] == pytest.approx(found.accuracy.mean_rms(less), rel=1e-9)
        sizes = np.linalg.norm(less, axis=1) / np.linalg.norm(whole, axis=1)
        assert worth.growth[i] == pytest.approx(sizes, rel=1e-9)
    # what is not learnt from the poses stands at its plausible size
    told = len(info.names) - np.sum(np.linalg.norm(info.sizes @ whole, axis=1) ** 2)
    assert worth.directions.sum() == pytest.approx(told, rel=1e-9)


def test_the_tour_is_the_motion(made: PlanOutcome, shown: Page) -> None:
    """Its pictures lie on the waypoints in time, every pose is reached, and the arm's end is where the tool is."""
    planned, arm = made.findings.planned, made.findings.problem.arm
    found = tour(planned, 1000)
    assert found.q[0] == pytest.approx(planned.start)
    assert found.q[found.reached] == pytest.approx(planned.plan.poses)
    assert found.times[-1] == pytest.approx(planned.motion.total_time)
    assert np.all(np.diff(found.times) >= 0)
    assert len(found.q) <= 601 + len(planned.plan)
    begins = np.concatenate([[0.0], np.cumsum([segment.time for segment in planned.motion.segments])])
    for k in range(1, len(found.q), 37):
        segment = planned.motion.segments[found.segments[k]]
        at = found.times[k] - begins[found.segments[k]]
        expected = [np.interp(at, segment.times, readings) for readings in segment.waypoints.T]
        assert found.q[k] == pytest.approx(expected, abs=1e-9)
    body = moved(made.experiment.model, found)
    assert body.nodes[:, -1] == pytest.approx(arm.motion(found.q)[0], abs=1e-6)
    drawn = shown.scene["tour"]
    assert np.array(drawn["nodes"]) == pytest.approx(body.nodes, abs=0.51)
    assert len({len(drawn[key]) for key in ("q", "nodes", "axes", "pointers", "at", "segment")}) == 1


def test_what_stands_around(made: PlanOutcome, configs: Path) -> None:
    """That of an experiment with a camera, a cabinet and a table, about the same poses."""
    other, found = load(configs / "plan_camera.yaml"), made.findings
    assert other.file.plan.constraints.camera is not None
    view, _ = separate_camera(other.file.plan.constraints.camera, other.file, other.document, other.model, [])
    found = replace(found, file=other.file, problem=replace(found.problem, view=view))
    nodes = found.problem.arm.nodes(found.planned.plan.poses).reshape(-1, 3)
    around = {each["name"]: each for each in what_is_around(found, other.model, nodes)}
    kinds = {"cabinet": "keep out", "table": "plane", "camera": "camera"}
    assert {name: each["kind"] for name, each in around.items()} == kinds
    corners = np.array([p for p in around["cabinet"]["points"] if p is not None])
    assert (corners.min(axis=0), corners.max(axis=0)) == (
        pytest.approx([-1050, 100, -50]),
        pytest.approx([-750, 500, 850]),
    )
    assert {p[2] for p in around["table"]["points"]} == {770.0}
    assert [300.0, 3000.0, 1200.0] in around["camera"]["points"]


def test_a_patch_lies_in_its_plane() -> None:
    wall = Plane("wall", np.array([100.0, 0, 0]), np.array([0.6, 0.0, 0.8]))
    low, high = np.array([-500.0, -400, 0]), np.array([500.0, 400, 900])
    patch = wall.patch(low, high)
    assert patch is not None
    assert (patch - wall.point) @ wall.normal == pytest.approx(np.zeros(4), abs=1e-9)
    assert wall.patch(low + 5000, high + 5000) is None


def test_it_asks_for_nothing_and_stays_small(shown: Page, whole: str) -> None:
    assert all(address.startswith(("data:", "#")) for address in shown.addresses)
    assert not shown.handlers
    assert shown._open == []
    assert len(shown.scripts) == 5
    assert len(whole.encode()) < CAP


def test_names_are_text(made: PlanOutcome) -> None:
    content = copy.deepcopy(dict(made.content))
    content |= {"title": NASTY, "warnings": [NASTY], "inputs": {NASTY: "0" * 64}, "region": NASTY}
    content["robot"] = content["robot"] | {"name": NASTY}
    content["identifiability"] = content["identifiability"] | {"unseen": [{"direction": {}, "text": NASTY}]}
    content["constraints"] = content["constraints"] | {"feasible_share_of_each_alone": {NASTY: 0.5}}
    names = tuple(f"{NASTY}{i}" for i in range(len(made.findings.planned.names)))
    found = replace(made.findings, planned=replace(made.findings.planned, names=names))
    read = Page(plan_page(shown_of(made, content=content, found=found)))
    assert len(read.scripts) == 5
    assert not read.handlers
    assert read.scene["poses"]["label"] == list(names)
    assert read.cells["points"][1][0] == names[0]
    assert " ".join(NASTY.split()) in read.text


def test_a_way_that_breaks_constraints_is_the_verdict(made: PlanOutcome) -> None:
    content = copy.deepcopy(dict(made.content))
    assert plan_headline(content)["decision"]["accepted"]
    content["order"]["conflicts"] = ["the way from pose 1 to pose 2 breaks 'clear of table' by 3 mm"]
    decision = plan_headline(content)["decision"]
    assert not decision["accepted"]
    assert content["order"]["conflicts"][0] in decision["lines"]


def test_without_speeds_no_times_are_told(configs: Path) -> None:
    made = quick_plan(
        configs / "plan_position.yaml", "plan.speeds={}", "plan.prove=false", "plan.required=[[0, 900, 200, 90, 0]]"
    )
    assert not made.findings.planned.timed
    read = Page(plan_page(shown_of(made)))
    assert "required" in read.cells["points"][0]
    assert "s" not in read.cells["points"][0]
    assert read.scene["poses"]["time"] is None
    assert read.scene["tour"]["at"][-1] == pytest.approx(len(made.findings.planned.plan), rel=1e-3)
    assert "no speeds are known" in read.text


def test_outputs_say_whether_there_is_a_page(made: PlanOutcome, tmp_path: Path) -> None:
    outputs = made.experiment.file.outputs.model_copy(update={"report": False, "figures": False})
    for name, html in (("page", True), ("none", False), ("as_report", None)):
        file = made.experiment.file.model_copy(update={"outputs": outputs.model_copy(update={"html": html})})
        (tmp_path / name).mkdir()
        write(replace(made, experiment=replace(made.experiment, file=file)), tmp_path / name, lambda _: None)
        assert (tmp_path / name / "report.html").exists() == bool(html)
    read = Page((tmp_path / "page" / "report.html").read_text(encoding="utf-8"))
    results = json.loads((tmp_path / "page" / "results.json").read_text(encoding="utf-8"))
    assert number(results["plan"]["mean_pose_rms_mm"]) in read.text
    assert len([address for address in read.addresses if address.startswith("data:image/png")]) == 6
