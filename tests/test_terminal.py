"""What a command says in the terminal after an identification."""

from __future__ import annotations

from typing import Any

import pytest

from symcal.cli.terminal import print_accuracy

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
