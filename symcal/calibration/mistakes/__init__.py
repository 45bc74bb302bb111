"""Gross mistakes between the robot file and the measurements: the small finite set of what commonly goes wrong."""
