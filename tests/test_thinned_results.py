"""What stands for very many poses in tables and figures, and the words that say so."""

from __future__ import annotations

import csv
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from cases import handling
from hypothesis import given
from hypothesis import strategies as st

from symcal.calibration import thinned
from symcal.calibration.evaluate import Errors
from symcal.calibration.thinned import few_folds, listed, listed_notes
from symcal.data import saved_measurements
from symcal.data.dataset import Dataset, readings
from symcal.data.measurement_file import load_measurements
from symcal.data.notes import notes
from symcal.data.saved_measurements import save_measurements
from symcal.plots import panels


def data_of(q: np.ndarray) -> Dataset:
    names = tuple(f"p{i}" for i in range(len(q)))
    return Dataset(readings("position", ("P",)), q, np.ones((len(q), 3)), names, ("train",) * len(q))


def test_errors_of_some_poses_are_listed_whole_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    pose = np.repeat(np.arange(50), 2)
    found = Errors(np.arange(300.0).reshape(100, 3), pose, np.tile([0, 1], 50), None)
    data = data_of(np.zeros((50, 5)))
    assert listed(found) is found
    assert listed_notes(data) == []
    monkeypatch.setattr(thinned, "LISTED", 8)
    few = listed(found)
    assert few.pose.tolist() == [i for i in (0, 7, 14, 21, 28, 35, 42, 49) for _ in range(2)]
    assert np.array_equal(few.vectors, found.vectors[np.isin(pose, few.pose)])
    assert "lists 8 of the 50 poses" in listed_notes(data)[0]


def test_folds_of_some_poses_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    data = data_of(np.zeros((50, 5)))
    assert few_folds(data) == []
    monkeypatch.setattr(thinned, "SOME", 20)
    assert "of 20 of the 50 poses" in few_folds(data)[0]


def test_marks_stand_for_some_values_and_the_largest() -> None:
    values = np.zeros(5000)
    values[[17, 4321]] = -7.0, 8.0
    found = panels.drawn(values)
    assert {0, 17, 4321, 4999} <= set(found.tolist())
    assert len(found) <= panels.SOME + 100
    assert np.array_equal(panels.drawn(values[:300]), np.arange(300))
    assert panels.drawn_words([300], "poses") == ""
    assert "of the 5000 poses" in panels.drawn_words([300, 5000], "poses")


@given(
    st.lists(st.tuples(st.sampled_from([-1.0, 0.0, -0.0, 1.0]), st.sampled_from([0.0, 0.5])), min_size=1, max_size=12)
)
def test_repeated_postures_are_those_that_a_look_at_every_pair_finds(rows: list[tuple[float, float]]) -> None:
    q = np.zeros((len(rows), 5))
    q[:, :2] = np.array(rows).reshape(-1, 2)
    again = {j: i for i, j in reversed(list(combinations(range(len(rows)), 2))) if rows[i] == rows[j]}
    said = [note for note in notes(data_of(q), handling()) if "the joint readings of another" in note]
    if not again:
        assert said == []
        return
    assert said[0].startswith(f"{len(again)} pose")
    pairs = ", ".join(f"p{again[j]} and p{j}" for j in sorted(again)[:5])
    assert f"({pairs}{', ...' if len(again) > 5 else ''})" in said[0]


@pytest.mark.parametrize("at_once", [1, 7, 10_000])
def test_measurements_are_written_alike_in_pieces_of_any_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_once: int
) -> None:
    rng = np.random.default_rng(3)
    robot, q = handling(), rng.uniform(0.1, 1.0, (20, 5))
    z = rng.normal(size=(20, 6))
    z[3, :3], z[5, 3:] = np.nan, np.nan
    names = tuple(f'a,"{i}"' for i in range(20))
    data = Dataset(readings("position", ("P", "Q")), q, z, names, ("train", "test") * 10, sigma=np.full((20, 6), 0.1))
    monkeypatch.setattr(saved_measurements, "_AT_ONCE", at_once)
    save_measurements(data, robot, tmp_path / "m.csv", ("of  today",))
    text = (tmp_path / "m.csv").read_text()
    rows = list(csv.reader(text.splitlines()[1:]))
    assert text.startswith("# of today\npose,q1_deg,")
    assert [(row[0], row[6]) for row in rows[1:]] == [
        (names[i], point) for i in range(20) for k, point in enumerate("PQ") if np.isfinite(z[i, 3 * k])
    ]
    back = load_measurements(tmp_path / "m.csv", robot, "position")
    np.testing.assert_array_equal(back.z, z)
    np.testing.assert_allclose(back.q, q, rtol=1e-15)
    assert (back.labels, back.split) == (data.labels, data.split)
