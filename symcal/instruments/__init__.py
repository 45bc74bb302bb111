"""Instruments: what one reading is (a short file per kind), and how an instrument reads a target on a robot."""

from symcal.instruments.measurement import Group, Measurement, Setup
from symcal.instruments.observe import observe
from symcal.instruments.protocol import Kind
from symcal.instruments.registry import KINDS, kind_named

__all__ = ["KINDS", "Group", "Kind", "Measurement", "Setup", "kind_named", "observe"]
