"""Images with the joint readings at which they were taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.data.conditions import read_conditions
from symcal.data.dataset import evenly
from symcal.data.split import Split, splits
from symcal.documents.csv_file import read_table
from symcal.documents.table import joint_readings
from symcal.errors import InputError
from symcal.robot.robot import Robot
from symcal.vision.images import read_image

Array = NDArray[np.float64]


THUMBNAILS = 1000
"""Small copies of images that are kept in memory, some ten thousand bytes each; no page has room for more."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One image to be measured: its name, the pose's label and split, joint readings (dof,), and how to get it.

    conditions: what else its table says of the pose, see `symcal.data.conditions`.
    """

    name: str
    label: str
    split: str
    q: Array
    load: Callable[[], NDArray[np.generic]]
    conditions: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Shots:
    """Images with their joint readings, in the order of the table that has them.

    labels, q: of all its poses, those without image too; q of shape (M, dof), rad and mm. rows: the pose of each shot.
    left: (image, reason) of every image without readings and every pose without image.
    """

    shots: tuple[Shot, ...]
    rows: tuple[int, ...]
    labels: tuple[str, ...]
    q: Array
    left: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, shots: Sequence[Shot]) -> Shots:
        """Shots where every pose has its image."""
        q = np.array([shot.q for shot in shots])
        return cls(tuple(shots), tuple(range(len(shots))), tuple(shot.label for shot in shots), q)


def read_shots(path: Path | str, robot: Robot, images: Sequence[Path], split: Split | None = None) -> Shots:
    """Images with their joint readings, from a CSV file with the columns `image`, joints, and `pose`, `split`,
    directions and payload if any.

    Args:
        split: which poses train and which test; None keeps the labels of a column `split` as they are.
    Raises:
        InputError: a file that cannot be read, two images of one name, or an image that stands twice.
    """
    table = read_table(path)
    if "image" not in table.columns:
        raise InputError("there is no column 'image'", file=path, line=table.head_line, allowed=table.columns)
    if not len(table):
        raise InputError("the file has a header but no rows", file=path)
    q = joint_readings(table, [(joint.name, joint.revolute) for joint in robot.joints])
    conditions = read_conditions(table, robot)
    places: dict[str, Path] = {}
    for image in images:
        if image.name in places:
            raise InputError("two images have this name", found=image.name)
        places[image.name] = image
    names = table.text("image")
    labels = table.text("pose") if "pose" in table.columns else [Path(name).stem for name in names]
    if split is not None:
        parts: Sequence[str] = splits(table, range(len(table)), split, alone=False)
    else:
        parts = table.text("split") if "split" in table.columns else ["train"] * len(table)
    shots, rows, left, seen = [], [], [], set[str]()
    for row, name in enumerate(names):
        if name in seen:
            raise InputError("this image stands twice", file=path, line=table.lines[row], key="image", found=name)
        seen.add(name)
        file = places.pop(Path(name).name, None)
        if file is None:
            left.append((name, f"line {table.lines[row]} of {Path(path).name} names it, but no such image was given"))
        else:
            given = {condition: float(values[row]) for condition, values in conditions.items()}
            shots.append(Shot(name, labels[row], parts[row], q[row], _reader(file), given))
            rows.append(row)
    left += [(name, f"{Path(path).name} has no joint readings for it") for name in places]
    return Shots(tuple(shots), tuple(rows), tuple(labels), q, tuple(left))


def _reader(path: Path) -> Callable[[], NDArray[np.generic]]:
    return lambda: read_image(path)


def conditions_of(shots: Sequence[Shot]) -> dict[str, Array]:
    """The conditions of shots of one table, by name, shape (N,)."""
    return {name: np.array([shot.conditions[name] for shot in shots]) for name in shots[0].conditions}


def with_thumbnail(count: int) -> frozenset[int]:
    """Of which of so many images a small copy is kept: evenly of `THUMBNAILS` where there are more."""
    return frozenset(evenly(count, THUMBNAILS).tolist())


def listed_failures(failures: Sequence[tuple[str, str]]) -> str:
    """The first few images with what is wrong with them."""
    shown = "; ".join(f"{name}: {reason}" for name, reason in failures[:5])
    return shown + ("; ..." if len(failures) > 5 else "")
