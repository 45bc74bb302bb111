"""How URScript, RAPID and KRL write targets: joints, and frames with what they say of the posture.

Sources: as in `symcal.programs.languages`. Of a RAPID robtarget cf1, cf4 and cf6 are the quadrants of axes 1, 4 and 6;
of a KRL position bit i of T says that axis i + 1 is below zero. S and cfx are not read: a target that they alone make
clear is left where that matters (`symcal.programs.correct`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from symcal.programs.literals import NUMBER, Grammar, Kind, Literal, numbers

_NONE = r"(?:9[eE]\+?0?9|" + NUMBER + ")"
_JOINTTARGET = re.compile(rf"\[\s*\[(?P<own>[^\[\]]*)\]\s*,\s*\[\s*{_NONE}(?:\s*,\s*{_NONE}){{5}}\s*\]\s*\]")
_ROBTARGET = re.compile(
    r"\[\s*\[(?P<place>[^\[\]]*)\]\s*,\s*\[(?P<turn>[^\[\]]*)\]\s*,\s*\[(?P<cf>[^\[\]]*)\]\s*,"
    rf"\s*\[\s*{_NONE}(?:\s*,\s*{_NONE}){{5}}\s*\]\s*\]"
)
_LIST = re.compile(r"\[(?P<own>[^\[\]]*)\]")
_POSE = re.compile(r"p\s*\[(?P<own>[^\[\]]*)\]")
_AGGREGATE = re.compile(r"\{\s*(?:\w+\s*:\s*)?(?P<own>[^{}]*)\}")
_ENTRY = re.compile(rf"\s*(?P<name>[A-Za-z]\d?)\s+(?P<value>{NUMBER})\s*")


def _urscript(code: str, at: int) -> Literal | None:
    if (pose := _POSE.match(code, at)) and (values := numbers(pose["own"], 6)) is not None:
        return Literal("frame", pose.start("own"), pose.end("own"), values, pose[0])
    if (joints := _LIST.match(code, at)) and (values := numbers(joints["own"], 6)) is not None:
        return Literal("joints", joints.start("own"), joints.end("own"), values, joints[0])
    return None


def _rapid(code: str, at: int) -> Literal | None:
    if (joints := _JOINTTARGET.match(code, at)) and (values := numbers(joints["own"], 6)) is not None:
        return Literal("joints", joints.start("own"), joints.end("own"), values, joints[0])
    if (frame := _ROBTARGET.match(code, at)) is None:
        return None
    place, turn, cf = (numbers(frame[name], count) for name, count in (("place", 3), ("turn", 4), ("cf", 4)))
    if place is None or turn is None or cf is None:
        return None
    posture = {axis: (90 * cf[k], 90 * cf[k] + 90) for k, axis in enumerate((0, 3, 5))}
    return Literal("frame", frame.start("place"), frame.end("turn"), (*place, *turn), frame[0], posture)


def _krl(code: str, at: int) -> Literal | None:
    found = _AGGREGATE.match(code, at)
    if found is None:
        return None
    entries: dict[str, float] = {}
    for part in found["own"].split(","):
        entry = _ENTRY.fullmatch(part)
        if entry is None or entry["name"].upper() in entries:
            return None
        entries[entry["name"].upper()] = float(entry["value"])
    kinds: dict[Kind, tuple[str, ...]] = {"joints": ("A1", "A2", "A3", "A4", "A5", "A6"), "frame": tuple("XYZABC")}
    for kind, names in kinds.items():
        if tuple(entries)[:6] == names:
            start, last = found.start("own"), list(_ENTRY.finditer(found["own"]))[5]
            posture = _turns(entries) if kind == "frame" else {}
            values = tuple(entries[name] for name in names)
            return Literal(kind, start, start + last.end("value"), values, found[0], posture)
    return None


def _turns(entries: Mapping[str, float]) -> dict[int, tuple[float, float]]:
    if "T" not in entries:
        return {}
    bits = int(entries["T"])
    return {axis: (-360.0, 0.0) if bits >> axis & 1 else (0.0, 360.0) for axis in range(6)}


GRAMMARS: Mapping[str, Grammar] = {
    "urscript": Grammar(
        comment="#",
        motion=re.compile(r"(?<![\w.])move[jlpc]\(\s*"),
        target=_urscript,
        declaration=re.compile(r"(?<![\w.])(?:global\s+|local\s+)?(?P<name>[A-Za-z_]\w*)\s*=\s*(?=p?\s*\[)"),
        stop=re.compile(r"\s*[,)]"),
        relative=re.compile(r"(?!)"),
        ignore_case=False,
    ),
    "rapid": Grammar(
        comment="!",
        motion=re.compile(r"(?<!\w)Move(?:AbsJ|[JLC])(?:DO|Sync|AO|GO)?(?:\s*\\Conc\s*,)?\s+", re.IGNORECASE),
        target=_rapid,
        declaration=re.compile(
            r"(?<!\w)(?:CONST|PERS|VAR)\s+(?:jointtarget|robtarget)\s+(?P<name>\w+)\s*:=\s*", re.IGNORECASE
        ),
        stop=re.compile(r"\s*(?:\\\w+(?::=\w+)?\s*)*,"),
        relative=re.compile(r"(?!)"),
        ignore_case=True,
    ),
    "krl": Grammar(
        comment=";",
        motion=re.compile(r"(?<![\w$])S?(?:PTP|LIN|CIRC)(?:_REL)?(?=[\s{])\s*", re.IGNORECASE),
        target=_krl,
        declaration=re.compile(
            r"(?<![\w$])(?:(?:GLOBAL\s+)?(?:DECL\s+)?(?:E6POS|E6AXIS|POS|AXIS|FRAME)\s+)?(?P<name>[A-Za-z$_][\w$]*)\s*=\s*(?=\{)",
            re.IGNORECASE,
        ),
        stop=re.compile(r"\s*(?:C_(?:PTP|DIS|VEL|ORI)\s*)*(?:,|\n|$)", re.IGNORECASE),
        relative=re.compile(r"S?(?:PTP|LIN|CIRC)_REL", re.IGNORECASE),
        ignore_case=True,
    ),
}

SUFFIXES: Mapping[str, str] = {
    ".script": "urscript",
    ".urscript": "urscript",
    ".mod": "rapid",
    ".prg": "rapid",
    ".sys": "rapid",
    ".src": "krl",
    ".dat": "krl",
}
"""The language of a file."""
