"""A routine check of a robot in service: does its calibration still hold, and if not, what changed."""
