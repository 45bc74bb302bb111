"""The first files of a calibration: a robot, an experiment that works as it is, and an empty table for measurements."""
