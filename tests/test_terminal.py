"""What a command says in the terminal after an identification."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_term_files import FILE

from symcal.cli.terminal import print_accuracy, print_check, print_robot
from symcal.robot.files import load_robot
from symcal.runs.check import Added, Check, check_robot

FOUND = {
    "converged": True,
    "message": "converged: the cost is least",
    "effective_parameters": 31.24,
    "noise_sigma_mm": 0.0512,
    "noise_sigma_deg": None,
    "noise_sigma_px": None,
}


def content(**identification: Any) -> dict[str, Any]:
    return {
        "identifiability": {"rank": 33, "parameters": 40},
        "identification": FOUND | identification,
        "accuracy": {},
        "against": "noisy measurement",
        "warnings": [],
    }


def test_seen_learnt_noise_and_the_end_stand_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    print_accuracy(content())
    line = capsys.readouterr().out.splitlines()[0]
    assert line == (
        "33 of 40 directions seen; 31.2 parameters' worth learnt; noise 0.0512 mm; converged: the cost is least"
    )


def test_a_fit_that_did_not_converge_is_said_first(capsys: pytest.CaptureFixture[str]) -> None:
    print_accuracy(content(converged=False, message="stopped: it [swings]"))
    first, second = capsys.readouterr().out.splitlines()[:2]
    assert "must not be used" in first
    assert second.endswith("stopped: it [swings]")


def test_a_validation_has_no_identification_to_speak_of(capsys: pytest.CaptureFixture[str]) -> None:
    print_accuracy({"accuracy": {}, "against": "noisy measurement", "warnings": []})
    assert "directions" not in capsys.readouterr().out


def _statistics(rms: float, count: int = 40) -> dict[str, float]:
    return {"mean": rms, "rms": rms, "p95": 2 * rms, "max": 3 * rms, "count": count}


def _lines(capsys: pytest.CaptureFixture[str]) -> list[list[str]]:
    return [line.split() for line in capsys.readouterr().out.splitlines()]


def test_noise_is_named_where_there_are_several_instruments(capsys: pytest.CaptureFixture[str]) -> None:
    noise = {
        "tracker position": {"sigma": 0.05, "unit": "mm", "quantity": "position"},
        "wire distance": {"sigma": 0.03, "unit": "mm", "quantity": "distance"},
    }
    print_accuracy(content(noise=noise))
    assert "; noise tracker position 0.05 mm, wire distance 0.03 mm; " in capsys.readouterr().out
    print_accuracy(content(noise={"distance": noise["wire distance"]}))
    assert "; noise 0.03 mm; " in capsys.readouterr().out


def test_errors_have_the_unit_of_what_judges(capsys: pytest.CaptureFixture[str]) -> None:
    measurement = {"quantity": "direction_deg", "unit": "deg"}
    accuracy = {"test": {"after": {"direction_deg": _statistics(0.2)}}}
    print_accuracy(content() | {"measurement": measurement, "accuracy": accuracy})
    head, row = _lines(capsys)[1:3]
    assert head == ["data", "state", "mean", "deg", "rms", "deg", "p95", "deg", "max", "deg"]
    assert row == ["test", "after", "0.2", "0.2", "0.4", "0.6"]


def test_a_position_keeps_the_column_of_angles(capsys: pytest.CaptureFixture[str]) -> None:
    print_accuracy(content() | {"accuracy": {"test": {"after": {"position_mm": _statistics(0.2)}}}})
    assert _lines(capsys)[1][-2:] == ["rms", "deg"]


def test_every_instrument_has_rows_in_its_own_unit(capsys: pytest.CaptureFixture[str]) -> None:
    states = {"before": _statistics(2.0, 30), "offsets_only": _statistics(1.0, 30), "after": _statistics(0.5, 30)}
    instruments = {
        "tracker": {"unit": "mm", "accuracy": {"train": states, "test": states}},
        "beam": {"unit": "deg", "accuracy": {"test": states}},
    }
    print_accuracy(content() | {"instruments": instruments})
    lines = _lines(capsys)
    start = lines.index(["instrument", "data", "state", "rms", "max", "unit", "count"])
    assert lines[start + 1 : start + 7] == [
        ["tracker", "train", "before", "2", "6", "mm", "30"],
        ["tracker", "train", "after", "0.5", "1.5", "mm", "30"],
        ["tracker", "test", "before", "2", "6", "mm", "30"],
        ["tracker", "test", "after", "0.5", "1.5", "mm", "30"],
        ["beam", "test", "before", "2", "6", "deg", "30"],
        ["beam", "test", "after", "0.5", "1.5", "deg", "30"],
    ]
    print_accuracy(content() | {"instruments": {"tracker": instruments["tracker"]}})
    assert "instrument" not in capsys.readouterr().out


def test_check_says_what_every_instrument_adds(capsys: pytest.CaptureFixture[str]) -> None:
    unknown = ("my_wire_x", "my_wire_y", "my_wire_z", "smr_P", "my_wire_offset")
    wire = Added("my_wire", "world", "distances", "smr P on flange", unknown, 1, 25, 6)
    print_check(Check(np.eye(4), {}, (), (wire,)))
    out = capsys.readouterr().out
    assert "rows per pose  rank alone  rank added" in out
    assert "my_wire (x, y, z), smr_P, my_wire_offset" in out
    assert out.splitlines()[-1].split()[-3:] == ["1", "25", "6"]
    print_check(Check(np.eye(4), {}, ()))
    assert "rank alone" not in capsys.readouterr().out


def test_check_says_joint_terms_with_their_units(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(FILE)
    robot = load_robot(path)
    print_robot(robot)
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    for line in (
        "joint term number value unit depends on",
        "waist harmonics q1_sin_1 0.02 deg waves 1, 2 of its reading",
        "waist harmonics q1_motor_sin_1 0.003 deg waves 1 of its motor, 101 turns per turn",
        "lift harmonics q3_sin_1 0.05 mm waves 1 of its screw, 20 mm per turn",
        "wrist ratio q4_ratio 0.001 1 its reading",
        "elbow coupling q2_by_q3 174.5329 mrad/m the reading of joint 3",
        "elbow backlash q2_backlash 0.01 deg the direction it came from (q2_direction)",
        "elbow compliance q2_compliance 17.45329 µrad/(N m) the gravity moment of masses and payload",
        "elbow gravity q2_gravity_x 0.1 deg the gravity moment of weights at x, q4, flange",
    ):
        assert line in lines
    facts = "gravity along (0, 0, 1) of the base; masses: 8 kg on elbow, 1 kg on the flange and a payload of 2 kg"
    assert lines[-1] == facts
    path.write_text(FILE[: FILE.index("terms:")])
    print_robot(load_robot(path))
    out = capsys.readouterr().out
    assert "depends on" not in out
    assert "gravity" not in out


def test_check_counts_the_numbers_of_terms_and_names_the_columns_that_they_need(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(FILE)
    found = check_robot(load_robot(path))
    seen = found.seen["pose of the tool"]
    assert set(load_robot(path).term_parameters) <= set(seen.names)
    # at this wrist, which turns about the lift's axis, weights at its origin and at the flange weigh the same
    texts = [direction.text for direction in seen.unseen()]
    assert sum("q2_gravity_q4 and q2_gravity_flange cannot be told apart" in text for text in texts) == 1
    assert not any("direction" in text or "backlash" in text or "payload" in text for text in texts)
    assert any("depend on q2_direction and payload_kg" in note for note in found.notes)
