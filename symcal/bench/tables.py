"""What a bench found as rows of text: the same for the terminal and for Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class TextTable:
    """rows: cells as text, those after the first to be aligned right. notes: sentences below."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def tables(content: Mapping[str, Any]) -> list[TextTable]:
    """All tables of a bench.json."""
    return [*(_contest(each) for each in content["contests"]), *(_growth(each) for each in content["growth"])]


def machine_lines(content: Mapping[str, Any]) -> list[str]:
    """The machine, what is installed, and what to doubt."""
    facts = content["machine"]
    versions = {"python": facts["python"], **facts["packages"]}
    load = "unknown" if facts["load"] is None else f"{facts['load']:g}"
    return [
        f"{facts['processor']}, {facts['cores']} cores, {' '.join(facts['flags'])}; {facts['system']}",
        f"compiler: {facts['compiler'] or 'none'}; SYMCAL_KERNELS: {facts['kernels']}; load: {load}",
        ", ".join(f"{name} {found or 'not installed'}" for name, found in versions.items()),
        "peers: " + ", ".join(f"{name} {found}" for name, found in content["peers"].items()),
        "one core (commands: all), one thread of linear algebra; medians of processor time over rounds in turn, ratios "
        "within a round",
        *(f"warning: {each}" for each in content["warnings"]),
    ]


def duration(seconds: float) -> str:
    """Three digits and a unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}" if seconds < 1000 * size else f"{seconds / size:.0f} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def times(value: float) -> str:
    """How many times as fast: three digits, never a power of ten."""
    if value >= 100:
        return f"{value:.0f}"
    return f"{value:.3g}" if value >= 1e-3 else f"{value:.1g}" if value >= 1e-4 else f"{value:.6f}"


def _contest(contest: Mapping[str, Any]) -> TextTable:
    commands = contest["subject"] == "commands"
    per = f"time per {contest['unit']}"
    heads = ("", per, "of the clock", "peak") if commands else ("", per, "times as fast", "quartiles", "differs by")
    rows = [_command(entry) if commands else _entry(entry) for entry in contest["entries"]]
    notes = [f"{name}: {why}" for name, why in contest["absent"].items()]
    if not commands and contest["entries"]:
        notes.insert(0, f"1 is {contest['reference']}; differs by: {contest['compared']}, relative")
    return TextTable(contest["name"], heads, tuple(rows), tuple(notes))


def _command(entry: Mapping[str, Any]) -> tuple[str, ...]:
    peak = "" if entry["peak_mb"] is None else f"{entry['peak_mb']:.0f} MB"
    return entry["name"], duration(entry["seconds"]["median"]), duration(entry["wall"]["median"]), peak


def _entry(entry: Mapping[str, Any]) -> tuple[str, ...]:
    ratio = entry["ratio"]
    shown = (
        ("", "") if ratio is None else (times(ratio["median"]), f"{times(ratio['lower'])} .. {times(ratio['upper'])}")
    )
    return entry["name"], duration(entry["seconds"]["median"]), *shown, f"{entry['difference']:.1e}"


def _growth(panel: Mapping[str, Any]) -> TextTable:
    sizes = sorted({size for curve in panel["curves"] for size in curve["sizes"]})
    rows = []
    for curve in panel["curves"]:
        found = dict(zip(curve["sizes"], curve["seconds"], strict=True))
        cells = [duration(found[size]) if size in found else "" for size in sizes]
        rows.append((curve["name"], *cells, "" if curve["power"] is None else f"{curve['power']:.2f}"))
    heads = (panel["variable"], *(f"{size:,}".replace(",", " ") for size in sizes), "power")
    return TextTable(
        f"{panel['name']}, by {panel['variable']}",
        heads,
        tuple(rows),
        ("power: k of time ~ size^k over the last three sizes",),
    )


def markdown(content: Mapping[str, Any], more: list[TextTable]) -> str:
    """Everything as a Markdown file."""
    parts = ["# symcal bench", "\n".join(f"- {line}" for line in machine_lines(content))]
    for table in [*tables(content), *more]:
        lines = [f"## {table.title}", "", _row(table.heads), _row(("---", *("---:" for _ in table.heads[1:])))]
        lines += [_row(row) for row in table.rows]
        lines += ["", *(f"{note}.  " for note in table.notes)]
        parts.append("\n".join(lines).rstrip())
    return "\n\n".join(parts) + "\n"


def _row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
