"""The table of frames for people: where base, tool, instruments, targets and points are, and what told it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from symcal.parameters import FRAME_AXES
from symcal.report.measured import Facts, observers, stands_on, unknowns
from symcal.words import fixed

Content = Mapping[str, Any]

_OF_THE_ROBOT, _CAMERA = ("base", "tool"), "camera"
_POINTS = "points_mm"


def frame_table(content: Content) -> list[dict[str, Any]]:
    """Frames of robot, instruments and targets, then the points."""
    frames, instruments = content.get("frames", {}), observers(content)
    estimated, unknown = content["measurement"].get("estimate", []), unknowns(instruments)
    settled = content.get("settled", {}).get("things", [])
    rows: list[dict[str, Any]] = []
    for name, frame in frames.items():
        if name != _POINTS:
            cells = [fixed(v, 3) for v in frame["xyz_mm"]] + [fixed(v, 4) for v in frame["rpy_deg"]]
            rows.append(
                {
                    "label": _frame_label(name, instruments),
                    "cells": cells,
                    "estimated": _settled(_how_far(name, unknown), name in settled)
                    or ("estimated" if name in estimated else ""),
                }
            )
    for name, xyz in frames.get(_POINTS, {}).items():
        target = _target_of(name, instruments)
        called = f"tool_{name}" if target == "tool" else name
        rows.append(
            {
                "label": f"point {name} in {target if target in frames else stands_on(target, instruments)}",
                "cells": [*(fixed(v, 3) for v in xyz), "", "", ""],
                "estimated": _settled("estimated", called in settled)
                if (called in unknown if instruments else "points" in estimated)
                else "",
            }
        )
    return rows


def frames_note(content: Content) -> str:
    note = "Rotation R = Rz(yaw) Ry(pitch) Rx(roll)."
    if content.get("settled", {}).get("things"):
        note += " What comes from held-out poses was fitted to these alone, the identified robot held."
    return note


def _how_far(name: str, unknown: Collection[str]) -> str:
    """What of a place was estimated: of some instruments neither all turns nor all shifts mean anything."""
    axes = [axis for axis in FRAME_AXES if f"{name}_{axis}" in unknown]
    if len(axes) in (0, len(FRAME_AXES)):
        return "estimated" if axes else ""
    return f"{', '.join(axes)} estimated"


def _settled(words: str, later: bool) -> str:
    """Where held-out poses alone told a place."""
    return words.replace("estimated", "from held-out poses") if later else words


def _frame_label(name: str, instruments: Facts) -> str:
    """`base in world`; of an instrument or a target its name, and on what it stands."""
    on = stands_on(name, instruments)
    if name in _OF_THE_ROBOT or (name == _CAMERA and on in (None, "world")):
        return f"{name} in {'flange' if name == 'tool' else 'world'}"
    return f"{name} on {on}" if on else name


def _target_of(point: str, instruments: Facts) -> str:
    """The target whose name a point's begins with; the tool, whose points have no other."""
    others = {facts["target"] for facts in instruments} - {"tool"}
    return max((target for target in others if point.startswith(f"{target}_")), key=len, default="tool")
