"""Whether errors of a calibrated robot on other poses are one rigid motion of its base or its tool: the instrument or
the target was moved in between, and the kinematics may well be as good as they were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.mistakes.mistake import Mistake
from symcal.calibration.mistakes.sight import Sight, sights
from symcal.data.dataset import Dataset
from symcal.model.model import State
from symcal.placing.ends import Ends
from symcal.placing.registration import register

Array = NDArray[np.float64]

_BETTER = 4.0  # times that the moved frame must explain the readings better
_FEWEST = 4  # poses


@dataclass(frozen=True, slots=True)
class _Motion:
    """What was moved, in words and as `--refit` calls it, and the rms that is left with it fitted, mm."""

    said: str
    refit: str
    rms: float


def moved_between(state: State, data: Dataset) -> tuple[Mistake, ...]:
    """Frames that have moved since the state was found, by observation; empty where that explains nothing.

    Positions and poses only: base and target are fitted by themselves in closed form.

    Args:
        data: poses that the state was not fitted to.
    """
    out = []
    for sight in sights(state.model, data):
        if sight.reads == "axes" or sight.constrains or sight.part.observation.instrument.is_camera:
            continue
        found = _of(sight, state, data)
        if found is not None:
            out.append(found)
    return tuple(out)


def _of(sight: Sight, state: State, data: Dataset) -> Mistake | None:
    model, o = state.model, sight.part.observation
    own = data.read_by(o.name) if len(data.of) > 1 else data
    ends: Ends = replace(sight.ends, model=model)
    setup = model.moved(state.setup, state.x)
    chain = ends.chain(own.q, state.x)
    measured, stated = ends.measured(own), ends.registration(setup)
    if len(own) < _FEWEST:
        return None
    as_is = register(chain, measured, stated, base=False, tool=None)[0].rms
    one_point = o.instrument.reads == "points" and len(stated.points) == 1
    fixed = register(chain, measured, stated, base=True, tool=None)[0].rms
    moving = register(chain, measured, stated, base=False, tool="position" if one_point else "frame")[0].rms
    fixed, moving = (moving, fixed) if ends.reversed else (fixed, moving)
    still, carried = (_called(o.at.moves, o.place, o.target.name, still=still) for still in (True, False))
    tried: Sequence[_Motion] = (
        _Motion("what stands still (the instrument, or the robot's base)", still, fixed),
        _Motion("what is on the robot (the target or the tool)", carried, moving),
    )
    best = min(each.rms for each in tried)
    if not best * _BETTER < as_is:
        return None
    like = [each for each in tried if each.rms <= 1.3 * best]
    texts = tuple(f"{each.said} was moved: fit it anew with --refit {each.refit}" for each in like)
    who = f"{o.name}: " if len(model.task.observations) > 1 else ""
    at = " (at 200 mm from the tool)" if o.instrument.reads == "frame" else ""
    text = (
        f"{who}one rigid motion explains the errors: {as_is:.4g} mm rms become {best:.3g} mm{at}; {'; or '.join(texts)}"
    )
    return Mistake("moved between sets", texts, text, as_is, best, "mm")


def _called(riding: bool, place: str, target: str, *, still: bool) -> str:
    """What `--refit` calls an end: the robot's own frames where the thing itself has no name of its own."""
    name = (target if riding else place) if still else (place if riding else target)
    own = "base" if still else "tool"
    return own if name in ("world", "tool", "base", "position", "pose") else f"{own} (or {name})"
