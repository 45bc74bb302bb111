"""What is said of images that do not belong to the joint readings of their names."""

from __future__ import annotations

from collections.abc import Sequence

from symcal.errors import RefusedError
from symcal.images.shots import Shots
from symcal.placing.agreement import Agreement
from symcal.placing.pairing import Foreign
from symcal.words import plural

_DOUBTED = 0.4  # share of foreign images from which all names are in doubt
_NO_BETTER = 0.3  # of the misfit at foreign postures: nobody's robot errs so much
_ROBOT = 50.0  # mm: misfit that may still be the robot's
_RUN = 3  # images in a row with one shift
_COUNTS = {1: "one", 2: "two", 3: "three"}


def foreign_reasons(
    foreign: Sequence[Foreign], shots: Shots, own: Sequence[int], names: Sequence[str], found: Agreement
) -> tuple[dict[int, str], list[str]]:
    """The reason of each foreign view by its number, and sentences on those that belong together.

    Args:
        own: pose of each view by its name. names: of the views' images.
    Raises:
        RefusedError: so many are foreign that nothing can be believed.
    """
    if found.typical > max(_NO_BETTER * found.by_chance, _ROBOT):
        raise RefusedError(
            "images and joint readings do not belong together: as this robot moves, most images are off by more than "
            f"{found.typical:.0f} mm; look at names, units and signs of the joint readings, and at the robot file"
        )
    reasons, notes = _swapped(foreign, shots, own, names)
    for run in _runs([each for each in foreign if each.view not in reasons], own):
        first, last, shift = names[run[0].view], names[run[-1].view], _shift(run[0], own)
        how = f"shifted by {_COUNTS.get(abs(shift), str(abs(shift)))}"
        far = "" if abs(shift) == 1 else f"{_COUNTS.get(abs(shift), str(abs(shift)))} "
        whose = f"the pose {far}before" if shift < 0 else f"the pose {far}later" if far else "the next pose"
        notes.append(f"images {first} to {last} are {how}: each fits the joints of {whose}")
        reasons |= {each.view: f"the names of {first} to {last} are {how}" for each in run}
    for each in foreign:
        if each.view in reasons:
            continue
        if each.fits is None:
            others = f"others about {found.typical:.1f} mm"
            reasons[each.view] = f"it fits no pose: it is {each.off:.0f} mm off its own, {others}"
        else:
            reasons[each.view] = (
                f"it fits the joints of pose {shots.labels[each.fits]}, not those of its name "
                f"({each.there:.1f} mm off, and {each.off:.0f} mm)"
            )
    if len(foreign) > _DOUBTED * len(names):
        said = notes or [f"{names[view]}: {reason}" for view, reason in list(reasons.items())[:5]]
        raise RefusedError(
            f"{len(foreign)} of {plural(len(names), 'image')} do not fit the joint readings of their names: "
            + "; ".join(said)
        )
    return reasons, notes


def _swapped(
    foreign: Sequence[Foreign], shots: Shots, own: Sequence[int], names: Sequence[str]
) -> tuple[dict[int, str], list[str]]:
    """Reasons of the views that fit each other's pose, and a sentence for each pair."""
    by_row = {own[each.view]: each for each in foreign}
    reasons: dict[int, str] = {}
    notes: list[str] = []
    for each in foreign:
        other = None if each.fits is None else by_row.get(each.fits)
        if other is None or other.fits != own[each.view] or other.view == each.view:
            continue
        reasons[each.view] = f"its name is swapped with that of {names[other.view]}"
        if each.view < other.view:
            notes.append(
                f"image {names[each.view]} fits the joints of {_pose(shots, other, own)} and {names[other.view]} those "
                f"of {_pose(shots, each, own)}: the two names are swapped"
            )
    return reasons, notes


def _pose(shots: Shots, each: Foreign, own: Sequence[int]) -> str:
    return f"pose {shots.labels[own[each.view]]}"


def _shift(each: Foreign, own: Sequence[int]) -> int:
    assert each.fits is not None
    return each.fits - own[each.view]


def _runs(foreign: Sequence[Foreign], own: Sequence[int]) -> list[list[Foreign]]:
    """Those that follow one another, each shifted by as many poses."""
    runs: list[list[Foreign]] = []
    for each in sorted((each for each in foreign if each.fits is not None), key=lambda each: each.view):
        last = runs[-1][-1] if runs else None
        if last is not None and each.view == last.view + 1 and _shift(each, own) == _shift(last, own):
            runs[-1].append(each)
        else:
            runs.append([each])
    return [run for run in runs if len(run) >= _RUN]
