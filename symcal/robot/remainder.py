"""A smooth remainder as a robot file says it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from symcal.documents.document import Document, Key, Strict
from symcal.joints.remainder import Kernel, Remainder

_Rows = Annotated[list[list[float]], Field(min_length=1)]


class RemainderEntry(Strict):
    """lengths: one per joint. centres: joint readings. weights: x, y, z along the axes of the base. amplitude: a
    component's plausible size. In the units of the file."""

    lengths: list[Annotated[float, Field(gt=0)]]
    amplitude: Annotated[float, Field(gt=0)]
    centres: _Rows
    weights: _Rows

    def read(self, document: Document, revolute: Sequence[bool], length: float, angle: float) -> Remainder:
        """In mm and rad.

        Raises:
            InputError: rows of the wrong length, not as many weights as centres, or two centres at one place.
        """
        dof, key = len(revolute), "remainder"
        if len(self.lengths) != dof:
            raise document.error(f"one length per joint: {dof}", (key, "lengths"), found=self.lengths)
        for name, rows, width in (("centres", self.centres, dof), ("weights", self.weights, 3)):
            for i, row in enumerate(rows):
                if len(row) != width:
                    at: Key = (key, name, i)
                    raise document.error(f"rows of {name} have {width} numbers", at, found=row)
        if len(self.weights) != len(self.centres):
            message = f"{len(self.centres)} centres need as many weights"
            raise document.error(message, (key, "weights"), found=len(self.weights))
        units = np.array([angle if turns else length for turns in revolute])
        out = Remainder(
            Kernel(tuple(revolute), np.array(self.lengths) * units),
            np.array(self.centres) * units,
            np.array(self.weights) * length,
            self.amplitude * length,
        )
        try:
            out.told(out.centres)
        except np.linalg.LinAlgError:
            raise document.error("two centres are at one place", (key, "centres")) from None
        return out


def remainder_entry(remainder: Remainder, length: float, angle: float) -> dict[str, Any]:
    """The entry of a robot file."""
    units = np.array([angle if turns else length for turns in remainder.kernel.revolute])
    return {
        "lengths": (remainder.kernel.lengths / units).tolist(),
        "amplitude": float(remainder.amplitude / length),
        "centres": (remainder.centres / units).tolist(),
        "weights": (remainder.weights / length).tolist(),
    }
