"""What measured and what its errors are, as reports say it: instruments, the quantity that judges, noise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from symcal.parameters import FRAME_AXES
from symcal.words import listed, number

Content = Mapping[str, Any]
Facts = Sequence[Mapping[str, Any]]

POSITION = "position_mm"
"""The quantity of results that do not name theirs."""

_OF_THE_ROBOT = {"base", "tool", "points", "camera", "intrinsics"}
_MOST_NAMED = 6  # instruments in a sentence
_MOST_FEATURES = 4  # points or axes of a target in a cell
_OLDER = (
    ("noise_sigma_mm", "position", "mm"),
    ("noise_sigma_deg", "orientation", "deg"),
    ("noise_sigma_px", "image", "px"),
)


@dataclass(frozen=True, slots=True)
class Judged:
    """The quantity that an identification is judged by.

    key: its name in the accuracy of results.json. error: said to people; title: to tables. of_tool: it is the error of
    the robot's tool. reader: whose it is, where several instruments measured and none of them tells the tool's error.
    scalar: it is one number, so that its norm is its size. touched: it is of contacts, which read nothing.
    """

    key: str
    unit: str
    error: str
    of_tool: bool
    reader: str | None
    scalar: bool
    touched: bool = False

    @property
    def counted(self) -> str:
        """What one of its errors is of."""
        return "contact" if self.touched else "observation"

    @property
    def title(self) -> str:
        return "position error" if self.of_tool else self.error

    @property
    def these(self) -> str:
        return "these position errors" if self.of_tool else "these errors"


def judged(content: Content) -> Judged:
    """Which quantity a report speaks of."""
    measurement, instruments = content.get("measurement", {}), observers(content)
    of_tool = measurement.get("of_tool", True)
    alone, judges = len(instruments) < 2, measurement.get("judged_by", [])
    own = [facts for facts in instruments if facts["name"] in judges] or instruments
    return Judged(
        measurement.get("quantity", POSITION),
        measurement.get("unit", "mm"),
        measurement.get("error", "tool error"),
        of_tool,
        None if alone or of_tool or len(judges) == len(instruments) else listed(list(by_entry(own))),
        not of_tool and bool(instruments) and instruments[0]["quantities"][0]["size"] == 1,
        bool(own) and all(facts.get("constrains", False) for facts in own),
    )


def observers(content: Content) -> Facts:
    """Facts about every instrument; none where results are too old to have them."""
    facts: Facts = content.get("measurement", {}).get("instruments", ())
    return facts


def by_entry(instruments: Facts) -> dict[str, Facts]:
    """Instruments by the entry that they come from, several sessions of one together; by its own name one alone."""
    entries: dict[str, list[Mapping[str, Any]]] = {}
    for facts in instruments:
        entries.setdefault(facts.get("entry", facts["name"]), []).append(facts)
    return {name if len(own) > 1 else own[0]["name"]: own for name, own in entries.items()}


def observers_named(instruments: Facts) -> str:
    """`tracker (positions) and socket (contacts with a fixed point, 6 sessions)`; of many the first ones and how many
    more."""
    names = [
        f"{name} ({own[0]['reads']}{f', {len(own)} sessions' if len(own) > 1 else ''})"
        for name, own in by_entry(instruments).items()
    ]
    if len(names) > _MOST_NAMED + 1:
        names = [*names[:_MOST_NAMED], f"{len(names) - _MOST_NAMED} more"]
    return listed(names)


def what_is_read(facts: Mapping[str, Any]) -> str:
    """`distances of smr P on flange`."""
    features = facts["features"]
    many = len(features) > _MOST_FEATURES
    named = [f"({len(features)} of them)"] if many else [", ".join(features)] if features else []
    on = [] if facts["target"] == facts["target_on"] else [f"on {facts['target_on']}"]
    return " ".join([facts["reads"], "of", facts["target"], *named, *on])


def fitted_before(content: Content) -> str:
    """What was fitted with nominal kinematics."""
    own = set(content.get("measurement", {}).get("estimate", ())) <= _OF_THE_ROBOT
    return "base and tool" if own else "places, points and instruments' own numbers"


def unknowns(instruments: Facts) -> set[str]:
    return {name for facts in instruments for name in facts["unknown"]}


def stands_on(name: str, instruments: Facts) -> str | None:
    """On what an instrument or a target stands, by the name of its place; None if there is no such place."""
    for facts in instruments:
        if facts["name"] == name:
            return str(facts["on"])
        if facts["target"] == name:
            return str(facts["target_on"])
    for facts in instruments:  # a place for each session has a name of its own
        if any(f"{name}_{axis}" in facts["unknown"] for axis in FRAME_AXES):
            return str(facts["on"])
    return None


# --------------------------------------------------------------------------------------------------------------- noise


def noise_groups(found: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Noise by group of an identification: sigma, unit and quantity; of older results as far as they have it."""
    if "noise" in found:
        return dict(found["noise"])
    return {
        group: {"sigma": found[key], "unit": unit, "quantity": group}
        for key, group, unit in _OLDER
        if found.get(key) is not None
    }


def noise_words(content: Content) -> str:
    """`standard deviation 0.05 mm per axis of position (given)`."""
    parts = []
    for group, noise in noise_groups(content["identification"]).items():
        how = "estimated from the training data" if group in _estimated(content) else "given"
        parts.append(f"{noise_phrase(group, noise, content)} ({how})")
    return "standard deviation " + ", ".join(parts) if parts else "given with each measurement"


def noise_phrase(group: str, noise: Mapping[str, Any], content: Content) -> str:
    """`0.05 mm per axis of position`."""
    sizes = {q["noise"]: q["size"] for facts in observers(content) for q in facts["quantities"]}
    touched = {facts.get("entry", facts["name"]) for facts in observers(content) if facts.get("constrains")}
    several = sizes.get(noise["quantity"], 3) > 1 and group.endswith(noise["quantity"])
    what = _of_contacts(group, noise) if noise.get("instrument") in touched else group
    what = f"the {what}" if noise["unit"] == "px" else what
    return f"{number(noise['sigma'])} {noise['unit']} {'per axis ' if several else ''}of {what}"


def _of_contacts(group: str, noise: Mapping[str, Any]) -> str:
    """What has the noise of a constraint: `each contact with left`, `the height of each contact`; `x` of one axis."""
    entry, quantity = str(noise["instrument"]), str(noise["quantity"])
    with_what = f" with {entry}" if group.startswith(f"{entry} ") else ""
    axis = group.partition(quantity)[2].strip()
    of = f"{axis or quantity} of " if axis or quantity != "position" else ""
    return f"{f'the {of}' if of else ''}each contact{with_what}"


def noise_of(content: Content, facts: Mapping[str, Any]) -> str:
    """The noise of one instrument: `0.05 mm (given)`."""
    groups = noise_groups(content["identification"])
    entry = facts.get("entry", facts["name"])
    own = {group: noise for group, noise in groups.items() if noise.get("instrument", entry) == entry}
    if not own:
        return "as given by reading"
    units = dict.fromkeys(noise["unit"] for noise in own.values())
    sizes = ", ".join(
        f"{', '.join(number(noise['sigma']) for noise in own.values() if noise['unit'] == unit)}\u00a0{unit}"
        for unit in units
    )
    return f"{sizes} ({'estimated' if set(own) <= set(_estimated(content)) else 'given'})"


def _estimated(content: Content) -> Iterable[str]:
    groups: Iterable[str] = content["identification"].get("noise_estimated", ())
    return groups
