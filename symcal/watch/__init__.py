"""A routine check of a robot in service: does its calibration still hold, and if not, what changed."""

OFFSET = "0.5mrad,0.1mm"
"""Offsets of joints that a check is to find, unless others are wanted."""
POSES = 8
"""Of a planned check."""
ALPHA = 0.05
"""Share of good checks that raise a false alarm."""
