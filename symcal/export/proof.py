"""Files that leave are taken back by a reader that is not ours, and its kinematics compared with ours.

Readers: yourdfpy for URDF, ROS's own xacro for xacro files (`pip install 'symcal[proof]'`). Ours is the model that
wrote the file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.compensation.targets import tool_poses
from symcal.errors import RefusedError
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Read = Callable[[Path, Array], Array]
"""The folder of the files, readings (n, dof) in rad and mm -> T_base_tool (n, 4, 4), mm."""

POSES = 1000
LARGEST = 1e-6
"""mm and rad beyond which a file is not handed over; rounding leaves a thousandth of a thousandth of it."""


@dataclass(frozen=True, slots=True)
class Proof:
    """The largest differences over random readings within the limits, mm and rad. reader: who read; None: nobody, as
    ``missing`` is not installed."""

    reader: str | None
    mm: float = 0.0
    rad: float = 0.0
    poses: int = POSES
    missing: str = ""

    @property
    def text(self) -> str:
        if self.reader is None:
            return f"not read back: {self.missing} is not installed (pip install 'symcal[proof]')"
        return (
            f"read back by {self.reader}: at {self.poses} random poses its tool is within {self.mm:.1e} mm and "
            f"{self.rad:.1e} rad of ours"
        )


def proof(robot: Robot, files: Mapping[str, str], read: Read, readers: tuple[str, ...]) -> Proof:
    """Write the files into a temporary folder, have them read, and compare.

    Args:
        robot: what they are to say; joint terms do not count. readers: packages that ``read`` needs.
    Raises:
        RefusedError: they say something else.
    """
    for name in readers:
        if find_spec(name) is None:
            return Proof(None, missing=name)
    lower, upper = robot.ranges
    q = np.random.default_rng(0).uniform(lower, upper, (POSES, robot.dof))
    ours = tool_poses(robot, q)
    with TemporaryDirectory(prefix="symcal-proof-") as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        theirs = read(folder, q)
    mm = float(np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1).max())
    chord = np.linalg.norm(ours[:, :3, :3] - theirs[:, :3, :3], axis=(1, 2)).max()  # sqrt(8) sin(angle / 2)
    rad = float(2 * np.arcsin(min(chord / np.sqrt(8), 1.0)))
    reader = " and ".join(f"{each} {version(each)}" for each in readers)
    if not (mm <= LARGEST and rad <= LARGEST):
        raise RefusedError(
            f"{', '.join(files)} would not say what the model says: {reader} puts the tool up to {mm:.3g} mm and "
            f"{rad:.3g} rad elsewhere. Nothing was written; please report this with the robot file"
        )
    return Proof(reader, mm, rad)


def link_poses(path: Path, positions: Mapping[str, Array], link: str, base: str) -> Array:
    """T_base_link of a URDF file by yourdfpy, shape (n, 4, 4), mm.

    Args:
        positions: of each joint as URDF counts them, rad and m, shape (n,).
    """
    from yourdfpy import URDF

    found: Any = URDF.load(str(path), load_meshes=False, build_collision_scene_graph=False)
    poses = []
    for each in zip(*positions.values(), strict=True):
        found.update_cfg(dict(zip(positions, each, strict=True)))
        poses.append(found.get_transform(link, base))
    moved = np.array(poses)
    moved[:, :3, 3] *= 1e3
    return moved
