"""What was found beyond geometry, in words: which groups of joint terms were kept, which not, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from symcal.units import in_mrad
from symcal.words import fixed, listed, number, plural

Facts = Mapping[str, Any]

GROUPS: dict[str, str] = {
    "gravity": "gravity",
    "coupling": "coupling of the wrist",
    "backlash": "backlash",
    "payload": "payload",
    "ratio": "gear ratios",
}
"""What groups are called; harmonics by their multiple."""

_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")


def group_words(group: str) -> str:
    """`harmonics 1` as `first harmonics`."""
    if not group.startswith("harmonics"):
        return GROUPS.get(group, group)
    k = int(group.rpartition(" ")[2])
    return f"{_ORDINALS[k - 1] if k <= len(_ORDINALS) else f'{k}th'} harmonics"


def extension_text(content: Mapping[str, Any]) -> dict[str, Any] | None:
    """The section beyond geometry; None where nothing was tried.

    Args:
        content: the results dictionary (results.json).
    """
    found = content.get("extension")
    if not found:
        return None
    return {
        "text": " ".join([_first(found), _held_out(found)]),
        "groups": [_group(name, facts, found) for name, facts in found["groups"].items()],
        "shared": [_shared(each) for each in found["one_sum"]],
    }


def extension_sentence(content: Mapping[str, Any]) -> list[str]:
    """For the verdict: what was kept, and what it is worth on poses that were held out of the training."""
    found = content.get("extension")
    if not found:
        return []
    if not found["kept"]:
        return ["Nothing beyond geometry was kept: the data do not ask for it."]
    return [f"Beyond geometry the data ask for {listed([group_words(g) for g in found['kept']])}. {_held_out(found)}"]


def _first(found: Facts) -> str:
    groups = [group_words(name) for name in found["groups"]]
    return (
        f"Between a joint's reading and the chain the identification tried {listed(groups)}, all at once, each group "
        "with one scale that marginal likelihood finds with the noise; a group that is not needed shrinks by itself. A "
        f"group is kept when twice its gain in log marginal likelihood is above {number(found['enough'], 2)} and "
        "held-out poses do not speak against it."
    )


def _held_out(found: Facts) -> str:
    rms, unit = found["held_out_rms"], found["unit"]
    poses = f"{plural(found['poses'], 'training pose')} held out in {found['folds']} folds"
    if not found["kept"]:
        return f"With geometry alone the {poses} are off by {number(rms['geometry'])} {unit} rms."
    return (
        f"The {poses} are off by {number(rms['geometry'])} {unit} rms with geometry alone and by "
        f"{number(rms['kept'])} {unit} with what was kept (linearised at the estimate)."
    )


def _group(name: str, facts: Facts, found: Facts) -> dict[str, Any]:
    unit = found["unit"]
    gain = f"gain {number(facts['gain'], 2)}" if facts["gain"] > 0 else "no gain"
    why = f"{gain}, but held-out poses speak against it" if facts["rejected"] else gain
    verdict = f"kept, {gain}" if facts["kept"] else f"left out: {why}"
    held = f"{number(facts['held_out_rms_without'])} → {number(facts['held_out_rms_with'])} {unit}"
    return {
        "name": group_words(name),
        "verdict": verdict,
        "kept": facts["kept"],
        "held_out": held,
        "joints": _joints(name, facts),
    }


def _joints(name: str, facts: Facts) -> str:
    """Which joints a group is named at, and which it cannot be seen at."""
    named = [_named(joint) for joint in facts["joints"] if joint["named"]] if facts["kept"] else []
    unseen = [joint["name"] for joint in facts["joints"] if joint["seen"] == 0]
    parts = [f"at {listed(named)}" if named else "no joint stands out"] if facts["kept"] else []
    if unseen:
        every = len(unseen) == len(facts["joints"])
        parts.append("unseen at every joint" if every else f"unseen at {listed(unseen)}")
    if name.startswith("harmonics") and not facts["kept"]:
        seen = [joint for joint in facts["joints"] if joint["seen"]]
        if seen:
            best, worst = (pick(seen, key=lambda j: j["smallest_named"]) for pick in (min, max))
            parts.append(
                f"one of {_angle(best['smallest_named'], best['unit'])} at {best['name']}, of "
                f"{_angle(worst['smallest_named'], worst['unit'])} at {worst['name']} would be named"
            )
    return "; ".join(parts)


def _named(joint: Facts) -> str:
    if joint.get("amplitude") is None:
        return str(joint["name"])
    words = f"{joint['name']} ({_spread(joint['amplitude'], joint['amplitude_sigma'], joint['unit'])}"
    if joint["phase_deg"] is not None:
        words += f", phase {fixed(joint['phase_deg'], 0)} ± {number(joint['phase_sigma_deg'], 1)} deg"
    return f"{words})"


def _shared(found: Facts) -> str:
    return (
        f"The first harmonic of {found['name']} and the gravity moment of its own link are one and the same at every "
        f"pose. Together they are {_spread(found['amplitude'], found['amplitude_sigma'], 'rad')} with phase "
        f"{fixed(found['phase_deg'], 0)} ± {number(found['phase_sigma_deg'], 1)} deg; separable only with two payloads."
    )


def _spread(value: float, sigma: float, unit: str) -> str:
    shown, factor = in_mrad(unit)
    decimals = max(1 - math.floor(math.log10(max(sigma * factor, 1e-9))), 0)
    return f"{fixed(value * factor, decimals)} ± {fixed(sigma * factor, decimals)} {shown}"


def _angle(value: float, unit: str) -> str:
    shown, factor = in_mrad(unit)
    return f"{number(value * factor, 2)} {shown}"
