"""What tells one pose of a table from another, and what each is called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.documents.table import Table

Array = NDArray[np.float64]


def pose_keys(table: Table, postures: Array) -> list[object]:
    """What tells the posture of each row: its name within its session and file, or its joint readings with its
    conditions."""
    if "pose" in table.columns:
        names = table.text("pose")
        return [(s, n) if s else n for s, n in zip(_sessions(table), names, strict=True)]
    if "point" in table.columns:
        return [tuple(row) for row in postures.tolist()]
    return list(range(len(table)))


def _sessions(table: Table) -> list[str]:
    """The session of every row; of several files after the file, where that is not the session."""
    own = table.text("session") if "session" in table.columns else [""] * len(table)
    if table.of is None:
        return own
    files = [table.origins[i].name for i in table.of]
    return ["/".join(dict.fromkeys(filter(None, parts))) for parts in zip(files, own, strict=True)]


def of_session(table: Table, session: str) -> Table:
    """The rows of a session without its name; nor does that of a file that is the session stand in labels."""
    origins = tuple(replace(each, name="") if each.name == session else each for each in table.origins)
    return replace(table.without("session"), origins=origins)


def provenance_of(table: Table) -> str:
    """The files that a table comes from, as text."""
    return ", ".join(str(origin.path) for origin in table.origins) if table.of is not None else str(table.path)


def labels_of(table: Table, rows: NDArray[np.intp]) -> tuple[str, ...]:
    """What poses are called, by the first row of each: after their session and file, where there are several."""
    if "pose" in table.columns:
        names, sessions = table.text("pose"), _sessions(table)
        return tuple(f"{sessions[i]}/{names[i]}" if sessions[i] else names[i] for i in rows)
    if table.of is None:
        return tuple(str(i) for i in range(len(rows)))
    count = dict.fromkeys(range(len(table.origins)), -1)
    found = []
    for row in rows:
        file = table.of[row]
        count[file] += 1
        found.append("/".join(filter(None, (table.origins[file].name, str(count[file])))))
    return tuple(found)
