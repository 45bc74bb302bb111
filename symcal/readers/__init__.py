"""Readers of other files than CSV: sheets, recordings, trajectories, pose pairs; each gives a table of measurements."""
