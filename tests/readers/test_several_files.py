"""Several files of one instrument, and files whose delimiter and decimal sign are found out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sheet_files import write_excel

import symcal as sc
from symcal.data.layout import Layout
from symcal.documents.csv_file import read_table

Call = Callable[..., tuple[int, str, str]]
HEAD = "pose,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg,x_mm,y_mm,z_mm"
EXPERIMENT = """schema: symcal/experiment/1
name: several
robot: {robot}
units: {{length: mm, angle: deg}}
base: unknown
measurements:
  tracker:
    instrument: position
    at: {{on: world{place}}}
    data: {{source: file, file: {file}{more}}}
"""


@pytest.fixture
def arm(configs: Path) -> sc.Robot:
    return sc.load_robot(configs / "robots" / "handling_robot.yaml")


def days(folder: Path, arm: sc.Robot, count: int = 3, poses: int = 12, shifted: int = 0) -> sc.Dataset:
    """Files of one tracker, a day each, with poses called alike; readings may stand rows above their measurements."""
    rng = np.random.default_rng(8)
    model = sc.build_model(arm, sc.Task.of("position", {"base"}))
    q = rng.uniform(arm.lower, arm.upper, (count * poses, arm.dof))
    data = sc.simulate(model, {"theta_4": 0.002, "base_x": 30.0}, q, sc.Noise(position=0.02), rng)
    read = np.column_stack([np.where([j.revolute for j in arm.joints], np.rad2deg(q), q), data.z])
    for day in range(count):
        own = read[day * poses : (day + 1) * poses]
        if shifted:
            own = np.hstack([own[shifted:, : arm.dof], own[:-shifted, arm.dof :]])
        lines = [",".join([str(i), *map(repr, row)]) for i, row in enumerate(own.tolist())]
        (folder / f"day{day}.csv").write_text("\n".join([HEAD, *lines]) + "\n")
    return data


def test_files_are_one_set_and_labels_say_the_file(tmp_path: Path, arm: sc.Robot) -> None:
    whole = days(tmp_path, arm)
    found = sc.load_measurements([tmp_path / f"day{i}.csv" for i in range(3)], arm, "position")
    np.testing.assert_allclose(found.q, whole.q, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.z, whole.z)
    assert found.labels[:2] == ("day0/0", "day0/1")
    assert found.labels[-1] == "day2/11"


def test_poses_without_names_are_called_by_file_and_number(tmp_path: Path, arm: sc.Robot) -> None:
    days(tmp_path, arm, count=2, poses=3)
    paths = [tmp_path / f"day{i}.csv" for i in range(2)]
    for path in paths:
        path.write_text("\n".join(line.split(",", 1)[1] for line in path.read_text().splitlines()))
    found = sc.load_measurements(paths, arm, "position")
    assert found.labels == ("day0/0", "day0/1", "day0/2", "day1/0", "day1/1", "day1/2")


def test_a_pattern_identifies_as_the_whole_does(tmp_path: Path, arm: sc.Robot, configs: Path, symcal: Call) -> None:
    days(tmp_path, arm)
    lines = [(tmp_path / f"day{i}.csv").read_text().splitlines()[1:] for i in range(3)]
    own = [f"{i}-{line}" for i, day in enumerate(lines) for line in day]
    (tmp_path / "whole.txt").write_text("\n".join([HEAD, *own]))
    robot, records = configs / "robots" / "handling_robot.yaml", []
    for name, file in (("several", "'day*.csv'"), ("whole", "whole.txt")):
        path = tmp_path / f"{name}.yaml"
        path.write_text(EXPERIMENT.format(robot=robot, file=file, more="", place=""))
        code, _, err = symcal("identify", path, "--no-report", "--out", tmp_path / name)
        assert code == 0, err
        records.append(sc.load_robot(tmp_path / name / "calibrated.yaml").record)
    assert records[0].errors == records[1].errors
    assert set(map(str, records[0].provenance["inputs"])) >= {"day0.csv", "day1.csv", "day2.csv"}


@pytest.mark.long
def test_every_file_may_be_a_session_with_a_place_of_its_own(
    tmp_path: Path, arm: sc.Robot, configs: Path, symcal: Call
) -> None:
    days(tmp_path, arm)
    path = tmp_path / "sessions.yaml"
    text = EXPERIMENT.format(
        robot=configs / "robots" / "handling_robot.yaml",
        file="[day0.csv, day1.csv, day2.csv]",
        more=", session: file",
        place=", place: unknown, per: session",
    )
    path.write_text(text.replace("base: unknown", "base: known"))
    code, _, err = symcal("identify", path, "--no-report", "--out", tmp_path / "run")
    assert code == 0, err
    errors = sc.load_robot(tmp_path / "run" / "calibrated.yaml").record.provenance["measurements"]
    assert list(errors) == ["tracker_day0", "tracker_day1", "tracker_day2"]
    code, _, err = symcal("validate", tmp_path / "run" / "calibrated.yaml", "--data", tmp_path / "day1.csv")
    assert code == 0, err


@pytest.mark.parametrize("shifted", [0, 1])
def test_rows_shifted_in_every_file_are_found(tmp_path: Path, arm: sc.Robot, shifted: int) -> None:
    from symcal.calibration.mistakes.search import find_mistakes

    days(tmp_path, arm, shifted=shifted)
    data = sc.load_measurements([tmp_path / f"day{i}.csv" for i in range(3)], arm, "position")
    found = find_mistakes(sc.build_model(arm, sc.Task.of("position", {"base"})), data)
    assert [each.kind for each in found] == ["row shift"] * bool(shifted)


def test_files_that_do_not_go_together_are_named(tmp_path: Path, arm: sc.Robot) -> None:
    days(tmp_path, arm, count=2, poses=3)
    first, second = (tmp_path / f"day{i}.csv" for i in range(2))
    second.write_text(first.read_text())
    with pytest.raises(sc.InputError, match=r"the same as day0\.csv"):
        sc.load_measurements([first, second], arm, "position")
    second.write_text(first.read_text().replace("pose,", "shot,"))
    with pytest.raises(sc.InputError, match=r"this column is not in day1\.csv, and in day0\.csv") as error:
        sc.load_measurements([first, second], arm, "position")
    assert error.value.column == "pose"
    second.write_text(first.read_text().replace("2,", "2x,", 1).replace("\n1,", "\n1,x"))
    with pytest.raises(sc.InputError, match="not a finite number") as error:
        sc.load_measurements([first, second], arm, "position")
    assert error.value.file == second
    sheet = write_excel(tmp_path / "day1.xlsx", {"S": [HEAD.split(","), [0, *[1.0] * 7, "x"]]})
    with pytest.raises(sc.InputError, match="not a finite number") as error:
        sc.load_measurements([first, sheet], arm, "position")
    assert (error.value.file, error.value.line, error.value.part) == (sheet, 2, "sheet 'S'")


@pytest.mark.parametrize(
    ("file", "more", "message"),
    [
        ("'night*.csv'", "", "no file of measurements is like this pattern"),
        ("[day0.csv, day0.csv]", "", "this file stands here twice"),
        ("[day0.csv, night.csv]", "", "the file of measurements is not there"),
        ("day0.csv", ", sheet: A", "'sheet' names one of an Excel or ODS file"),
        ("book.xlsx", ", decimal: ','", "a sheet has cells and numbers"),
    ],
)
def test_what_an_experiment_says_of_its_files_is_checked(
    tmp_path: Path, arm: sc.Robot, configs: Path, symcal: Call, file: str, more: str, message: str
) -> None:
    days(tmp_path, arm, count=1, poses=3)
    write_excel(tmp_path / "book.xlsx", {"S": [["pose"], [1]]})
    path = tmp_path / "experiment.yaml"
    robot = configs / "robots" / "handling_robot.yaml"
    path.write_text(EXPERIMENT.format(robot=robot, file=file, more=more, place=""))
    code, _, err = symcal("identify", path, "--no-report", "--out", tmp_path / "run")
    assert code == 1
    assert message in " ".join(err.split())


# --------------------------------------------------------------------------------------------- delimiter, decimal sign


def test_semicolons_and_decimal_commas_are_found_and_said(tmp_path: Path, arm: sc.Robot) -> None:
    data = days(tmp_path, arm, count=1)
    path = tmp_path / "day0.csv"
    path.write_text(path.read_text().replace(",", ";").replace(".", ","))
    found = sc.load_measurements(path, arm, "position")
    np.testing.assert_array_equal(found.z, data.z)
    assert found.notes[0] == "the cells of the file are separated by ';', as its header says"
    assert "numbers of the file have decimal commas" in found.notes[1]
    again = sc.load_measurements(path, arm, "position", delimiter=";", decimal=",")
    assert again.notes == ()


@pytest.mark.parametrize(
    ("rows", "message", "column", "found"),
    [
        (["1,234;5", "2,345;6"], "may be a decimal comma or part thousands", "q1_deg", "1,234"),
        (["1,2;5", "2;6.5"], "some numbers have a decimal comma and others a point", "q1_deg", "1,2"),
    ],
)
def test_numbers_that_can_be_read_in_two_ways_are_refused(
    tmp_path: Path, rows: list[str], message: str, column: str, found: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["q1_deg;x_mm", *rows]))
    with pytest.raises(sc.InputError, match=message) as error:
        Layout().table(path)
    assert (error.value.column, error.value.found, error.value.allowed) == (column, found, ("','", "'.'"))
    assert "say \"decimal: ','\" or \"decimal: '.'\"" in str(error.value)
    assert Layout(decimal=",").table(path).decimal == ","


@pytest.mark.parametrize("cell", ["0,234", "1234,567", "1,23", "-,5", "1,2345", "2,500e-3"])
def test_one_comma_that_cannot_part_thousands_tells(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"pose;q1_deg\n1.1;1,234\n1.2;{cell}\n")
    table = read_table(path, decimal=None)
    assert table.decimal == ","
    np.testing.assert_array_equal(table.numbers("q1_deg"), [1.234, float(cell.replace(",", "."))])


def test_a_comma_in_a_remark_is_none(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text('pose,remark,q1_deg\n1,"1,5",2.5\n')
    assert read_table(path, decimal=None).decimal == "."


def test_a_header_that_can_be_taken_apart_in_two_ways_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b;c\n1,2;3\n")
    with pytest.raises(sc.InputError, match="taken apart in two ways") as error:
        read_table(path)
    assert error.value.allowed == ("','", "';'")
    assert read_table(path, delimiter=";").columns == ("a,b", "c")
