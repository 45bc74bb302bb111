"""Which terms of the lens a calibration holds at zero: those named, or k3 where the data do not tell it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import NUMBER_NAMES
from symcal.errors import InputError

FIXABLE = ("k1", "k2", "p1", "p2", "k3")
AUTO = "auto"


def fixed_terms(given: str | Iterable[str]) -> frozenset[str] | None:
    """The terms of a text such as `p1,p2,k3` or of a list of names; `none` is none, None for `auto`.

    Raises:
        InputError: a name that is not `FIXABLE`.
    """
    names = [name.strip() for name in (given.split(",") if isinstance(given, str) else given)]
    if names in ([AUTO], ["none"], [""]):
        return None if names == [AUTO] else frozenset()
    for name in names:
        if name not in FIXABLE:
            message = "no term of the lens that can be held at zero (none: no term is)"
            raise InputError(message, key="fix", found=name, allowed=FIXABLE)
    return frozenset(names)


def free_numbers(fixed: frozenset[str], skew: bool) -> NDArray[np.bool_]:
    """Which of `NUMBER_NAMES` are estimated, shape (10,)."""
    return np.array([name not in fixed and (skew or name != "skew") for name in NUMBER_NAMES])
