"""A comparison of calibrations in words: which parameters differ, what it comes to, and what to be careful with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.words import listed, number, p_value, plural, symbol

Content = Mapping[str, Any]

_LEVEL = 0.05
_MOST_NAMED = 8


def pair_sentences(pair: Content) -> list[str]:
    """What is said of two calibrations, the most important first.

    Args:
        pair: an entry of `comparison` in results.json.
    """
    names = f"{pair['second']} against {pair['first']}"
    if pair["identical"]:
        return [f"{names}: the same numbers, to the last digit: one calibration twice"]
    joint = f"joint {p_value(pair['p'])} over {plural(pair['directions'], 'direction')} that both determine"
    if not pair["directions"]:
        said = "the two determine no direction of the parameters in common: nothing can be told"
    elif pair["differing"]:
        shown = [symbol(name) for name in pair["differing"][:_MOST_NAMED]]
        more = len(pair["differing"]) - len(shown)
        shown += [f"{more} more"] * (more > 0)
        verb = "differs" if len(pair["differing"]) == 1 else "differ"
        said = f"{listed(shown)} {verb} beyond the joint uncertainty ({joint})"
    elif pair["p"] < _LEVEL:
        said = f"together the parameters differ beyond their uncertainty, but none can be named ({joint})"
    else:
        said = f"no parameter differs beyond its uncertainty ({joint})"
    return [f"{names}: {said}", tool_sentence(pair["tool_mm"])]


def tool_sentence(tool: Content) -> str:
    """How far the tool is apart, beside what was to be expected."""
    fitted = f" once {listed(list(tool['aligned']))} {'is' if len(tool['aligned']) == 1 else 'are'} aligned"
    return (
        f"over the joint ranges the tool is apart by {number(tool['rms'])} mm rms and {number(tool['max'])} mm at most"
        f"{fitted if tool['aligned'] else ''}; two calibrations of one robot would be by "
        f"{number(tool['expected_rms'])} mm rms"
    )


def changed(pair: Content) -> bool:
    """Whether two calibrations differ beyond their uncertainty."""
    return bool(pair["differing"]) or (pair["directions"] > 0 and pair["p"] < _LEVEL)


def cautions(content: Content) -> list[str]:
    """What whoever reads the comparison must know.

    Args:
        content: of its results.json, without the warnings.
    """
    out = []
    for name, run in content["runs"].items():
        if run["trouble"]:
            out.append(f"{name}: the identification did not converge ({run['trouble']}): do not use its numbers")
        elif run["accepted"] is False:
            reasons = f": {'; '.join(run['reasons'])}" if run["reasons"] else ""
            out.append(f"{name}: this calibration was refused{reasons}")
    for pair in content["comparison"]:
        names = f"{pair['second']} against {pair['first']}"
        if pair["shared"] and not pair["identical"]:
            out.append(
                f"{names}: both are from {pair['shared']}: as far as they share measurements, they differ by less than "
                "is foretold here of independent ones"
            )
        if pair["left_out"]:
            left = [symbol(name) for name in pair["left_out"]]
            shown = left if len(left) <= _MOST_NAMED else [*left[:_MOST_NAMED], f"{len(left) - _MOST_NAMED} more"]
            are = "is" if len(left) == 1 else "are"
            out.append(
                f"{names}: {listed(shown)} {are} estimated in one alone and not compared; "
                "in the other one, parameters that are compared may have taken up their part"
            )
    if any(changed(pair) for pair in content["comparison"]):
        out.append(
            "a difference is the robot's or the model's: poses elsewhere show an effect that the model lacks "
            "differently; look at each run's model check before the robot is blamed"
        )
    units = {run["accuracy"]["quantity"] for run in content["runs"].values() if run["accuracy"]}
    if len(units) > 1:
        out.append(f"the runs are judged by different quantities ({listed(sorted(units))}): errors do not compare")
    return out
