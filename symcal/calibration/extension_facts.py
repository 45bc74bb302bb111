"""What an identification beyond geometry found, as numbers and names for results.json; mm, rad and deg in the keys."""

from __future__ import annotations

from typing import Any

import numpy as np

from symcal.calibration.extension import Extension, GroupFinding, JointFinding, SharedFinding
from symcal.fit.groups import enough
from symcal.units import DEGREES, SHOWN_UNITS


def extension_facts(found: Extension | None) -> dict[str, Any] | None:
    """The groups with scale, gain and held-out errors, and what was found at every joint; None if none was tried."""
    if found is None:
        return None
    factor = DEGREES if found.unit == "rad" else 1.0
    return {
        "wanted": list(found.wanted),
        "kept": list(found.kept),
        "enough": enough(len(found.groups)),
        "poses": found.poses,
        "folds": found.folds,
        "quantity": found.quantity,
        "unit": SHOWN_UNITS[found.unit],
        "held_out_rms": {"geometry": factor * found.geometry, "kept": factor * found.chosen},
        "groups": {group.name: _group(group, factor) for group in found.groups},
        "one_sum": [_shared(each) for each in found.shared],
    }


def _group(group: GroupFinding, factor: float) -> dict[str, Any]:
    return {
        "kept": group.kept,
        "scale": group.scale,
        "rejected": group.rejected,
        "gain": group.gain,
        "held_out_rms_without": factor * group.held_out.without,
        "held_out_rms_with": factor * group.held_out.with_,
        "held_out_better": group.held_out.better,
        "joints": [_joint(joint) for joint in group.joints],
    }


def _joint(found: JointFinding) -> dict[str, Any]:
    out: dict[str, Any] = {
        "joint": found.joint,
        "name": found.name,
        "unit": found.unit,
        "numbers": dict(zip(found.names, found.values, strict=True)),
        "sigmas": dict(zip(found.names, found.sigmas, strict=True)),
        "p": found.p,
        "named": found.named,
        "seen": found.seen,
        "summed": found.summed,
    }
    if found.amplitude is not None:
        out |= {
            "amplitude": found.amplitude,
            "amplitude_sigma": found.amplitude_sigma,
            "phase_deg": None if found.phase is None else np.rad2deg(found.phase),
            "phase_sigma_deg": None if found.phase_sigma is None else np.rad2deg(found.phase_sigma),
            "smallest_named": found.smallest,
        }
    return out


def _shared(found: SharedFinding) -> dict[str, Any]:
    return {
        "joint": found.joint,
        "name": found.name,
        "of": ["harmonics 1", "gravity moment of its own link"],
        "amplitude": found.amplitude,
        "amplitude_sigma": found.amplitude_sigma,
        "phase_deg": float(np.rad2deg(found.phase)),
        "phase_sigma_deg": float(np.rad2deg(found.phase_sigma)),
    }
