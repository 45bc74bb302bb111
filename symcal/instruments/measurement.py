"""A measurement: a kind of instrument on a robot, as compiled functions of joint readings, errors and frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.instruments.protocol import Kind, Unit
from symcal.kinematics import Chain, frame_vector
from symcal.parameters import ParameterSet, frame_names
from symcal.parameters import point_names as coordinate_names

SX = ca.SX
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Setup:
    """Where things nominally are: numbers that a model is given at evaluation, and that its increments refer to.

    base: T_world_base, tool: T_flange_tool, shape (4, 4), mm. points: tool points in the tool frame, shape (k, 3), mm.
    camera: T_world_camera, shape (4, 4), mm, and intrinsics: its numbers, shape (9,); None without a camera.
    """

    base: Array
    tool: Array
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    camera: Array | None = None
    intrinsics: Array | None = None

    @property
    def vector(self) -> Array:
        parts = [frame_vector(self.base, self.tool), self.points.ravel()]
        if self.camera is not None and self.intrinsics is not None:
            parts += [self.camera[:3].ravel(order="F"), self.intrinsics]
        return np.concatenate(parts)

    def moved(self, errors: dict[str, float], point_names: tuple[str, ...] = ()) -> Setup:
        """The setup with the increments of base, tool, points and camera in ``errors`` (mm, rad) carried out.

        Intrinsics stay: their errors are from the calibration that gave their prior.
        """
        points = self.points + np.array(
            [[errors.get(c, 0.0) for c in coordinate_names(name)] for name in point_names]
        ).reshape(self.points.shape)
        return replace(
            self,
            base=_moved(self.base, "base", errors),
            tool=_moved(self.tool, "tool", errors),
            points=points,
            camera=None if self.camera is None else _moved(self.camera, "camera", errors),
        )


def _moved(frame: Array, name: str, errors: dict[str, float]) -> Array:
    increment = np.array([errors.get(axis, 0.0) for axis in frame_names(name)])
    rotation = Rotation.from_rotvec(increment[3:]).as_matrix()
    return np.asarray(frame @ spatial.transform(rotation, increment[:3]))


@dataclass(frozen=True, slots=True)
class Group:
    """Residual components that share one noise sigma: `position` in mm, `orientation` in rad, `image` in px."""

    name: str
    unit: Unit
    columns: tuple[int, ...]
    block: int
    """Components of one observation: residuals are judged by the norm over ``block`` consecutive columns."""
    floor: float
    """Noise of data that have none: rounding."""
    alike: float = 1.0
    """Noise that goes with one unit of noise of the measurement's first group, roughly."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One kind of observation of one robot.

    predict:  (q, x, setup) -> h, shape (nz,), as the instrument would give it.
    residual: (q, x, setup, z) -> r = model minus measured, shape (m,), and J = dr/dx, shape (m, n).
    jacobian: (q, x, setup) -> J at zero residual, shape (m, n): the information of a pose that is yet to be measured.
    accuracy: (q, x, setup, z) -> e: the tool's error in the words of the user (world frame), mm and rad, grouped as r.
        Of an image point: the smallest displacement, across the line of sight, that would explain the residual.
    points: (q, x, setup) -> tool points (or the tool) in world, shape (3 k,), mm, and their Jacobian, shape (3 k, n).
    """

    kind: Kind
    chain: Chain
    point_names: tuple[str, ...]
    groups: tuple[Group, ...]
    predict: ca.Function
    residual: ca.Function
    jacobian: ca.Function
    accuracy: ca.Function
    points: ca.Function

    @property
    def parameters(self) -> ParameterSet:
        return self.chain.parameters

    @property
    def rows(self) -> int:
        """Residual components per pose."""
        return sum(len(group.columns) for group in self.groups)

    def per_component(self, values: dict[str, float]) -> Array:
        """A value per group spread over the residual components, shape (m,)."""
        out = np.empty(self.rows)
        for group in self.groups:
            out[list(group.columns)] = values[group.name]
        return out
