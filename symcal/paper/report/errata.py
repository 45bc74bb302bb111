"""Slips in the paper, and what we did instead."""

from __future__ import annotations

from symcal.paper.report.blocks import Block, bullets, heading, paragraph

_ERRATA: tuple[tuple[str, str], ...] = (
    ("Table I", "lists α₅, Table III does not: it cannot be seen, and it is not among our parameters."),
    (
        "Eqs. 5 and 6",
        "M₁ is 3 × 4 and M₂ 4 × 4; what stands as M₁₁ in eqs. 6 to 10 is the upper left 2 × 3 block of M₁.",
    ),
    (
        "Eqs. 7 and 9",
        "drop the change of the depth z: M₁₁ J / z is not the derivative of a projection, which has a second term "
        "−(u, v)ᵀ ∂z / z. Our program can take the exact derivative instead.",
    ),
    (
        "Eq. 8",
        "sets the rotation between robot and camera to the identity: the camera would look straight up along the "
        "base's z. Ours is that of the scene.",
    ),
    (
        "Eq. 10",
        "has its factors in an order that their shapes forbid: J is 3 × 15, M₁₁ is 2 × 3. It must be M₁₁ J / z.",
    ),
    (
        "Eq. 12",
        "minimises c₃ S although the text wants a large triangle. c₃ must be negative (or 1 / S be taken); ours is "
        "negative.",
    ),
    (
        "Eq. 12",
        "takes the condition number over all fifteen columns, with which that of a whole trajectory is infinite at "
        "nominal, where it is planned; ours is over the identifiable ones.",
    ),
    ("Eq. 13", "gives the step, which is to be added to the estimate, and calls it the estimate."),
    (
        "Section II",
        "needs ‘at least five points’ for fifteen unknowns; five points have fifteen coordinates, but no number of "
        "points makes the unseen directions visible.",
    ),
    (
        "Section V",
        "concludes from one draw that the planned trajectory identifies all parameters well; its Table V shows the "
        "opposite for those that take part in unseen directions.",
    ),
)


def errata() -> list[Block]:
    """The list, as found on reading the paper with the model beside it."""
    return [
        heading("Errata of the paper"),
        paragraph(
            "None of them changes what the paper wants; each had to be decided before anything could be computed."
        ),
        bullets([(f"{where}", what) for where, what in _ERRATA]),
    ]
