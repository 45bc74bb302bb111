"""CSV files as strangers write them: what is read, and what each slip is answered with."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symcal.documents import csv_file
from symcal.documents.csv_file import read_table
from symcal.documents.table import LARGEST, Table, joint_readings
from symcal.errors import InputError
from symcal.units import LENGTH

GOOD = "pose,q1_deg,q2_mm,x_m\nA,90,10,0.001\nB,-45.5,1e1,2\n"


@pytest.fixture
def write(tmp_path):
    def to_file(text: str | bytes) -> Path:
        path = tmp_path / "data.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return to_file


def values(table: Table) -> tuple[np.ndarray, np.ndarray]:
    return joint_readings(table, [("turn", True), ("lift", False)]), table.quantity("x", LENGTH, "the measured x")


def check_good(table: Table) -> None:
    assert table.columns == ("pose", "q1_deg", "q2_mm", "x_m")
    assert table.text("pose") == ["A", "B"]
    q, x = values(table)
    np.testing.assert_allclose(q, [[math.pi / 2, 10], [math.radians(-45.5), 10]])
    np.testing.assert_array_equal(x, [1.0, 2000.0])


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        b"\xef\xbb\xbf" + GOOD.encode(),
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        GOOD.rstrip("\n"),
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", ", "),
        "# exported today\n\n" + GOOD + "\n# end\n",
        GOOD.replace("\n", ",,\n"),  # what spreadsheets leave of empty columns
        GOOD + ",,,\n,,,\n",  # and of empty rows
        "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in GOOD.splitlines()),
    ],
)
def test_layouts_of_the_same_table(write, text):
    check_good(read_table(write(text)))


@pytest.mark.parametrize("piece", [30, 31, 32, 33, 34, 50, 10_000])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_table_is_the_same_in_pieces_of_any_size(write, piece, end):
    rows = [
        "\ufeffpose,q1_deg,q2_mm,x_m",
        "# Grüße",
        'A,1,2.5,"3"',
        "",
        " B , -1e1 ,+.5,7.",
        ",,,",
        "Ü,0,0,1",
        "#D,1,2,3",
    ]
    found = read_table(write(end.join(rows) + end), piece=piece)
    assert found.text("pose") == ["A", "B", "Ü"]
    assert list(found.lines) == [3, 5, 7]
    assert found.hidden == 1
    numbers = np.column_stack([found.numbers(c) for c in ("q1_deg", "q2_mm", "x_m")])
    np.testing.assert_array_equal(numbers, [[1, 2.5, 3], [-10, 0.5, 7], [0, 0, 1]])
    assert found.where({"pose": "B"}).text("x_m") == ["7."]
    assert list(found.where({"pose": "B"}).lines) == [5]
    assert found.with_compound("name", ("pose", "x_m")).text("name") == ["A/3", "B/7.", "Ü/1"]


@pytest.mark.parametrize(
    ("row", "line", "words"),
    [
        (b"A,1", 6, "this row has 2 cells, the header 4"),
        (b'A,1,"2,3', 6, "not a line of a CSV file"),
        (b"A,1,\x01,3", 6, "a control character"),
        (b"A,1,2-3,3", 6, "not a finite number"),
        (b"A,1,,3", 6, "an empty cell"),
        (b"A,1,\xff,3", None, "byte 0xff in position 86"),
        (b"A,1,2," + b"3" * 100, None, "a line of more than 40 bytes"),
    ],
)
def test_a_slip_in_a_later_piece_is_named_at_its_place(write, row, line, words):
    good = b"pose,q1_deg,q2_mm,x_m\n" + b"A,1.25,100.5,0\n" * 4
    with pytest.raises(InputError, match=words) as caught:
        values(read_table(write(good + row + b"\nA,1,2,3\n"), piece=40))
    assert caught.value.line == line


def test_a_table_has_a_largest_size(write, monkeypatch):
    path = write("x_mm,y_mm\n" + "1,2\n" * 10)
    monkeypatch.setattr(csv_file, "_MOST_CELLS", 20)
    assert len(read_table(path)) == 10
    monkeypatch.setattr(csv_file, "_MOST_CELLS", 19)
    with pytest.raises(InputError, match="10 rows or more, of 2 cells each; at most 10000000 rows and 19 cells"):
        read_table(path)
    monkeypatch.setattr(csv_file, "_MOST_ROWS", 9)
    with pytest.raises(InputError, match="at most 9 rows"):
        read_table(path)


def test_decimal_commas_are_read_when_said(write):
    check_good(read_table(write(GOOD.replace(",", ";").replace(".", ",")), decimal=","))


def test_other_names_are_mapped(write):
    check_good(read_table(write(GOOD.replace("q1_deg", "J1 [deg]")), {"q1_deg": "J1 [deg]"}))


def refused(path: Path, **options) -> InputError:
    with pytest.raises(InputError) as caught:
        values(read_table(path, **options))
    assert caught.value.file == path
    return caught.value


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("A,90", "A,nan", 2, "column 'q1_deg': not a finite number"),
        ("A,90", "A,inf", 2, "not a finite number"),
        ("A,90", "A,1e999", 2, "not a finite number"),
        ("A,90", "A,9_0", 2, "not a finite number"),
        ("A,90", "A,٩٠", 2, "not a finite number"),
        ("A,90", "A,ninety", 2, "found: ninety"),
        ("A,90", "A,", 2, "an empty cell"),
        ("B,-45.5,1e1,2", "B,-45.5,1e1", 3, "this row has 3 cells, the header 4"),
        ("B,-45.5,1e1,2", "B,-45.5,1e1,2,3", 3, "this row has 5 cells"),
        ("q2_mm", "q1_deg", 1, "two columns have this name (found: q1_deg)"),
        ("q2_mm", "q1_rad", 1, "'q1_deg' and 'q1_rad' are the same quantity twice"),
        ("q2_mm", "", 1, "a column without a name"),
        ("q1_deg", "q1", 1, "column 'q1': the column of joint 1"),
        ("q1_deg", "q1_mm", 1, "has the unit 'mm'"),
        ("x_m", "x_MM", 1, "is it 'x_MM'?"),
        ("x_m", "x_km", 1, "is it 'x_km'?"),
        ("x_m", "abc", 1, "expected 'x_<unit>' with a unit of mm, m, um, cm, in (found: pose, q1_deg, q2_mm, abc)"),
        ("q2_mm", "lft_mm", 1, "expected 'lift_<unit>' or 'q2_<unit>'"),
        ("q2_mm", "lft_mm", 1, "is it 'lft_mm'?"),
        ("x_m\n", "x_m,lift_mm\n", 2, "this row has 4 cells"),
        ("B,", '"B,', 3, "not a line of a CSV file"),
    ],
)
def test_each_slip_is_one_error_at_its_place(write, old, new, line, words):
    assert old in GOOD
    error = refused(write(GOOD.replace(old, new, 1)))
    assert error.line == line
    assert words in str(error)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the file is empty"),
        ("# nothing\n\n", "the file is empty"),
        ("1,2,3\n4,5,6\n", "the first line must name the columns"),
        (bytes(range(256)), "cannot be read as UTF-8 text"),
        (GOOD.encode("utf-16"), "cannot be read as UTF-8 text"),
        (b"\x89PNG\r\n\x1a\n", "cannot be read as UTF-8 text"),
        (GOOD.replace(",", "|"), "there is no column for joint 1"),
        (GOOD.replace(",", ";").replace(".", ","), "a decimal comma: say"),
    ],
)
def test_what_is_not_such_a_table(write, text, words):
    assert words in str(refused(write(text)))


def test_a_missing_file_and_a_folder(tmp_path):
    assert "there is no such file" in str(refused(tmp_path / "nothing.csv"))
    assert "this is a folder" in str(refused(tmp_path))


def test_all_bad_lines_of_a_column_are_named(write):
    text = "x_mm\n" + "1\n?\n" * 8
    with pytest.raises(InputError) as caught:
        read_table(write(text)).numbers("x_mm")
    assert caught.value.line == 3
    assert "(also in line 5, 7, 9, 11, ...)" in str(caught.value)


def test_a_comma_file_may_not_hold_points(write):
    error = refused(write(GOOD.replace(",", ";")), decimal=",")
    assert (error.line, error.found) == (3, "-45.5")


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"q1_deg": "J1"}, "maps 'q1_deg' to a column that the file does not have (found: J1)"),
        ({"q1_deg": "q2_mm"}, "gives this name to a column, and another has it"),
    ],
)
def test_maps_that_do_not_fit(write, columns, words):
    assert words in str(refused(write(GOOD), columns=columns))


def test_a_joint_is_not_read_from_a_measured_column_of_its_name(write):
    gantry = [("x", False), ("y", False)]
    both = read_table(write("q1_mm,q2_mm,x_mm,y_mm\n1,2,3,4\n"))
    np.testing.assert_array_equal(joint_readings(both, gantry, ("x", "y", "z")), [[1, 2]])
    only = read_table(write("x_mm,y_mm\n3,4\n"))
    np.testing.assert_array_equal(joint_readings(only, gantry), [[3, 4]])
    with pytest.raises(InputError, match="whose name is also that of a measured 'x': expected 'q1_<unit>'"):
        joint_readings(only, gantry, ("x", "y", "z"))


def test_a_joint_given_twice_is_refused(write):
    table = read_table(write("q1_deg,waist_rad\n1,2\n"))
    with pytest.raises(InputError, match="has two columns, 'q1_deg' and 'waist_rad': keep one"):
        joint_readings(table, [("waist", True)])


def test_rows_that_are_commented_out_are_counted(write):
    assert read_table(write("# a note, with a comma\n" + GOOD.replace("A,", "#A,"))).hidden == 1


@given(st.lists(st.floats(-LARGEST, LARGEST), min_size=1, max_size=20))
def test_every_float_is_read_as_it_was_written(tmp_path, values):
    path = tmp_path / "numbers.csv"
    path.write_text("x_mm\n" + "\n".join(map(repr, values)), encoding="utf-8")
    np.testing.assert_array_equal(read_table(path).numbers("x_mm"), values)
