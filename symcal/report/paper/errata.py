"""Slips in the paper, and what we did instead."""

from __future__ import annotations

from symcal.report.paper.blocks import Block, bullets, heading, paragraph

_ERRATA: tuple[tuple[str, str], ...] = (
    ("Table I", "lists α₅, Table III does not: it cannot be seen, and it is not among our parameters."),
    ("Eq. 5", "calls M₁ a 3 × 4 and M₂ a 4 × 4 matrix; M₁₁ in eq. 6 is then the upper left 2 × 3 block of M₁."),
    (
        "Eqs. 7 and 9",
        "drop the change of the depth z: M₁₁ J / z is not the derivative of a projection, which has a second term "
        "−(u, v)ᵀ ∂z / z. The reading ‘exact derivative’ of our fitness has it.",
    ),
    ("Eq. 8", "sets the rotation between robot and camera to the identity. We keep it."),
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
        "takes condition numbers over all fifteen columns; at nominal, where the plan is made, they are infinite.",
    ),
    ("Eq. 13", "gives the step, which is to be added to the estimate, and calls it the estimate."),
    (
        "Section IV",
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
