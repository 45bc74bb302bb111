"""What takes part, what is left out and why, and that identifications minimise the same."""

from __future__ import annotations

import builtins
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from symcal.bench import identifications, positions
from symcal.bench.case import Case
from symcal.bench.contest import Contest, Entry, hold
from symcal.bench.rounds import Contender, Pace, Samples, measure, quartiles, ratio

SHORT = Pace(rounds=3, sample_s=0.0, slow_s=10.0)


def counting() -> tuple[list[str], Callable[[str], Callable[[], None]]]:
    calls: list[str] = []
    return calls, lambda name: lambda: calls.append(name)


def test_contenders_take_turns() -> None:
    calls, record = counting()
    samples = measure((Contender("a", record("a"), 2), Contender("b", record("b"), 1)), SHORT)
    assert calls[-6:] == ["a", "b"] * 3
    assert {name: each.cpu.shape for name, each in samples.items()} == {"a": (3,), "b": (3,)}


def test_what_is_slow_is_measured_in_fewer_rounds() -> None:
    calls, record = counting()
    pace = Pace(rounds=9, sample_s=0.0, slow_s=-1.0)  # everything is slow
    samples = measure((Contender("a", record("a"), 1),), pace)
    assert len(samples["a"].cpu) == 3
    assert len(calls) == 4


def test_a_ratio_is_that_of_rounds() -> None:
    """A machine that is ten times slower in one round changes nothing."""
    slow = np.array([1.0, 10.0, 1.0, 1.0])
    found = ratio(Samples(4 * slow, slow), Samples(2 * slow, slow))
    assert found == {"median": 2.0, "lower": 2.0, "upper": 2.0}
    assert quartiles(np.arange(5.0)) == {"median": 2.0, "lower": 1.0, "upper": 3.0}


def test_who_computes_something_else_is_not_compared() -> None:
    calls, record = counting()
    entries = (
        Entry(Contender("right", record("right"), 1), 1e-12, 1e-9),
        Entry(Contender("wrong", record("wrong"), 1), 1e-3, 1e-9),
    )
    held = hold(Contest("s", "n", 1, "u", "right", "slopes", entries), SHORT)
    assert [entry["name"] for entry in held["entries"]] == ["right"]
    assert "wrong" not in calls
    assert held["absent"]["wrong"] == "computes something else: slopes differ by 1.0e-03, allowed 1e-09"
    assert held["entries"][0]["ratio"] == {"median": 1.0, "lower": 1.0, "upper": 1.0}


def test_nan_agrees_with_nothing() -> None:
    assert not Entry(Contender("nan", int, 1), float("nan"), 1.0).agrees


@pytest.fixture
def without_peers(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def guarded(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.partition(".")[0] in ("jax", "pinocchio"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", guarded)


@pytest.mark.usefixtures("without_peers")
def test_what_is_not_installed_is_listed(handling: Case) -> None:
    contest = positions.contest(handling, 3, None)
    assert contest.reference == positions.CASADI_VM
    absent = {positions.JAX: "not installed", positions.PINOCCHIO: "not installed", positions.CASADI_C: "no C compiler"}
    assert contest.absent == absent
    assert all(entry.agrees for entry in contest.entries)
    names = {entry.contender.name for entry in contest.entries}
    assert {positions.CASADI_VM, positions.NUMPY, positions.LOOP, "symcal, virtual machine", "symcal, NumPy"} <= names


def test_all_paths_and_peers_agree_at_a_thousand_postures(handling: Case) -> None:
    contest = positions.contest(handling, 1000, None)
    assert {entry.contender.name: entry.difference for entry in contest.entries if not entry.agrees} == {}
    assert next(e for e in contest.entries if e.contender.name == positions.LOOP).difference > positions.EXACT


def test_identifications_reach_the_cost_that_scipy_reaches(handling: Case) -> None:
    repeated = identifications.repeat(handling, 12)
    contest = identifications.contest(repeated, None, slow=False)
    assert contest.absent == {"JAX": "left out by --quick"}
    found = {entry.contender.name: entry.difference for entry in contest.entries}
    assert "symcal, 12 at once" in found
    assert "SciPy trf, 2-point slopes (NumPy)" in found
    assert all(entry.agrees for entry in contest.entries), found
    assert max(off for name, off in found.items() if name.startswith("symcal")) < 1e-10


def test_the_cost_is_a_sum_of_squares_of_noise(handling: Case) -> None:
    """At the truth twice the cost is chi-squared of 3 readings at each posture, beside a small prior."""
    repeated = identifications.repeat(handling, 200)
    best = _own(repeated)
    costs = 2 * repeated.costs(best)
    assert np.mean(costs) == pytest.approx(3 * identifications.POSES - len(repeated.free), rel=0.15)
    spoiled = best.copy()
    spoiled[:, repeated.problem.free[0]] += 1e-3
    assert np.all(repeated.costs(spoiled) > repeated.costs(best))


def _own(repeated: identifications.Repeated) -> np.ndarray:
    from symcal.bench import own_fits

    return own_fits.many(repeated.case, repeated.q, repeated.z, identifications.SIGMA, repeated.free)()


def test_jax_identifies_the_same(handling: Case) -> None:
    pytest.importorskip("jax")
    repeated = identifications.repeat(handling, 5)
    found = {e.contender.name: e for e in identifications.contest(repeated, None).entries}
    assert found["JAX, 5 at once"].agrees
    assert found["JAX, single"].agrees


@pytest.mark.usefixtures("without_peers")
def test_without_jax_a_full_contest_says_so(handling: Case) -> None:
    contest = identifications.contest(identifications.repeat(handling, 2), None)
    assert contest.absent == {"JAX": "not installed"}
    assert "SciPy lm, 2-point slopes (NumPy, pose by pose)" in {entry.contender.name for entry in contest.entries}
