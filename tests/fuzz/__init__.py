"""Mutated inputs for everything that reads: `python -m tests.fuzz 10000` from the root of the project."""
