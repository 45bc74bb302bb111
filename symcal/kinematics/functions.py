"""Expressions as named functions."""

from __future__ import annotations

import casadi as ca

SX = ca.SX


def function(name: str, inputs: dict[str, SX], outputs: dict[str, SX]) -> ca.Function:
    """A named function of dense outputs with common subexpressions shared."""
    dense = ca.cse([ca.densify(expression) for expression in outputs.values()])
    return ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs))
