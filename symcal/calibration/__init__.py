"""From measurements to a calibrated robot: identification, how good it is, what to doubt, and its results as data."""
