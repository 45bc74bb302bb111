"""Commands and files that are not theirs: inputs, neighbours of an output; and standard output that fails."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from measured_arms import measure, write_experiment
from test_cli_handover import calibrated

from symcal.cli.stdout import NamedStdout, ReaderGone, StdoutError
from symcal.config.conversion import load_experiment, named_paths
from symcal.errors import InputError, RefusedError
from symcal.export import export_robot
from symcal.robot.files import save_robot
from symcal.runs import camera, experiment, plan
from symcal.runs.folder import run_folder
from symcal.runs.plan import run_plan
from symcal.runs.run import run
from symcal.runs.validate import validate_robot


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    return write_experiment(measure("puma", "standard", np.random.default_rng(5), 25, 10), tmp_path, "long")


@pytest.fixture(autouse=True)
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is refused is refused before the work begins."""

    def began(*_: object, **__: object) -> None:
        pytest.fail("the work had begun")

    monkeypatch.setattr(experiment, "measurements", began)
    monkeypatch.setattr(plan, "find", began)
    monkeypatch.setattr(camera, "detect_boards", began)
    monkeypatch.setattr(camera, "load_corners", began)


def made_by_a_run(folder: Path, name: str, content: bytes) -> Path:
    """A file that a run's manifest lists: still it is not written over where it is read."""
    with run_folder(folder) as fresh:
        (fresh / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize("name", ["data.csv", "robot.yaml", "experiment.yaml"])
def test_no_input_of_a_run_is_written_over(arm: Path, tmp_path: Path, name: str) -> None:
    inside = made_by_a_run(tmp_path / "s4", name, (tmp_path / name).read_bytes())
    before = inside.read_bytes()
    if name == "experiment.yaml":
        (tmp_path / "s4" / name).write_bytes(before)
        words = {"path": inside, "overrides": ("robot=../robot.yaml", "data.file=../data.csv")}
    elif name == "data.csv":
        words = {"path": arm, "data": inside}
    else:
        words = {"path": arm, "overrides": ("robot=s4/robot.yaml",)}
    for command in (run, lambda path, out, **more: run_plan(path, out, overrides=more.get("overrides", ()))):
        if command is not run and name == "data.csv":
            continue  # a plan has no --data
        with pytest.raises(RefusedError, match=rf"{name} is read by this run and lies in .*s4"):
            command(out=tmp_path / "s4", **words)
    with pytest.raises(RefusedError, match=rf"{name} is read by this run"):
        validate_robot(inside, tmp_path / "new.csv", tmp_path / "s4")
    assert inside.read_bytes() == before


def test_every_file_that_an_experiment_names_is_an_input(arm: Path, tmp_path: Path) -> None:
    """Images as a folder and as files, joints, cameras, targets; not what an unset variable hides."""
    overrides = (
        "data={source: images, files: [s4, more/1.png], joints: j.csv}",
        "plan.candidates=poses.csv",
        "plan.required=$NOWHERE_AT_ALL/r.csv",
        "measurement={type: pixels, camera: c.yaml, target: t.yaml}",
    )
    found = {path.relative_to(tmp_path.resolve()).as_posix() for path in named_paths(*load_experiment(arm, overrides))}
    assert found == {"robot.yaml", "s4", "more/1.png", "j.csv", "poses.csv", "c.yaml", "t.yaml"}


def test_a_plan_does_not_begin_where_it_cannot_end(arm: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("mine")
    with pytest.raises(RefusedError, match=r"chapter\.tex"):
        run_plan(arm, tmp_path / "thesis")


@pytest.mark.parametrize(("to", "name"), [("urdf", "robot.urdf"), ("json", "robot.json"), ("json", "corrections.csv")])
def test_an_export_replaces_exports_alone(tmp_path: Path, to: str, name: str) -> None:
    export_robot(calibrated(), to, tmp_path, force=True)
    export_robot(calibrated(), to, tmp_path, force=True)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    (tmp_path / name).write_text("the maker's own")
    with pytest.raises(RefusedError, match=f"{name} is there already"):
        export_robot(calibrated(), to, tmp_path, force=True)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before | {name: b"the maker's own"}


def test_the_data_sheet_of_a_camera_is_kept(tmp_path: Path) -> None:
    (tmp_path / "camera.pdf").write_bytes(b"%PDF-1.4 of the maker")
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((8, 8), np.uint8))
    from symcal.camera.board import parse_board

    board = parse_board("chessboard:9x6:25mm")
    with pytest.raises(RefusedError, match=r"camera\.pdf is there already"):
        camera.calibrate_from_images([tmp_path / "0.png"], board, tmp_path / "camera.yaml")
    with pytest.raises(RefusedError, match=r"camera\.pdf is there already"):
        camera.calibrate_from_corners(tmp_path / "c.csv", (640, 480), tmp_path / "camera.yaml")
    with pytest.raises(InputError, match="its page takes this name"):
        camera.calibrate_from_corners(tmp_path / "c.csv", (640, 480), tmp_path / "other.pdf")
    assert (tmp_path / "camera.pdf").read_bytes() == b"%PDF-1.4 of the maker"


def symcal(*words: object, **streams: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "symcal.cli", *map(str, words)]
    return subprocess.run(command, check=False, text=True, stderr=subprocess.PIPE, **streams)  # type: ignore[call-overload,no-any-return]


def test_single_outputs_are_not_written_over_what_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from symcal.cli import main

    save_robot(calibrated(), tmp_path / "calibrated.yaml")
    (tmp_path / "targets.csv").write_text("q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\n0,900,100,90,0\n")
    (tmp_path / "robot.urdf").write_text("<robot/>")
    monkeypatch.chdir(tmp_path)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    for words in (
        ("compensate", "calibrated.yaml", "--targets", "targets.csv", "--out", "targets.csv"),
        ("compensate", "calibrated.yaml", "--targets", "targets.csv", "--out", "./calibrated.yaml"),
        ("import", "robot.urdf", "--base", "a", "--tip", "b", "--out", "robot.urdf"),
        ("camera", "--points", "targets.csv", "--size", "9x9", "--out", "targets.csv"),
        (
            *[
                "measure",
                "a.png",
                "--camera",
                "c.yaml",
                "--joints",
                "targets.csv",
                "--robot",
                "r.yaml",
                "--out",
                "targets.csv",
            ],
        ),
    ):
        monkeypatch.setattr(sys, "argv", ["symcal", *words])
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == 1
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_file_with_a_default_name_is_replaced_only_if_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from symcal.cli import main

    monkeypatch.chdir(tmp_path)
    save_robot(calibrated(), tmp_path / "calibrated.yaml")
    (tmp_path / "targets.csv").write_text("q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\n0,900,100,90,0\n")
    commands = {
        "joints.csv": "compensate calibrated.yaml --targets targets.csv",
        "board.pdf": "board chessboard:9x6:25mm",
        "robot.yaml": "import robot.urdf --base a --tip b",
        "camera.yaml": "camera --points points.csv --size 9x9",
        "measurements.csv": "measure a.png --camera c.yaml --joints j.csv --robot r.yaml --target t.yaml",
    }
    for name, words in commands.items():
        (tmp_path / name).write_text("mine")
        monkeypatch.setattr(sys, "argv", ["symcal", *words.split()])
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == 1
        assert f"{name} is there already and is kept: '--out {name}' replaces it" in capsys.readouterr().err
        assert (tmp_path / name).read_text() == "mine"
    for name in ("joints.csv", "board.pdf"):
        monkeypatch.setattr(sys, "argv", ["symcal", *commands[name].split(), "--out", name, "--quiet"])
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == 0
        assert (tmp_path / name).read_bytes() != b"mine"


# ------------------------------------------------------------------------------------------------- standard output


@pytest.fixture
def full() -> Iterator[object]:
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    stream = Path("/dev/full").open("w")  # noqa: SIM115  # closing it fails where something was not written
    yield stream
    with contextlib.suppress(OSError):
        stream.close()


def test_a_full_standard_output_is_one_sentence(full: object) -> None:
    done = symcal("schema", "robot", stdout=full)
    assert done.returncode == 1
    assert done.stderr == (
        "symcal: standard output cannot be written: No space left on device; what went to files is there\n"
    )


def test_a_reader_that_is_gone_is_no_error_to_speak_of() -> None:
    """As `| head -1`, which closes the pipe before all of it is written."""
    process = subprocess.Popen(
        [sys.executable, "-m", "symcal.cli", "schema"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr as errors:
        assert errors.read() == b""
    assert process.wait() in (0, 1)


def test_each_failure_of_standard_output_has_its_name(full: object) -> None:
    named = NamedStdout(full)  # type: ignore[arg-type]
    named.write("x")
    with pytest.raises(StdoutError, match="No space left"):
        named.flush()
    read, write = os.pipe()
    os.close(read)
    with open(write, "w") as pipe:  # noqa: PTH123
        named = NamedStdout(pipe)
        named.write("x")
        with pytest.raises(ReaderGone):
            named.flush()
        named.write("goes nowhere")
