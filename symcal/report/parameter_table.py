"""The table of parameters for people: deg, mm and such, numbers of one unit with the same decimals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from symcal.parameters import FRAME_AXES
from symcal.report.learnt import was_learnt
from symcal.units import SHOWN
from symcal.words import fixed, is_link_parameter, is_term_number, listed, number, percent, plural, symbol

Parameters = Mapping[str, Mapping[str, Any]]

_WITHOUT_SIGMA = {"rad": 4, "mm": 3}
_MOST = 6
_NAMED = 6  # places and instruments that a note names
_ROBOT = {"base", "tool", "camera"}


def parameter_table(parameters: Parameters, settled: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Rows in the order of the parameter vector, and the notes that they need.

    Args:
        parameters: by name: nominal, error, identified, sigma (mm, rad), learnt (0 to 1), unit, free, unplaced; sigma
            and learnt are None where a parameter was held. Those that no training pose tells are left out.
        settled: what held-out poses told of these.
    """
    unplaced = [name for name, p in parameters.items() if p.get("unplaced")]
    parameters = {name: p for name, p in parameters.items() if name not in unplaced}
    units = {p["unit"] for p in parameters.values()}
    decimals = {unit: _decimals(parameters, unit) for unit in units}
    rows = [_row(name, p, decimals[p["unit"]]) for name, p in parameters.items()]
    states = {row["state"] for row in rows}
    notes = []
    if states & {"learnt", "assumed"}:
        notes.append(
            "Learnt: the share of the uncertainty (variance) before the measurement that the data took away; 75 % "
            "halves the standard deviation."
        )
    if "assumed" in states:
        notes.append(
            "Grey rows, below 50 %, are mostly assumed: the data say little about the parameter by itself; it "
            "is drawn to nominal, and its standard deviation is mostly the size of error that was thought plausible."
        )
    increments = _increments(parameters)
    if increments:
        notes.append(
            f"Rows of {increments} that fit the nominal kinematics best; nothing was "
            "assumed about them, but they carry the uncertainty of link parameters that they cannot be told from."
        )
    if "fixed" in states:
        notes.append("Rows marked 'fixed' were held at nominal, as the experiment asks.")
    if unplaced:
        notes.append(_left_out(unplaced, settled or {}))
    return {"rows": rows, "notes": notes}


def _left_out(unplaced: list[str], settled: Mapping[str, Any]) -> str:
    """What is said of parameters that no training pose tells anything of."""
    things = [name.replace("_", " ") for name in dict.fromkeys(name.rpartition("_")[0] for name in unplaced)]
    if len(things) > _NAMED + 1:
        things = [*things[:_NAMED], f"{len(things) - _NAMED} more"]
    text = f"Left out: {plural(len(unplaced), 'parameter')} of {listed(things)}, which no training pose tells."
    if settled.get("things"):
        text += " Where the held-out poses put them stands in the table of frames."
    numbers = [f"{symbol(n)} {fixed(of['value'], 3)} {of['unit']}" for n, of in settled.get("numbers", {}).items()]
    return f"{text} The held-out poses give {listed(numbers)}." if numbers else text


def _increments(parameters: Parameters) -> str:
    """Which rows are increments, and on what; empty if there are none."""
    robots = {name for name in parameters if is_link_parameter(name) or is_term_number(name)}
    loose = [name for name in parameters if name.rpartition("_")[2] in FRAME_AXES and name not in robots]
    kinds = {name.partition("_")[0] for name in loose}
    if kinds - _ROBOT:
        return "frames and points are increments on those"
    return "base and tool are increments on the frames" if kinds & {"base", "tool"} else ""


def _row(name: str, p: Mapping[str, Any], places: int) -> dict[str, str]:
    unit, factor = SHOWN[p["unit"]]
    held = p["sigma"] is None
    return {
        "symbol": symbol(name),
        "name": name,
        "kind": "term" if is_term_number(name) else name.partition("_")[0],
        "nominal": fixed(p["nominal"] * factor, places),
        "error": fixed(p["error"] * factor, places),
        "identified": fixed(p["identified"] * factor, places),
        "sigma": "fixed" if held else _sigma(p["sigma"] * factor, places),
        "learnt": "–" if held else percent(p["learnt"]),
        "unit": unit,
        "state": "fixed" if held else "learnt" if was_learnt(p) else "assumed",
    }


def _decimals(parameters: Parameters, unit: str) -> int:
    """So many that the smallest standard deviation has two digits, within reason."""
    _, factor = SHOWN[unit]
    known = [p["sigma"] * factor for p in parameters.values() if p["unit"] == unit and p["sigma"]]
    if not known:
        return _WITHOUT_SIGMA.get(unit, 4)
    return min(max(1 - math.floor(math.log10(min(known))), 2), _MOST)


def _sigma(value: float, places: int) -> str:
    return number(value, 2) if 0 < value < 0.5 * 10**-places else fixed(value, places)
