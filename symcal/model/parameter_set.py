"""Which parameters a model has: links, joint terms, then base, tool, points, places, and numbers of instruments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from symcal.parameters import FRAME_AXES, SCALE, JointPrior, Parameter, ParameterSet, Unit, coordinate_names
from symcal.robot.robot import Robot


def parameter_set(
    robot: Robot,
    *,
    base: bool = False,
    tool: Literal["frame", "position"] | None = None,
    points: Iterable[str] = (),
    places: Mapping[str, tuple[str, ...]] | None = None,
    own: Iterable[Parameter] = (),
    priors: Iterable[JointPrior] = (),
) -> ParameterSet:
    """All parameters that a model of this robot has.

    Args:
        robot: gives its own parameters, their nominal values and the scales that its file states.
        base: six increments `base_x`..`base_rz` on the nominal base frame (rotation vector, applied on the right).
        tool: the same for the tool frame, or its position alone.
        points: what points are called whose coordinates are parameters (`tool_P1`: `tool_P1_x`, ...).
        places: which increments of frames of instruments and targets are, by name: (`x`, .., `rz`).
        own: numbers of instruments. priors: what is known of them together.
    """
    entries: list[tuple[str, Unit, float]] = []
    frames = {"base": FRAME_AXES if base else (), "tool": FRAME_AXES[: {"frame": 6, "position": 3}.get(tool or "", 0)]}
    for name, axes in frames.items():
        entries += _frame(name, axes)
    entries += [(name, "mm", 0.0) for point in points for name in coordinate_names(point)]
    for name, axes in (places or {}).items():
        entries += _frame(name, axes)
    items = [Parameter(name, unit, value, SCALE[unit], unknown=True) for name, unit, value in entries]
    return ParameterSet((*robot.described, *items, *own), tuple(priors))


def _frame(name: str, axes: tuple[str, ...]) -> list[tuple[str, Unit, float]]:
    return [(f"{name}_{axis}", "rad" if axis.startswith("r") else "mm", 0.0) for axis in axes]
