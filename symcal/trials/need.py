"""What a study answers: how many poses a tolerance needs, or whether it is met, in a sentence for each other choice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from symcal.words import number, percent, plural

Cell = Mapping[str, Any]

OF = {"mean": "mean error", "rms": "rms error", "p95": "95th percentile of the errors", "max": "largest error"}


def judged_words(question: Mapping[str, Any]) -> str:
    """Which error is judged, in words."""
    against = " against measurement" if question["against"] == "measurement" else ""
    return f"{OF[question['of']]}{against}"


def answers(cells: Sequence[Cell], varied: Sequence[str], question: Mapping[str, Any]) -> list[dict[str, Any]]:
    """For every combination of what varies but the number of poses: the answer, and its sentence.

    Args:
        cells: of results.json. varied: axes with more than one value. question: `of`, `share`, `tolerance_mm`.
    """
    others = [axis for axis in varied if axis != "poses"]
    found = []
    for own in groups(cells, others):
        chosen = {axis: own[0]["shown"][axis] for axis in others}
        where = words(own[0], others)
        fewest = _fewest(own, question) if question["tolerance_mm"] is not None else None
        sentence = _sentence(own, fewest, question)
        found.append(
            {
                "where": chosen,
                "poses": None if fewest is None else fewest["shown"]["poses"],
                "sure": fewest is not None and _met(fewest, question, "high"),
                "text": f"{where}: {sentence}" if where else sentence[:1].upper() + sentence[1:],
            }
        )
    return found


def groups(cells: Sequence[Cell], axes: Sequence[str]) -> list[list[Cell]]:
    """Cells that have the same values on these axes, together."""
    found: dict[tuple[Any, ...], list[Cell]] = {}
    for cell in cells:
        found.setdefault(tuple(cell["shown"][axis] for axis in axes), []).append(cell)
    return list(found.values())


def _met(cell: Cell, question: Mapping[str, Any], bound: str) -> bool:
    value = cell["judged_mm"]["at_share"][bound]
    return value is not None and value <= question["tolerance_mm"]


def _fewest(cells: Sequence[Cell], question: Mapping[str, Any]) -> Cell | None:
    """The cell of fewest poses that meets the tolerance, as do all with more."""
    found = None
    for cell in sorted(cells, key=lambda each: -each["shown"]["poses"]):
        if not _met(cell, question, "value"):
            break
        found = cell
    return found


def _sentence(cells: Sequence[Cell], fewest: Cell | None, question: Mapping[str, Any]) -> str:
    tolerance, what = question["tolerance_mm"], judged_words(question)
    share = percent(question["share"])
    ordered = sorted(cells, key=lambda each: each["shown"]["poses"])
    if tolerance is None:
        parts = [f"{_quantile(cell)} with {plural(cell['shown']['poses'], 'pose')}" for cell in ordered]
        return f"in {share} of the trials the {what} is at most {'; '.join(parts)}"
    if fewest is None:
        best = min(ordered, key=lambda each: each["judged_mm"]["at_share"]["value"] or float("inf"))
        far = f"{plural(best['shown']['poses'], 'pose')} leave {_quantile(best)}, the least of what was tried"
        if best["judged_mm"]["at_share"]["value"] is None:
            far = "too many trials fail"
        return f"{tolerance:g} mm cannot be met: {far}, for the {what} in {share} of the trials"
    poses = plural(fewest["shown"]["poses"], "pose")
    met = f"{poses} {'is' if fewest['shown']['poses'] == 1 else 'are'} enough for {tolerance:g} mm"
    met += f": in {share} of the trials the {what} is at most {_quantile(fewest)}"
    if not _met(fewest, question, "high"):
        met += ", which so few trials do not settle"
    fewer = [cell for cell in ordered if cell["shown"]["poses"] < fewest["shown"]["poses"]]
    if fewer:
        less = fewer[-1]
        value = less["judged_mm"]["at_share"]["value"]
        met += f"; with {less['shown']['poses']} it is " + (
            "larger, because trials fail" if value is None else _quantile(less)
        )
    elif len(ordered) > 1:
        met += "; fewer were not tried"
    return met


def _quantile(cell: Cell) -> str:
    """Value with its bounds."""
    found = cell["judged_mm"]["at_share"]
    if found["value"] is None:
        return millimetres(None)
    return f"{number(found['value'])} mm ({bounds(found)})"


def millimetres(value: float | None) -> str:
    """A quantile without its unit, as tables have it."""
    return "infinity" if value is None else number(value)


def bounds(found: Mapping[str, float | None]) -> str:
    """Those of a quantile, mm."""
    return f"{millimetres(found['low'])} to {millimetres(found['high'])}"


def said(axis: str, value: Any) -> str:
    """A value of the grid as people read it."""
    if axis == "errors":
        return f"true errors {value}"
    if axis == "size":
        return f"errors times {value:g}"
    if axis == "plan":
        return "random plans" if value == "random" else f"plan {value}"
    if axis.startswith("noise_"):
        return f"{axis.removeprefix('noise_')} noise {value:g}"
    return f"{value} poses" if axis == "poses" else str(value)


def words(cell: Cell, axes: Sequence[str]) -> str:
    """A cell by its values on some axes."""
    return ", ".join(said(axis, cell["shown"][axis]) for axis in axes)


def label(cell: Cell, varied: Sequence[str]) -> str:
    """A cell by what varies."""
    return words(cell, varied) or "all trials"
