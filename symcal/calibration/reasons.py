"""Why a calibration is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

Kind = Literal[
    "unsettled",
    "implausible",
    "mistake",
    "unjudged",
    "no_gain",
    "worthless",
    "position",
    "orientation",
    "unseen",
    "coverage",
    "lack_of_fit",
    "outlier",
    "halves",
    "remainder",
]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a calibration is refused; parameter: the one that is to blame, where it is one."""

    kind: Kind
    text: str
    parameter: str = ""
