"""YAML in and out: nothing runs, nothing is guessed, every mistake has its place."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from symcal.documents.document import Strict, dotted, read_document, validate, write_document
from symcal.documents.yaml_dialect import Dumper, parse_value, written
from symcal.errors import InputError, SymcalError


class Circle(Strict):
    kind: Literal["circle"]
    radius: float


class Square(Strict):
    kind: Literal["square"]
    side: Annotated[float, Field(gt=0)]


class Drawing(Strict):
    title: str
    copies: int = 1
    final: bool = False
    shapes: list[Annotated[Circle | Square, Field(discriminator="kind")]] = Field(default_factory=list)
    notes: dict[str, float] = Field(default_factory=dict)


GOOD = """\
title: a drawing
copies: 2
shapes:
  - {kind: circle, radius: 1}
  - kind: square
    side: 2.5
notes: {weight: 3}
"""


@pytest.fixture
def write(tmp_path):
    def to_file(text: str | bytes) -> Path:
        path = tmp_path / "file.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return to_file


def refused(path: Path, model: type[Strict] = Drawing) -> InputError:
    with pytest.raises(InputError) as caught:
        validate(read_document(path), model)
    assert caught.value.file == path
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_good_file(write):
    document = read_document(write(GOOD))
    drawing = validate(document, Drawing)
    assert drawing.shapes == [Circle(kind="circle", radius=1.0), Square(kind="square", side=2.5)]
    assert document.line(("shapes", 1, "side")) == 6
    assert document.line(("shapes", 1, "absent", "deeper")) == 5
    assert document.line(("absent",)) == 1


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1E+3", 1000.0),
        (".5", 0.5),
        ("-5.", -5.0),
        ("010", 10),
        ("+7", 7),
        ("1" * 30, float("1" * 30)),
        ("on", "on"),
        ("yes", "yes"),
        ("12:30", "12:30"),
        ("1_000", "1_000"),
        ("0x10", "0x10"),
        ("2024-01-01", "2024-01-01"),
        ("1e", "1e"),
        ("1.2.3", "1.2.3"),
        ("true", True),
        ("False", False),
        ("~", None),
        ("", None),
        ("'1'", "1"),
    ],
)
def test_scalars_are_those_of_yaml_1_2(write, text, value):
    found = read_document(write(f"key: {text}\n")).data["key"]
    assert found == value
    assert type(found) is type(value)


def test_keys_are_text_whatever_they_look_like(write):
    document = read_document(write("1: a\ntrue: b\nnull: c\n1.5: d\n"))
    assert document.data == {"1": "a", "true": "b", "null": "c", "1.5": "d"}
    assert document.line(("true",)) == 2


def test_windows_line_ends_and_byte_order_mark_do_not_matter(write):
    assert read_document(write(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())).data == yaml.safe_load(GOOD)


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "found", "words"),
    [
        ("copies:", "copeis:", 2, "copeis", "copeis", "did you mean 'copies'? allowed: title, copies, final, shapes"),
        ("radius: 1", "radus: 1", 4, "shapes[0].radus", "radus", "did you mean 'radius'? allowed: kind, radius"),
        ("side: 2.5", "radius: 2.5", 6, "shapes[1].radius", "radius", "allowed: kind, side"),
        ("kind: square", "kind: sqare", 5, "shapes[1].kind", "sqare", "did you mean 'square'? allowed: circle, square"),
        ("kind: circle, ", "", 4, "shapes[0].kind", None, "missing"),
        ("title: a drawing\n", "", 1, "title", None, "missing"),
        ("    side: 2.5\n", "", 5, "shapes[1].side", None, "missing"),
        ("radius: 1", "radius: '1'", 4, "shapes[0].radius", "1", "expected a number"),
        ("radius: 1", "radius: 1 mm", 4, "shapes[0].radius", "1 mm", "expected a number"),
        ("radius: 1", "radius: true", 4, "shapes[0].radius", "True", "expected a number"),
        ("radius: 1", "radius: .nan", 4, "shapes[0].radius", "nan", "NaN"),
        ("radius: 1", "radius: 1e999", 4, "shapes[0].radius", "inf", "finite"),
        ("radius: 1", "radius: " + "9" * 5000, 4, "shapes[0].radius", "inf", "finite"),
        ("radius: 1", "radius: [1]", 4, "shapes[0].radius", "[1]", "expected a number"),
        ("radius: 1", "radius:", 4, "shapes[0].radius", None, "nothing stands behind this key"),
        ("side: 2.5", "side: -1", 6, "shapes[1].side", "-1", "greater than 0"),
        ("copies: 2", "copies: 2.5", 2, "copies", "2.5", "whole number"),
        ("copies: 2", "final: 1", 2, "final", "1", "true or false"),
        ("title: a drawing", "title: 7", 1, "title", "7", "expected text"),
        ("notes: {weight: 3}", "notes: 3", 7, "notes", "3", "keys with values"),
        ("notes: {weight: 3}", "notes: {weight: .inf}", 7, "notes.weight", "inf", "finite"),
        ("notes: {weight: 3}", "shapes2: 1\ncopies: 3", 8, "copies", None, "twice (first in line 2)"),
    ],
)
def test_each_mistake_is_one_error_at_its_place(write, old, new, line, key, found, words):
    assert old in GOOD
    error = refused(write(GOOD.replace(old, new, 1)))
    assert (error.line, error.key, error.found) == (line, key, found)
    assert words in str(error)
    assert f"file.yaml:{line}: key '{key}'" in str(error)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "expected 'key: value' lines"),
        ("# only a comment\n", 1, "expected 'key: value' lines"),
        ("- a\n- b\n", 1, "expected 'key: value' lines"),
        ("pose,q1_deg\n1,2\n", 1, "expected 'key: value' lines"),
        ("a: 1\nb:\n\tc: 2\n", 3, "spaces, not tabs"),
        ("a: 1\nb: [1, 2\nc: 3\n", 3, "not valid YAML"),
        ("a: 1\n---\nb: 2\n", 2, "another document"),
        ("a: b: c\n", 1, "not valid YAML"),
        ("a: 1\nb: \0\n", 2, "control character"),
        ("a: 1\n[1, 2]: 3\n", 2, "plain word"),
        ("a: 1\nb: !!python/object/apply:os.system [exit 1]\n", 2, "tags are not used here"),
        ("a: !!timestamp x\n", 1, "tags are not used here"),
        ("a: !!bool x\n", 1, "tags are not used here"),
        ("a: &a [*a]\n", 1, "aliases are not used here"),
        ("a: &a {x: 1}\nb: {<<: *a}\n", 2, "aliases are not used here"),
        ("a: " + "[" * 3000 + "]" * 3000, 1, "nested too deeply"),
        (b"\x89PNG\r\n\x1a\n", None, "UTF-8"),
        ("title: x\n".encode("utf-16"), None, "UTF-8"),
    ],
)
def test_what_is_not_a_document(write, text, line, words):
    error = refused(write(text))
    assert error.line == line
    assert words in str(error)


def test_an_alias_bomb_is_refused_at_once(write):
    lines = ["a: &a [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"{b}: &{b} [{', '.join(['*' + a] * 10)}]" for a, b in zip("abcdefghij", "bcdefghijk", strict=True)]
    assert refused(write("\n".join(lines))).line == 2


def test_a_missing_file_and_a_folder(tmp_path):
    assert "no such file" in str(refused(tmp_path / "none.yaml"))
    assert "this is a folder" in str(refused(tmp_path))


def test_further_problems_are_counted(write):
    error = refused(write("title: 1\ncopies: x\nfinal: 3\n"))
    assert error.key == "title"
    assert "2 more problems" in str(error)


def test_a_long_value_is_cut_in_the_message_and_whole_in_the_error(write):
    error = refused(write(GOOD.replace("radius: 1", "radius: " + "x" * 5000)))
    assert len(str(error)) < 300 + len(str(error.file))
    assert error.found == "x" * 5000


def test_errors_survive_the_way_between_processes(write):
    error = refused(write("title: 1\n"))
    again = pickle.loads(pickle.dumps(error))
    assert isinstance(again, SymcalError)
    assert str(again) == str(error)


def test_dotted():
    assert dotted(("links", 2, "alpha")) == "links[2].alpha"
    assert dotted((0, "a")) == "[0].a"
    assert dotted(()) == ""


def test_paths_are_relative_to_the_file_and_know_the_environment(write, monkeypatch):
    path = write("data: x\n")
    document = read_document(path)
    monkeypatch.setenv("SYMCAL_TEST_FOLDER", "/somewhere")
    monkeypatch.delenv("SYMCAL_TEST_UNSET", raising=False)
    assert document.resolve("../a.csv", ("data",)) == path.parent.parent / "a.csv"
    assert document.resolve("$SYMCAL_TEST_FOLDER/a.csv", ("data",)) == Path("/somewhere/a.csv")
    assert document.resolve("${SYMCAL_TEST_FOLDER}/a.csv", ("data",)) == Path("/somewhere/a.csv")
    with pytest.raises(InputError, match="SYMCAL_TEST_UNSET in this path is not set") as caught:
        document.resolve("$SYMCAL_TEST_UNSET/a.csv", ("data",))
    assert (caught.value.line, caught.value.key) == (1, "data")
    for bad in ("a\0b", "~nobody-of-this-name/a"):
        with pytest.raises(InputError, match="not a path"):
            document.resolve(bad, ("data",))


# PyYAML writes the exotic line separators (NEL, LS, PS) bare, and reads them as line ends
letters = st.characters(exclude_categories=("Cs", "Cc", "Zl", "Zp")) | st.sampled_from("\n\t\r\0")
words = st.text(letters)
plain = st.none() | st.booleans() | st.integers(-(10**15), 10**15) | st.floats(allow_nan=False) | words
trees = st.recursive(plain, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(words, inner, max_size=4))


@given(data=st.dictionaries(words, trees, max_size=5))
def test_what_is_written_is_read_back(tmp_path, data):
    path = tmp_path / "tree.yaml"
    write_document(path, data)
    assert read_document(path).data == data


@given(
    text=st.sampled_from(["1e-3", "010", "on", "null", "~", "", "<<", "=", "1:30", "0x1", ".inf", "- a", "a: b", "#"])
)
def test_text_that_looks_like_something_else_stays_text(tmp_path, text):
    path = tmp_path / "text.yaml"
    write_document(path, {"key": text, "list": [text, 1]})
    assert read_document(path).data == {"key": text, "list": [text, 1]}


@given(value=st.floats(allow_nan=False))
def test_numbers_keep_every_digit_also_for_other_readers(tmp_path, value):
    path = tmp_path / "number.yaml"
    write_document(path, {"x": value})
    assert read_document(path).data["x"] == value
    assert yaml.safe_load(path.read_text())["x"] == value  # YAML 1.1


def test_numpy_and_tuples_are_written_as_what_they_hold(tmp_path):
    path = tmp_path / "numpy.yaml"
    data = {"f": np.float64(0.1), "f32": np.float32(0.5), "i": np.int64(3), "b": np.bool_(True), "t": (1, 2)}
    write_document(path, data | {"nan": math.nan})
    read = read_document(path).data
    assert math.isnan(read.pop("nan"))
    assert read == {"f": 0.1, "f32": 0.5, "i": 3, "b": True, "t": [1, 2]}


def test_nothing_is_shared_in_what_is_written(tmp_path):
    row = [1.0, 2.0]
    path = tmp_path / "rows.yaml"
    write_document(path, {"matrix": [row, row], "again": row})
    assert read_document(path).data == {"matrix": [row, row], "again": row}


def test_both_ways_of_writing_read_back_alike() -> None:
    """libyaml writes what PyYAML's own emitter would, but for the escapes of a few characters."""
    rng = np.random.default_rng(3)
    data = {
        "matrix": (rng.normal(size=(12, 12)) * 10.0 ** rng.integers(-300, 300, (12, 12))).tolist(),
        "text": ["1e-3", "yes", "~", "010", "a: b", "- c", "it's", "é\n\tf", " " * 3, "", "x" * 300, "word " * 60],
        "deep": [{"a": [1, 2], "b": {"c": [[1.0, -0.0], [float("inf")]]}}, None, True],
    }
    plain = yaml.dump(data, Dumper=Dumper, sort_keys=False, allow_unicode=True, width=120)
    assert written(data) == plain
    assert parse_value(plain) == data
    for odd in ("\U0001f600", "\x85", "\x07"):
        assert parse_value(written({"a": odd})) == {"a": odd}


def test_a_name_of_bytes_that_are_no_text_is_written() -> None:
    half = b"caf\xe9".decode("utf-8", "surrogateescape")
    assert written({"file": half}) == 'file: "caf\\uDCE9"\n'
