"""Two halves of the training poses compared: the sentence, and every division."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.report.decision import as_sentence
from symcal.words import chance, number, plural


def halves_text(found: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Sentence, rows of a table and its note; None where nothing was compared.

    Args:
        found: of results.json.
    """
    if not found:
        return None
    sentence = as_sentence(found["text"])
    if found["agree"] is None:
        return {"sentence": sentence, "rows": [], "note": ""}
    count = len(found["divisions"])
    note = (
        f"By how much the halves of {plural(count, 'division')} differ in what they predict of the tool over the "
        f"{found['over']}, to first order, and what their stated uncertainties let expect. p is the probability of "
        "such a difference by chance, of each division alone; the text has that of the least of all of them. Halves "
        "drawn by chance cannot show what the model lacks, which is for them like more noise; those that a joint "
        "divides do. Noise and sizes of errors are those of all training poses."
    )
    if found.get("aside"):
        note += (
            f" {plural(found['aside'], 'pose')} with gross slips {'is' if found['aside'] == 1 else 'are'} in no half."
        )
    return {"sentence": sentence, "rows": [_row(each, found["division"]) for each in found["divisions"]], "note": note}


def _row(each: Mapping[str, Any], told: str) -> dict[str, Any]:
    cells = [
        each["halves"],
        number(each["difference_rms_mm"], 2),
        number(each["predicted_rms_mm"], 2),
        chance(each["p"]),
    ]
    return {"cells": cells, "strong": each["name"] == told}
