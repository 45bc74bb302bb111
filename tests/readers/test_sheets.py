"""Excel and ODS sheets hold what their CSV twins hold, and what is wrong in a cell is said with its place."""

from __future__ import annotations

import csv
import datetime
import json
import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from sheet_files import write_excel, write_ods

import symcal as sc
from symcal.documents.csv_file import read_table
from symcal.readers.sheets import read_sheet

Rows = list[list[str | float | int | None]]
HEAD = ["pose", *(f"q{i}_deg" for i in range(1, 7)), "x_mm", "y_mm", "z_mm", "remark"]
EXPERIMENT = """schema: symcal/experiment/1
name: sheets
robot: robot.yaml
units: {{length: mm, angle: deg}}
measurement: {{type: position, points: {{P: [10, 20, 100]}}, estimate: [base]}}
data: {{source: file, file: {file}, split: {{test_fraction: 0.2}}}}
"""


@pytest.fixture(scope="module")
def rows() -> Rows:
    """A thousand poses of a UR5e, with the fifteen digits that a spreadsheet keeps."""
    rng = np.random.default_rng(5)
    robot = sc.load_robot(Path(sc.__file__).parent / "robot" / "arms" / "ur5e.yaml")
    q = rng.uniform(-2, 2, (1000, 6))
    model = sc.build_model(robot, sc.Task.of("position", {"base"}, {"P": (10.0, 20.0, 100.0)}))
    truth = {"theta_2": 0.003, "a_3": 0.4, "alpha_4": -0.002, "base_x": 500.0}
    z = sc.simulate(model, truth, q, sc.Noise(position=0.03), rng).z
    numbers = [[float(f"{cell:.15g}") for cell in row] for row in np.hstack([np.rad2deg(q), z]).tolist()]
    return [[i, *row, f"shot {i}"] for i, row in enumerate(numbers)]


def write_csv(path: Path, rows: Rows) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([HEAD, *rows])
    return path


@pytest.mark.parametrize("write", [write_excel, write_ods], ids=["xlsx", "ods"])
def test_a_sheet_has_the_numbers_of_its_csv_twin(
    rows: Rows, tmp_path: Path, write: Callable[..., Path], request: pytest.FixtureRequest
) -> None:
    end = request.node.callspec.id
    sheet = read_sheet(write(tmp_path / f"data.{end}", {"Data": [HEAD, *rows], "Blank": []}))
    table = read_table(write_csv(tmp_path / "data.csv", rows))
    assert sheet.columns == table.columns
    assert list(sheet.lines) == list(table.lines)
    for column in HEAD[1:-1]:
        np.testing.assert_array_equal(sheet.numbers(column), table.numbers(column))
    assert sheet.text("pose") == table.text("pose")
    assert sheet.text("remark") == table.text("remark")


def test_sheets_identify_as_their_csv_twin(
    rows: Rows, tmp_path: Path, symcal: Callable[..., tuple[int, str, str]]
) -> None:
    robot = Path(sc.__file__).parent / "robot" / "arms" / "ur5e.yaml"
    (tmp_path / "robot.yaml").write_text(robot.read_text())
    write_csv(tmp_path / "data.csv", rows)
    write_excel(tmp_path / "data.xlsx", {"Notes": [["by", "hand"]], "Data": [HEAD, *rows]})
    write_ods(tmp_path / "data.ods", {"Data": [HEAD, *rows]})
    found = {}
    for name, file in (("csv", "data.csv"), ("xlsx", "data.xlsx, sheet: Data"), ("ods", "data.ods")):
        (tmp_path / f"{name}.yaml").write_text(EXPERIMENT.format(file=file))
        code, _, err = symcal("identify", tmp_path / f"{name}.yaml", "--no-report", "--out", tmp_path / name)
        assert code == 0, err
        found[name] = json.loads((tmp_path / name / "results.json").read_text())
    assert found["xlsx"]["accuracy"] == found["csv"]["accuracy"] == found["ods"]["accuracy"]
    assert "data.xlsx" in str(found["xlsx"]["inputs"])
    records = [sc.load_robot(tmp_path / name / "calibrated.yaml").record for name in ("csv", "xlsx", "ods")]
    assert records[0].errors == records[1].errors == records[2].errors
    # a sheet judges too, read by the names and the sheet that the calibration was read by
    code, _, err = symcal("validate", tmp_path / "xlsx" / "calibrated.yaml", "--data", tmp_path / "data.xlsx")
    assert code == 0, err
    for each in records[1:]:
        np.testing.assert_array_equal(each.covariance, records[0].covariance)


def test_rows_that_say_nothing_are_passed_over_and_numbers_stay_those_of_the_sheet(tmp_path: Path) -> None:
    path = write_excel(
        tmp_path / "a.xlsx",
        {"S": [[], ["pose", "q1_deg", None], ["# 0", 1.0, None], ["1", 2.5, None], [], ["2", "oops"], [None, None]]},
    )
    table = read_sheet(path)
    assert (table.head_line, list(table.lines), table.hidden) == (2, [4, 6], 1)
    with pytest.raises(sc.InputError, match="not a finite number") as error:
        table.numbers("q1_deg")
    assert (error.value.line, error.value.part, error.value.column) == (6, "sheet 'S'", "q1_deg")
    assert str(error.value).startswith(f"{path}:6: sheet 'S': column 'q1_deg': ")


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        (datetime.date(2026, 5, 1), "a date or a time where a number is needed"),
        (datetime.time(1, 5), "a date or a time where a number is needed"),
        (True, "true or false where a number is needed"),
        ("#DIV/0!", "an empty cell, or one whose formula has no value or an error"),
        (None, "an empty cell"),
        ("=1+1", "an empty cell, or one whose formula has no value"),
        ("1,5", "text with a decimal comma"),
        ("3 mm", "not a finite number"),
    ],
)
def test_a_cell_that_is_no_number_is_said_where_a_number_is_needed(
    tmp_path: Path, cell: str | datetime.date | None, message: str
) -> None:
    path = write_excel(tmp_path / "a.xlsx", {"S": [["pose", "q1_deg"], [1, 1.5], [2, cell]]})
    table = read_sheet(path)
    assert table.text("pose") == ["1", "2"]
    with pytest.raises(sc.InputError, match=message) as error:
        table.numbers("q1_deg")
    assert (error.value.line, error.value.column) == (3, "q1_deg")


def test_merged_cells_in_the_table_are_refused(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    for row in (["pose", "q1_deg", "x_mm"], [1, 2.0, 3.0], [None, 4.0, 5.0]):
        book.active.append(row)
    book.active.merge_cells("A2:A3")
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(sc.InputError, match="merged cells") as error:
        read_sheet(tmp_path / "a.xlsx")
    assert (error.value.line, error.value.found) == (2, "A2:A3")


@pytest.mark.parametrize("write", [write_excel, write_ods], ids=["xlsx", "ods"])
@pytest.mark.parametrize(
    ("sheets", "sheet", "message", "allowed"),
    [
        ({"A": [["pose"], [1]], "B": [["pose"], [1]]}, None, "several sheets: say which with 'sheet:'", ("A", "B")),
        ({"A": [["pose"], [1]]}, "C", "there is no such sheet", ("A",)),
        ({"A": []}, None, "no sheet of the file has a cell", ()),
        ({"A": []}, "A", "the sheet is empty", ()),
        ({"A": [["pose", "q1_deg", "q1_deg"], [1, 2, 3]]}, None, "two columns have this name", ()),
        ({"A": [["pose", None], [1, 2]]}, None, "a cell in column B, which has no name", ()),
        ({"A": [[1, 2], [3, 4]]}, None, "the first line must name the columns", ()),
    ],
)
def test_a_sheet_that_is_no_table_is_refused(
    tmp_path: Path,
    write: Callable[..., Path],
    sheets: dict[str, Rows],
    sheet: str | None,
    message: str,
    allowed: tuple[str, ...],
    request: pytest.FixtureRequest,
) -> None:
    end = "xlsx" if "xlsx" in request.node.callspec.id else "ods"
    with pytest.raises(sc.InputError, match=message) as error:
        read_sheet(write(tmp_path / f"a.{end}", sheets), sheet)
    assert error.value.allowed == allowed


def test_a_cell_far_out_does_not_take_all_memory(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active["A1"], book.active["XFD1048576"] = "pose", 1
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(sc.InputError, match="room for 17179869184 cells"):
        read_sheet(tmp_path / "a.xlsx")
    many = (
        '<table:table-row table:number-rows-repeated="1000000"><table:table-cell office:value-type="float" '
        'office:value="1" table:number-columns-repeated="16000"/></table:table-row>'
    )
    with pytest.raises(sc.InputError, match="room for"):
        read_sheet(write_ods(tmp_path / "a.ods", {"A": [["pose"], [1]]}, many))


def test_damaged_files_are_refused_in_one_sentence(tmp_path: Path) -> None:
    rng = random.Random(3)
    for end, write in (("xlsx", write_excel), ("ods", write_ods)):
        whole = write(tmp_path / f"a.{end}", {"A": [["pose", "q1_deg"], [1, 2.5]]}).read_bytes()
        spoilt = [b"", b"PK\x03\x04", rng.randbytes(300), b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + rng.randbytes(900)]
        spoilt += [whole[: rng.randrange(len(whole))] for _ in range(20)]
        for _ in range(40):
            content = bytearray(whole)
            for _ in range(5):
                content[rng.randrange(len(content))] = rng.randrange(256)
            spoilt.append(bytes(content))
        for n, content in enumerate(spoilt):
            path = tmp_path / f"{n}.{end}"
            path.write_bytes(content)
            with suppress(sc.InputError):
                read_sheet(path)
