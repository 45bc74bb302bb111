"""An instrument at a place reads a target at a place: one observation, and what of it is unknown.

Places, points and numbers belong to a name: that of the instrument (the observation's) or of the target. What they are
called as parameters is decided here: `smr_P_x`, `tracker_rx`, `wire_offset`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.target import Target as Marks
from symcal.errors import InputError
from symcal.instruments import Instrument
from symcal.parameters import FRAME_AXES, coordinate_names, frame_names

Array = NDArray[np.float64]
Point = tuple[float, float, float]

_DISC_INCIDENCE = np.deg2rad(60.0)  # beyond, a disc's image is a sliver
_BOARD_INCIDENCE = np.deg2rad(75.0)  # beyond, the squares of a board are
_FEW = 12  # points that are better written out one by one
_UNCODED = ("chessboard", "circles", "asymmetric_circles")
"""Boards whose corners have no marks of their own: detectors want to see them whole."""
_FEWEST_CORNERS = 6
_SHARE = 0.25  # of a coded board's corners: a pose that is off by what the robot is off still shows some

OFF_ROBOT = ("world", "base")
"""Where things stand that no joint moves."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where something stands: a frame on the world, the base, a link (by its joint's name), the flange or the tool.

    frame: there, shape (4, 4), mm; its origin when None. unknown: the frame is to be found; ``frame`` is then a first
    guess, if there is one.

    Example:
        >>> import symcal as sc
        >>> sc.Place("flange").on, sc.Place("world", unknown=True).unknown
        ('flange', True)
    """

    on: str = "world"
    frame: Array | None = None
    unknown: bool = False

    @property
    def moves(self) -> bool:
        """Whether it is on the robot."""
        return self.on not in OFF_ROBOT

    @property
    def nominal(self) -> Array:
        return np.eye(4) if self.frame is None else self.frame


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """What is read: points and axes by name in a frame that stands at a place, or that frame itself.

    name: by which its unknown place and points are called; `tool` of the short form, whose place is the tool itself.
    points: mm, in its frame; None: to be found, from first guesses under ``near`` where there are any. unknown: all of
    them are, and their coordinates first guesses.
    axes: directions in its frame, of any length. marks: a camera's plate with discs, if it is one. board: a printed
    board, if it is one: its points are called by their numbers, and known.
    incidence: of plates and boards, largest angle between their normal and the ray from a point to the camera at which
    it is seen, rad; by default 60 deg for discs and 75 deg for boards. least: how many of the points must be seen for
    any to count; None for what the kind of target needs.

    Example:
        >>> import symcal as sc
        >>> smr = sc.Target("smr", sc.Place("flange"), {"P": (40.0, 0.0, 60.0)})
        >>> list(smr.points)
        ['P']
    """

    name: str = "tool"
    at: Place = field(default_factory=lambda: Place("tool"))
    points: Mapping[str, Point | None] = field(default_factory=dict)
    axes: Mapping[str, Point] = field(default_factory=dict)
    marks: Marks | None = None
    unknown: bool = False
    near: Mapping[str, Point] = field(default_factory=dict)
    board: Board | None = None
    incidence: float | None = None
    least: int | None = None

    def __post_init__(self) -> None:
        if self.board is None:
            return
        points = {str(i): (float(x), float(y), float(z)) for i, (x, y, z) in enumerate(self.board.points)}
        if self.unknown or (self.points and dict(self.points) != points):
            raise InputError("a board has its own points, and they are known", key=f"targets.{self.name}.points")
        object.__setattr__(self, "points", points)

    @property
    def face(self) -> Point | None:
        """Normal of the side that cameras see, in its frame; None of what is seen from all sides."""
        if self.board is not None:
            return self.board.normal
        return None if self.marks is None else self.marks.normal

    @property
    def largest_incidence(self) -> float:
        given = _BOARD_INCIDENCE if self.marks is None else _DISC_INCIDENCE
        return given if self.incidence is None else self.incidence

    @property
    def needed(self) -> int:
        """How many of its points must be seen for any of them to count: of a board as many as its detector needs."""
        if self.least is not None:
            return min(self.least, len(self.points))
        if self.board is None:
            return 1  # discs are found one by one
        coded = self.board.kind not in _UNCODED
        return max(_FEWEST_CORNERS, round(_SHARE * len(self.points))) if coded else len(self.points)

    @property
    def rigid(self) -> bool:
        """Many known points in one piece: they are no numbers of the model's, see `symcal.model.stages`."""
        return self.board is not None or (len(self.points) > _FEW and not self.unknown_points)

    @property
    def unknown_points(self) -> tuple[str, ...]:
        return tuple(name for name, xyz in self.points.items() if self.unknown or xyz is None)

    @property
    def nominal(self) -> Array:
        """Points as they are known or guessed, else the frame's origin, shape (k, 3), mm."""
        guesses = [self.near.get(name, (0.0, 0.0, 0.0)) if xyz is None else xyz for name, xyz in self.points.items()]
        return np.array(guesses).reshape(-1, 3)

    def coordinates(self, point: str) -> tuple[str, ...]:
        """What the coordinates of a point are called as parameters."""
        return coordinate_names(self.qualified(point))

    def qualified(self, point: str) -> str:
        return f"{self.name}_{point}"


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One instrument that reads one target.

    name: of its own, that of its kind if none is given; entry: that of `measurements` it comes from, whose noise it
    shares. at: where the instrument stands; its origin and axes are those of its readings.
    reports: which of the two poses the data hold, where whole frames are read: that of the target in the instrument's
    frame, or that of the instrument in the target's. session: poses of different sessions are different postures,
    whatever they are called. noise: stated standard deviation by quantity, mm, rad or px. per_axis: the noise of every
    component by itself, in the instrument's axes.
    place_name, own_prefix: how its frame and its own numbers are called as parameters. data: what it has read, for
    `symcal.identify`: a Dataset of it alone, or the path of a CSV file. value: what it would read between two things
    that do not move against each other, where that is known instead; mm, rad.

    Example:
        >>> import symcal as sc
        >>> smr = sc.Target("smr", sc.Place("flange"), {"P": (40.0, 0.0, 60.0)})
        >>> wire = sc.Observation(sc.Distance(offset=None), "wire", at=sc.Place("world", unknown=True), target=smr)
        >>> wire.name
        'wire'
    """

    instrument: Instrument
    name: str = ""
    at: Place = field(default_factory=Place)
    target: Target = field(default_factory=Target)
    reports: Literal["target", "instrument"] = "target"
    session: str = ""
    entry: str = ""
    noise: Mapping[str, float] = field(default_factory=dict)
    per_axis: bool = False
    place_name: str = ""
    own_prefix: str | None = None
    data: Any = None
    value: tuple[float, ...] | None = None

    @property
    def of(self) -> str:
        """The entry that it belongs to."""
        return self.entry or self.name

    @property
    def place(self) -> str:
        return self.place_name or self.name

    @property
    def prefix(self) -> str:
        return f"{self.name}_" if self.own_prefix is None else self.own_prefix

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features that are read one by one; empty where it is the frame."""
        reads = self.instrument.reads
        return tuple(self.target.points) if reads == "points" else tuple(self.target.axes) if reads == "axes" else ()

    @property
    def things(self) -> tuple[str, ...]:
        """Names of the places and targets that are to be found."""
        ends = ((self.place, self.at.unknown), (self.target.name, self.target.at.unknown or self.target.unknown_points))
        return tuple(name for name, unknown in ends if unknown)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that its places, points and numbers may have."""
        points = [name for point in self.target.points for name in self.target.coordinates(point)]
        numbers = [f"{self.prefix}{name}" for name in self.instrument.own]
        return (*frame_names(self.place), *frame_names(self.target.name), *points, *numbers)

    @property
    def staged(self) -> bool:
        """It reads many known points in one piece, one by one."""
        return self.instrument.reads == "points" and self.target.rigid

    @property
    def faces(self) -> Point | None:
        """Normal of the side of the target that must be turned to the instrument; None where any side will do."""
        return self.target.face if self.instrument.is_camera else None

    @property
    def riding(self) -> bool:
        """The instrument is on the robot, its target is not."""
        return self.at.moves and not self.target.at.moves

    @property
    def place_axes(self) -> tuple[str, ...]:
        """Increments of the instrument's frame that are unknown: those that it can tell."""
        if not self.at.unknown:
            return ()
        return FRAME_AXES if self.reports == "instrument" else self.instrument.sees

    @property
    def target_axes(self) -> tuple[str, ...]:
        """Increments of the target's frame that are unknown: of one point alone its place, of axes their turns."""
        if not self.target.at.unknown:
            return ()
        reads = self.instrument.reads
        if reads == "points" and len(self.target.points) == 1:
            return FRAME_AXES[:3]
        return FRAME_AXES[3:] if reads == "axes" else FRAME_AXES

    def own_errors(self, errors: Mapping[str, float]) -> dict[str, float]:
        """Errors of the instrument's own numbers by their own names, from those of all parameters."""
        return {name: errors.get(f"{self.prefix}{name}", 0.0) for name in self.instrument.own}

    def with_marks(self, marks: Marks) -> Observation:
        """The same observation of another plate with discs."""
        return replace(self, target=replace(self.target, points=marks.by_name, marks=marks))
