"""A gross mistake in words and as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

_SHOWN = 4  # of a class


@dataclass(frozen=True, slots=True)
class Mistake:
    """A gross mistake, or a class of those that the data do not tell apart.

    kind: of the foremost. hypotheses: what may be wrong, one of these. before, after: rms of what no frames explain, as
    given and with the mistake undone, in ``unit``. fatal: the data cannot be used as they are, however well they fit.
    """

    kind: str
    hypotheses: tuple[str, ...]
    text: str
    before: float
    after: float
    unit: str
    fatal: bool = False


def mistake_of(
    kind: str, texts: tuple[str, ...], before: float, after: float, unit: str, judge: str = "frames"
) -> Mistake:
    """A mistake in words; judge: what explains the data, `frames` or `the identification`."""
    does = "do" if judge == "frames" else "does"
    what = f"with it what {judge} {does} not explain goes from {before:.4g} to {after:.3g} {unit} rms"
    if len(texts) == 1:
        text = f"the data look as if {texts[0]}: {what}"
    else:
        shown = "; or ".join(texts[:_SHOWN]) + (f"; or {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else "")
        text = f"the data look as if one of these were so, they cannot tell which: {shown}. {what[0].upper()}{what[1:]}"
    return Mistake(kind, texts, text, before, after, unit)


def mistake_facts(found: Sequence[Mistake]) -> list[dict[str, Any]]:
    """Mistakes as plain data (results.json)."""
    return [
        {
            "kind": each.kind,
            "class": list(each.hypotheses),
            "text": each.text,
            "before": each.before,
            "after": each.after,
            "unit": each.unit,
        }
        for each in found
    ]
