"""Calibrations of one robot beside each other: the law of what differs, planted changes, the command, hostile input."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from cases import ARM, ROBOTS
from compare_draws import CASES, calibrated, compared
from identifications import content_of, simulated
from matplotlib.container import ErrorbarContainer
from model_check_draws import model_of
from scipy import stats
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from strategies import random_frame
from typer.testing import CliRunner

import symcal as sc
from symcal.calibration.robot_difference import _estimate, robot_difference
from symcal.calibration.tool_difference import tool_difference
from symcal.cli import app
from symcal.errors import InputError, RefusedError
from symcal.plots.comparison import comparison
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Robot
from symcal.runs.compare import compare_runs

BOTH = {"base", "tool"}
ERRORS = {"a_3": 0.2, "theta_2": 1e-3}


@cache
def pair() -> tuple[Robot, Robot]:
    """One robot calibrated twice: other poses, base and noise."""
    return tuple(calibrated(ARM, "position", ERRORS, 30, 1.0, [seed]) for seed in (11, 12))  # type: ignore[return-value]


# --------------------------------------------------------------------------------------------------------------- laws


def test_calibrations_of_one_robot_have_uniform_probabilities():
    """Noise and sizes unknown, two plans, two set-ups; the long form is compare_draws.py."""
    found = [compared(CASES[name], seed) for name in ("arm", "prismatic, few") for seed in range(8)]
    p = [each.numbers.p for each in found]
    assert stats.kstest(p, "uniform").pvalue > 1e-3
    assert sum(bool(each.differing) for each in found) <= stats.binom.isf(1e-3, len(found), 0.05)
    ratio = np.mean([(each.tool.rms / each.tool.expected) ** 2 for each in found])
    assert 0.7 < math.sqrt(ratio) < 1.35


def test_a_link_that_got_longer_is_named_and_nothing_else():
    found = [compared(CASES["arm"], seed, {"a_3": 0.3}).differing for seed in range(100, 108)]
    assert sum(named[:1] == ("a_3",) for named in found) >= 7
    assert sum(len(named) > 1 for named in found) <= 3


def test_plausible_sizes_are_read_off_what_was_learnt():
    """The record has no prior: variance and share learnt give it, but for what is not known of noise and sizes."""
    robot = pair()[0]
    assert robot.record is not None
    names = tuple(n for n in robot.parameters if robot.record.sigmas[n])
    sizes = _estimate(robot.record, names).sizes
    stated = np.array([p.scale for p in robot.described if p.name in names])
    assert sizes / stated == pytest.approx(float(robot.record.provenance["size_factor"]), rel=0.25)


# --------------------------------------------------------------------------------------------------------------- tool


def tool_positions(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Where the tool is, (N, 3), by NumPy: craig's convention."""
    where = np.tile(robot.base, (len(q), 1, 1))
    for link, reading in zip(robot.links, q.T, strict=True):
        p = {k: link.parameters.get(k, 0.0) for k in ("alpha", "a", "beta", "theta", "d")}
        for axis, angle, along in (("x", p["alpha"], "a"), ("y", p["beta"], None), ("z", p["theta"] + reading, "d")):
            step = np.tile(np.eye(4), (len(q), 1, 1))
            step[:, :3, :3] = Rotation.from_euler(axis, np.broadcast_to(angle, len(q))[:, None]).as_matrix()
            step[:, "xyz".index(axis), 3] = p[along] if along else 0.0
            where = where @ step
    return np.asarray((where @ robot.tool)[:, :3, 3])


def test_tools_are_as_far_apart_as_numpy_and_scipy_say():
    """Both robots stand elsewhere and hold the tool elsewhere: only what no alignment takes away is left."""
    rng = np.random.default_rng(1)
    grip = shifted(np.array([30.0, -20.0, 90.0]))
    first = replace(ARM, tool=grip, base=random_frame(rng))
    second = replace(
        ARM.corrected({"a_3": 0.3, "alpha_2": 4e-4, "theta_1": 2e-3}), tool=random_frame(rng), base=random_frame(rng)
    )
    q = np.random.default_rng(0).uniform(*ARM.ranges, (1000, 6))
    found = tool_difference(first, second, ("a_3",), np.zeros((1, 1)), BOTH)
    wanted, eye = tool_positions(replace(first, base=np.eye(4)), q), replace(second, base=np.eye(4))
    frames = [tool_positions(replace(eye, tool=shifted(v)), q) for v in np.vstack([np.zeros(3), np.eye(3)])]
    axes = np.stack([f - frames[0] for f in frames[1:]], axis=2)

    def apart(x: np.ndarray) -> np.ndarray:
        moved = (frames[0] + axes @ x[6:]) @ Rotation.from_rotvec(x[:3]).as_matrix().T + x[3:6]
        return np.asarray(moved - wanted).ravel()

    best = least_squares(apart, np.concatenate([np.zeros(6), grip[:3, 3]]), x_scale="jac", xtol=1e-14, ftol=1e-14)
    sizes = np.linalg.norm(best.fun.reshape(-1, 3), axis=1)
    assert found.rms == pytest.approx(math.sqrt(np.mean(sizes**2)), rel=1e-6)
    assert (found.largest, found.p95) == pytest.approx((sizes.max(), np.percentile(sizes, 95)), rel=1e-4)
    assert found.at == pytest.approx(q[sizes.argmax()])
    unaligned = np.sum((tool_positions(replace(eye, tool=grip), q) - wanted) ** 2, axis=1)
    assert found.rms < 0.8 * math.sqrt(unaligned.mean())


def shifted(v: np.ndarray) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, 3] = v
    return frame


def test_a_robot_that_was_moved_and_regripped_did_not_change():
    rng = np.random.default_rng(2)
    second = replace(ARM, base=random_frame(rng), tool=random_frame(rng))
    assert tool_difference(ARM, second, (), np.zeros((0, 0)), BOTH).largest < 1e-6
    known = tool_difference(ARM, replace(ARM, base=shifted(np.array([3.0, 4.0, 0.0]))), (), np.zeros((0, 0)), ())
    assert (known.rms, known.largest) == pytest.approx((5.0, 5.0))
    assert known.aligned == ()


def test_what_is_expected_of_the_tool_is_the_mean_of_many_draws():
    rng = np.random.default_rng(3)
    names = ("theta_2", "theta_4", "alpha_2", "a_3", "d_4")
    half = rng.normal(size=(5, 5)) * np.array([2e-4, 2e-4, 2e-4, 0.1, 0.1])[:, None]
    covariance = half @ half.T
    expected = tool_difference(ARM, ARM, names, covariance, BOTH).expected
    draws = rng.multivariate_normal(np.zeros(5), covariance, 24)
    squares = [
        tool_difference(ARM, ARM.corrected(dict(zip(names, d, strict=True))), names, covariance, BOTH).rms ** 2
        for d in draws
    ]
    assert np.mean(squares) == pytest.approx(expected**2, abs=4 * np.std(squares) / math.sqrt(24))


def test_only_what_a_set_up_finds_itself_is_aligned():
    assert robot_difference(*pair()).tool.aligned == ("base", "tool")


# ----------------------------------------------------------------------------------------------------- different robots


def other(robot: Robot, link: int = 0, parameters: dict[str, float] | None = None, **joint: Any) -> Robot:
    links = list(robot.links)
    old = links[link]
    links[link] = replace(old, joint=replace(old.joint, **joint), parameters={**old.parameters, **(parameters or {})})
    return replace(robot, links=tuple(links))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r: replace(r, links=r.links[:-1], record=replace(r.record, errors={}, sigmas={})), "6 joints and 5"),
        (lambda r: replace(r, convention="standard"), "convention 'craig' and 'standard'"),
        (lambda r: other(r, 2, name="elbow"), "joint 3 is called 'r' and 'elbow'"),
        (lambda r: other(r, 1, sign=-1), "sign of joint 'r': 1 and -1"),
        (lambda r: other(r, 1, ratio=1.5), "ratio of joint 'r': 1.0 and 1.5"),
        (lambda r: r.corrected({"a_3": 2e-6}), "nominal a_3 of -425 and -424.999998 mm"),
        (lambda r: other(r, 0, {"beta": 0.1}), "nominal beta_1 of 0 and 0.1 rad"),
    ],
)
def test_other_robots_are_refused_by_what_differs(change, said):
    first, second = pair()
    with pytest.raises(RefusedError, match=re.escape(f"different robots: {said}")):
        robot_difference(first, change(second))


def test_a_parameter_that_one_does_not_list_is_at_nominal_zero():
    first, second = pair()
    found = robot_difference(first, other(second, 0, {"beta": 0.0}))
    assert found.numbers.p == robot_difference(first, second).numbers.p


def test_a_parameter_that_one_held_is_left_out_and_named():
    first, second = pair()
    assert second.record is not None
    sigmas = {**second.record.sigmas, "alpha_2": None}
    found = robot_difference(first, replace(second, record=replace(second.record, sigmas=sigmas)))
    assert dict(found.left_out) == {"alpha_2": "estimated in the first alone"}
    assert "alpha_2" not in found.names


def test_records_that_are_none_are_refused():
    first, second = pair()
    assert second.record is not None
    with pytest.raises(InputError, match="has no 'calibration'"):
        robot_difference(first, ARM)
    spoilt = second.record.covariance.copy()
    spoilt[0, 1] = spoilt[1, 0] = 1e3
    with pytest.raises(InputError, match="this is no covariance"):
        robot_difference(first, replace(second, record=replace(second.record, covariance=spoilt)))
    for said in ({}, {"learnt": [1]}, {"learnt": {"a_3": 0.5}}):
        with pytest.raises(InputError, match="does not say what was learnt"):
            robot_difference(first, replace(second, record=replace(second.record, provenance=said)))
    held = replace(second.record, sigmas=dict.fromkeys(second.record.sigmas))
    with pytest.raises(RefusedError, match="no parameter of the robot in common"):
        robot_difference(first, replace(second, record=held))


# ---------------------------------------------------------------------------------------------------------- the command


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """january and february: one robot; june: a_4 is longer; folders as runs leave them."""
    folder, (calibration, data, errors) = tmp_path_factory.mktemp("runs"), simulated(ROBOTS.parent, "position")
    handling, truth = load_robot(ROBOTS / "handling_robot.yaml"), {"a_4": 0.1, "d_4": -0.1, "alpha_2": 2e-3}
    robots = {"january": calibration.robot}
    content = json.loads(json.dumps(content_of(calibration, data, errors)))
    truth = dict(zip(calibration.model.parameters.names, np.zeros(99), strict=False)) | drawn_errors()
    for name, seed, longer in (("february", 21, 0.0), ("june", 22, 0.4)):
        moved = {k: v for k, v in truth.items() if k in handling.parameters}
        moved["a_4"] += longer
        robots[name] = calibrated(handling, "position", moved, 40, 1.0, [seed])
    for name, robot in robots.items():
        assert robot.record is not None
        (folder / name).mkdir()
        save_robot(robot, folder / name / "calibrated.yaml")
        parameters = {k: {"error": v} for k, v in robot.record.errors.items()}
        own = content | {"identification": content["identification"] | {"parameters": parameters}}
        if name == "june":
            own["decision"] = {
                "accepted": False,
                "reasons": [{"kind": "position", "text": "held-out error 0.2 mm: above 0.1 mm"}],
            }
        (folder / name / "results.json").write_text(json.dumps(own))
    return folder


def drawn_errors() -> dict[str, float]:
    """What `identifications.identified` plants."""
    rng = np.random.default_rng(7)
    names = model_of(load_robot(ROBOTS / "handling_robot.yaml"), "position").kinematic
    return {n: rng.normal() * (0.004 if n[0] in "tb" or n.startswith("al") else 0.3) for n in names}


def test_the_command_says_what_changed_and_writes_it(runs: Path, tmp_path: Path):
    out = tmp_path / "compared"
    done = CliRunner().invoke(
        app, ["compare", *(str(runs / n) for n in ("january", "february", "june")), "--out", str(out)]
    )
    assert done.exit_code == 0, done.output
    assert "february against january: no parameter differs beyond its uncertainty" in done.output
    assert re.search(r"june against january: .*a₄.* beyond the joint uncertainty", done.output)
    assert re.search(r"^june .* refused$", done.output, re.M)
    assert "held-out error 0.2 mm: above 0.1 mm" in done.output
    content = json.loads((out / "results.json").read_text())
    table = pd.read_csv(out / "tables" / "differences.csv")
    row = table[(table["second"] == "june") & (table["parameter"] == "a_4")].iloc[0]
    errors = [load_robot(runs / n / "calibrated.yaml").record.errors["a_4"] for n in ("january", "june")]  # type: ignore[union-attr]
    assert row["difference"] == pytest.approx(errors[1] - errors[0])
    assert abs(row["difference"] - 0.4) < 4 * row["sigma"]
    assert row["differs"]
    june = content["comparison"][1]
    assert june["differing"][0] == "a_4"
    assert june["tool_mm"]["rms"] > 3 * june["tool_mm"]["expected_rms"]
    assert (out / "figures" / "compare.png").stat().st_size > 20_000
    assert (out / "figures" / "compare.pdf").read_bytes().startswith(b"%PDF")
    assert set(pd.read_csv(out / "tables" / "runs.csv")["run"]) == {"january", "february", "june"}


def test_the_figure_has_the_numbers(runs: Path):
    content = compare_runs([runs / "january", runs / "february", runs / "june"])
    picture = comparison(content)
    angles, lengths = picture.figure.subfigs[0].axes
    assert "mrad" in angles.get_ylabel()
    assert "mm" in lengths.get_ylabel()
    june = content["comparison"][1]["parameters"]
    drawn = [c for c in lengths.containers if isinstance(c, ErrorbarContainer)]
    ends = [segment for c in drawn if c[2] for segment in c[2][0].get_segments()]
    each = june["a_4"]
    expected = [each["difference"] - each["half_width_95"], each["difference"] + each["half_width_95"]]
    assert any(np.allclose(np.asarray(segment)[:, 1], expected) for segment in ends)
    (bold,) = [t.get_text() for t in lengths.get_xticklabels() if t.get_fontweight() == "bold"]
    assert bold == "a₄"
    assert "june differs in a₄" in picture.caption
    assert "february differs by no more than its uncertainty" in picture.caption


def test_a_run_beside_itself_is_identical(runs: Path):
    content = compare_runs([runs / "january", runs / "january" / "calibrated.yaml"])
    (found,) = content["comparison"]
    assert found["identical"]
    assert list(content["runs"]) == ["january (1)", "january (2)"]
    assert found["tool_mm"]["max"] == pytest.approx(0, abs=1e-9)


def test_runs_of_one_name_are_told_apart_by_their_folders(runs: Path, tmp_path: Path):
    (tmp_path / "again" / "january").mkdir(parents=True)
    robot = (runs / "february" / "calibrated.yaml").read_bytes()
    (tmp_path / "again" / "january" / "calibrated.yaml").write_bytes(robot)
    names = list(compare_runs([runs / "january", tmp_path / "again" / "january"])["runs"])
    assert names == [f"{runs.name}/january", "again/january"]


def test_runs_of_the_same_measurements_say_so(runs: Path, tmp_path: Path):
    for name in ("january", "february"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "calibrated.yaml").write_bytes((runs / name / "calibrated.yaml").read_bytes())
        (tmp_path / name / "measurements.csv").write_text(f"# {name}\npose,x_mm\n1,0.5\n2,{len(name)}.25\n")
    warnings = compare_runs([tmp_path / "january", tmp_path / "february"])["warnings"]
    assert any("1 of the same measurements" in warning for warning in warnings)
    assert not any("same" in warning for warning in compare_runs([runs / "january", runs / "february"])["warnings"])


def test_a_calibrated_robot_alone_is_compared_without_its_results(runs: Path, tmp_path: Path):
    file = tmp_path / "lone.yaml"
    file.write_bytes((runs / "june" / "calibrated.yaml").read_bytes())
    content = compare_runs([runs / "january", file])
    assert content["runs"]["lone.yaml"]["accuracy"] is None
    assert content["comparison"][0]["differing"][0] == "a_4"
    comparison(content)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not the JSON that a run writes"),
        ("[1]", "not results that this version"),
        ('{"schema": "symcal/results/2"}', "found: symcal/results/2"),
        ('{"schema": "symcal/results/1", "plan": {}}', "not the results of an identification"),
        ('{"schema": "symcal/results/1", "identification": {"parameters": {}}}', "of another calibration"),
        ('{"schema": "symcal/results/1", "identification": 3}', "not the results of an identification"),
    ],
)
def test_results_that_are_something_else_are_refused(runs: Path, tmp_path: Path, text: str, said: str):
    (tmp_path / "calibrated.yaml").write_bytes((runs / "june" / "calibrated.yaml").read_bytes())
    (tmp_path / "results.json").write_text(text)
    with pytest.raises(InputError, match=said):
        compare_runs([runs / "january", tmp_path])


def test_runs_that_are_none_are_refused(runs: Path, tmp_path: Path):
    with pytest.raises(RefusedError, match="name two or more"):
        compare_runs([runs / "january"])
    with pytest.raises(RefusedError, match="9 runs: compare at most 8"):
        compare_runs([runs / "january"] * 9)
    with pytest.raises(InputError, match="there is no such file"):
        compare_runs([runs / "january", tmp_path / "nowhere"])
    with pytest.raises(InputError, match=r"holds no calibrated\.yaml"):
        compare_runs([runs / "january", tmp_path])
    with pytest.raises(InputError, match="has no 'calibration'"):
        compare_runs([runs / "january", ROBOTS / "handling_robot.yaml"])
    six = pair()[0]
    named = [replace(link, joint=replace(link.joint, name=f"j{i}")) for i, link in enumerate(six.links)]
    save_robot(replace(six, links=tuple(named)), tmp_path / "calibrated.yaml")
    with pytest.raises(RefusedError, match=r"january and .*different robots: 5 joints and 6"):
        compare_runs([runs / "january", tmp_path])
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(RefusedError, match=r"holds files and no manifest\.json"):
        compare_runs([runs / "january", runs / "june"], out=tmp_path)


def test_eight_runs_are_drawn(runs: Path):
    folders = [runs / "january", *[runs / n for n in ("february", "june")] * 3, runs / "january"]
    content = compare_runs(folders)
    picture = comparison(content)
    assert len(content["comparison"]) == 7
    picture.figure.canvas.draw()
    labels = [t.get_text() for t in picture.figure.legends[0].get_texts()]
    assert len([label for label in labels if "−" in label]) == 7


def test_it_is_part_of_the_public_names():
    assert sc.robot_difference is robot_difference
