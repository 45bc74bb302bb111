"""The verdict of an identification in plain words: what the numbers say, and no more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.report.extension import extension_sentence
from symcal.report.learnt import learnt_and_assumed
from symcal.report.measured import Judged, judged, observers
from symcal.words import GIVEN, number, plural

Content = Mapping[str, Any]

UNCHANGED = 0.02
"""Relative change of an rms that is not called a change."""


def judging_part(content: Content) -> str:
    """The part of the data that judges: held-out poses, else cross-validation, else the training poses."""
    return next(part for part in ("test", "cross_validation", "train") if part in content["accuracy"])


def usable(content: Content) -> bool:
    """Whether the calibration was accepted; of results without a decision, whether the identification converged."""
    decision = content.get("decision")
    return bool(content["identification"]["converged"] if decision is None else decision["accepted"])


def verdict(content: Content) -> list[str]:
    """Sentences for page one, the most important first.

    Args:
        content: the results dictionary (results.json).
    """
    warning = (
        []
        if usable(content) or "decision" in content  # its own box says it
        else [
            f"Do not use these numbers: the identification did not converge ({content['identification']['message']})."
        ]
    )
    accuracy, part, what = content["accuracy"], judging_part(content), judged(content)
    after = accuracy[part]["after"][what.key]
    sentences = [
        *warning,
        _main(content, part),
        f"Errors are taken against the {content['against']}. Afterwards 95 % of {what.these} are below "
        f"{number(after['p95'])} {what.unit}; the largest is {number(after['max'])} {what.unit}{_where(after)}.",
    ]
    if "offsets_only" in accuracy[part] and content["robot"]["name"] != GIVEN:
        offsets = _rms(content, part, "offsets_only")
        sentences.append(f"Correcting the joint offsets alone gives {number(offsets)} {what.unit} rms.")
    if "truth" in accuracy:
        sentences.append(_truth(content))
    expected = content.get("expected_position_rms_mm", {}).get("test" if part == "test" else "train")
    if expected is not None and what.unit == "mm":  # angles alone tell nothing of where the tool is
        error = f"{'' if what.of_tool else 'a position error of '}{number(expected)} mm rms"
        sentences.append(
            "The uncertainty of the parameters alone, without the noise of a measurement, lets expect "
            f"{error} at the {'held-out' if part == 'test' else 'training'} poses"
            + (", what contacts cannot see included." if what.touched else ".")
        )
    sentences += extension_sentence(content)
    if content.get("promise"):
        sentences.append(_promise(content["promise"]))
    if part == "train":
        sentences.append("No pose was held out, so nothing here says how accurate the robot is at other poses.")
    return [*sentences, *_seen(content)]


def _main(content: Content, part: str) -> str:
    before, after = _rms(content, part, "before"), _rms(content, part, "after")
    if content["robot"]["name"] == GIVEN:
        return _frames_alone(content, part)
    angles = [content["accuracy"][part][state].get("orientation_deg") for state in ("before", "after")]
    what = judged(content)
    sentence = (
        f"The robot's {what.error}{_as_read(what)} {_moved(before, after)} from "
        f"{number(before)} {what.unit} (nominal "
        f"kinematics, frames fitted) to {number(after)} {what.unit} rms on {_poses(content, part)}"
    )
    if all(angles):
        first, last = (angle["rms"] for angle in angles)
        sentence += f"; its orientation error {_moved(first, last)} from {number(first)} to {number(last)} deg"
    sentence += "."
    refused = {reason["kind"] for reason in content.get("decision", {}).get("reasons", ())}
    if after > (1 - UNCHANGED) * before and "no_gain" not in refused:
        sentence += " The identified kinematics predicts these poses no better than the nominal one."
    return sentence


def _frames_alone(content: Content, part: str) -> str:
    """Of a robot whose poses are data: what its frames leave, and where they are."""
    after, what = content["accuracy"][part]["after"], judged(content)
    turned = after.get("orientation_deg")
    text = f"The robot's poses are data, and frames alone were estimated. They leave {number(after[what.key]['rms'])} "
    text += (
        f"{what.unit}" + (f" and {number(turned['rms'])} deg" if turned else "") + f" rms on {_poses(content, part)}."
    )
    return text


def _where(after: Mapping[str, Any]) -> str:
    """At which pose; of results that do not say it, nothing."""
    return f", at pose {after['worst']['pose']}" if "worst" in after else ""


def _as_read(what: Judged) -> str:
    if what.touched:
        return " that it touches" + ("" if what.reader is None else f" ({what.reader})")
    return "" if what.reader is None else f", as {what.reader} reads it,"


def _poses(content: Content, part: str) -> str:
    facts = content["accuracy"][part]
    what = judged(content)
    count = facts["after"][what.key]["count"]
    if part == "cross_validation":
        return f"{plural(count, what.counted)} held out in turn ({facts['folds']}-fold cross-validation)"
    if len(observers(content)) > 1 or what.touched:  # not every one of them reads at every pose
        return plural(count, f"{'held-out' if part == 'test' else 'training'} {what.counted}")
    return plural(content["measurement"]["poses"][part], "held-out pose" if part == "test" else "training pose")


def _truth(content: Content) -> str:
    before, after = _rms(content, "truth", "before"), _rms(content, "truth", "after")
    what = judged(content)
    count = content["accuracy"]["truth"]["after"][what.key]["count"]
    return (
        f"Against the simulated truth, without noise, the error {_moved(before, after)} from {number(before)} to "
        f"{number(after)} {what.unit} rms on {plural(count, 'test point' if what.of_tool else f'test {what.counted}')}."
    )


def _promise(kept: Mapping[str, Any]) -> str:
    """What the plan foretold for the held-out poses, and what came of it."""
    foretold, true = kept["predicted_rms_mm"], kept["found_true_rms_mm"]
    if true is not None:
        return (
            f"Before anything was measured these {kept['poses']} training poses foretold {number(foretold)} mm rms at "
            f"the held-out poses from the stated noise; against the truth {number(true)} mm came of it."
        )
    return (
        f"Before anything was measured these {kept['poses']} training poses foretold "
        f"{number(kept['predicted_measured_rms_mm'])} mm rms at the held-out poses, noise of the measurement included; "
        f"{number(kept['found_measured_rms_mm'])} mm were found."
    )


def _seen(content: Content) -> list[str]:
    sentence = learnt_and_assumed(content["identification"]["parameters"])
    return [sentence] if sentence else []


def _moved(before: float, after: float) -> str:
    if abs(after - before) <= UNCHANGED * before:
        return "hardly changed,"
    return "fell" if after < before else "rose"


def _rms(content: Content, part: str, state: str) -> float:
    return float(content["accuracy"][part][state][judged(content).key]["rms"])
