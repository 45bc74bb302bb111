"""A second calibration, from new measurements alone, in the results of their validation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.again import Again, calibrated_again
from symcal.calibration.halves_words import again_facts, halves_warnings
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.model.measurement import Setup
from symcal.model.observation import Observation
from symcal.model.task import Task
from symcal.robot.robot import Robot

Array = NDArray[np.float64]


def with_second(
    content: dict[str, Any],
    robot: Robot,
    task: Task,
    data: Dataset,
    refit: Sequence[str],
    strange: Sequence[str],
    now: Setup,
) -> Again | None:
    """A second calibration from new measurements, its facts and warnings added to the content.

    Args:
        task: of what measured, everything where it was before the recorded calibration. refit: frames that were fitted
            to the new data. strange: sessions that the calibration does not know. now: where things stand with the
            calibrated robot.
    Returns:
        None where there can be none: the content says why.
    """
    found: Again | None = None
    try:
        moved = [part for part in refit if part not in ("base", *(name for o in task.observations for name in _at(o)))]
        if moved:
            raise RefusedError(f"{', '.join(moved)} may have moved on the robot in between")
        if strange:
            raise RefusedError(f"the calibration does not know session {', '.join(strange)}")
        found = calibrated_again(robot, task, data, np.random.default_rng(0), now if refit else None)
        content["halves"] = again_facts(found)
        content["warnings"] += halves_warnings(found)
    except RefusedError as error:
        content["halves"] = again_facts(str(error))
    return found


def _at(o: Observation) -> tuple[str, ...]:
    """What an instrument's place is called, where that is in world."""
    return (o.of, o.place) if o.at.on == "world" else ()
