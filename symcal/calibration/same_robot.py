"""Whether two calibrations are of one robot: the same joints, convention and nominal numbers."""

from __future__ import annotations

from symcal.robot.robot import Robot

_SAME = 1e-6  # of the plausible size of an error: rounding of files


def what_differs(first: Robot, second: Robot) -> str | None:
    """What makes the nominal robots behind two robots different ones, in words; None if they are the same.

    A parameter that one of them does not list is the other's at nominal zero. Names of robots, limits, speeds and where
    base and tool are do not matter. Gravity matters where both have joint terms.
    """
    a, b = first.nominal(), second.nominal()
    if a.dof != b.dof:
        return f"{a.dof} joints and {b.dof}"
    if a.convention != b.convention:
        return f"convention '{a.convention}' and '{b.convention}'"
    for i, (one, other) in enumerate(zip(a.joints, b.joints, strict=True), start=1):
        if one.name != other.name:
            return f"joint {i} is called '{one.name}' and '{other.name}'"
        for key in ("kind", "sign", "ratio", "offset"):
            if getattr(one, key) != getattr(other, key):
                return f"{key} of joint '{one.name}': {getattr(one, key)} and {getattr(other, key)}"
    known = {p.name: p for p in (*a.described, *b.described)}
    for name, p in known.items():
        values = a.parameters.get(name, 0.0), b.parameters.get(name, 0.0)
        if abs(values[0] - values[1]) > _SAME * p.scale:
            return f"nominal {name} of {values[0]:.9g} and {values[1]:.9g} {p.unit}"
    if a.terms and b.terms and (a.down, a.masses, a.payload) != (b.down, b.masses, b.payload):
        return "gravity: its direction, or the masses that it pulls at"
    return None
