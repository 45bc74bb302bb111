"""What speaks against a calibration that must be within a tolerance, one rule after the other. The rules are ours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from symcal.calibration.claims import MOST_OUTSIDE, where_judged
from symcal.calibration.evidence import Evidence
from symcal.calibration.reasons import Reason
from symcal.calibration.tolerance import Tolerance, taken_of
from symcal.words import listed, number, percent, plural

GROSS = 10.0
"""Noises from which on a held-out reading is no accident of any noise."""
_FEW = 20  # poses: 95 % of fewer is the largest one
_NAMED = 5


def against(found: Evidence, tolerance: Tolerance) -> Iterator[Reason]:
    """Reasons against a calibration that must be within a tolerance."""
    if found.part in (None, "left_out"):
        text = "nothing was held out and nothing cross-validated, so nothing shows errors within the tolerance"
        yield Reason("unjudged", f"{text}: keep poses for a test split, or cross-validate")
    for size, unit, what in held_out(found, tolerance):
        limit = tolerance.limit(unit)
        if limit is not None and size > limit:
            beyond = f"beyond the tolerance of {number(limit)} {unit}"
            where = where_judged(str(found.part))
            yield Reason(
                "position" if unit == "mm" else "orientation",
                f"{where} {_said(tolerance, what, f'{number(size)} {unit}')}, {beyond}",
            )
    yield from _unseen(found, tolerance)
    yield from _uncovered(found)
    yield from _lacking(found, tolerance)
    yield from _outliers(found, tolerance)
    yield from _differing(found, tolerance)


def _differing(found: Evidence, tolerance: Tolerance) -> Iterator[Reason]:
    """Two halves, or a second calibration from poses that may be few: that counts only where it is not by chance."""
    halves = found.halves or {}
    difference = halves.get("difference_rms_mm")
    if difference is None or tolerance.position is None or difference <= tolerance.position:
        return
    beyond = f"beyond the tolerance of {number(tolerance.position)} mm"
    if not halves["agree"] and halves.get("text"):
        yield Reason("halves", f"{halves['text']}; that is {beyond}")
    elif not halves["agree"] or "divisions" in halves:
        yield Reason(
            "halves", f"two halves of the data give robots that differ by {number(difference)} mm rms, {beyond}"
        )


def held_out(found: Evidence, tolerance: Tolerance) -> Iterator[tuple[float, str, str]]:
    """Errors of poses that were held out, in mm and deg, and what they are errors of."""
    if found.part is None:
        return
    after = found.errors[found.part]["after"]
    if tolerance.limit(after.unit) is not None:
        size = after.statistics
        judged = {"p95": size.p95, "rms": size.rms, "max": size.max}[tolerance.of]
        yield judged, after.unit, "position error" if after.of_tool else after.words
    if tolerance.orientation is not None and after.orientation is not None and after.orientation.size:
        yield float(taken_of(tolerance.of, np.degrees(after.orientation))), "deg", "orientation error"


def _said(tolerance: Tolerance, what: str, size: str) -> str:
    """`the position error is below 0.3 mm for 95 %`."""
    if tolerance.of == "p95":
        return f"the {what} is below {size} for 95 %"
    return f"the {'largest ' if tolerance.of == 'max' else ''}{what} is {size}{' rms' if tolerance.of == 'rms' else ''}"


def _unseen(found: Evidence, tolerance: Tolerance) -> Iterator[Reason]:
    for unit in ("mm", "deg"):
        size, limit = found.open.of(unit), tolerance.limit(unit)
        if limit is None:
            continue
        if size is None:
            if unit not in {unit for _, unit, _ in held_out(found, tolerance)}:
                what = "position" if unit == "mm" else "orientation"
                yield Reason("unjudged", f"nothing tells how far off the {what} is, so no tolerance of it is shown")
            continue
        if size > limit:
            most = f"; {found.foremost} has the largest part in it" if found.foremost and unit == "mm" else ""
            yield Reason(
                "unseen",
                f"what the data leave open about the parameters makes errors of {number(size)} {unit} over "
                f"{found.over} ({_of(tolerance)}), beyond the tolerance of {number(limit)} {unit}{most}",
            )


def _of(tolerance: Tolerance) -> str:
    return {"p95": "95 % are smaller", "rms": "rms", "max": "the largest"}[tolerance.of]


def _uncovered(found: Evidence) -> Iterator[Reason]:
    outside = found.outside
    if outside is not None and outside.share > MOST_OUTSIDE:
        yield Reason(
            "coverage",
            f"{percent(outside.share)} of {outside.of} lies beyond the measured poses, at joint readings or "
            f"combinations of them that were not measured (at most {percent(MOST_OUTSIDE)} may): measure there too",
        )


def _lacking(found: Evidence, tolerance: Tolerance) -> Iterator[Reason]:
    beyond = []
    for lack in found.lacks:
        limit = tolerance.limit(lack.unit)
        if limit is not None and lack.rms > limit:
            beyond.append(f"{lack.what} ({number(lack.rms)} {lack.unit} rms)")
    if beyond:
        yield Reason(
            "lack_of_fit", f"the model lacks more than the tolerance: the residuals follow {listed(beyond[:_NAMED])}"
        )


def _outliers(found: Evidence, tolerance: Tolerance) -> Iterator[Reason]:
    limit = tolerance.position
    training = [each for each in found.outliers if each.get("split", "train") == "train"]
    if limit is not None:
        pulls = {str(each["pose"]): float(each["tool_mm"]) for each in training if each["tool_mm"] > limit}
        if pulls:
            yield Reason(
                "outlier",
                f"training {_poses(list(pulls))} cannot be explained and moves the robot by up to "
                f"{number(max(pulls.values()))} mm, beyond the tolerance of {number(limit)} mm: measure again there",
            )
    test = [each for each in found.outliers if each.get("split", "train") != "train" and each["noises"] > GROSS]
    for unit in ("mm", "deg"):
        most = tolerance.limit(unit)
        far = [each for each in test if each["unit"] == unit and most is not None and each["off"] > most]
        if far:
            worst = max(far, key=lambda each: float(each["off"]))
            yield Reason(
                "outlier",
                f"held-out {_poses([str(each['pose']) for each in far])} cannot be explained, off by up to "
                f"{number(worst['off'])} {unit}: measure again there, or leave out what was a slip",
            )


def _poses(labels: Sequence[str]) -> str:
    named = list(dict.fromkeys(labels))
    more = f" and {len(named) - _NAMED} more" if len(named) > _NAMED else ""
    return f"pose{'s' if len(named) > 1 else ''} {', '.join(named[:_NAMED])}{more}"


def basis(found: Evidence, tolerance: Tolerance) -> str:
    shown = [_said(tolerance, what, f"{number(size)} {unit}") for size, unit, what in held_out(found, tolerance)]
    if not shown or found.part is None:
        return f"the tolerance is {tolerance.text}"
    return f"{where_judged(found.part)} {' and '.join(shown)}; the tolerance is {tolerance.text}"


def cautions(found: Evidence, tolerance: Tolerance) -> Iterator[str]:
    """What of a tolerance was not measured, or on few poses."""
    if found.part is None:
        return
    after = found.errors[found.part]["after"]
    measured = {unit for _, unit, _ in held_out(found, tolerance)}
    for unit, what in (("mm", "position"), ("deg", "orientation")):
        if tolerance.limit(unit) is None or found.open.of(unit) is None:
            continue
        if unit not in measured:
            yield f"no {what} was measured: its tolerance is judged by the uncertainties of the parameters alone"
        elif unit == after.unit and not after.of_tool:
            yield (
                f"the {what} itself was not measured but the {after.words}: whether the tool is within the tolerance "
                "is judged by the uncertainties of the parameters too"
            )
    poses = len(np.unique(after.pose))
    if tolerance.of == "p95" and poses < _FEW:
        yield f"only {plural(poses, 'pose')} judge: 95 % of so few is hardly more than the worst one"
