"""Which poses to measure, how many, and how good they are at least."""
