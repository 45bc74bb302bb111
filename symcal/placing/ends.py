"""The two ends of an observation as the robot's chain between two frames: left . chain_i . right.

    measured point = left . chain_i . right . point

An instrument off the robot: left is the robot's base in the instrument's frame, the chain goes from base to link, right
is the target on the link. An instrument on the robot: left is the link in the instrument's frame, the chain goes from
link to base, right is the target in the base. Whole frames are always seen the first way: those that an instrument on
the robot has read are inverted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.model.observation import Observation, Place
from symcal.placing.registration import Registration, hand_eye, virtual_points
from symcal.spatial import inverse, pose_matrix

Array = NDArray[np.float64]
Mode = Literal["frame", "position", "points"]


@dataclass(frozen=True, slots=True)
class End:
    """One end of an observation: what its frame is called, and where it stands."""

    name: str
    place: Place


@dataclass(frozen=True, slots=True)
class Ends:
    """The ends of an observation, one off the robot and one on it.

    reversed: the instrument that reads points is on the robot. open: parameters that are still to be placed.
    """

    model: Model
    observation: Observation
    fixed: End
    moving: End
    reversed: bool
    open: frozenset[str]

    def unknown(self, end: End) -> bool:
        """Whether an end's own place is still to be found; one of which something is held stays where it is."""
        return end.place.unknown and bool({f"{end.name}_x", f"{end.name}_rx"} & self.open)

    def chain(self, q: Array, x: Array) -> Array:
        """The robot's part, shape (N, 4, 4), mm, with its errors."""
        return inverse(self._link(q, x)) if self.reversed else self._link(q, x)

    def _link(self, q: Array, x: Array) -> Array:
        """T_base_link of the link that the moving end is on, shape (N, 4, 4), mm."""
        on, model = self.moving.place.on, self.model
        links = np.where([name in model.robot.parameters for name in model.parameters.names], x, 0.0)
        bare = Setup(np.eye(4), np.eye(4)).vector
        return np.asarray(model.kernels.pose("flange" if on == "tool" else on)(q, links, bare)[0])

    def registration(self, setup: Setup) -> Registration:
        """What is known of left, right and points."""
        fixed, link = self._fixed(setup), self._moving(setup)
        left, right = (inverse(link), inverse(fixed)) if self.reversed else (fixed, link)
        return Registration(left, right, self.points(setup), np.inf)

    def points(self, setup: Setup) -> Array:
        if self.observation.instrument.reads != "points":
            return np.asarray(virtual_points(np.eye(4)[None])[0])
        if self.observation.target.rigid:
            return self.observation.target.nominal
        called = self.model.measurement.points_called
        names = [self.observation.target.qualified(name) for name in self.observation.target.points]
        return setup.points[[called.index(name) for name in names]]

    def _fixed(self, setup: Setup) -> Array:
        """T_fixed_base."""
        on = setup.base if self.fixed.place.on == "world" else np.eye(4)
        place = setup.places.get(self.fixed.name)
        return on if place is None else np.asarray(inverse(place) @ on)

    def _moving(self, setup: Setup) -> Array:
        """T_link_moving."""
        place = setup.places.get(self.moving.name)
        if self.moving.place.on != "tool":
            return np.eye(4) if place is None else place
        return setup.tool if place is None else np.asarray(setup.tool @ place)

    @property
    def left_unknown(self) -> bool:
        return self._moving_mode == "frame" if self.reversed else self._fixed_unknown

    @property
    def _fixed_unknown(self) -> bool:
        return self.unknown(self.fixed) or (self.fixed.place.on == "world" and "base_x" in self.open)

    @property
    def _moving_mode(self) -> Mode | None:
        names = [self.moving.name] if self.moving.place.unknown else []
        names += ["tool"] if self.moving.place.on == "tool" else []
        for name in names:
            if f"{name}_rx" in self.open:
                return "frame"
            if f"{name}_x" in self.open:
                return "position"
        return None

    @property
    def right_mode(self) -> Mode | None:
        """What is unknown of the right end: its frame, its place, or the points there."""
        target = self.observation.target
        if self.observation.instrument.reads == "points" and any(
            target.coordinates(point)[0] in self.open for point in target.unknown_points
        ):
            return "points"
        if self.reversed:
            return "frame" if self._fixed_unknown else None
        return self._moving_mode

    def placed(self, setup: Setup, found: Registration) -> Setup:
        """The setup where left, right and points are as they were found."""
        left, right = (found.tool, found.base) if self.reversed else (found.base, found.tool)
        fixed = inverse(left) if self.reversed else left
        moving = inverse(right) if self.reversed else right
        if self._fixed_unknown:
            setup = self._with_fixed(setup, fixed)
        if self._moving_mode:
            setup = self._with_moving(setup, moving)
        if self.right_mode == "points":
            called, points = self.model.measurement.points_called, setup.points.copy()
            for name, xyz in zip(self.observation.target.points, found.points, strict=True):
                if name in self.observation.target.unknown_points:
                    points[called.index(self.observation.target.qualified(name))] = xyz
            setup = replace(setup, points=points)
        return setup

    def _with_fixed(self, setup: Setup, fixed: Array) -> Setup:
        place = setup.places.get(self.fixed.name)
        if self.unknown(self.fixed):
            on = setup.base if self.fixed.place.on == "world" else np.eye(4)
            own = on @ inverse(fixed)
            return replace(setup, places={**setup.places, self.fixed.name: own})
        return replace(setup, base=fixed if place is None else np.asarray(place @ fixed))

    def _with_moving(self, setup: Setup, moving: Array) -> Setup:
        place = setup.places.get(self.moving.name)
        if self.unknown(self.moving):
            own = np.asarray(inverse(setup.tool) @ moving) if self.moving.place.on == "tool" else moving
            return replace(setup, places={**setup.places, self.moving.name: own})
        return replace(setup, tool=moving if place is None else np.asarray(moving @ inverse(place)))

    def measured(self, data: Dataset) -> Array:
        """What was read as points, shape (N, k, 3), mm, NaN where not seen."""
        if self.observation.instrument.reads == "points":
            return data.z.reshape(len(data), -1, 3)
        return np.asarray(virtual_points(self.poses(data)))

    def poses(self, data: Dataset) -> Array:
        """Whole frames that were read, as the moving end in the fixed one, shape (N, 4, 4)."""
        poses = pose_matrix(data.z)
        reader = self.observation.target.at if self.observation.reports == "instrument" else self.observation.at
        return inverse(poses) if reader.moves else poses

    def starts(self, data: Dataset, nominal: Registration, chain: Array) -> tuple[Registration, ...]:
        """A first guess in closed form, where whole frames are read and both ends are unknown."""
        if self.observation.instrument.reads == "points" or len(data) < 3:
            return ()
        if not self.left_unknown or self.right_mode is None:
            return ()
        left, right = hand_eye(chain, self.poses(data))
        return (replace(nominal, base=left, tool=right),)


def ends_of(model: Model, observation: Observation, still_open: frozenset[str]) -> Ends | None:
    """The ends of an observation; None where no joint lies between them, or both are on the robot."""
    instrument = End(observation.place, observation.at)
    target = End(observation.target.name, observation.target.at)
    if instrument.place.moves == target.place.moves:
        return None
    riding = instrument.place.moves
    fixed, moving = (target, instrument) if riding else (instrument, target)
    return Ends(model, observation, fixed, moving, riding and observation.instrument.reads == "points", still_open)
