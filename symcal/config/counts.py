"""How many of anything a file may ask for."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

MOST = 1_000_000
"""Poses, draws, steps or views: more is a slip of the hand, and would not end. Ours."""

Count = Annotated[int, Field(ge=1, le=MOST)]
