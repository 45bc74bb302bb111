"""Study files: each slip is one error at its place, before anything is written; the command line around them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pypdf
import pytest
from studies import CONFIGS, write_study

from symcal import cli
from symcal.errors import InputError, RefusedError
from symcal.trials.check import check_study
from symcal.trials.load import load_study
from symcal.trials.study import Execution, run_study


@pytest.fixture
def symcal(capsys, monkeypatch, tmp_path):
    """`symcal ARGS` in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def call(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["symcal", *map(str, arguments)])
        try:
            cli.main()
            code = 0
        except SystemExit as exit_:
            code = exit_.code if isinstance(exit_.code, int) else int(exit_.code is not None)
        out, err = capsys.readouterr()
        return code, out, err

    return call


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("kind: study", "kind: trial", "kind", "not one of the allowed values"),
        ("seed: 5", "sed: 5", "sed", "did you mean 'seed'"),
        ("repetitions: 40", "repetitions: 0", "repetitions", "must be at least 1"),
        ("repetitions: 40", "repetitions: 20000000", "repetitions", "must be at most 1e+07"),
        ("repetitions: 40", "repetitions: 9000000", "repetitions", "4 cells of the grid with 9000000 trials each"),
        ("poses: [12, 20]", "poses: []", "vary.poses", "expected at least 1 items"),
        ("poses: [12, 20]", "poses: [12, 12]", "vary.poses", "12 stands here twice"),
        ("poses: [12, 20]", "poses: many", "vary.poses", "expected a whole number"),
        ("poses: [12, 20]", "plan: [random, best]", "vary.plan", "no such plan (found: best)"),
        ("poses: [12, 20]", "plan: missing.csv", "vary.plan", "the plan is not there"),
        ("poses: [12, 20]", "noise: {postion: 0.1}", "vary.noise.postion", "not one of the allowed values"),
        ("poses: [12, 20]", "noise: {position: 0}", "vary.noise.position", "must be greater than 0"),
        ("poses: [12, 20]", "noise: {distance: 0.1, position: .nan}", "vary.noise.position", "NaN"),
        (
            "poses: [12, 20]",
            "noise: {distance: 0.1}",
            "vary.noise.distance",
            "no instrument reads this (found: distance)",
        ),
        ("poses: [12, 20]", "instruments: [[wire]]", "vary.instruments[0]", "no such instrument (found: wire)"),
        ("[fixed, drawn]", "[fixed, random]", "vary.errors[1]", "allowed: fixed, drawn"),
        ("{test_poses: 50}", "{test_poses: 0}", "judge.test_poses", "must be at least 1"),
        ("{test_poses: 50}", "{tolerance: 0.1, share: 1}", "judge.share", "must be less than 1"),
        ("{test_poses: 50}", "{of: p99}", "judge.of", "allowed: mean, rms, p95, max"),
        ("{noise: known}", "{noise: guessed}", "identification.noise", "allowed: known, estimated"),
        ("simulated_arm.yaml", "no_arm.yaml", "experiment", "the experiment is not there"),
        ("simulated_arm.yaml", "study_poses.yaml", "experiment", "this is a study itself"),
        ("simulated_arm.yaml", "robots/handling_robot.yaml", None, "this is a robot file"),
        ("simulated_arm.yaml", "plan_fr3.yaml", "experiment", "a study repeats an experiment on simulated data"),
    ],
)
def test_each_slip_is_one_error_at_its_place(tmp_path, old, new, key, words):
    path = write_study(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError) as caught:
        run_study(path, tmp_path / "out", execution=Execution(1))
    assert words in str(caught.value)
    if key is not None:
        assert caught.value.key == key
        assert caught.value.file == path
        assert key.split(".")[0].split("[")[0] in path.read_text().splitlines()[caught.value.line - 1]
    assert not (tmp_path / "out").exists()


def test_a_plan_file_must_have_the_poses(tmp_path):
    plan = CONFIGS / "plans/handling_robot_40.csv"
    path = write_study(tmp_path, vary=f"{{plan: {plan}, poses: [30, 50]}}")
    with pytest.raises(InputError, match="the plan has 40 poses"):
        load_study(path)
    study = load_study(write_study(tmp_path, vary=f"{{plan: [{plan}, random], poses: [30, 40]}}"))
    assert [(cell.poses_of, cell.poses) for cell in study.description.cells] == [
        (0, 30),
        (0, 40),
        (None, 30),
        (None, 40),
    ]
    assert [len(plan) for plan in study.description.plans] == [40]


def test_extensions_are_not_repeated(tmp_path):
    text = (CONFIGS / "simulated_arm.yaml").read_text().replace("robots/", f"{CONFIGS}/robots/")
    (tmp_path / "arm.yaml").write_text(text + "identification: {extend: auto}\n")
    with pytest.raises(InputError, match=r"identification\.extend"):
        load_study(write_study(tmp_path, experiment=tmp_path / "arm.yaml"))


def test_where_nothing_says_where_the_world_is(tmp_path):
    with pytest.raises((InputError, RefusedError), match="wire"):
        load_study(write_study(tmp_path, vary="{instruments: [[wire]]}", experiment=CONFIGS / "tracker_and_wire.yaml"))


def test_an_outside_experiment_names_the_study(symcal, tmp_path):
    code, _, err = symcal("run", write_study(tmp_path))
    assert code == 1
    assert "'symcal study' runs it" in err
    code, _, err = symcal("study", CONFIGS / "simulated_arm.yaml")
    assert code == 1
    assert "this is an experiment: a study ('kind: study')" in err


def test_the_command_answers(symcal, tmp_path):
    path = write_study(tmp_path, 60, "{poses: [15, 30], noise: {position: 0.05}}", "{test_poses: 80, tolerance: 0.08}")
    path.write_text(path.read_text().replace("outputs: {report: false, figures: false}\n", ""))
    code, out, err = symcal("study", path, "--workers", "1", "--out", "answered")
    assert (code, err) == (0, "")
    assert "poses are enough for 0.08 mm" in out
    assert "identified at once" in out
    assert "written to answered" in out
    names = {p.name for p in (tmp_path / "answered/figures").iterdir()}
    assert {f"{stem}.{kind}" for stem in ("errors", "need", "coverage") for kind in ("pdf", "png")} == names
    text = " ".join(page.extract_text() for page in pypdf.PdfReader(tmp_path / "answered/report.pdf").pages)
    content = json.loads((tmp_path / "answered/results.json").read_text())
    assert content["answers"][0]["text"].split(":")[0] in text.replace("\n", " ")
    assert "SeedSequence(5, spawn_key=(t,))" in text
    assert content["machine"]["processor"] in text


def test_numbers_only(symcal, tmp_path):
    code, _, _ = symcal("study", write_study(tmp_path, 3), "--no-report", "--quiet", "--workers", "1", "--out", "run")
    assert code == 0
    assert not (tmp_path / "run/figures").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--workers", "2", "--scheduler", "tcp://127.0.0.1:1"), "leave one of the two out"),
        (("--set", "repetitions"), "expected key.path=value"),
        (("--set", "repetitions=none"), "--set repetitions"),
    ],
)
def test_the_command_refuses_in_one_line(symcal, tmp_path, arguments, words):
    code, out, err = symcal("study", write_study(tmp_path), *arguments)
    assert (code, out) == (1, "")
    assert words in err
    assert err.count("\n") == 1


def test_check_and_schema(symcal, tmp_path):
    lines = check_study(write_study(tmp_path))
    assert lines[0].startswith("small: 160 trials, 40 of each of 4 cells")
    assert "identified at once" in lines[-1]
    code, out, _ = symcal("check", write_study(tmp_path, identification="{noise: estimated}"))
    assert code == 0
    assert "one by one, because the noise is estimated" in out
    code, out, _ = symcal("schema", "study")
    assert code == 0
    assert "repetitions" in json.loads(out)["properties"]


@pytest.mark.parametrize("name", ["study_simulation_2.yaml", "study_poses.yaml"])
def test_shipped_studies_load(name):
    study = load_study(CONFIGS / name)
    assert study.description.trials >= 10_000
