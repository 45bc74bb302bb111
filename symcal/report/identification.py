"""The report of an identification as text: results in, strings for the template out.

Nothing is computed here but units and rounding.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from symcal.report.decision import as_sentence, decision_text, warnings_beside
from symcal.report.extension import extension_text
from symcal.report.frames import frame_table, frames_note
from symcal.report.halves import halves_text
from symcal.report.handover import handover_text
from symcal.report.images import images_text
from symcal.report.instruments import instruments_text
from symcal.report.known import known_table, unseen_length
from symcal.report.learnt import learnt_and_assumed
from symcal.report.measured import (
    Judged,
    fitted_before,
    judged,
    noise_words,
    observers,
    observers_named,
)
from symcal.report.model_check import model_check_text
from symcal.report.outliers import loss_words, outliers_text
from symcal.report.parameter_table import parameter_table
from symcal.report.verdict import judging_part, usable, verdict
from symcal.words import MINUS, fixed, listed, number, percent, plural

Content = Mapping[str, Any]

_STATES = {
    "before_raw": "nominal, frames as given",
    "before": "before: nominal, frames fitted",
    "offsets_only": "joint offsets only",
    "after": "after the identification",
}
_PARTS = {
    "test": "held-out poses",
    "cross_validation": "cross-validation",
    "train": "training poses",
    "truth": "simulated test poses, against the truth",
}
_COLUMNS = ("rms", "mean", "p95", "max")
_MOST_NAMED = 8  # parameters of an unseen direction that are named in the report
_AS_STATED = 1.15  # a factor on the sizes nearer to one than this is no news
_WIDEST = 1e4  # largest ratio of numbers in a column that still share their decimals


def identification_text(content: Content) -> dict[str, Any]:
    """Everything that the template `identification` prints, by section.

    Args:
        content: the results dictionary (results.json).
    """
    return {
        "title": content.get("title") or content["name"],
        "subtitle": _subtitle(content),
        "version": content["versions"].get("symcal", ""),
        "decision": decision_text(content),
        "verdict": verdict(content),
        "usable": usable(content),
        "warnings": [as_sentence(warning) for warning in warnings_beside(content)],
        "accuracy": _accuracy(content),
        "instruments": instruments_text(content),
        "outliers": outliers_text(content),
        "images": images_text(content),
        "extension": extension_text(content),
        "model_check": model_check_text(content.get("model_check")),
        "halves": halves_text(content.get("halves")),
        "identifiability": identifiability_text(content),
        "parameters": parameter_table(content["identification"]["parameters"], content.get("settled", {})),
        "frames": frame_table(content),
        "frames_note": frames_note(content),
        "known": known_table(content.get("known", {})),
        "handover": handover_text(content),
        "facts": _facts(content),
        "inputs": [[path, digest] for path, digest in content["inputs"].items()],
    }


def _subtitle(content: Content) -> str:
    robot, measurement = content["robot"], content["measurement"]
    words = {"train": "training", "test": "held-out"}
    poses = listed([f"{count} {words.get(part, part)}" for part, count in measurement["poses"].items() if count])
    points = measurement.get("points", [])
    of_points = f" of {len(points)} {'axes' if judged(content).unit == 'deg' else 'points'}" if len(points) > 1 else ""
    instruments = observers(content)
    measurements = (
        f"Measurements of {observers_named(instruments)}"
        if len(instruments) > 1
        else f"{measurement['type'].capitalize()} measurements{of_points}"
    )
    return (
        f"{robot['name']}: {plural(robot['dof'], 'joint')}, {robot['convention']} link convention. "
        f"{measurements}, {poses} poses."
    )


# ------------------------------------------------------------------------------------------------------------ accuracy


def _accuracy(content: Content) -> dict[str, Any]:
    parts, what = [part for part in _PARTS if part in content["accuracy"]], judged(content)
    quantities = [q for q in (what.key, "orientation_deg") if _rms_values(content, parts, q)]
    decimals = {q: _shared_decimals(_rms_values(content, parts, q)) for q in quantities}
    groups = []
    for part in parts:
        states = content["accuracy"][part]
        rows = []
        for state in [s for s in _STATES if s in states]:
            cells: list[str] = []
            for q in quantities:
                found = states[state].get(q)
                cells += ["–"] * 4 if found is None else [_cell(found[c], decimals[q]) for c in _COLUMNS]
            rows.append({"label": _STATES[state], "cells": cells, "strong": state == "after"})
        groups.append({"label": _group_label(content, part), "rows": rows})
    angles = "orientation_deg" in quantities
    note = (
        f"{'Sizes of errors' if what.scalar else 'Euclidean norms'} over {what.counted}s"
        f"{', rotation angles over poses' if angles else ''}, "
        f"against the {content['against']}{' unless the truth is named' if 'truth' in parts else ''}. 'Before' is the "
        f"nominal kinematics with {fitted_before(content)} fitted on the training poses; 95 % of the errors are below "
        f"the figure under 95 %.{_whose(content, what)}{_fitted_to_them(content, what)}"
    )
    head = [f"{what.title} / {what.unit}", *(["orientation error / deg"] if angles else [])]
    return {"groups": groups, "head": head, "note": note}


def _whose(content: Content, what: Judged) -> str:
    """Whose errors the table and the figures have, where several instruments measured."""
    if len(observers(content)) < 2:
        return ""
    if what.reader is None and not what.of_tool:
        return " Here and in the figures they are those of all together; those of every one are under Instruments."
    whose = "the instruments that read whole points" if what.reader is None else what.reader
    return f" Here and in the figures they are those of {whose}; those of every instrument are under Instruments."


def _fitted_to_them(content: Content, what: Judged) -> str:
    """What could not be found on training poses, since nothing was read there that tells of it."""
    facts = content["accuracy"][judging_part(content)]["after"][what.key]
    if not facts.get("fitted"):
        return ""
    return (
        f" {plural(facts['fitted'], 'parameter')} of places and points, of which no training pose tells anything, were "
        f"fitted to the {'contacts' if judged(content).touched else 'readings'} that judge; they are taken off the "
        "count in the rms."
    )


def _rms_values(content: Content, parts: Sequence[str], quantity: str) -> list[float]:
    states = [content["accuracy"][part].get(state, {}) for part in parts for state in _STATES]
    return [state[quantity]["rms"] for state in states if state.get(quantity)]


def _shared_decimals(values: Sequence[float]) -> int | None:
    """Decimals that leave the smallest number three digits; None where the numbers differ too much for that."""
    smallest = min(values)
    if smallest <= 0 or max(values) > _WIDEST * smallest:
        return None
    return max(2 - math.floor(math.log10(smallest)), 0)


def _cell(value: float, decimals: int | None) -> str:
    return number(value) if decimals is None else fixed(value, decimals)


def _group_label(content: Content, part: str) -> str:
    facts = content["accuracy"][part]
    folds = f", {facts['folds']} folds" if "folds" in facts else ""
    what = judged(content)
    label = f"{_PARTS[part]} ({plural(facts['after'][what.key]['count'], what.counted)}{folds})"
    return f"{label}: these judge" if part == judging_part(content) and part != "train" else label


# ----------------------------------------------------------------------------------------------------- identifiability


def identifiability_text(content: Content) -> dict[str, Any]:
    """What the data can see, and what they cannot."""
    seen, found = content["identifiability"], content["identification"]
    total, rank = seen["parameters"], seen["rank"]
    text = (
        f"Measurements do not see each of the {plural(total, 'free parameter')} by itself, but combinations of them, "
        f"here called directions. {rank} of {total} {'is' if rank == 1 else 'are'} seen: about these the measurements, "
        "at their noise, say more than the plausible size of an error does"
    )
    if seen.get("numerical_rank") is not None:
        text += f" (without noise there would be {seen['numerical_rank']})"
    text += "."
    if seen.get("condition_number") is not None:
        text += f" The condition number of the seen part is {number(seen['condition_number'])}."
    learning = (
        "Nothing is cut off there. Every free link parameter starts at its nominal value with a plausible size of "
        "error, and the data move it as far as they speak about it. The share of its uncertainty that they took away "
        "was learnt; what they do not tell stays at nominal, with the plausible size as its uncertainty: that part is "
        f"assumed, not found. In all {fixed(found['effective_parameters'], 1)} parameters' worth was learnt from the "
        f"data, frames included. {learnt_and_assumed(found['parameters'])}"
    )
    return {
        "text": text,
        "learning": learning.strip(),
        "length": unseen_length(content),
        "hidden": _hidden(total - rank),
        "unseen": [_unseen(entry) for entry in seen["unseen"]],
    }


def _hidden(count: int) -> str:
    if count == 0:
        return "Every direction is seen."
    if count == 1:
        return "One direction is not seen, or hardly; along it the result is mostly assumed:"
    return f"{count} directions are not seen, or hardly; along these the result is mostly assumed:"


def _unseen(entry: Mapping[str, Any]) -> str:
    """The sentence of an unseen direction; of a long one only the parameters that move most for their scale."""
    direction = entry["direction"]
    if len(direction) > _MOST_NAMED:
        foremost = sorted(direction, key=lambda name: -abs(direction[name]))[:_MOST_NAMED]
        return (
            f"{len(direction)} parameters can be changed together unseen, foremost {listed(foremost)} "
            "(all of them are in results.json)."
        )
    text: str = entry["text"]
    text = re.sub(r"(?<=\s)-(?=[\d.])", MINUS, text)
    return text if text.endswith(".") else f"{text}."


# ------------------------------------------------------------------------------------------------------ how it was made


def _facts(content: Content) -> list[list[str]]:
    found = content["identification"]
    solver = found["solver"].replace("_", " ")
    facts = [
        ["solver", f"{solver}, {plural(found['iterations'], 'accepted step')}; {found['message']}"],
        ["noise", noise_words(content)],
        ["sizes", _sizes(found, sees_length=content["measurement"].get("sees_length", True))],
        [
            "degrees of freedom",
            f"{fixed(found['dof'], 1)}: {found['equations']} equations less {fixed(found['effective_parameters'], 1)} "
            "parameters' worth that was learnt from them",
        ],
    ]
    loss = loss_words(content)
    if loss is not None:
        facts.insert(1, ["loss", loss])
    if found.get("chi_squared") is not None:
        facts.append(["chi-squared", f"{number(found['chi_squared'], 4)}: squared residuals over their variances"])
    if content.get("remainder"):
        facts.append(["smooth remainder", _remainder(content["remainder"])])
    facts.append(["random seed", str(content["seed"])])
    facts.append(["versions", ", ".join(f"{name} {version}" for name, version in content["versions"].items())])
    return facts


def _remainder(found: Mapping[str, Any]) -> str:
    """What became of a smooth displacement over joint readings."""
    text = f"{found['said']}, {found['folds']} folds"
    if not found["kept"]:
        return text
    where = "working area" if found["outside_of"] == "area" else "joint limits"
    return (
        f"{text}; {found['centres']} centres, {number(found['amplitude_mm'])} mm per axis. It is zero away from the "
        f"training poses: at {percent(found['outside'])} of random postures within the {where}"
    )


def _sizes(found: Mapping[str, Any], *, sees_length: bool) -> str:
    """The common factor on the plausible sizes of link errors, and what it means."""
    factor = found["scale_factor"]
    if not found["scale_factor_estimated"]:
        return "plausible sizes of the link parameters' errors as stated"
    if factor > _AS_STATED:
        means = "this robot's errors are larger than was thought plausible"
    elif factor < 1 / _AS_STATED:
        means = "this robot's errors are smaller than was thought plausible"
    else:
        means = "this robot's errors are about as large as was thought plausible"
    text = f"{number(factor)} times the plausible sizes of the link parameters' errors, by marginal likelihood: {means}"
    if sees_length:
        return text
    return f"{text}. The growth of all lengths by one share is held at its stated size whatever the factor"
