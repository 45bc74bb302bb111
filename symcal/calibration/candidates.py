"""Joint terms that an identification may add to a robot: groups of them by name."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.joints import Term
from symcal.joints.backlash import Backlash, direction_name
from symcal.joints.compliance import Compliance
from symcal.joints.coupling import Coupling
from symcal.joints.gravity import Gravity, points_of
from symcal.joints.harmonics import Harmonics
from symcal.joints.payload import PAYLOAD, PayloadTerm
from symcal.joints.ratio import Ratio
from symcal.kinematics import motions
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

AUTO = ("gravity", "harmonics 1", "harmonics 2", "coupling", "backlash", "payload")
"""Groups that `extend: auto` tries; the last two where the data carry what they depend on."""
HIGHEST = 40
"""Highest multiple of a joint's reading that may be asked for by name."""
GROUPS = ("gravity", "coupling", "ratio", "backlash", "payload", *(f"harmonics {k}" for k in range(1, HIGHEST + 1)))
"""Every group that may be asked for."""
CONDITIONED = ("backlash", "payload")
"""Those that depend on more than joint readings."""

_SAMPLES = 400
_SAME = 1e-3  # of the lever: what of a weight's moment others do not have is nothing below
_WRIST = 3  # joints that may be coupled to each other


def candidates(robot: Robot, wanted: Sequence[str], conditions: Collection[str]) -> tuple[Term, ...]:
    """The joint terms of some groups; without those that the robot has.

    Args:
        wanted: names of groups, or `auto` alone. conditions: what the data say of every pose (`Dataset.conditions`).
    Raises:
        InputError: no such group, or one that the data carry nothing for.
    """
    automatic = tuple(wanted) == ("auto",)
    groups = AUTO if automatic else tuple(dict.fromkeys(wanted))
    for group in groups:
        if group not in GROUPS:
            allowed = ("auto", *GROUPS)
            raise InputError("no such group of joint terms", key="identification.extend", found=group, allowed=allowed)
    found = [term for group in groups for term in _group(robot, group, conditions)]
    for group in groups if not automatic else ():
        if group in CONDITIONED and not any(n.group == group for t in found for n in t.numbers):
            column = "q1_direction, ..." if group == "backlash" else "payload_kg"
            message = f"the data do not say what {group} depends on: give columns {column}"
            raise InputError(message, key="identification.extend", found=group)
    own = robot.term_parameters
    return tuple(term for term in found if not any(p.name in own for p in term.parameters))


def _group(robot: Robot, group: str, conditions: Collection[str]) -> list[Term]:
    revolute = [j.revolute for j in robot.joints]
    every = list(enumerate(revolute, start=1))
    if group == "gravity":
        return [*gravity_terms(robot)]
    if group.startswith("harmonics"):
        k = int(group.rpartition(" ")[2])
        return [Harmonics(i, True, k=(k,)) for i, turns in every if turns]
    if group == "coupling":
        wrist = [i for i, turns in every if turns][-_WRIST:]
        return [Coupling(j, True, by=i) for i in wrist for j in wrist if i < j]
    if group == "ratio":
        return [Ratio(i, turns) for i, turns in every]
    if group == "backlash":
        return [Backlash(i, turns) for i, turns in every if direction_name(i) in conditions]
    return [t for t in (PayloadTerm(i, turns) for i, turns in every) if PAYLOAD in conditions]


def terms_named(robot: Robot, names: Collection[str]) -> tuple[Term, ...]:
    """Terms that have these numbers (`q2_sin_1`, `q3_compliance`, ...) and that the robot lacks; those of a true robot.

    Numbers that no term has are passed over. Compliances are there where the robot file has masses or a payload.
    """
    every: list[Term] = []
    for i, joint in enumerate(robot.joints, start=1):
        turns = joint.revolute
        every += [Ratio(i, turns), *(Gravity(i, turns, points=(p,)) for p in points_of(i, turns, robot.dof))]
        every += [Harmonics(i, turns, k=(k,)) for k in range(1, HIGHEST + 1)] if turns else []
        every += [
            Coupling(i, turns, by=j, by_revolute=other.revolute)
            for j, other in enumerate(robot.joints, start=1)
            if j != i
        ]
        if robot.payload.kg or any(mass.on >= i for mass in robot.masses):
            every.append(Compliance(i, turns))
    own = robot.term_parameters
    return tuple(t for t in every if any(p.name in names and p.name not in own for p in t.parameters))


def gravity_terms(robot: Robot) -> list[Gravity]:
    """Weights whose moments differ, at every joint on which gravity has one that changes over the joint limits.

    Of weights whose moments are sums of those of others and a constant the later ones are left out.
    """
    terms = [
        Gravity(i, joint.revolute, points=points_of(i, joint.revolute, robot.dof))
        for i, joint in enumerate(robot.joints, start=1)
    ]
    q = np.random.default_rng(0).uniform(*robot.ranges, (_SAMPLES, robot.dof))
    kept = [_independent(moments) for moments in motions(replace(robot, terms=tuple(terms)), q)]
    return [
        replace(term, points=tuple(term.points[i] for i in own)) for term, own in zip(terms, kept, strict=True) if own
    ]


def _independent(columns: Array) -> list[int]:
    """Which columns are no sums of a constant and of columns before them."""
    basis = [np.full(len(columns), 1 / np.sqrt(len(columns)))]
    kept = []
    for i, column in enumerate(columns.T):
        rest = column
        for _ in range(2):
            for direction in basis:
                rest = rest - (direction @ rest) * direction
        size = float(np.linalg.norm(rest))
        if size > _SAME * np.sqrt(len(columns)):
            kept.append(i)
            basis.append(rest / size)
    return kept
