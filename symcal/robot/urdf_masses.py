"""What the joints of a URDF chain carry: masses and centres of the links behind each, one mass per joint.

Links behind fixed joints belong to the joint that carries them, branches off the chain (a gripper's fingers, another
arm) too, as they stand with their own readings at zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.joints.arm import Mass
from symcal.robot.conventions import joint_frames
from symcal.robot.robot import Robot
from symcal.robot.urdf_xml import MM, Element, numbers, origin
from symcal.spatial import inverse

Array = NDArray[np.float64]

_LENGTH_ZERO = 1e-9  # mm: a rounding error of a product of frames


def carried_masses(path: Path, root: Element, joints: Sequence[Element], robot: Robot) -> tuple[Mass, ...]:
    """The masses that the joints of a chain carry, in the joints' frames of the robot that was made of it.

    Args:
        joints: of the chain, from base to tip, fixed ones included.
    Raises:
        InputError: a mass or a centre is no number, or a mass negative; with its line.
    """
    links = {child.attributes.get("name", ""): child for child in root.children if child.tag == "link"}
    branches: dict[str, list[Element]] = {}
    for joint in (child for child in root.children if child.tag == "joint" and child not in joints):
        branches.setdefault(joint.get("parent", "link") or "", []).append(joint)
    out: list[Mass] = []
    frames, at, on = joint_frames(robot), np.eye(4), 0
    met = {joint.get(end, "link") or "" for joint in joints for end in ("parent", "child")}
    carried: list[tuple[float, Array]] = []
    for joint in joints:
        at = at @ origin(path, joint)
        if joint.attributes.get("type") != "fixed":
            out += _lumped(on, frames[on - 1], carried) if on else []
            on, carried = on + 1, []
        carried += _behind(path, joint.get("child", "link") or "", at, (links, branches), met) if on else []
    return (*out, *_lumped(on, frames[on - 1], carried))


def _behind(
    path: Path, link: str, at: Array, tree: tuple[dict[str, Element], dict[str, list[Element]]], met: set[str]
) -> list[tuple[float, Array]]:
    """Masses and centres, in base, of a link and of what hangs on it off the chain."""
    links, branches = tree
    found, waiting = list[tuple[float, Array]](), [(link, at)]
    while waiting:
        name, frame = waiting.pop()
        inertial = links[name].child("inertial") if name in links else None
        if inertial is not None:
            (kg,) = numbers(path, inertial, "mass", "value", (0.0,))
            if kg < 0:
                raise InputError("a mass cannot be negative", file=path, line=inertial.line, key=name, found=kg)
            centre = frame[:3, :3] @ numbers(path, inertial, "origin", "xyz", (0.0, 0.0, 0.0)) * MM + frame[:3, 3]
            found.append((float(kg), centre))
        for joint in branches.get(name, []):
            child = joint.get("child", "link") or ""
            if child not in met:
                met.add(child)
                waiting.append((child, frame @ origin(path, joint)))
    return found


def _lumped(on: int, carrier: Array, carried: Sequence[tuple[float, Array]]) -> list[Mass]:
    """One mass in the carrier's frame for all; none where nothing weighs."""
    kg = sum(mass for mass, _ in carried)
    if not kg > 0:
        return []
    centre = sum(mass / kg * place for mass, place in carried)
    local = (inverse(carrier) @ np.append(centre, 1.0))[:3]
    x, y, z = (0.0 if abs(value) < _LENGTH_ZERO else float(value) for value in local)
    return [Mass(on, kg, (x, y, z))]
