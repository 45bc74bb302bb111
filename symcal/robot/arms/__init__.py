"""Common arms as robot files, shipped with symcal: dimensions as their makers state them, each with its sources.

The comment at the head of each file is a YAML mapping of its own (as if the '# ' were not there):

    maker, model:  as on the type plate.
    sources:       where every number of the file is from, the maker's own document or file first.
    checked:       a description by other hands that puts the tool at the same places; left out where none was found
                   (a port of the source is none). It may count its joints otherwise: it vouches for dimensions.
    notes:         which zero, signs and frames the joints have: those of the description named last in sources.

These are nominal numbers of a type, not of the arm that stands there; base and tool are frames of the description.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from itertools import takewhile
from pathlib import Path

import yaml

from symcal.errors import InputError
from symcal.robot.files import load_robot


@dataclass(frozen=True)
class Arm:
    """What a file of this folder says of itself.

    Attributes:
        name: of the file and of the robot. axes: the number of its joints.
        checked: a second source that the dimensions agree with; None where one source is all there is.
    """

    name: str
    maker: str
    model: str
    axes: int
    sources: tuple[str, ...]
    checked: str | None
    notes: str


def arm_names() -> tuple[str, ...]:
    """The names of all arms, sorted."""
    return tuple(sorted(path.stem for path in _folder().glob("*.yaml")))


def arm_file(name: str) -> Path:
    """The robot file of an arm.

    Raises:
        InputError: no arm has this name.
    """
    if name not in arm_names():
        raise InputError("no arm of this name is in the list", found=name, allowed=arm_names())
    return _folder() / f"{name}.yaml"


def arm(name: str) -> Arm:
    """Maker, model and sources of an arm.

    Raises:
        InputError: no arm has this name.
    """
    path = arm_file(name)
    lines = path.read_text(encoding="utf-8").splitlines()
    head = yaml.safe_load("\n".join(line[2:] for line in takewhile(lambda line: line.startswith("#"), lines)))
    return Arm(
        name=name,
        maker=head["maker"],
        model=head["model"],
        axes=load_robot(path).dof,
        sources=tuple(head["sources"]),
        checked=head.get("checked"),
        notes=head.get("notes", ""),
    )


def _folder() -> Path:
    return Path(str(files("symcal.robot.arms")))
