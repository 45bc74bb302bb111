"""The kinds of instrument by name: a kind is registered here and nowhere else."""

from __future__ import annotations

from symcal.errors import InputError
from symcal.instruments.pixels import Pixels
from symcal.instruments.pose import Pose
from symcal.instruments.position import Position
from symcal.instruments.protocol import Kind

KINDS: dict[str, Kind] = {kind.name: kind for kind in (Position(), Pose(), Pixels())}


def kind_named(name: str) -> Kind:
    """The kind of this name.

    Raises:
        InputError: it is not registered.
    """
    if name not in KINDS:
        raise InputError("no such kind of measurement", key="measurement.type", found=name, allowed=KINDS)
    return KINDS[name]
