"""A robot's tool pose from its exported JSON alone: what somebody writes who never saw symcal, with NumPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

ORDER = {"standard": ("theta", "d", "a", "alpha", "beta"), "craig": ("alpha", "a", "beta", "theta", "d")}
AXIS = {"theta": 2, "d": 2, "a": 0, "alpha": 0, "beta": 1}


def motion(kind: str, value: float) -> np.ndarray:
    t, axis = np.eye(4), AXIS[kind]
    if kind in ("a", "d"):
        t[axis, 3] = value
        return t
    i, j = (axis + 1) % 3, (axis + 2) % 3
    t[i, i] = t[j, j] = np.cos(value)
    t[j, i], t[i, j] = np.sin(value), -np.sin(value)
    return t


def frame(entry: Mapping[str, Any]) -> np.ndarray:
    x, y, z, w = entry["quat_xyzw"]
    t = np.eye(4)
    t[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    t[:3, 3] = entry["xyz"]
    return t


def frames(data: Mapping[str, Any], q: Sequence[float], delta: Sequence[float]) -> list[np.ndarray]:
    """Of the joints behind their motions, and of the flange, in base."""
    out, t = [], np.eye(4)
    for joint, link, reading, more in zip(data["joints"], data["links"], q, delta, strict=True):
        u = joint["sign"] * joint["ratio"] * reading + joint["offset"] + more
        moved = "theta" if joint["kind"] == "revolute" else "d"
        at = t
        for kind in ORDER[data["convention"]]:
            t = t @ motion(kind, link.get(kind, 0.0) + (u if kind == moved else 0.0))
            at = t if kind in ("theta", "d") else at
        out.append(at)
    return [*out, t]


def tool_pose(data: Mapping[str, Any], q: Sequence[float], conditions: Mapping[str, float] | None = None) -> np.ndarray:
    """T_base_tool, shape (4, 4)."""
    given = dict.fromkeys(data["conditions"], 0.0) | dict(conditions or {})
    at = frames(data, q, [0.0] * len(q))
    delta = [0.0] * len(q)
    for term in data["terms"]:
        delta[term["i"] - 1] += added(data, term, q, at, given)
    return frames(data, q, delta)[-1] @ frame(data["frames"]["tool"])


def added(data: Any, term: Any, q: Sequence[float], at: list[np.ndarray], given: Mapping[str, float]) -> float:
    i, number = term["i"], {label: n["value"] for label, n in term["numbers"].items()}
    turns = data["joints"][i - 1]["kind"] == "revolute"
    m = [joint["sign"] * joint["ratio"] * reading for joint, reading in zip(data["joints"], q, strict=True)]
    down, payload = np.array(data["gravity"]["down"]), data["payload"]

    def lever(on: int, xyz: Sequence[float]) -> float:
        z, o = at[i - 1][:3, 2], at[i - 1][:3, 3]
        p = (at[on - 1] @ [*xyz, 1.0])[:3]
        return float(z @ np.cross(p - o, down)) if turns else float(z @ down)

    arm, flange = 300.0 if turns else 1.0, len(at)
    match term["kind"]:
        case "ratio":
            return number["ratio"] * m[i - 1]
        case "coupling":
            return number[f"by_q{term['by']}"] * m[term["by"] - 1]
        case "harmonics":
            w = q[i - 1] if turns else 2 * np.pi * q[i - 1] / term["pitch"]
            of = ""
            if term["gear"] is not None:
                w, of = term["gear"] * w, "motor_"
            return sum(
                number[f"{of}sin_{k}"] * np.sin(k * w) + number[f"{of}cos_{k}"] * np.cos(k * w) for k in term["k"]
            )
        case "backlash":
            return -number["backlash"] * given[f"q{i}_direction"]
        case "gravity":
            places = {"x": (i, (300, 0, 0)), "y": (i, (0, 300, 0)), "flange": (flange, (0, 0, 0))}
            places |= {f"q{j}": (j, (0, 0, 0)) for j in range(1, flange)}
            return sum(number[f"gravity_{p}"] * lever(*places[p]) / arm for p in term["points"])
        case "payload":
            return number["payload"] * given["payload"] * lever(flange, payload["at"]) / arm
        case "compliance":
            moment = sum(x["kg"] * lever(x["i"], x["at"]) for x in data["masses"] if x["i"] >= i)
            moment += (payload["kg"] + given["payload"]) * lever(flange, payload["at"])
            return number["compliance"] * 9.80665 * moment
    raise AssertionError(term["kind"])
