"""Kinds of observation, a sibling per file: each is h(q, x), its residual, its Jacobian and its noise groups."""

from symcal.measurements.model import Group, Measurement, Setup
from symcal.measurements.pixels import pixels
from symcal.measurements.pose import pose
from symcal.measurements.position import position

__all__ = ["Group", "Measurement", "Setup", "pixels", "pose", "position"]
