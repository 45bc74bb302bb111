"""How a capture stands: what its events come to. A pure function of the journal, so that a resumed one goes on alike.

{"event": "begin", "schema": ..., "experiment": hash, "plan": hash}
{"event": "reading", "number": 7, "pose": "12", "asked": "pose" | "again" | "check", "beside": 3, "since": 5,
 "q": [...], "z": [...], "from": [...], "source": "30.png"}     rad and mm, as inside; null: not seen
{"event": "missed", "number": 8, "pose": "3", "why": "..."}
{"event": "judged", "number": 7, "as": "taken" | "held" | "struck", "why": "...", "proof": true}    the last counts
{"event": "wanted", "asked": "again" | "check", "pose": "12", "beside": 3, "since": 5}      what is read next
{"event": "moved", "number": 9, "why": "..."}                   something has moved before this reading
{"event": "mistaken", "why": "..."}                             all readings are wrong in the same way
{"event": "settled"}                                            neither is so any more
{"event": "afresh"}                                             what was read so far does not count
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.capture.journal import Event

Array = NDArray[np.float64]
Standing = Literal["new", "taken", "held", "struck"]
"""Of a reading: not yet looked at; counts; does not fit and waits for what others say; does not count."""
Asked = Literal["pose", "again", "check"]
"""Why something was read: a pose of the plan, the same once more, or a known one, to see whether all still stands."""

MISSES = 2
"""Times that a pose may be missed before it is left out."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be read next. beside: number of the reading that it is compared with, and since: of the first one that
    is not proved by that; 0 where there are none."""

    pose: str
    asked: Asked = "pose"
    beside: int = 0
    since: int = 0


@dataclass(frozen=True, slots=True)
class Reading:
    """One answer of the instrument.

    number: of the request, from 1. q: joint readings, shape (dof,), rad and mm. z: what was read, shape (w,), NaN where
    nothing was. directions: from where each joint came, shape (dof,), 0 where not known. proof: that nothing had moved
    by then: so sharply was it foreseen.
    """

    number: int
    of: Wanted
    q: Array
    z: Array
    directions: Array
    standing: Standing = "new"
    why: str = ""
    proof: bool = False

    @property
    def pose(self) -> str:
        """Its name in the plan."""
        return self.of.pose


@dataclass(frozen=True, slots=True)
class Course:
    """Where a capture stands.

    readings: in their order. misses: poses that could not be read, as often as that was. last: number of the last
    request. wanted: what must be read before anything else. moved: before which reading something moved; None where all
    stands. mistaken: whether all readings are wrong. words: of either. begun: number of the last request before it was
    begun anew.
    """

    readings: tuple[Reading, ...] = ()
    misses: tuple[str, ...] = ()
    last: int = 0
    wanted: Wanted | None = None
    moved: int | None = None
    mistaken: bool = False
    words: str = ""
    begun: int = 0

    def standing(self, *of: Standing) -> tuple[Reading, ...]:
        """The readings of which that is so."""
        return tuple(reading for reading in self.readings if reading.standing in of)

    @property
    def taken(self) -> tuple[Reading, ...]:
        """Those that count."""
        return self.standing("taken")

    @property
    def anchor(self) -> Reading | None:
        """The last reading up to which nothing had moved, as far as is proved; the first one where nothing is yet."""
        taken = self.taken
        proved = [reading for reading in taken if reading.proof]
        return proved[-1] if proved else taken[0] if taken else None

    @property
    def unproved(self) -> int:
        """How many readings have come since."""
        anchor = self.anchor
        return 0 if anchor is None else sum(reading.number > anchor.number for reading in self.taken)

    @property
    def done(self) -> frozenset[str]:
        """Poses that need not be asked for again."""
        given_up = {pose for pose in self.misses if self.misses.count(pose) >= MISSES}
        return frozenset({reading.pose for reading in self.standing("new", "taken", "held")} | given_up)

    def numbered(self, number: int) -> Reading | None:
        """The reading of a number."""
        return next((reading for reading in self.readings if reading.number == number), None)

    def after(self, event: Event) -> Course:
        """The course with one more event."""
        kind = event["event"]
        if kind == "reading":
            z = np.array([np.nan if value is None else value for value in event["z"]], dtype=np.float64)
            q, came = (np.array(event[key], dtype=np.float64) for key in ("q", "from"))
            of = Wanted(str(event["pose"]), event["asked"], int(event["beside"]), int(event["since"]))
            new = Reading(int(event["number"]), of, q, z, came)
            return replace(self, readings=(*self.readings, new), last=new.number, wanted=None)
        if kind == "missed":
            return replace(
                self, misses=(*self.misses, str(event["pose"])), last=int(event["number"]), wanted=self._missed(event)
            )
        if kind == "judged":
            judged = (
                replace(reading, standing=event["as"], why=event["why"], proof=event["proof"])
                if reading.number == event["number"]
                else reading
                for reading in self.readings
            )
            return replace(self, readings=tuple(judged))
        if kind == "wanted":
            of = Wanted(str(event["pose"]), event["asked"], int(event["beside"]), int(event["since"]))
            return replace(self, wanted=of)
        if kind == "moved":
            return replace(self, moved=int(event["number"]), words=str(event["why"]))
        if kind == "mistaken":
            return replace(self, mistaken=True, words=str(event["why"]))
        if kind == "settled":
            return replace(self, moved=None, mistaken=False, words="")
        if kind == "afresh":
            struck = (replace(reading, standing="struck", why=reading.why or "begun anew") for reading in self.readings)
            return Course(tuple(struck), last=self.last, begun=self.last)
        return self

    def _missed(self, event: Event) -> Wanted | None:
        """What is still wanted when that could not be read: a pose that is missed again and again is left."""
        often = self.misses.count(str(event["pose"])) + 1
        return self.wanted if often < MISSES else None


def course_of(events: Sequence[Event]) -> Course:
    """What events come to."""
    course = Course()
    for event in events:
        course = course.after(event)
    return course
