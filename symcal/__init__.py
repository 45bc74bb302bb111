"""Kinematic calibration of serial robots, from the symbolic model to the controller."""
