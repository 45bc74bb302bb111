"""The verdict of an identification in plain words: what the numbers say, and no more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.words import number, plural

Content = Mapping[str, Any]

_UNCHANGED = 0.02  # relative change of an rms that is not called a change


def judged(content: Content) -> str:
    """The part of the data that judges: held-out poses, else cross-validation, else the training poses."""
    return next(part for part in ("test", "cross_validation", "train") if part in content["accuracy"])


def over(content: Content, part: str) -> str:
    """The poses of a part in words."""
    facts = content["accuracy"][part]
    poses = content["measurement"]["poses"]
    if part == "cross_validation":
        count = facts["after"]["position_mm"]["count"]
        return f"{plural(count, 'observation')} held out in turn ({facts['folds']}-fold cross-validation)"
    if part == "truth":
        return plural(facts["after"]["position_mm"]["count"], "simulated test point")
    return f"{poses[part]} {'held-out' if part == 'test' else 'training'} pose{'' if poses[part] == 1 else 's'}"


def verdict(content: Content) -> list[str]:
    """Sentences for page one, most important first."""
    accuracy, part = content["accuracy"], judged(content)
    sentences = [_main(content, part)]
    position = accuracy[part]["after"]["position_mm"]
    sentences.append(
        f"Afterwards 95 % of these position errors are below {number(position['p95'])} mm; the largest is {number(position['max'])} mm."
    )
    if "offsets_only" in accuracy[part]:
        sentences.append(
            f"Correcting the joint offsets alone gives {number(_rms(content, part, 'offsets_only'))} mm rms."
        )
    if "truth" in accuracy:
        sentences.append(_truth(content))
    expected = content.get("expected_position_rms_mm", {}).get("test" if part == "test" else "train")
    if expected is not None:
        sentences.append(
            f"From the uncertainty of the parameters alone, without the noise of a measurement, {number(expected)} mm rms is to be expected."
        )
    if part == "train":
        sentences.append("No pose was held out, so nothing here says how accurate the robot is at other poses.")
    return [*sentences, _seen(content)]


def _main(content: Content, part: str) -> str:
    before, after = _rms(content, part, "before"), _rms(content, part, "after")
    change = _verb(before, after)
    sentence = (
        f"The robot's tool error {change} from {number(before)} mm (nominal kinematics, frames fitted) to {number(after)} mm rms on "
        f"{over(content, part)}"
    )
    angles = [content["accuracy"][part][state].get("orientation_deg") for state in ("before", "after")]
    if all(angles):
        first, last = (angle["rms"] for angle in angles)
        sentence += f"; its orientation error {_verb(first, last)} from {number(first)} to {number(last)} deg"
    sentence += f". Errors are taken against the {content['against']}."
    if after > (1 - _UNCHANGED) * before:
        sentence += " The identified kinematics predicts these poses no better than the nominal one: do not use it for its accuracy."
    return sentence


def _truth(content: Content) -> str:
    before, after = _rms(content, "truth", "before"), _rms(content, "truth", "after")
    return (
        f"Against the simulated truth, on {over(content, 'truth')} without noise, the error {_verb(before, after)} from {number(before)} to "
        f"{number(after)} mm rms."
    )


def _seen(content: Content) -> str:
    seen = content["identifiability"]
    total, rank = seen["parameters"], seen["rank"]
    if rank == total:
        return f"The data determine all {total} parameters."
    return (
        f"Of {plural(total, 'parameter')} the data determine {plural(rank, 'combination')}; the other {total - rank} stay at their nominal values, and "
        "parameters that they touch have no standard deviation of their own."
    )


def _verb(before: float, after: float) -> str:
    if abs(after - before) <= _UNCHANGED * before:
        return "went"
    return "fell" if after < before else "rose"


def _rms(content: Content, part: str, state: str) -> float:
    return float(content["accuracy"][part][state]["position_mm"]["rms"])
