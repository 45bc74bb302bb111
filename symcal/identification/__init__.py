"""From measurements to a calibrated robot: model, first values, fit, what was seen, how good, what to doubt."""
