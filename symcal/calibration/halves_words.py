"""What two halves say: one sentence, and all of it as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from symcal.calibration.again import Again
from symcal.calibration.apart import LEVEL, Apart, Compared
from symcal.calibration.divisions import Division
from symcal.calibration.halves import Halves
from symcal.words import number, p_value, plural

_HARDLY = 1.25  # times what is expected: more than chance, but nothing that anybody would feel
_MORE = 1.25  # times what halves by chance differ by, from which another division says something of its own
CLEARLY = 1.5
"""Times what their uncertainties let expect from which halves that differ are warned of."""


def halves_facts(found: Halves | str) -> dict[str, Any]:
    """Numbers for results.json, lengths in mm and angles in deg.

    Args:
        found: what was found, or why nothing was.
    """
    if isinstance(found, str):
        return {"agree": None, "why": found, "text": not_compared(found)}
    first = found.division.first
    return {
        "agree": found.agree,
        **compared_facts(found.apart),
        "p": found.p,
        "p_least": found.least,
        "level": LEVEL,
        "poses": [int(first.sum()), int((~first).sum())],
        "aside": found.aside,
        "division": found.division.name,
        "over": "working area" if found.by_area else "ranges of the training poses",
        "divisions": [_of_division(division, compared) for division, compared in found.every],
        "text": halves_sentence(found),
    }


def compared_facts(apart: Apart) -> dict[str, Any]:
    """Numbers of two estimates compared, whatever they are of."""
    own = apart.compared
    tested = own.tested
    return {
        "difference_rms_mm": own.difference,
        "predicted_rms_mm": own.predicted,
        "ratio": own.difference / own.predicted,
        "largest_mm": float(apart.apart.max()),
        "within_95": apart.within,
        "postures": len(apart.apart),
        "squares": tested.squares,
        "degrees_of_freedom": [tested.directions, tested.dof if np.isfinite(tested.dof) else None],
        "p_alone": tested.p,
        "orientation": _turn(own),
    }


def _turn(own: Compared) -> dict[str, float] | None:
    if own.turn is None or own.turn_predicted is None:
        return None
    return {
        "difference_rms_deg": float(np.rad2deg(own.turn)),
        "predicted_rms_deg": float(np.rad2deg(own.turn_predicted)),
        "ratio": own.turn / own.turn_predicted,
    }


def _of_division(division: Division, compared: Compared) -> dict[str, Any]:
    return {
        "name": division.name,
        "halves": division.said,
        "difference_rms_mm": compared.difference,
        "predicted_rms_mm": compared.predicted,
        "p": compared.tested.p,
    }


def halves_warnings(found: Halves | Again | str) -> list[str]:
    """A warning where two calibrations differ by much more than their uncertainties let expect."""
    if isinstance(found, str) or found.agree or found.apart.compared.ratio < CLEARLY:
        return []
    return [halves_sentence(found) if isinstance(found, Halves) else again_sentence(found)]


def not_compared(why: str) -> str:
    return f"no two halves of the training poses were compared: {why}"


def halves_sentence(found: Halves) -> str:
    """Whether two halves differ by no more than is stated, by how much they do, and what that means."""
    where = "the working area" if found.by_area else "the ranges of the training poses"
    what = f"two halves of the training poses ({found.division.said}), identified apart, differ over {where} by"
    amount = f"{what} {_amount(found.apart)}"
    if found.agree:
        return f"{amount}: they agree{_others(found)}"
    ratio, by_chance = found.apart.compared.ratio, found.every[0][1].ratio
    means = _MEANS[found.division.by].format(joint=found.division.joint)
    if found.division.by != "chance" and by_chance * _MORE > ratio:
        means = f"{_MEANS['chance']}, since halves drawn by chance differ as much"
    return _differing(amount, found, means)


def _differing(amount: str, found: Halves | Again, means: str) -> str:
    hardly = found.apart.compared.ratio < _HARDLY
    said = "that is hardly more, though not by chance" if hardly else "they do not agree"
    return f"{amount}: {said} ({p_value(found.p)}), as if {means}"


def _others(found: Halves) -> str:
    """What other divisions say where the one that is told of agrees."""
    if found.least >= LEVEL:
        count = len(found.every) - 1
        return f", as do those of {plural(count, 'other division')}" if count else ""
    least = p_value(found.least)
    return f" about the tool, though other halves differ in some parameters by more than chance ({least})"


def again_facts(found: Again | str) -> dict[str, Any]:
    """Numbers of a second calibration compared with the recorded one, for results.json, lengths in mm, angles in deg.

    Args:
        found: what was found, or why nothing was.
    """
    if isinstance(found, str):
        text = f"no second calibration from the new poses alone was compared with the recorded one: {found}"
        return {"agree": None, "why": found, "text": text}
    return {
        "agree": found.agree,
        **compared_facts(found.apart),
        "p": found.p,
        "level": LEVEL,
        "poses": found.poses,
        "over": "ranges of the new poses",
        "text": again_sentence(found),
    }


def again_sentence(found: Again) -> str:
    """Whether a second calibration differs from the recorded one by no more than is stated."""
    amount = (
        f"a calibration from the {plural(found.poses, 'new pose')} alone and the recorded one differ over the ranges "
        f"of the new poses by {_amount(found.apart)}"
    )
    if found.agree:
        return f"{amount}: they agree"
    means = (
        "the robot or the instrument had changed, or the model lacked something that acts differently on these poses"
    )
    return _differing(amount, found, means)


_MEANS: Mapping[str, str] = {
    "chance": "the readings of some poses erred together (a slip, a pose that is wrong), or poses were not independent",
    "order": "something had moved or drifted during the measurement, or the model lacked something that acts "
    "differently on the later poses",
    "reading": "the model lacked something that depends on joint {joint}",
    "middle": "the model lacked something that depends on joint {joint}",
}


def _amount(apart: Apart) -> str:
    own = apart.compared
    said = f"{number(own.difference, 2)} mm rms; their stated uncertainties allow {number(own.predicted, 2)} mm"
    if own.turn is None or own.turn_predicted is None:
        return said
    turn, allowed = (number(float(np.rad2deg(each)), 2) for each in (own.turn, own.turn_predicted))
    return f"{said} (orientation {turn} deg, allowed {allowed} deg)"
