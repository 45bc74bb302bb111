"""Which poses to measure, how many, and a proof of how good they are."""
