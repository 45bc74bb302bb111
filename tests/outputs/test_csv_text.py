"""Tables as CSV against pandas."""

from __future__ import annotations

import csv
import io

import numpy as np
import pandas as pd

from symcal.outputs.csv_text import csv_text, rows_of

ROWS = [
    {"name": "a, b", "value": 0.1 + 0.2, "seen": True, "note": None},
    {"name": 'said "so"', "value": np.float64(1e-300), "seen": np.False_, "count": np.int64(3)},
    {"name": "", "value": float("nan"), "seen": True, "note": "µm"},
]


def test_the_same_text_as_pandas() -> None:
    plain = [{k: v for k, v in row.items() if k != "count"} for row in ROWS]  # pandas writes 3.0 beside missing ones
    assert csv_text(plain) == pd.DataFrame(plain).to_csv(index=False)


def test_numbers_come_back_to_the_last_bit() -> None:
    rows = rows_of({"x": np.random.default_rng(0).normal(size=50), "n": np.arange(50)})
    back = list(csv.DictReader(io.StringIO(csv_text(rows))))
    assert [float(row["x"]) for row in back] == [row["x"] for row in rows]
    assert [int(row["n"]) for row in back] == list(range(50))


def test_columns_of_a_table_without_rows() -> None:
    assert csv_text([], ("a", "b")) == "a,b\n"
    assert csv_text([{"b": 1}], ("a", "b")) == "a,b\n,1\n"
