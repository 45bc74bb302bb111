"""Joint terms, masses, gravity and remainder as a robot file says them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from symcal.documents.document import Document, Key, Strict
from symcal.joints import TERMS, Term
from symcal.joints.arm import Mass, Payload
from symcal.joints.gravity import FLANGE, points_of
from symcal.joints.remainder import Remainder
from symcal.robot.remainder import RemainderEntry, remainder_entry
from symcal.units import unit_factor

Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
_Kg = Annotated[float, Field(ge=0)]

DOWN = (0.0, 0.0, -1.0)
"""Gravity in the base frame of an arm that stands on the floor."""


def _no_zero(direction: list[float]) -> list[float]:
    if np.linalg.norm(direction) < 1e-9:
        raise PydanticCustomError("direction", "gravity needs a direction: [0, 0, -1] is down along the base's z axis")
    return direction


Direction = Annotated[Triple, AfterValidator(_no_zero)]


class _Entry(Strict):
    """joint: by its name. values: of its numbers by label, in the file's units."""

    joint: str
    values: dict[str, float] = Field(default_factory=dict)


class RatioEntry(_Entry):
    term: Literal["ratio"]


class HarmonicsEntry(_Entry):
    term: Literal["harmonics"]
    k: Annotated[list[Annotated[int, Field(gt=0)]], Field(min_length=1)]
    gear: Annotated[float | None, Field(gt=0)] = None
    pitch: Annotated[float | None, Field(gt=0)] = None


class BacklashEntry(_Entry):
    term: Literal["backlash"]


class CouplingEntry(_Entry):
    term: Literal["coupling"]
    by: str


class ComplianceEntry(_Entry):
    term: Literal["compliance"]


class GravityEntry(_Entry):
    term: Literal["gravity"]
    points: Annotated[list[str], Field(min_length=1)]


class PayloadTermEntry(_Entry):
    term: Literal["payload"]


TermEntry = Annotated[
    RatioEntry | HarmonicsEntry | BacklashEntry | CouplingEntry | ComplianceEntry | GravityEntry | PayloadTermEntry,
    Field(discriminator="term"),
]


class MassEntry(Strict):
    """A mass that a joint carries: `on` its name or `flange`, its centre in that joint's frame."""

    on: str
    mass_kg: _Kg
    at: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])


class PayloadEntry(Strict):
    mass_kg: _Kg
    at: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Physics:
    """What a robot file says beyond geometry."""

    terms: tuple[Term, ...] = ()
    down: tuple[float, float, float] = DOWN
    masses: tuple[Mass, ...] = ()
    payload: Payload = field(default_factory=Payload)
    remainder: Remainder | None = None


class PhysicsEntries(Strict):
    """The keys of a robot file that say it."""

    terms: list[TermEntry] = Field(default_factory=list)
    gravity: Direction = Field(default_factory=lambda: list(DOWN))
    masses: list[MassEntry] = Field(default_factory=list)
    payload: PayloadEntry | None = None
    remainder: RemainderEntry | None = None

    def read(self, document: Document, joints: Sequence[tuple[str, bool]], length: float, angle: float) -> Physics:
        """In mm and rad.

        Args:
            joints: names, and whether they are revolute.
        Raises:
            InputError: with file, line and key.
        """
        names = [name for name, _ in joints]
        terms = [_term(document, i, entry, joints, length, angle) for i, entry in enumerate(self.terms)]
        masses = []
        for i, mass in enumerate(self.masses):
            if mass.on not in (*names, FLANGE):
                raise document.error("no such joint", ("masses", i, "on"), found=mass.on, allowed=(*names, FLANGE))
            masses.append(Mass([*names, FLANGE].index(mass.on) + 1, mass.mass_kg, _scaled(mass.at, length)))
        payload = Payload() if self.payload is None else Payload(self.payload.mass_kg, _scaled(self.payload.at, length))
        found: dict[str, int] = {}
        for i, term in enumerate(terms):
            if term.kind == "compliance" and not any(m.on >= term.joint for m in masses) and not payload.kg:
                message = (
                    "a compliance needs what the joint carries: give 'masses' or 'payload', or use 'gravity' terms"
                )
                raise document.error(message, ("terms", i, "term"))
            for label in term.labels:
                if found.setdefault(term.name(label), i) != i:
                    message = f"'{term.name(label)}' stands in two terms"
                    raise document.error(message, ("terms", i, "term"))
        down = np.array(self.gravity) / np.linalg.norm(self.gravity)
        revolute = [turns for _, turns in joints]
        rest = None if self.remainder is None else self.remainder.read(document, revolute, length, angle)
        return Physics(tuple(terms), (float(down[0]), float(down[1]), float(down[2])), tuple(masses), payload, rest)


def _scaled(at: Sequence[float], length: float) -> tuple[float, float, float]:
    return at[0] * length, at[1] * length, at[2] * length


def _term(
    document: Document, i: int, entry: Any, joints: Sequence[tuple[str, bool]], length: float, angle: float
) -> Term:
    names = [name for name, _ in joints]
    key: Key = ("terms", i)
    joint = _joint(document, (*key, "joint"), entry.joint, names)
    revolute = joints[joint - 1][1]
    own = entry.model_dump(exclude={"term", "joint", "values"})
    if entry.term == "harmonics":
        own = _waves(document, key, own, revolute, length)
    elif entry.term == "coupling":
        by = _joint(document, (*key, "by"), entry.by, names)
        if by == joint:
            raise document.error("a joint does not drive itself along", (*key, "by"), found=entry.by)
        own = {"by": by, "by_revolute": joints[by - 1][1]}
    elif entry.term == "gravity":
        allowed = points_of(joint, revolute, len(joints))
        for point in entry.points:
            if point not in allowed or entry.points.count(point) > 1:
                message = "a weight stands at a point that the joint carries, once"
                raise document.error(message, (*key, "points"), found=point, allowed=allowed)
        own = {"points": tuple(entry.points)}
    term = TERMS[entry.term](joint=joint, revolute=revolute, **own)
    for label in entry.values:
        if label not in term.labels:
            raise document.error("this term has no such number", (*key, "values"), found=label, allowed=term.labels)
    values = {label: v * unit_factor(term.unit(label), length, angle) for label, v in entry.values.items()}
    return replace(term, values=values)


def _joint(document: Document, key: Key, name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise document.error("no such joint", key, found=name, allowed=names)
    return list(names).index(name) + 1


def _waves(document: Document, key: Key, own: dict[str, Any], revolute: bool, length: float) -> dict[str, Any]:
    if len(set(own["k"])) < len(own["k"]):
        raise document.error("each multiple once", (*key, "k"), found=own["k"])
    if revolute and own["pitch"] is not None:
        raise document.error("a revolute joint has no pitch", (*key, "pitch"), found=own["pitch"])
    if not revolute and own["pitch"] is None:
        raise document.error("waves of a prismatic joint need 'pitch', the travel per turn of its screw", key)
    if not revolute and own["gear"] is not None:
        raise document.error("of a prismatic joint 'pitch' says it all", (*key, "gear"), found=own["gear"])
    pitch = None if own["pitch"] is None else own["pitch"] * length
    return {"k": tuple(own["k"]), "gear": own["gear"], "pitch": pitch}


def physics_entries(physics: Physics, names: Sequence[str], length: float, angle: float) -> dict[str, Any]:
    """The keys of a robot file for these terms; only those that say something."""
    out: dict[str, Any] = {}
    if physics.terms:
        out["terms"] = [_entry(term, names, length, angle) for term in physics.terms]
    if physics.down != DOWN:
        out["gravity"] = list(physics.down)
    if physics.masses:
        carriers = [*names, FLANGE]
        out["masses"] = [
            {"on": carriers[m.on - 1], "mass_kg": m.kg, "at": [v / length for v in m.at]} for m in physics.masses
        ]
    if physics.payload != Payload():
        out["payload"] = {"mass_kg": physics.payload.kg, "at": [v / length for v in physics.payload.at]}
    if physics.remainder is not None:
        out["remainder"] = remainder_entry(physics.remainder, length, angle)
    return out


def _entry(term: Term, names: Sequence[str], length: float, angle: float) -> dict[str, Any]:
    own = {key: value for key, value in term.entry().items() if value is not None}
    if term.kind == "coupling":
        own["by"] = names[own["by"] - 1]
    if "pitch" in own:
        own["pitch"] /= length
    own = {key: list(value) if isinstance(value, tuple) else value for key, value in own.items()}
    values = {k: v / unit_factor(term.unit(k), length, angle) for k, v in term.values.items()}
    return {"term": term.kind, "joint": names[term.joint - 1], **own, "values": values}
