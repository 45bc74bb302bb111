"""What follows from a reading: it counts, or it is read again, or a known pose is, or something has moved.

    odd                 the same pose is read again
    ... and now good    the first one was a slip
    ... and the same    a known pose is read again: has something moved, or is it this pose alone?
    ... off as well     and one more: something has moved, unless that one is as it was and the first was the slip
    ... as it was       the readings are judged anew, all together: those that the others do not explain are left out;
                        if they are many, it is the model that lacks something, and all count

Everything is an event for the journal; nothing here has a memory of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symcal.calibration.mistakes.search import find_mistakes
from symcal.capture.aim import Aim
from symcal.capture.checks import ODD, Found, agree, apart, check, odd_among, off_by_now
from symcal.capture.course import Asked, Course, Reading
from symcal.capture.estimate import Estimate, dataset, estimate
from symcal.capture.journal import Event
from symcal.capture.moved import jump
from symcal.capture.promise import ground
from symcal.words import number

TRIES = 4
"""Readings of one pose that may all be odd and different before it is left out."""
UNPROVED = 2
"""Readings in a row that would not tell whether something has moved, after which a known pose is read again."""
_FIRST = 12  # readings among which a mistake of all of them is looked for
_MANY = 0.2  # share of the readings from which on odd ones are no slips


@dataclass(frozen=True, slots=True)
class Judged:
    """What follows from one reading: events for the journal, what was found of it, the course and the estimate then."""

    events: tuple[Event, ...]
    found: Found
    course: Course
    known: Estimate | None


def judge(aim: Aim, course: Course, known: Estimate | None, reading: Reading) -> Judged:
    """What follows from a reading that just came in.

    Args:
        known: the estimate of the readings that count.
    """
    others = [each for each in course.readings if each.number < reading.number]
    found = check(aim, known, reading, others)
    mistaken = _mistaken(aim, course)
    if mistaken:
        told: tuple[Event, ...] = (judged(reading, "held", "as others"), {"event": "mistaken", "why": mistaken})
        return Judged(told, found, course.after(told[0]).after(told[1]), known)
    events: tuple[Event, ...] = tuple(_events(aim, course, known, reading, found))
    now = course
    for event in events:
        now = now.after(event)
    if now.taken != course.taken:
        known = estimate(aim, dataset(aim, now.taken), known)
        if now.wanted is None and now.moved is None and not now.mistaken:
            more = tuple(_afterwards(aim, now, known))
            for event in more:
                now = now.after(event)
            if any(event["event"] == "judged" for event in more):
                known = estimate(aim, dataset(aim, now.taken), None)
            events += more
    return Judged(events, found, now, known)


def _mistaken(aim: Aim, course: Course) -> str:
    """What is wrong with all readings alike, such as their unit, or with the joint readings; empty where nothing is."""
    every = course.standing("new", "taken", "held")
    if not len(every) <= _FIRST:
        return ""
    data = dataset(aim, every)
    found = find_mistakes(aim.model, replace(data, split=("train",) * len(data)))
    return "; ".join(each.text for each in found)


def _events(aim: Aim, course: Course, known: Estimate | None, reading: Reading, found: Found) -> Iterator[Event]:
    beside = course.numbered(reading.of.beside)
    if reading.of.asked == "check" and beside is not None:
        yield from _checked(aim, course, known, reading, beside)
    elif not found.odd:
        if reading.of.asked == "again":
            for each in _tries(course, reading):
                yield judged(each, "struck", f"a slip: read again it was another ({each.why})")
        yield judged(reading, "taken", proof=found.sharp)
    elif known is None or beside is None or reading.of.asked != "again":
        yield judged(reading, "held", found.odd)
        yield wanted("again", reading)
    elif any(agree(aim, known, each, reading) for each in _tries(course, reading)):
        yield judged(reading, "held", found.odd)
        yield from _to_check(aim, course, known)
    elif len(_tries(course, reading)) + 1 >= TRIES:
        for each in (*_tries(course, reading), reading):
            yield judged(each, "held", "read several times, each time something else: is the mark seen, is all tight?")
    else:
        yield judged(reading, "held", found.odd)
        yield wanted("again", reading)


def _tries(course: Course, reading: Reading) -> tuple[Reading, ...]:
    """Earlier readings of the same pose that wait."""
    return tuple(each for each in course.standing("held") if each.pose == reading.pose and each.number < reading.number)


def _to_check(aim: Aim, course: Course, known: Estimate | None, before: int | None = None) -> Iterator[Event]:
    """A pose from when nothing had moved is read again, that which tells most besides; without one nothing can be
    compared.

    Args:
        before: the first reading after which something may have moved; the first one that proves nothing when None.
    """
    anchor = course.anchor
    if anchor is None:
        return
    last = anchor.number if before is None else before - 1
    sure = [each for each in course.taken if each.number <= last] or [anchor]
    best = sure[-1]
    if known is not None:
        best = sure[int(np.argmax(ground(aim, known).gains([aim.number(each.pose) for each in sure])))]
    yield wanted("check", best, last + 1)


def _checked(aim: Aim, course: Course, known: Estimate | None, reading: Reading, beside: Reading) -> Iterator[Event]:
    """A known pose was read again: does it read as before?"""
    p, size, unit = apart(aim, known, reading, beside)
    tries = [each for each in _tries(course, reading) if each.of == reading.of]
    others = [each for each in course.standing("held") if each.of.asked == "check" and each.pose != reading.pose]
    if p >= ODD:
        yield judged(reading, "taken", proof=True)
        for each in tries:
            yield judged(each, "struck", f"a slip: read again it was another ({each.why})")
        if course.moved is not None:
            yield {"event": "settled"}
            for each in course.standing("held"):
                yield judged(each, "struck", "read while something stood elsewhere")
            return
        for each in others:  # two of them agreed: what they were compared with was wrong
            yield judged(each, "taken")
            old = course.numbered(each.of.beside)
            if old is not None and old.standing == "taken":
                yield judged(old, "struck", f"a slip: read again it was another, while pose {beside.pose} is as before")
        yield from _all_together(aim, course, reading, known)
        return
    yield judged(reading, "held", f"{number(size)} {unit} from what was read there before")
    if course.moved is not None:
        yield moved(aim, course, course.moved, beside, size, unit)
    elif any(agree(aim, known, each, reading) for each in tries):
        second = None if others else _second(course, beside)
        if second is not None:  # it may have been a slip that they were compared with
            yield wanted("check", second, reading.of.since)
            return
        since = [each for each in course.standing("taken", "held") if reading.of.since <= each.number < reading.number]
        for each in since:
            if each.standing == "taken":
                yield judged(each, "held", "something has moved, before it or after")
        yield moved(aim, course, min((each.number for each in since), default=reading.number), beside, size, unit)
    elif len(tries) + 1 >= TRIES:
        yield {"event": "mistaken", "why": _unsteady(aim, known, reading, (*tries, beside))}
    else:
        yield wanted("check", beside, reading.of.since)


def _second(course: Course, beside: Reading) -> Reading | None:
    """Another reading to compare with: the last one before, else any."""
    others = [each for each in course.taken if each.pose != beside.pose]
    before = [each for each in others if each.number < beside.number]
    return (before or others)[-1] if others else None


def _unsteady(aim: Aim, known: Estimate | None, reading: Reading, others: Sequence[Reading]) -> str:
    """What is said of a pose that reads otherwise each time."""
    size, unit = max((apart(aim, known, reading, each)[1:] for each in others), key=lambda each: each[0])
    return (
        f"pose {reading.pose} reads otherwise each time, by up to {number(size)} {unit}, which is more than the noise "
        f"that is stated: is {_ends(aim)[1]} tight, does the robot stand still, and is the noise what the instrument "
        "has? Where it is not, state it in the experiment and plan again"
    )


def _all_together(aim: Aim, course: Course, reading: Reading, last: Estimate | None) -> Iterator[Event]:
    """Nothing has moved: which of the readings do the others not explain?"""
    held = tuple(each for each in course.standing("held") if each.of.asked != "check")
    if not held:
        return
    every = sorted((*course.taken, *held, reading), key=lambda each: each.number)
    known = estimate(aim, dataset(aim, every), last)
    odd = () if known is None else odd_among(aim, known, every)
    numbers = {each.number for each in odd}
    many = len({each.pose for each in odd}) > max(_MANY * len({each.pose for each in every}), 1)
    for each in held:
        if many or each.number not in numbers:
            yield judged(each, "taken", "")
    if not many:
        for each in odd:
            if each.standing == "taken":
                yield judged(each, "held", "the others put it elsewhere")


def _afterwards(aim: Aim, course: Course, known: Estimate | None) -> Iterator[Event]:
    """What the new estimate says of readings that were taken before, and whether it is time to look if all stands; no
    more of it once there are more such readings than poses."""
    again = sum(each.of.asked != "pose" for each in course.readings if each.number > course.begun)
    if again > len({each.pose for each in course.taken}):
        return
    if known is None:
        if course.unproved >= UNPROVED:
            yield from _to_check(aim, course, known)
        return
    first = max((i for i, each in enumerate(course.taken) if each.of.asked == "check"), default=0)
    found = jump(aim, known, first)
    if found is not None or course.unproved >= UNPROVED:
        yield from _to_check(aim, course, known, None if found is None else course.taken[found.at].number)
        return
    odd = [each for each in off_by_now(aim, known, course.taken) if not _confirmed(aim, known, course, each)]
    if odd:
        yield judged(odd[0], "held", "the others put it elsewhere")
        yield wanted("again", odd[0])


def _confirmed(aim: Aim, known: Estimate, course: Course, reading: Reading) -> bool:
    """Whether its pose was read again, and was the same: then it is no slip, whatever the others say."""
    others = [each for each in course.standing("taken", "held") if each.pose == reading.pose and each is not reading]
    return any(agree(aim, known, each, reading) for each in others)


def judged(reading: Reading, as_: str, why: str = "", *, proof: bool = False) -> Event:
    """How a reading stands from now on. Args: proof: that nothing had moved by then."""
    return {"event": "judged", "number": reading.number, "as": as_, "why": why, "proof": proof}


def wanted(asked: Asked, beside: Reading, since: int = 0) -> Event:
    """The pose of a reading is read again next. Args: since: the first reading that is not proved by that one."""
    return {"event": "wanted", "pose": beside.pose, "asked": asked, "beside": beside.number, "since": since}


def moved(aim: Aim, course: Course, first: int, beside: Reading, size: float, unit: str) -> Event:
    """Something stands elsewhere since a reading."""
    at = course.numbered(first)
    since = "now" if at is None else f"from pose {at.pose} on (reading {first})"
    still, carried = _ends(aim)
    why = (
        f"something has moved, {since}: pose {beside.pose} reads {number(size)} {unit} from where it was. Is {carried} "
        f"tight, and did nobody touch {still}? Put back what can be put back exactly, and call the same command again: "
        f"pose {beside.pose} is read first, and if it is as before all goes on. Otherwise '--afresh' begins anew and "
        "keeps the readings so far aside"
    )
    return {"event": "moved", "number": first, "why": why}


def _ends(aim: Aim) -> tuple[str, str]:
    """What stands still and what the robot carries, in words."""
    o = aim.observation
    target = f"the target '{o.target.name}'" if o.target.name != o.name else "the target"
    own = f"the instrument '{o.name}'"
    return (target, own) if o.at.moves else (f"{own} or the robot's base", target)
