"""95 % intervals of parameters as bars on one scale for each unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.units import SHOWN
from symcal.words import number

Parameters = Mapping[str, Mapping[str, Any]]

_WIDTH = 100.0
_OUT = 4.0  # times the middle one: intervals longer than that do not set the scale
_ROOM = 1.1  # of the largest estimate, which is always within


def intervals(parameters: Parameters) -> dict[str, dict[str, Any]]:
    """By parameter: where the bar of its correction starts, ends and has its estimate, on a scale of 0 to 100 with zero
    at 50; whether it is cut off; and the same in words. Parameters that were held have none."""
    free = {name: p for name, p in parameters.items() if p.get("half_width_95") is not None and not p.get("unplaced")}
    scales: dict[tuple[str, bool], float] = {}
    for name, p in free.items():
        key = _scale(name, p)
        own = [q for n, q in free.items() if _scale(n, q) == key]
        ends = sorted(abs(q["error"]) + q["half_width_95"] for q in own)
        farthest = max(abs(q["error"]) for q in own)
        scales[key] = max(min(ends[-1], _OUT * ends[len(ends) // 2]), _ROOM * farthest) or 1.0
    out = {}
    for name, p in free.items():
        unit, factor = SHOWN[p["unit"]]
        full, half = scales[_scale(name, p)], p["half_width_95"]
        ends = [_WIDTH / 2 * (1 + value / full) for value in (p["error"] - half, p["error"], p["error"] + half)]
        low, at, high = (min(max(end, 0.0), _WIDTH) for end in ends)
        out[name] = {
            "low": round(low, 2),
            "at": round(at, 2),
            "high": round(high, 2),
            "cut": ends[0] < 0 or ends[2] > _WIDTH,
            "words": f"{number(p['error'] * factor)} ± {number(half * factor, 2)} {unit}",
        }
    return out


def _scale(name: str, p: Mapping[str, Any]) -> tuple[str, bool]:
    """Corrections of links share a scale by unit; so do frames and the rest, which are wherever they are."""
    return p["unit"], name.partition("_")[0] in ("theta", "alpha", "beta", "a", "d")
