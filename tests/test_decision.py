"""What a calibration is accepted or refused for, one planted fault after the other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symcal.calibration.claims import Outside
from symcal.calibration.decision import Decision, decide
from symcal.calibration.evaluate import Errors
from symcal.calibration.evidence import Evidence, Lack, Sizes
from symcal.calibration.reasons import KINDS, Reason
from symcal.calibration.tolerance import ERRORS_OF, Tolerance, parse_tolerance
from symcal.errors import InputError
from symcal.report.decision import as_sentence, warnings_beside

TOLERANCE = Tolerance(0.5, np.deg2rad(0.1))
SLIP = {"pose": "T3", "noises": 40.0, "off": 50.0, "unit": "mm", "tool_mm": 0.0}


def errors(mm: float, deg: float = 0.02, poses: int = 60, seed: int = 1) -> Errors:
    """Normal errors of so many mm and deg per axis."""
    rng = np.random.default_rng(seed)
    pose = np.arange(poses)
    turns = np.deg2rad(deg) * rng.normal(size=(poses, 3))
    return Errors(mm * rng.normal(size=(poses, 3)), pose, np.zeros_like(pose), turns)


def good(**changed: Any) -> Evidence:
    """A calibration to be accepted, with or without a tolerance; ``changed`` spoils it."""
    found = Evidence(
        {"train": {"after": errors(0.09)}, "test": {"before": errors(1.0, seed=2), "after": errors(0.1, seed=3)}},
        uncalibrated=Sizes(20.0, 2.0),
        open=Sizes(0.05, 0.01),
        over="the working area",
        outside=Outside(0.02, "the working area"),
    )
    return replace(found, **changed)


def held_out(after: Errors) -> dict[str, Any]:
    return {"errors": {"test": {"before": errors(1.0, seed=2), "after": after}}}


def test_what_is_good_is_accepted() -> None:
    found = decide(good())
    assert found.accepted
    assert found.sentence.endswith("(0.171 mm rms instead of 1.86 mm); no tolerance was given")
    assert found.sentence.startswith("accepted: on the test poses it is better than the nominal robot")
    found = decide(good(), TOLERANCE)
    assert found.accepted
    assert found.cautions == ()
    assert "the tolerance is 0.500 mm and 0.100 deg" in found.sentence


def test_large_errors_that_unseen_poses_confirm_are_a_caution() -> None:
    """A robot file that is 30 mm off, right at poses of a test, is no mistake of the measurements."""
    reason = Reason("implausible", "d_2 is off by 30 mm, more than 10 times its plausible 1 mm", "d_2")
    wild = {"implausible": (reason,)}
    assert not decide(good(**wild)).accepted
    found = decide(good(**wild, conceivable=frozenset({"d_2"})))
    assert found.accepted
    assert found.cautions[0].startswith(reason.text)
    hardly = held_out(errors(0.5, seed=4))
    assert not decide(good(**wild, **hardly, conceivable=frozenset({"d_2"}))).accepted


@pytest.mark.parametrize(
    ("changed", "kind", "words"),
    [
        ({"trouble": "stopped: it swings"}, "unsettled", "did not converge: stopped: it swings"),
        ({"implausible": (Reason("implausible", "d_2 is off by 30 mm", "d_2"),)}, "implausible", "d_2 is off by 30 mm"),
        ({"mistakes": [{"kind": "order", "text": "quaternions are conjugate"}]}, "mistake", "quaternions are conjug"),
        ({"errors": {}}, "unjudged", "nothing was held out"),
        (held_out(errors(1.0, seed=4)), "no_gain", "the nominal one with fitted frames"),
        ({"uncalibrated": Sizes(0.05, 2.0)}, "worthless", "even a robot that was never calibrated"),
        ({"uncalibrated": Sizes(20.0, 0.005)}, "worthless", "the orientation error is"),
        (
            {
                "errors": {"test": {"before": errors(1.0, seed=2), "after": errors(0.95, seed=2)}},
                "uncalibrated": Sizes(1.0, 2.0),
            },
            "worthless",
            "the nominal one by hardly more",
        ),
    ],
)
def test_what_is_refused_whatever_is_asked(changed: dict[str, Any], kind: str, words: str) -> None:
    found = decide(good(**changed))
    assert [reason.kind for reason in found.reasons] == [kind]
    assert words in found.sentence
    if kind != "no_gain":  # a tolerance asks for less error, not for a gain
        assert kind in {reason.kind for reason in decide(good(**changed), TOLERANCE).reasons}


@pytest.mark.parametrize(
    ("changed", "kind", "words"),
    [
        ({"errors": {"left_out": good().errors["test"]}}, "unjudged", "nothing was held out and nothing cross-val"),
        (held_out(errors(0.4)), "position", "beyond the tolerance of 0.500 mm"),
        (held_out(errors(0.1, deg=0.06)), "orientation", "beyond the tolerance of 0.100 deg"),
        ({"open": Sizes(0.8, 0.01), "foremost": "a_4"}, "unseen", "0.800 mm over the working area"),
        ({"open": Sizes(0.05, 0.2)}, "unseen", "0.200 deg over the working area"),
        ({"outside": Outside(0.35, "the working area")}, "coverage", "35\u00a0% of the working area lies beyond"),
        ({"lacks": (Lack("gravity at joint 2", 0.7, "mm"),)}, "lack_of_fit", "gravity at joint 2 (0.700 mm rms)"),
        ({"lacks": (Lack("gravity at joint 2", 0.2, "deg"),)}, "lack_of_fit", "gravity at joint 2 (0.200 deg rms)"),
        ({"outliers": [SLIP | {"tool_mm": 0.9}]}, "outlier", "moves the robot by up to 0.900 mm"),
        ({"outliers": [SLIP | {"split": "test"}]}, "outlier", "held-out pose T3 cannot be explained"),
        ({"halves": {"agree": True, "difference_rms_mm": 0.7, "divisions": []}}, "halves", "differ by 0.700 mm rms"),
    ],
)
def test_what_a_tolerance_refuses_and_its_absence_does_not(changed: dict[str, Any], kind: str, words: str) -> None:
    found = decide(good(**changed), TOLERANCE)
    assert [reason.kind for reason in found.reasons] == [kind]
    assert words in found.sentence
    assert decide(good(**changed)).accepted


def test_what_is_small_beside_the_tolerance_is_no_reason() -> None:
    small = good(
        lacks=(Lack("gravity at joint 2", 0.3, "mm"), Lack("a wave of joint 1", 0.05, "deg")),
        outliers=[SLIP | {"tool_mm": 0.2}, SLIP | {"split": "test", "off": 0.4}, SLIP | {"split": "test", "noises": 5}],
        halves={"agree": True, "difference_rms_mm": 0.2},
    )
    assert decide(small, TOLERANCE).accepted


def test_halves_are_told_once() -> None:
    """As a reason where they differ by more than the tolerance, else as a caution, and never beside these."""
    text = "two halves differ by 0.7 mm rms: they do not agree"
    halves = {"agree": False, "difference_rms_mm": 0.7, "text": text, "divisions": []}
    refused, accepted = decide(good(halves=halves), TOLERANCE), decide(good(halves=halves), Tolerance(0.9))
    assert [reason.text for reason in refused.reasons] == [f"{text}; that is beyond the tolerance of 0.500 mm"]
    assert text not in refused.cautions
    assert text in accepted.cautions
    for decision in (refused, accepted):
        assert warnings_beside({"decision": decision.facts, "warnings": [text, "another"]}) == ["another"]


def test_a_second_calibration_from_few_poses_refuses_nothing_by_chance() -> None:
    second = {"agree": True, "difference_rms_mm": 0.7, "text": "the two differ: they agree"}
    assert decide(good(halves=second), TOLERANCE).accepted
    found = decide(good(halves=second | {"agree": False, "text": "the two differ"}), TOLERANCE)
    assert [reason.text for reason in found.reasons] == ["the two differ; that is beyond the tolerance of 0.500 mm"]


@pytest.mark.parametrize("of", ERRORS_OF)
def test_the_statistic_is_the_one_that_was_asked_for(of: Any) -> None:
    """Numbers of NumPy on either side of the limit."""
    size = errors(0.1, seed=3).size
    value = {"p95": np.percentile(size, 95), "rms": np.sqrt(np.mean(size**2)), "max": size.max()}[of]
    assert decide(good(), Tolerance(1.001 * float(value), of=of)).accepted
    (reason,) = decide(good(), Tolerance(0.999 * float(value), of=of)).reasons
    assert reason.kind == "position"


def test_what_was_not_measured_is_said() -> None:
    """Distances tell the position of the tool by the uncertainties alone, and nothing that can be judged without."""
    wire = replace(errors(0.05), vectors=errors(0.05).vectors[:, :1], rotations=None, of_tool=False, words="wire error")
    found = good(errors={"test": {"before": replace(wire, vectors=5 * wire.vectors), "after": wire}})
    decision = decide(found, TOLERANCE)
    assert decision.accepted
    assert any("the position itself was not measured but the wire error" in caution for caution in decision.cautions)
    assert any("no orientation was measured" in caution for caution in decision.cautions)
    (reason,) = decide(replace(found, open=Sizes(0.05, None)), TOLERANCE).reasons
    assert reason.kind == "unjudged"


def test_cautions() -> None:
    few = good(errors={"test": {"before": errors(1.0, poses=8), "after": errors(0.05, poses=8)}})
    assert any("only 8 poses judge" in caution for caution in decide(few, TOLERANCE).cautions)
    no_gain = decide(good(**held_out(errors(1.0, seed=4))), Tolerance(5.0))
    assert no_gain.accepted
    assert any("the data do not support an accuracy claim" in caution for caution in no_gain.cautions)
    halves = decide(good(halves={"agree": False, "text": "two halves differ"}))
    assert halves.accepted
    assert halves.cautions == ("two halves differ",)


_TOLERANCES = st.none() | st.builds(
    Tolerance, st.floats(1e-3, 1e3), st.none() | st.floats(1e-6, 1.0), st.sampled_from(ERRORS_OF)
)
_REASONS = st.lists(st.builds(Reason, st.sampled_from(KINDS), st.text(min_size=1), st.sampled_from(["", "d_2"])))


@given(_TOLERANCES, _REASONS, st.text(), st.lists(st.text()))
def test_a_decision_accepts_what_nothing_speaks_against_and_comes_back_whole(
    tolerance: Tolerance | None, reasons: list[Reason], basis: str, cautions: list[str]
) -> None:
    decision = Decision(tolerance, tuple(reasons), basis, tuple(cautions))
    assert decision.accepted == (not reasons)
    assert decision.facts["accepted"] == (not decision.facts["reasons"])
    back = Decision.recalled(decision.facts)
    assert back is not None
    assert (back.reasons, back.basis, back.cautions) == (decision.reasons, basis, decision.cautions)
    if tolerance is not None:
        assert back.tolerance is not None
        assert back.tolerance.position == tolerance.position
        assert back.tolerance.orientation == pytest.approx(tolerance.orientation)
    assert Decision.recalled({**decision.facts, "accepted": not decision.accepted}) is None


@given(
    st.sampled_from(["", "stopped"]),
    st.lists(st.just({"text": "a mistake"}), max_size=1),
    st.floats(0, 1),
    st.floats(0, 3),
    st.floats(0.01, 2),
    _TOLERANCES,
)
def test_accepted_means_no_reason(
    trouble: str, mistakes: Any, share: float, size: float, left: float, tolerance: Tolerance | None
) -> None:
    beyond = {"outside": Outside(share, "the area"), "open": Sizes(size, size)}
    found = good(trouble=trouble, mistakes=mistakes, **beyond, **held_out(errors(left)))
    decision = decide(found, tolerance)
    assert decision.accepted == (decision.reasons == ())
    assert decision.sentence.startswith("accepted: " if decision.accepted else "refused: ")
    assert all(reason.text in decision.sentence for reason in decision.reasons)


@pytest.mark.parametrize("facts", [None, {}, [], "accepted", {"accepted": True}, {"accepted": True, "tolerance": 1}])
def test_what_is_no_decision_decides_nothing(facts: Any) -> None:
    assert Decision.recalled(facts) is None


def test_tolerances_as_they_are_typed() -> None:
    assert parse_tolerance("0.5mm") == Tolerance(0.5)
    found = parse_tolerance("0.1deg, 0.0002 m", "max")
    assert (found.position, found.orientation) == pytest.approx((0.2, np.deg2rad(0.1)))
    assert found.of == "max"
    assert parse_tolerance("2mrad").orientation == pytest.approx(2e-3)
    for text in ("", "0.5", "0.5px", "mm", "-1mm", "nanmm", "1mm,2mm", "1e999mm"):
        with pytest.raises(InputError, match=r"0\.5mm,0\.1deg"):
            parse_tolerance(text)
    with pytest.raises(InputError, match="statistic"):
        parse_tolerance("1mm", "median")
    with pytest.raises(InputError, match="how far off"):
        Tolerance()


def test_what_is_said_are_sentences() -> None:
    assert as_sentence("the model lacks gravity") == "The model lacks gravity."
    assert as_sentence("base_y is not seen.") == "base_y is not seen."
