"""What the paper could not see: directions that positions do not determine, and what to do about them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from symcal.paper.report.blocks import Block, bullets, figures, heading, paragraph, row, span, table
from symcal.words import MINUS, fixed, listed, number, symbol

Content = Mapping[str, Any]

_REASONS = {
    frozenset({"theta_5"}): "With a₅ = 0 the last origin lies on the axis of the last joint, and turning about an axis "
    "moves no point on it.",
    frozenset(
        {"theta_4", "a_4"}
    ): "The last {d_5} mm stand across the elbow's axis: a small turn of the elbow moves their "
    "end along x, and so does a₄.",
    frozenset({"alpha_4", "d_4"}): "Tilting the last {d_5} mm moves their end along the elbow's axis, and so does d₄.",
    frozenset({"alpha_4", "d_3"}): "Tilting the last {d_5} mm moves their end along the elbow's axis, and so does d₃.",
    frozenset({"d_3", "d_4"}): "Reach and elbow have parallel axes: an offset may sit in either.",
}
"""Why the paper's robot has its unseen directions."""

_METHODS = {"unregularised": "all free, as in the paper", "posterior": "plausible sizes as prior"}


def unseen(content: Content) -> list[Block]:
    """Rank, directions, and what to do about them."""
    gauge = content["gauge"]
    nominal, truth, target = gauge["nominal"], gauge["truth"], gauge["three_target_points"]
    last = _last_length(content)
    items = [_direction(entry, last) for entry in nominal["unseen"]]
    left = nominal["parameters"] - nominal["rank"]
    return [
        heading("What the paper could not see: the parameters"),
        paragraph(
            f"At the noise of Simulation II the data determine {nominal['rank']} of {nominal['parameters']} directions "
            "in the space of the error parameters better than a plausible error (1 mm, 10 mrad); the other "
            f"{left} do not change any measured position at nominal. At the true errors they do, by so little that the "
            f"rank at this noise is {truth['rank']} all the same ([@paper_spectra]). The paper's sentence that all "
            "error parameters are well solved therefore cannot hold, whatever the trajectory:"
        ),
        bullets(items),
        *_table_v(content),
        figures("paper_spreads"),
        paragraph(
            "What helps is not another trajectory. Either the parameters are kept near nominal where nothing is known "
            "of them, with their plausible sizes as prior, which costs no accuracy ([@methods]); or more is measured: "
            "all "
            f"three points of the paper's own target instead of one show {target['rank']} of {target['parameters']}"
            + (f", and only {_names(target['unseen'][0])} stay together." if len(target["unseen"]) == 1 else ".")
        ),
        _methods(content),
        figures("paper_spectra"),
    ]


def _last_length(content: Content) -> float:
    """Nominal d of the last link, mm."""
    return float(content["model"]["links"][-1]["parameters"].get("d", 0.0))


def _direction(entry: Mapping[str, Any], last: float) -> tuple[str, str]:
    names = list(entry["direction"])
    text = entry["text"]
    _, _, amounts = text.partition(": ")
    for name in sorted(names, key=len, reverse=True):
        amounts = amounts.replace(name, symbol(name))
    reason = _REASONS.get(frozenset(names), "").format(d_5=f"{last:g}")
    words = f"{amounts.replace(' -', f' {MINUS}').removeprefix('-')}. " if amounts else ""
    lead = f"{symbol(names[0])}." if len(names) == 1 else f"{listed([symbol(n) for n in names])}."
    return lead, (words + reason).strip() or f"{text}."


def _names(entry: Mapping[str, Any]) -> str:
    return listed([symbol(name) for name in entry["direction"]])


def _table_v(content: Content) -> list[Block]:
    """Why the paper's identified values are no finding there."""
    paper = content["simulation_2"]["paper"]["optimal"]
    judged, table_v = paper["parameters_at_our_test_poses"], paper["parameters"]
    if not judged or not {"alpha_4", "theta_5", "d_3", "d_4"} <= set(table_v):
        return []
    last = _last_length(content)
    along, total = last * table_v["alpha_4"], table_v["d_3"] + table_v["d_4"]
    true = {n: p["true_error"] for n, p in content["simulation_1"]["parameters"].items()}
    left = true["d_3"] + true["d_4"] + last * true["alpha_4"]
    printed = content["printed"]["optimal"]
    reduced = printed["reduced"]
    return [
        paragraph(
            f"Its Δα₄ = {fixed(table_v['alpha_4'], 4)} rad moves the end of the last {last:g} mm by {fixed(along, 2)} "
            f"mm along the elbow's axis, and Δd₃ + Δd₄ = {fixed(total, 2)} mm move it back: {fixed(total + along, 2)} "
            f"mm are left of both, where the true robot has {fixed(left, 2)}. Its Δθ₅ = {fixed(table_v['theta_5'], 4)} "
            "rad turns a frame about its own origin. None of these is a finding about the robot. Without their unseen "
            f"part the paper's values are Δα₄ = {fixed(reduced['alpha_4'], 4)}, Δθ₅ = {fixed(reduced['theta_5'], 4)} "
            f"rad, Δd₃ = {fixed(reduced['d_3'], 3)} and Δd₄ = {fixed(reduced['d_4'], 3)} mm ([@table_5]) and predict "
            f"the same positions to {number(printed['moved_mm'], 2)} mm rms. Typed into a controller, Table V does no "
            "harm where the point is measured, but it turns the tool by "
            f"{fixed(math.degrees(printed['turned_rad']), 1)}° from where it is, and every longer tool goes astray by "
            "as much.",
            lead="Table V.",
        )
    ]


def _methods(content: Content) -> Block:
    gauge = content["gauge"]
    rows = []
    for key, label in _METHODS.items():
        entry = gauge["methods"][key]
        spread = {name: entry["sd"][name] for name in entry["sd"]}
        cells = [
            span(entry["true_rms_mm"]),
            number(entry["true_rms_over_cramer_rao"]),
            *(
                number(spread[name], 2) if name in spread else "–"
                for name in ("theta_5", "alpha_4", "a_4", "d_3", "d_4")
            ),
        ]
        rows.append(row(label, *cells, strong=key == "posterior"))
    return table(
        "methods",
        "Two ways to treat what is not seen",
        f"Over {gauge['repetitions']} draws of the noise on the certified plan: rms error against truth (median and 5 "
        "to 95 %, mm), relative to the Cramér–Rao bound of the identifiable directions, and standard deviation of the "
        "parameters that the paper reports (rad, mm).",
        ["", "error against truth", "over bound", "θ₅", "α₄", "a₄", "d₃", "d₄"],
        rows,
        groups=[("", 3), ("standard deviation", 5)],
    )
