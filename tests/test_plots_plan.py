"""Figures and report of a plan: they draw, say true numbers, and fit the page."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symcal.plots import print_settings
from symcal.plots.plan import plan_figures
from symcal.plots.save import save_figures
from symcal.report import write_report
from symcal.report.plan import plan_text
from symcal.report.plan_verdict import percent, plan_verdict
from symcal.runs.load import load
from symcal.runs.plan import PlanOutcome, plan_experiment
from symcal.words import number

QUICK = ("plan.poses=12", "plan.sample=600", "plan.random=20", "plan.promise={counts: [4, 6, 12], random: 10}")
CAMERA = (
    "plan.constraints={camera: {width: 2448, height: 2048, intrinsics: {fx: 2000, fy: 2000, cx: 1223.5, cy: 1023.5}, "
    "placement: {position: [300, 3000, 1200], look_at: [0, 500, 1100]}, incidence: 85, "
    "target: {triangle: {side: 200}, disc_radius: 15, mount: {rpy: [0, 45, 0]}}}, "
    "keep_out: [{name: press, xyz: [-900, 300, 400], size: [300, 400, 900]}]}"
)


def outcome(configs: Path, *overrides: str) -> PlanOutcome:
    return plan_experiment(load(configs / "plan_position.yaml", overrides=[*QUICK, *overrides]))


@pytest.fixture(scope="module")
def plain(configs) -> PlanOutcome:
    return outcome(configs, "plan.compare=[exchange, random]", "plan.promise={counts: [4, 12], accuracy: [0.1]}")


@pytest.fixture(scope="module")
def constrained(configs) -> PlanOutcome:
    required = "plan.required=[[0, 1100, 300, 90, -90]]"
    return outcome(configs, CAMERA, required, "plan.compare=[]", "plan.criterion=cond", "plan.speeds={}")


@pytest.fixture(scope="module")
def figures(plain):
    return {figure.name: figure for figure in plan_figures(plain.findings)}


def test_all_figures_are_there(figures):
    assert list(figures) == [
        "plan_in_space",
        "joint_motion",
        "error_map",
        "error_by_poses",
        "search_time",
        "singular_values",
    ]


def test_figures_have_the_width_of_a_column_or_a_page_and_write(figures):
    for figure in figures.values():
        assert round(figure.width_mm) in (85, 170)
        with print_settings():
            file = io.BytesIO()
            figure.figure.savefig(file, format="pdf")
        assert file.tell() > 5000


def test_captions_say_the_numbers_of_the_results(figures, plain):
    plan = plain.content["plan"]
    assert number(plan["mean_pose_rms_mm"]) in figures["error_map"].caption
    assert number(plan["worst_pose_rms_mm"]) in figures["error_map"].caption
    lines = plain.content["order"]["segments"]["line"]
    assert f"straight in {lines} of 12 segments" in figures["plan_in_space"].caption
    assert number(plain.content["order"]["time_s"]) in figures["joint_motion"].caption
    (needed,) = plain.content["promise"]["needed"]
    assert f"For 0.1 mm rms: {needed['poses']} poses" in figures["error_by_poses"].caption
    for method in ("certified", "exchange", "random"):
        assert method in figures["search_time"].caption


def test_the_map_shows_no_more_than_the_worst_pose(plain):
    foretold = plain.findings.planned.plan.prediction
    assert plain.findings.field.errors.max() <= foretold.worst_pose_rms_mm * (1 + 1e-6)
    rms = np.sqrt(np.mean(plain.findings.field.uniform**2))
    assert rms == pytest.approx(foretold.mean_pose_rms_mm, rel=1e-6)


def test_the_joints_drawn_are_those_of_the_plan(figures, plain):
    rows = figures["joint_motion"].figure.axes
    assert len(rows) == 5
    poses = plain.findings.planned.plan.poses
    for j, axes in enumerate(rows):
        factor = 180 / np.pi if plain.findings.problem.robot.joints[j].revolute else 1.0
        drawn = [line for line in axes.lines if len(line.get_xdata()) == 12 and line.get_marker() == "o"]
        np.testing.assert_allclose(drawn[0].get_ydata(), poses[:, j] * factor)


@pytest.mark.long
def test_a_plan_with_camera_boxes_required_poses_and_no_speeds_is_drawn_and_reported(constrained, tmp_path):
    illustrations = plan_figures(constrained.findings)
    space = illustrations[0].figure
    labels = [text.get_text() for text in space.legends[0].get_texts()]
    assert {"camera", "keep out", "required"} <= set(labels)
    pictures = save_figures(illustrations, tmp_path / "figures")
    write_report(constrained.content, pictures, tmp_path / "report.pdf", "plan")
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")
    text = " ".join(plan_verdict(constrained.content))
    assert "no bound is known" in text
    assert " s of motion" not in text
    assert plan_text(constrained.content)["constraints"][-1][0] == "all together"


def test_the_verdict_is_plain_and_true(plain):
    content = plain.content
    sentences = plan_verdict(content)
    assert sentences[0].startswith("These 12 poses are at least ")
    share = float(re.search(r"([\d.]+) %", sentences[0])[1])
    assert share <= 100 * content["plan"]["d_efficiency_lower_bound"] + 1e-9
    text = " ".join(sentences)
    assert number(content["plan"]["mean_pose_rms_mm"]) in text
    assert "Of 15 parameters this measurement can determine 11 combinations." in text
    (needed,) = content["promise"]["needed"]
    assert f"{needed['poses']} poses suffice for 0.1 mm rms" in text


def test_a_report_of_hostile_names_compiles(plain, tmp_path):
    content = plain.content | {"title": "#eval(1) $x$ \\ *b* @y", "warnings": ["#panic() `code` <label>"]}
    write_report(content, [], tmp_path / "report.pdf", "plan")
    assert (tmp_path / "report.pdf").stat().st_size > 1000


@given(st.floats(0.0, 1.0))
def test_a_lower_bound_is_never_rounded_up(share):
    shown = float(percent(share).removesuffix(" %"))
    assert shown <= 100 * share + 1e-9
    assert shown >= 100 * min(share, 0.9999) - 0.1 - 1e-9
