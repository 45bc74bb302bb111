"""Numbers and names as people read them in captions, reports and tables; files keep the plain ones."""

from __future__ import annotations

import math
from collections.abc import Sequence

MINUS = "\N{MINUS SIGN}"

_GREEK = {"theta": "θ", "alpha": "α", "beta": "β", "a": "a", "d": "d"}
_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def symbol(name: str) -> str:
    """A parameter's name as it is printed: `theta_1` is Greek with a lowered number, `tool_P1_x` has spaces."""
    kind, _, rest = name.partition("_")
    if kind in _GREEK and rest.isdecimal() and rest.isascii():
        return _GREEK[kind] + rest.translate(_LOWERED)
    return name.replace("_", " ")


def number(value: float, digits: int = 3) -> str:
    """So many significant digits, trailing zeros kept; powers of ten where zeros would pile up."""
    if not math.isfinite(value):
        return "undefined" if math.isnan(value) else "infinite" if value > 0 else f"{MINUS}infinite"
    if value == 0:
        return "0"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    exponent = int(power)
    if -4 <= exponent < 5:
        return f"{value:.{max(digits - 1 - exponent, 0)}f}".replace("-", MINUS)
    return f"{mantissa} × 10{str(exponent).translate(_RAISED)}".replace("-", MINUS)


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals, for columns that align; no minus before a zero."""
    text = f"{value:.{decimals}f}"
    return (text.lstrip("-") if float(text) == 0 else text).replace("-", MINUS)


def plural(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def listed(words: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
