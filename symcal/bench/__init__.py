"""How fast the package is beside what a user would write: one run, interleaved rounds, ratios with their quartiles."""
