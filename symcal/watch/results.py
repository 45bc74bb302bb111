"""Checks and their plans as plain data (results.json). Lengths are mm, angles rad."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from symcal.watch.check import Change, Check
from symcal.watch.directed import POWER, Law, Tested
from symcal.watch.plan import CheckPlan
from symcal.watch.reference import REST, Hypothesis, Reference
from symcal.watch.sensitivity import Sensitivity

Facts = dict[str, Any]


def check_facts(reference: Reference, found: Check) -> Facts:
    """What a check says; the offset of each joint is that if it alone changed."""
    laws, tests = found.sensitivity.laws, {**found.tests, REST: found.rest}
    return {
        "verdict": "holds" if found.holds else "changed",
        "moved": found.moved,
        "alpha": found.alpha,
        "p": found.p,
        "poses": list(found.labels),
        "gross": found.gross,
        "group": [_change(each) for each in found.group],
        "alarms": list(found.alarms),
        "tests": {name: _tested(each, laws[name]) for name, each in tests.items()},
        "joints": {h.name: _joint(h, found) for h in reference.joints},
        "unseen": list(found.unseen),
        "smallest": smallest_facts(found.sensitivity),
        "over_noise": {state: values.tolist() for state, values in found.residuals.items()},
        "noise": _noise(reference),
    }


def plan_facts(
    reference: Reference, plan: CheckPlan, offsets: Mapping[str, float], alpha: float, *, moved: bool
) -> Facts:
    """The poses and what they find, with the instrument where it was and set up anew."""
    return {
        "poses": plan.poses.tolist(),
        "moved": moved,
        "alpha": alpha,
        "power": POWER,
        "offsets": {
            h.name: {
                "joint": h.joint,
                "unit": h.units[0],
                "wanted": offsets[h.name],
                "still": _finite(plan.still.offset(h)),
                "moved": _finite(plan.moved.offset(h)),
                "needed": plan.needed[h.name],
            }
            for h in reference.joints
        },
        "frames": {
            state: {name: dict(sizes) for name, sizes in each.smallest.items() if name in _frames(reference)}
            for state, each in (("still", plan.still), ("moved", plan.moved))
        },
        "fewest": plan.fewest,
        "noise": _noise(reference),
    }


def smallest_facts(found: Sensitivity) -> Facts:
    """By hypothesis and unit the smallest change that is found with a power of 95 %."""
    return {name: {unit: _finite(size) for unit, size in sizes.items()} for name, sizes in found.smallest.items()}


def _frames(reference: Reference) -> list[str]:
    return [h.name for h in reference.hypotheses if h.joint is None]


def _noise(reference: Reference) -> dict[str, Facts]:
    units = {group.name: group.unit for group in reference.before.measurement.groups}
    return {name: {"sigma": sigma, "unit": units[name]} for name, sigma in reference.noise.items()}


def _change(change: Change) -> Facts:
    h, size = change.hypothesis, {}
    for unit in dict.fromkeys(h.units):
        own = [i for i, each in enumerate(h.units) if each == unit]
        size[unit] = float(np.linalg.norm(change.values[own]))
    return {
        "name": h.name,
        "joint": h.joint,
        "size": size,
        "parameters": {
            name: {"value": float(value), "half_width_95": float(half), "unit": unit}
            for name, value, half, unit in zip(h.parameters, change.values, change.half_widths, h.units, strict=True)
        },
    }


def _joint(h: Hypothesis, found: Check) -> Facts | None:
    if h.name not in found.alone:
        return None
    law, (value, sigma) = found.sensitivity.laws[h.name], found.alone[h.name]
    return {
        "joint": h.joint,
        "unit": h.units[0],
        "offset": value,
        "half_width_95": float(law.half_width(np.array(sigma))),
        "limit": float(np.sqrt(law.limit(1)) * sigma),
        "smallest": _finite(found.sensitivity.offset(h)),
    }


def _tested(each: Tested, law: Law) -> Facts:
    limit = law.limit(each.directions) if each.directions else None
    return {
        "squares": each.squares,
        "directions": each.directions,
        "level": law.level,
        "limit": limit,
        "p": each.p,
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
