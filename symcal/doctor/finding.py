"""One line of an examination."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

State = Literal["ok", "note", "broken"]


@dataclass(frozen=True, slots=True)
class Finding:
    """What was looked at, what was found, and what to do.

    state: `ok`; `note`: something is missing, and everything that is required works without it; `broken`: something
    required does not work. do: a command or a short instruction, empty where there is nothing to do.
    """

    subject: str
    state: State
    found: str
    do: str = ""

    def facts(self) -> dict[str, str]:
        """Everything, by name."""
        return asdict(self)
