"""`symcal plan` from file to folder: what is written, what is refused, and whether what is promised comes true."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from symcal.cli import app
from symcal.errors import InputError, RefusedError
from symcal.planning.drive_plan import find_plan, plan_generator
from symcal.planning.ordering import shortest_tour
from symcal.planning.plan_file import read_plan
from symcal.planning.plan_problem import plan_problem
from symcal.planning.results import constraint_facts, order_facts
from symcal.report.plan import plan_text
from symcal.report.plan_verdict import plan_verdict
from symcal.robot.files import load_robot
from symcal.runs.load import load
from symcal.runs.plan import plan_experiment, run_plan
from symcal.runs.run import run

PLAIN = ("outputs.report=false", "outputs.figures=false")
QUICK = (
    *PLAIN,
    "plan.poses=12",
    "plan.sample=600",
    "plan.random=20",
    "plan.compare=[]",
    "plan.promise={counts: [6, 12], random: 10}",
)
LEAN = (*PLAIN, "plan.sample=600", "plan.random=0", "plan.compare=[]")


@pytest.fixture(scope="module")
def planning(configs) -> Path:
    return configs / "plan_position.yaml"


@pytest.fixture(scope="module")
def robot(configs):
    return load_robot(configs / "robots" / "handling_robot.yaml")


@pytest.fixture(scope="module")
def small(planning, tmp_path_factory) -> Path:
    return run_plan(planning, tmp_path_factory.mktemp("plan") / "out", overrides=QUICK)[0]


def content(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


def planned(path: Path, *overrides: str):
    return plan_experiment(load(path, overrides=[*QUICK, *overrides]))


def chosen(path: Path, *overrides: str):
    """The problem and its plan in driving order, without what is foretold about other plans."""
    experiment = load(path, overrides=[*QUICK, "plan.random=0", *overrides])
    rng = plan_generator(experiment.seed)
    problem = plan_problem(experiment.file, experiment.document, experiment.model, rng)
    return problem, find_plan(problem, experiment.file.plan, rng)


def test_the_folder_is_whole(small):
    files = {str(p.relative_to(small)) for p in small.rglob("*") if p.is_file()}
    assert files >= {
        "results.json",
        "plan.csv",
        "experiment.resolved.yaml",
        *(f"tables/{name}.csv" for name in ("poses", "promise", "methods", "waypoints")),
    }


def test_results_say_what_they_must(small):
    found = content(small)
    assert found["kind"] == "plan"
    plan, random = found["plan"], found["plan"]["random"]
    assert (plan["poses"], plan["rank"], plan["method"], plan["criterion"]) == (12, 11, "certified", "D")
    assert plan["noise_sigma_mm"] == pytest.approx(0.1 / np.sqrt(3))
    assert 0 < plan["d_efficiency_lower_bound"] <= 1
    assert 0 < plan["g_efficiency"] <= 1
    assert plan["mean_pose_rms_mm"] <= plan["worst_pose_rms_mm"]
    for key in ("d_efficiency_lower_bound", "g_efficiency"):
        assert random[key] < plan[key]
    for key in ("worst_pose_rms_mm", "mean_pose_rms_mm"):
        assert random[key] > plan[key]
    assert plan["search_seconds"] > 0
    # what the design theory allows at best, with the plausible sizes as prior and without: the rms over the best plan's
    # own poses is sigma sqrt(n / N) without
    (row,) = [row for row in found["promise"]["table"] if row["poses"] == 12]
    assert plan["worst_pose_rms_mm"] >= row["bound_worst_mm"] * (1 - 1e-6)
    assert 0.9 < row["bound_worst_mm"] / (plan["noise_sigma_mm"] * np.sqrt(11 / 12)) < 1
    assert sum(found["order"]["segments"].values()) == 12
    assert found["order"]["time_s"] > 0


def test_only_what_is_proven_is_called_so(small):
    """Verdict, report and table, with the proof, with a loose one, without, and over candidates."""
    facts = content(small)
    certificate = facts["plan"]["certificate"]
    proof = certificate["proof"]
    assert proof["open_share"] == 0
    assert 0.9 < proof["d_efficiency_lower_bound"] <= facts["plan"]["d_efficiency_lower_bound"]
    assert "(D-efficiency, proven)" in plan_verdict(facts)[0]
    assert "proven over the whole working area" in plan_text(facts)["bounds"]

    def said(**changed) -> str:
        own = facts | {"plan": facts["plan"] | {"certificate": certificate | changed}}
        text = plan_text(own)
        return " ".join([*text["verdict"], text["bounds"], *(row[0] for row in text["comparison"]["rows"])])

    loose = said(proof=proof | {"d_efficiency_lower_bound": 0.5, "open_share": 0.25, "missed": 2})
    assert "searched; 50.0 % are proven" in loose
    assert "In 25 % of the area" in loose
    assert "2 poses that the search had missed" in loose
    without = said(proof=None, unproven="for a reason")
    assert "(D-efficiency, searched, not proven)" in without
    assert "is not proven: for a reason." in without
    assert "proven" not in without.replace("not proven", "")
    assert "proven" not in said(proof=None, exhaustive=True)


def test_promise_falls_with_the_poses_and_keeps_above_its_bound(small):
    table = content(small)["promise"]["table"]
    assert [row["poses"] for row in table] == [6, 12]
    for figure in ("mean", "worst"):
        best = [row[f"best_{figure}_mm"] for row in table]
        assert best[0] > best[1]
        for row in table:
            assert row[f"bound_{figure}_mm"] <= row[f"best_{figure}_mm"] * (1 + 1e-9)
            assert row[f"random_{figure}_mm"] > row[f"best_{figure}_mm"]
    assert all(row["random_mean_low_mm"] <= row["random_mean_mm"] * 1.5 for row in table)


def test_poses_needed_bracket_the_wanted_accuracy(planning):
    found = planned(planning, "plan.promise={counts: [12], random: 5, accuracy: [0.06]}").content["promise"]
    (needed,) = found["needed"]
    assert needed["at_least"] <= needed["poses"] < needed["random"]
    assert needed["mean_pose_rms_mm"] <= 0.06


def test_plan_csv_comes_back(small, robot):
    poses, names = read_plan(small / "plan.csv", robot)
    assert names == tuple(str(i) for i in range(1, 13))
    table = pd.read_csv(small / "tables" / "poses.csv")
    readings = table[["q1_deg", "q2_mm", "q3_mm", "q4_deg", "q5_deg"]].to_numpy()
    np.testing.assert_allclose(np.rad2deg(poses[:, 0]), readings[:, 0], atol=1e-9)
    np.testing.assert_allclose(poses[:, 1:3], readings[:, 1:3], atol=1e-9)
    assert (poses >= robot.lower - 1e-9).all()
    assert (poses <= robot.upper + 1e-9).all()
    plan = pd.read_csv(small / "plan.csv")
    assert set(plan["segment"]) <= {"line", "joint"}
    waypoints = pd.read_csv(small / "tables" / "waypoints.csv")
    assert waypoints["time_s"].is_monotonic_increasing
    assert waypoints["time_s"].iloc[-1] == pytest.approx(plan["time_s"].sum())
    assert waypoints["q1_deg"].iloc[0] == pytest.approx(45)


def test_same_seed_same_plan(planning, small, tmp_path):
    again = run_plan(planning, tmp_path / "again", overrides=QUICK)[0]
    assert (again / "plan.csv").read_bytes() == (small / "plan.csv").read_bytes()
    other = chosen(planning, "seed=2")[1].plan.poses
    assert not np.array_equal(other, chosen(planning)[1].plan.poses)


def test_required_poses_are_in_the_plan_and_marked(planning):
    _, found = chosen(planning, "plan.required=[[10, 1000, 300, 45, 20], [-10, 1200, 400, 90, 0]]")
    must = found.plan.poses[found.required]
    np.testing.assert_allclose(sorted(must[:, 1]), [1000, 1200])
    assert len(order_facts(found)["required"]) == 2


def test_a_plan_may_be_required_by_the_next_one(planning, small, robot):
    _, found = chosen(planning, f"plan.required={small / 'plan.csv'}", "plan.poses=14")
    before, _ = read_plan(small / "plan.csv", robot)
    after = found.plan.poses
    assert all(np.abs(after - pose).max(axis=1).min() < 1e-9 for pose in before)
    assert found.required.sum() == 12


def test_too_few_poses_for_the_rank_are_refused(planning):
    with pytest.raises(RefusedError, match="at least 4"):
        chosen(planning, "plan.poses=3")


def test_distance_and_coverage_are_kept(planning):
    problem, found = chosen(
        planning,
        "plan.poses=16",
        "plan.distance=0.3",
        "plan.constraints={coverage: {joints: {waist: 3, reach: 3}}}",
    )
    unit = problem.area.unit(found.plan.poses)
    distance = np.linalg.norm(unit[:, None] - unit[None], axis=2) + 9 * np.eye(16)
    assert distance.min() >= 0.3 - 1e-9
    cells = {(min(int(3 * u[0]), 2), min(int(3 * u[2]), 2)) for u in unit}
    assert len(cells) == 9


def test_coverage_beyond_the_poses_is_refused(planning):
    with pytest.raises(RefusedError, match="cover"):
        chosen(planning, "plan.constraints={coverage: {joints: {waist: 5, reach: 5}}}")


def test_margins_and_keep_outs_hold_at_every_pose(planning):
    box = "keep_out: [{name: press, xyz: [600, 500, 1100], size: [500, 500, 800], margin: 20}]"
    problem, found = chosen(planning, f"plan.constraints={{{box}}}", "plan.margins={angle: 5, length: 10}")
    poses = found.plan.poses
    assert (poses[:, 2] <= 690 + 1e-9).all()
    assert (poses[:, 2] >= 10 - 1e-9).all()
    local = np.abs(problem.arm.nodes(poses) - [600, 500, 1100])
    assert (local >= [250, 250, 400]).any(axis=2).all()
    assert 0 < constraint_facts(problem, 0.0)["feasible_share"] < 1


def test_without_speeds_there_are_no_times(planning, tmp_path):
    folder, found = run_plan(planning, tmp_path / "slow", overrides=[*QUICK, "plan.speeds={}"])
    assert found["order"]["time_s"] is None
    assert any("plan.speeds" in note for note in found["warnings"])
    assert "time_s" not in pd.read_csv(folder / "plan.csv").columns


@pytest.mark.parametrize("method", ["combined", "exchange", "refine", "random", "genetic"])
def test_every_method_can_be_asked_for(planning, method):
    _, found = chosen(planning, f"plan.method={method}", "plan.genetic={population: 20, generations: 20}")
    assert found.plan.method == method
    assert len(found.plan) == 12


@pytest.mark.parametrize("fitness", ["condition", "paper"])
def test_genetic_plans_by_another_fitness(planning, fitness):
    camera = (
        "plan.constraints={camera: {width: 2448, height: 2048, "
        "intrinsics: {fx: 2000, fy: 2000, cx: 1223.5, cy: 1023.5}, placement: "
        "{position: [300, 3000, 1200], look_at: [0, 500, 1100]}, incidence: 85, target: "
        "{triangle: {side: 200}, disc_radius: 15, mount: {rpy: [0, 45, 0]}}}}"
    )
    genetic = (
        f"plan.genetic={{population: 20, generations: 10, fitness: {fitness}, weights: {{angle: 1, area: -0.001}}}}"
    )
    problem, found = chosen(planning, camera, genetic, "plan.method=genetic")
    assert problem.feasible(found.plan.poses).all()


def test_the_paper_fitness_needs_a_camera(planning):
    with pytest.raises(RefusedError, match="camera"):
        chosen(planning, "plan.method=genetic", "plan.genetic={fitness: paper}")


# ----------------------------------------------------------------------------------------------------------- candidates


def candidates(robot, path: Path, count: int, rng: np.random.Generator) -> np.ndarray:
    q = rng.uniform([-1.5, 850, 0, 0, -3], [1.5, 1350, 700, 3, 3], (count, 5))
    shown = np.where([joint.revolute for joint in robot.joints], np.rad2deg(q), q)
    frame = pd.DataFrame(shown, columns=["q1_deg", "q2_mm", "q3_mm", "q4_deg", "q5_deg"])
    frame.insert(0, "pose", [f"m{i}" for i in range(count)])
    frame.to_csv(path, index=False)
    return q


def test_only_candidates_are_chosen_and_named(planning, robot, tmp_path, rng):
    given = candidates(robot, tmp_path / "given.csv", 60, rng)
    folder, found = run_plan(
        planning, tmp_path / "out", overrides=[*QUICK, f"plan.candidates={tmp_path / 'given.csv'}", "plan.criterion=D"]
    )
    poses, names = read_plan(folder / "plan.csv", robot)
    assert len(set(names)) == 12
    for pose, name in zip(poses, names, strict=True):
        np.testing.assert_allclose(pose, given[int(name[1:])], atol=1e-9)
    assert found["promise"] is None
    split = pd.read_csv(folder / "tables" / "candidates.csv")
    assert set(split.loc[split["split"] == "train", "pose"]) == set(names)


def test_candidates_that_cannot_be_measured_are_named_and_not_chosen(planning, robot, tmp_path, rng):
    given = candidates(robot, tmp_path / "given.csv", 80, rng)
    wall = "plan.constraints={planes: [{name: wall, point: [600, 0, 0], normal: [-1, 0, 0]}]}"
    found = planned(planning, f"plan.candidates={tmp_path / 'given.csv'}", wall)
    x = found.findings.problem.arm.nodes(given)[:, :, 0].max(axis=1)
    named = found.content["constraints"]["infeasible_candidates"]
    assert len(named) == (x > 600 + 1e-9).sum() > 0
    assert all("wall" in sentence for sentence in named)
    assert found.findings.problem.arm.nodes(found.findings.planned.plan.poses)[:, :, 0].max() <= 600 + 1e-6


def test_measured_poses_are_chosen_from_and_identified(configs, tmp_path):
    """Twenty poses of a measured set of two hundred, chosen by plan, then identified from its own table."""
    simulated = configs / "simulated_arm.yaml"
    measured = run(simulated, tmp_path / "measured", overrides=[*PLAIN, "plan.poses=200", "data.test_poses=0"])[0]
    csv = measured / "measurements.csv"
    folder, found = run_plan(simulated, tmp_path / "plan", overrides=[*LEAN, "plan.poses=20", f"plan.candidates={csv}"])
    assert found["plan"]["criterion"] == "J"
    result = run(simulated, tmp_path / "found", overrides=PLAIN, data=folder / "tables" / "candidates.csv")[1]
    assert result["measurement"]["poses"] == {"train": 20, "test": 180}
    assert result["accuracy"]["test"]["after"]["position_mm"]["rms"] < 0.2


# ------------------------------------------------------------------------------------------- what came of the promise


def test_a_run_takes_its_poses_from_the_plan_and_keeps_the_promise(configs, tmp_path, robot):
    simulated = configs / "simulated_arm.yaml"
    overrides = [*LEAN, "plan.method=certified", "plan.poses=30", "plan.promise={counts: [30], random: 2}"]
    plan_folder, plan = run_plan(simulated, tmp_path / "plan", overrides=overrides)
    folder, found = run(simulated, tmp_path / "run", overrides=overrides)
    np.testing.assert_array_equal(
        read_plan(folder / "plan.csv", robot)[0], read_plan(plan_folder / "plan.csv", robot)[0]
    )
    kept = found["promise"]
    assert kept["rank"] == plan["plan"]["rank"] == found["identifiability"]["rank"]
    # uniform over the same area, so the same within what a thousand test poses can tell
    assert kept["predicted_rms_mm"] == pytest.approx(plan["plan"]["mean_pose_rms_mm"], rel=0.05)
    # found^2 is about predicted^2 chi^2(rank) / rank: within these limits in all but one of 10^4 draws
    assert 0.4 < kept["found_true_rms_mm"] / kept["predicted_rms_mm"] < 1.7


def test_data_without_stated_noise_promise_nothing(configs, tmp_path):
    found = run(
        configs / "simulated_arm.yaml",
        tmp_path / "run",
        overrides=[*PLAIN, "data.noise={}", "plan.poses=30", "data.test_poses=20"],
    )[1]
    assert found["promise"] is None


def test_a_plan_alone_cannot_be_identified(planning, tmp_path):
    with pytest.raises(InputError, match="--data"):
        run(planning, tmp_path / "run", overrides=PLAIN)


# --------------------------------------------------------------------------------------------------------- the command


def test_the_command(planning, tmp_path):
    options = [part for override in QUICK for part in ("--set", override)]
    done = CliRunner().invoke(app, ["plan", str(planning), "--out", str(tmp_path / "out"), *options])
    assert done.exit_code == 0, done.output
    assert "as good as any 12 poses" in done.output
    assert (tmp_path / "out" / "plan.csv").is_file()
    bare = [*(each for pair in QUICK if pair not in PLAIN for each in ("--set", pair)), "--no-report", "--quiet"]
    quiet = CliRunner().invoke(app, ["plan", str(planning), "--out", str(tmp_path / "out"), *bare])
    assert quiet.output == ""
    assert not [*(tmp_path / "out").glob("report.*"), *(tmp_path / "out").glob("figures/*")]


def test_nothing_is_written_for_a_refused_plan(planning, tmp_path):
    with pytest.raises(RefusedError):
        run_plan(planning, tmp_path / "out", overrides=[*QUICK, "plan.noise={}"])
    assert not (tmp_path / "out").exists()


def test_a_resolved_plan_can_be_run_again(small, tmp_path):
    again = run_plan(small / "experiment.resolved.yaml", tmp_path / "again")[0]
    assert (again / "plan.csv").read_bytes() == (small / "plan.csv").read_bytes()


def test_tours_go_round_what_is_blocked(rng):
    poses = rng.uniform(-1, 1, (12, 3))
    free = shortest_tour(poses, np.zeros(3), np.ones(3))
    nodes = np.concatenate([[0], free.order + 1])
    blocked = np.zeros((13, 13), dtype=bool)
    for a, b in itertools.pairwise(nodes[3:7]):
        blocked[a, b] = blocked[b, a] = True
    found = shortest_tour(poses, np.zeros(3), np.ones(3), blocked)
    ways = np.concatenate([[0], found.order + 1])
    assert not blocked[ways[:-1], ways[1:]].any()
    assert sorted(found.order) == list(range(12))
    assert found.total >= free.total - 1e-12
    assert found.total < 2 * free.total  # times, not penalties
