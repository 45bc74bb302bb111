"""Numbers and names as people read them in captions, reports and tables; files keep the plain ones."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

MINUS = "\N{MINUS SIGN}"

MOSTLY = 0.5
"""Share of a parameter's uncertainty that the data must take away before people are told that it was learnt."""

_GREEK = {"theta": "θ", "alpha": "α", "beta": "β", "a": "a", "d": "d"}
_TERM = re.compile(r"q[0-9]+_")
_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_LEAST = 1e-12  # probability that is written out
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def symbol(name: str) -> str:
    """A parameter's name as it is printed: `theta_1` is Greek with a lowered number, `tool_P1_x` has spaces, and
    `q2_sin_1` of a joint term both."""
    if is_link_parameter(name):
        kind, _, rest = name.partition("_")
        return _GREEK[kind] + rest.translate(_LOWERED)
    if is_term_number(name):
        joint, _, rest = name.partition("_")
        return f"q{joint[1:].translate(_LOWERED)} {rest.replace('_', ' ')}"
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


def chance(p: float) -> str:
    """A probability of something by chance in one or two digits; below 1e-12, where no law holds, as a bound."""
    return number(p, 2 if p >= 1e-3 else 1) if p >= _LEAST else f"< {number(_LEAST, 1)}"


def p_value(p: float) -> str:
    """`p = 0.69`, `p < 1 × 10⁻¹²`."""
    return f"p {chance(p)}" if p < _LEAST else f"p = {chance(p)}"


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals, for columns that align; no minus before a zero."""
    text = f"{value:.{decimals}f}"
    return (text.lstrip("-") if float(text) == 0 else text).replace("-", MINUS)


def percent(share: float) -> str:
    """A share in whole percent, never rounded up: 49.9 % is not half, and 100 % is all but a hundred-thousandth."""
    return f"{math.floor(100 * share + 1e-3)}\u00a0%"


def rounded_down(share: float) -> str:
    """A share with four decimals, never rounded up, so that a lower bound stays one."""
    return f"{math.floor(share * 1e4) / 1e4:.4f}"


def is_link_parameter(name: str) -> bool:
    """Whether a name is that of a link parameter (`theta_1`, `a_4`), not of a frame, a point or a camera."""
    kind, _, rest = name.partition("_")
    return kind in _GREEK and rest.isdecimal() and rest.isascii()


def is_term_number(name: str) -> bool:
    """Whether a name is that of a number of a joint term (`q2_sin_1`)."""
    return _TERM.match(name) is not None


def free_parameters(names: Sequence[str]) -> str:
    """How many free parameters of a robot, and of what."""
    if any(is_term_number(name) for name in names):
        return f"{plural(len(names), 'free parameter')} of links and joint terms"
    return plural(len(names), "free link parameter")


def plural(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def in_short(names: Sequence[str], most: int = 8) -> str:
    """Names with commas; of many their number, and the first and last of them."""
    if len(names) <= most:
        return ", ".join(names)
    return f"{len(names)} points ({names[0]} to {names[-1]})"


def listed(words: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


GIVEN = "given_poses"
"""The robot whose flange pose is data (`symcal.robot.given`), and what an experiment says instead of its file."""
