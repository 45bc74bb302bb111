"""Instruments: what one reading is (a short file per kind)."""

from symcal.instruments.protocol import Edge, Instrument, Keys, Margin, Quantity
from symcal.instruments.registry import KINDS, kind_named, register, seen_by

__all__ = ["KINDS", "Edge", "Instrument", "Keys", "Margin", "Quantity", "kind_named", "register", "seen_by"]
