"""Figures and report of the paper's study: every figure and table of the paper, true to the numbers of the run."""

from __future__ import annotations

import copy
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from page_reader import Page
from scipy.spatial.transform import Rotation

from symcal.instruments.noise import Noise
from symcal.page.assembled import CAP
from symcal.paper import published
from symcal.paper.plots.looks import PLANS
from symcal.paper.printed import printed_tables
from symcal.paper.report import paper_text, write_paper_report
from symcal.paper.report.blocks import at_least, percent
from symcal.paper.report.verdict import study_verdict
from symcal.paper.results import Study
from symcal.paper.surroundings import mean_norm
from symcal.report import Picture
from symcal.runs.load import load
from symcal.runs.study import StudyOutcome, study_experiment, write
from symcal.words import number

SMALL = (
    "data.test_poses=300",
    "study.search.population=20",
    "study.search.generations=12",
    "study.search.side_generations=4",
    "study.random_plans=40",
    "study.repetitions=40",
    "study.unregularised=10",
    "study.simulation_1.draws=4",
    "outputs.c=false",
)
FIGURES = {3: "vision", 5: "trajectory", 6: "joint_motion", 7: "convergence", 8: "test_data", 9: "test_errors"}


@pytest.fixture(scope="module")
def outcome(configs: Path) -> StudyOutcome:
    return study_experiment(load(configs / "handling_robot.yaml", overrides=SMALL))


@pytest.fixture(scope="module")
def study(outcome: StudyOutcome) -> Study:
    return outcome.study


@pytest.fixture(scope="module")
def content(outcome: StudyOutcome) -> dict[str, Any]:
    return json.loads(json.dumps(outcome.content, allow_nan=False))


@pytest.fixture(scope="module")
def written(outcome: StudyOutcome, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[Picture, ...]]:
    """The folder of the study, and the pictures that its report was given."""
    folder, given = tmp_path_factory.mktemp("paper"), []

    def recorded(content: dict[str, Any], pictures: tuple[Picture, ...], path: Path) -> None:
        given.extend(pictures)
        write_paper_report(content, pictures, path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("symcal.paper.report.write_paper_report", recorded)
        write(outcome, folder)
    return folder, tuple(given)


@pytest.fixture(scope="module")
def pictures(written: tuple[Path, tuple[Picture, ...]]) -> tuple[Picture, ...]:
    return written[1]


@pytest.fixture(scope="module")
def text(written: tuple[Path, tuple[Picture, ...]]) -> str:
    return _text(written[0] / "report.pdf")


def _text(path: Path) -> str:
    pypdf = pytest.importorskip("pypdf", reason="pypdf, which reads PDF files back, is not installed")
    return " ".join("\n".join(page.extract_text() for page in pypdf.PdfReader(path).pages).split())


def test_every_figure_of_the_paper_is_drawn_or_named_with_the_reason(pictures: tuple[Picture, ...], text: str) -> None:
    drawn = {p.name: p.title for p in pictures}
    assert len(drawn) == len(pictures)
    for figure, name in FIGURES.items():
        assert f"paper: Fig. {figure}" in drawn[f"paper_{name}"]
        assert drawn[f"paper_{name}"] in text
    for figure in set(range(1, 10)) - set(FIGURES):
        assert f"Fig. {figure} (" in text[text.index("have no counterpart") :]
    for table in ("I", "II", "III", "IV", "V", "VI"):
        assert f"(paper: Table {table})" in text
    assert "not drawn" not in text
    assert all(p.width_mm <= 170.5 for p in pictures)


def test_numbers_stand_beside_the_papers(content: dict[str, Any], text: str) -> None:
    for key in ("optimal", "random"):
        for value in published.TABLE_IV[key]["after"].values():
            assert f"{value}" in text
        for value in published.TABLES[key].values():
            assert f"{value:.4f}".replace("-", "−") in text
    for plan in content["simulation_2"]["plans"].values():
        assert number(plan["after_measured"]["mean_mm"]) in text
        assert number(plan["after_true"]["max_mm"]) in text
        assert number(plan["repetitions"]["true_rms_mm"]["median"]) in text
    for value in content["nominal_pose"]["position_mm"]:
        assert f"{value:.3f}".replace("-", "−") in text
    assert f"determine {content['gauge']['nominal']['rank']} of 15 directions" in text


def test_its_page_is_the_certified_plans_with_the_study_below(
    outcome: StudyOutcome, content: dict[str, Any], written: tuple[Path, tuple[Picture, ...]]
) -> None:
    """Its first number is the held-out one, its worst pose that of the results; what is referred to is there."""
    folder, pictures = written
    whole = (folder / "report.html").read_text(encoding="utf-8")
    assert len(whole.encode()) < CAP
    read = Page(whole)
    found = content["accuracy"]["test"]["after"]["position_mm"]
    assert f"{number(found['rms'])} mm rms position error at held-out poses" in read.text
    scene = read.scene
    assert scene["poses"]["label"][scene["marks"]["pose"][scene["worst"]]] == found["worst"]["pose"]
    assert scene["marks"]["held"][scene["worst"]] == pytest.approx(found["max"], rel=1e-4)
    sizes = outcome.study.simulation_2["certified"].after_measured
    assert found["worst"]["pose"] == f"test {sizes.argmax() + 1}"
    for block in paper_text(content)["blocks"]:
        if block["kind"] in ("heading", "table"):
            assert (block.get("text") or block["title"]) in read.text
    assert all(picture.title in read.text for picture in pictures)
    anchors = [address[1:] for address in read.addresses if address.startswith("#")]
    assert set(anchors) <= set(read.ids)
    assert len(set(read.ids)) == len(read.ids)
    assert "[@" not in read.text
    assert all(address.startswith(("data:", "#")) for address in read.addresses)


def test_report_needs_no_picture(content: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "report.pdf"
    write_paper_report(content, (), path)
    assert "a figure that was not drawn" in _text(path)


def test_text_is_plain_data_and_leaves_no_gap(content: dict[str, Any]) -> None:
    text = json.dumps(paper_text(content), allow_nan=False)
    assert not re.search(r"\bnan\b|undefined|None(?! of)", text)


def test_other_true_errors_than_the_papers(content: dict[str, Any]) -> None:
    """Then its tables of identified errors say nothing about the robot, and the report does not use them."""
    other = copy.deepcopy(content)
    other["printed"] = {}
    for key in ("optimal", "random"):
        other["simulation_2"]["paper"][key]["parameters_at_our_test_poses"] = None
    text = json.dumps(paper_text(other), ensure_ascii=False)
    assert "Typed into a controller" not in text
    assert "A check that needs nothing but the paper" not in text


@pytest.mark.parametrize(("beaten", "rank", "says"), [(0.1, 11, True), (0.9, 15, False)])
def test_verdict_says_what_happened(content: dict[str, Any], beaten: float, rank: int, says: bool) -> None:
    case = copy.deepcopy(content)
    case["plans"]["paper_ga"]["beats_random_expected"] = beaten
    case["gauge"]["nominal"]["rank"] = rank
    first = study_verdict(case)[0]
    assert ("worse than random" in first) == says
    assert ("not all its parameters" in first) == says


def test_verdict_does_not_praise_what_misses_the_papers_numbers(content: dict[str, Any]) -> None:
    case = copy.deepcopy(content)
    case["simulation_2"]["plans"]["certified"]["repetitions"]["measured_mean_mm"]["median"] = 0.2
    assert "does not hold" in study_verdict(case)[0]
    assert "0.200 mm in the mean" in " ".join(study_verdict(case))


def test_the_papers_tables_without_their_unseen_part(study: Study) -> None:
    """They predict nearly the same positions, and nothing in them is larger than an error can plausibly be."""
    setting = study.setting
    names = setting.model.parameters.names
    for name, table in printed_tables(setting, study.plans["certified"].poses).items():
        assert table.moved_mm < 0.1
        unseen = [names.index(n) for n in ("theta_5", "theta_4", "alpha_4", "a_4", "d_3", "d_4")]
        scaled = np.abs(table.reduced / setting.model.parameters.scales)[unseen]
        assert scaled.max() < 1 < np.abs(published.TABLES[name]["theta_5"]) / 0.01
        # orientation by the forward kinematics of a corrected robot, and its angle by SciPy
        errors = dict(published.TABLES[name])
        turned = []
        for q in setting.test_poses[:20]:
            a, b = (_orientation(setting, q, e) for e in (errors, dict(published.TABLE_III)))
            turned.append((a.inv() * b).magnitude())
        assert table.turned == pytest.approx(np.mean(turned), rel=0.3)


def _orientation(setting: Any, q: Any, errors: dict[str, float]) -> Rotation:
    robot = setting.model.robot.corrected(errors)
    matrix = np.eye(4)
    for link, value in zip(robot.links, q, strict=True):
        p = {"theta": 0.0, "d": 0.0, "a": 0.0, "alpha": 0.0, "beta": 0.0} | dict(link.parameters)
        p["theta" if link.joint.revolute else "d"] += value
        step = np.eye(4)
        turn = Rotation.from_euler("ZXY", [p["theta"], p["alpha"], p["beta"]])
        step[:3, :3] = turn.as_matrix()
        matrix = matrix @ step
    return Rotation.from_matrix(matrix[:3, :3])


def test_mean_norm_of_noise() -> None:
    rng = np.random.default_rng(3)
    for distribution in ("uniform", "normal"):
        noise = Noise(distribution, 0.1)
        norms = np.linalg.norm(noise.draw(0.1, (200_000, 3), rng), axis=1)
        assert mean_norm(noise) == pytest.approx(norms.mean(), abs=5 * norms.std() / math.sqrt(len(norms)))


@given(st.floats(0, 1))
def test_shares_are_never_rounded_to_all_or_nothing(share: float) -> None:
    bound = float(at_least(share).removeprefix("≥ ").removesuffix(" %"))
    assert bound <= 100 * share + 1e-9
    shown = percent(share)
    if 0 < share < 1:
        assert shown.removesuffix(" %") not in ("0", "0.0", "100", "100.0")


def test_plans_are_told_apart_without_colour() -> None:
    assert len({look.marker for look in PLANS.values()}) == len(PLANS)
    assert len({str(look.line) for look in PLANS.values()}) == len(PLANS)
