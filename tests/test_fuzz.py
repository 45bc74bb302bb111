"""Mutated inputs, a few for every reader: read or refused in one clear error. The long form: `python -m tests.fuzz`."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from fuzz.mutations import NASTY, mutated
from fuzz.readers import READERS
from fuzz.worker import input_of, outcomes

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the time of a reader is limited by a signal")

COUNT = 60


@pytest.mark.parametrize("reader", READERS)
def test_what_is_written_well_is_read(reader: str, tmp_path) -> None:
    """Else the mutations would start from what is refused anyway."""
    one = READERS[reader]
    path = tmp_path / f"good{one.suffix}"
    for seed in one.seeds(tmp_path):
        path.write_bytes(seed)
        one.read(path)


@pytest.mark.parametrize("reader", READERS)
def test_mutated_inputs_are_read_or_refused(reader: str) -> None:
    found = list(outcomes(reader, range(COUNT)))
    assert [outcome for outcome in found if outcome.kind == "finding"] == []
    assert {outcome.kind for outcome in found} == {"ok", "refused"}  # some pass the parser, and some do not


def test_the_search_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    """A traceback, a warning, a hang and an eater of memory are findings, with their seeds."""
    import time
    import warnings
    from dataclasses import replace

    from fuzz import worker

    from symcal.errors import InputError, SymcalError

    monkeypatch.setattr(worker, "WAITING", 0.2)

    def read(path) -> None:
        match path.read_bytes()[:1]:
            case b"0":
                raise KeyError("x")
            case b"1":
                warnings.warn("x", RuntimeWarning, stacklevel=1)
            case b"2":
                time.sleep(5)
            case b"3":
                raise MemoryError
            case b"4":
                raise SymcalError("\x1b[2J")
            case b"5":
                raise InputError("refused")

    monkeypatch.setitem(READERS, "plan", replace(READERS["plan"], read=read))
    monkeypatch.setattr(worker, "input_of", lambda _, seed, __: str(seed).encode())
    assert [outcome.kind for outcome in outcomes("plan", range(7))] == [*["finding"] * 5, "refused", "ok"]


def test_an_input_can_be_made_again() -> None:
    seeds = [b"a: 1\nb: 2\n", b"pose,q1_deg\n1,2\n"]
    assert [input_of("robot", i, seeds) for i in range(50)] == [input_of("robot", i, seeds) for i in range(50)]
    assert input_of("robot", 1, seeds) != input_of("plan", 1, seeds)


def test_every_nasty_word_comes_up() -> None:
    rng = np.random.default_rng(0)
    made = b"".join(mutated(rng, [b"alpha: 1\n"]) for _ in range(6000))
    missing = [word for word in NASTY if word.encode("utf-8", "surrogatepass") not in made]
    assert len(missing) < len(NASTY) / 10
