"""The table of parameters for people: deg and mm, numbers of one unit with the same decimals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from symcal.words import fixed, number, symbol

Parameters = Mapping[str, Mapping[str, Any]]

_DEGREES = 180 / math.pi
_WITHOUT_SIGMA = {"rad": 4, "mm": 3}
_MOST = 6


def parameter_table(parameters: Parameters) -> dict[str, Any]:
    """Rows in the order of the parameter vector, and the notes that they need.

    Args:
        parameters: by name: nominal, error, identified, sigma (mm, rad; None where not determined), unit, free.
    """
    units = {p["unit"] for p in parameters.values()}
    decimals = {unit: _decimals(parameters, unit) for unit in units}
    rows = [_row(name, p, decimals[p["unit"]]) for name, p in parameters.items()]
    states = {row["state"] for row in rows}
    notes = []
    if any(row["kind"] in ("base", "tool") for row in rows):
        notes.append("Rows of base and tool are increments on the frames that fit the nominal kinematics best.")
    if "open" in states:
        notes.append(
            "Grey rows without a standard deviation (–): the data do not determine this parameter by itself, only "
            "combinations of it with others; its value is the one nearest to nominal and no finding."
        )
    if "fixed" in states:
        notes.append("Rows marked 'fixed' were held at nominal, as the experiment asks.")
    return {"rows": rows, "notes": notes}


def _row(name: str, p: Mapping[str, Any], places: int) -> dict[str, str]:
    factor, unit = (_DEGREES, "deg") if p["unit"] == "rad" else (1.0, p["unit"])
    state = "fixed" if not p.get("free", True) else "open" if p["sigma"] is None else "determined"
    return {
        "symbol": symbol(name),
        "name": name,
        "kind": name.partition("_")[0],
        "nominal": fixed(p["nominal"] * factor, places),
        "error": fixed(p["error"] * factor, places),
        "identified": fixed(p["identified"] * factor, places),
        "sigma": {"fixed": "fixed", "open": "–"}.get(state) or _sigma(p["sigma"] * factor, places),
        "unit": unit,
        "state": state,
    }


def _decimals(parameters: Parameters, unit: str) -> int:
    """So many that the smallest standard deviation has two digits, within reason."""
    factor = _DEGREES if unit == "rad" else 1.0
    known = [p["sigma"] * factor for p in parameters.values() if p["unit"] == unit and p["sigma"]]
    if not known:
        return _WITHOUT_SIGMA.get(unit, 4)
    return min(max(1 - math.floor(math.log10(min(known))), 2), _MOST)


def _sigma(value: float, places: int) -> str:
    return number(value, 2) if 0 < value < 0.5 * 10**-places else fixed(value, places)
