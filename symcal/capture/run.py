"""`symcal capture`: a plan in; pose by pose what is read, checked and kept; a session out that can be identified."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from symcal.calibration.calibrate import one_thread
from symcal.capture.aim import Aim, aim_of
from symcal.capture.checks import Found
from symcal.capture.course import Course, Reading, Wanted
from symcal.capture.estimate import Estimate, dataset, estimate
from symcal.capture.instruments import Way, way_to
from symcal.capture.judging import judge, judged, wanted
from symcal.capture.lines import Missed, Read, Request, Stop, Strike
from symcal.capture.outlook import Order, Outlook, outlook
from symcal.capture.session import EXPERIMENT, MEASUREMENTS, Session, opened_session
from symcal.outputs.names import file_name
from symcal.words import number

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Captured:
    """What a capture came to. tolerance: mm, if one was wanted. stopped: by who measures, before its end."""

    folder: Path
    course: Course
    outlook: Outlook
    tolerance: float | None
    stopped: bool

    @property
    def ended_well(self) -> bool:
        """Whether nothing speaks against going on to identify."""
        done = self.outlook.ending == "used up" and self.tolerance is None
        return self.stopped or done or self.outlook.ending == "reached"

    @property
    def facts(self) -> dict[str, Any]:
        """As plain data."""
        there = self.outlook
        return {
            "session": str(self.folder / EXPERIMENT),
            "measurements": str(self.folder / MEASUREMENTS),
            "poses": there.poses,
            "accuracy_mm": None if there.accuracy is None else asdict(there.accuracy),
            "poses_needed": None if there.forecast is None else there.forecast.poses,
            "ending": "stopped" if self.stopped else there.ending,
            "why": there.why,
            "left_out": [
                {"number": each.number, "pose": each.pose, "why": each.why}
                for each in self.course.standing("held", "struck")
            ],
        }


def capture(
    plan: Path,
    out: Path | None = None,
    *,
    instrument: str = "keyboard",
    tolerance: float | None = None,
    order: Order = "best",
    most: int | None = None,
    afresh: bool = False,
    say: Say = lambda _: None,
) -> Captured:
    """Lead a measurement, or go on with one.

    Args:
        plan: as of `symcal.capture.aim.aim_of`. out: the session's folder; `reports/<name>-capture` when None.
        instrument: one of `symcal.capture.instruments.WAYS`. tolerance: mm. most: poses at most. afresh: what was read
        so far shall not count. say: told what people should know.
    Raises:
        InputError, RefusedError: as of `aim_of`, `way_to` and `opened_session`.
    """
    with one_thread():
        aim = aim_of(plan, tolerance)
        folder = out or Path("reports") / f"{file_name(aim.experiment.file.name)}-capture"
        with opened_session(folder, aim) as session, way_to(instrument, aim, session.sources) as way:
            return _Lead(session, way, say, order, most).through(afresh=afresh)


@dataclass(slots=True)
class _Lead:
    """A capture under way."""

    session: Session
    way: Way
    say: Say
    order: Order
    most: int | None
    known: Estimate | None = None

    @property
    def aim(self) -> Aim:
        return self.session.aim

    def through(self, *, afresh: bool) -> Captured:
        """To the end, or until who measures stops."""
        self._resume(afresh=afresh)
        while True:
            there = outlook(self.aim, self.session.course, self.known, self.order, self.most)
            self._tell(there.said)
            if there.next is None:
                self.way.end(f"{there.ending}: {there.why}")
                return self._captured(there)
            if not self._asked(there.next):
                return self._captured(there, stopped=True)

    def _captured(self, there: Outlook, *, stopped: bool = False) -> Captured:
        return Captured(self.session.folder, self.session.course, there, self.aim.tolerance, stopped)

    def _resume(self, *, afresh: bool) -> None:
        """Where the last process left it."""
        session = self.session
        if afresh:
            session.add({"event": "afresh"})
        course = session.course
        self.known = estimate(self.aim, dataset(self.aim, course.taken))
        for reading in course.standing("new"):
            self._judge(reading)
        if session.course.moved is not None:
            before = [each for each in session.course.taken if each.number < session.course.moved]
            if before and session.course.wanted is None:
                session.add(wanted("check", before[-1], session.course.moved))

    def _asked(self, of: Wanted) -> bool:
        """Ask the instrument once; False where it is enough for now."""
        session, aim = self.session, self.aim
        number_ = session.course.last + 1
        pose = aim.number(of.pose)
        request = Request(number_, of, aim.poses[pose], aim.directions(number_))
        answer = self.way.ask(request)
        if isinstance(answer, Stop):
            return False
        if isinstance(answer, Strike):
            self._strike(answer)
        elif isinstance(answer, Missed):
            session.missed(of, answer.why)
            self._tell(f"pose {of.pose}: missed: {answer.why}")
        elif isinstance(answer, Read):
            session.read(of, answer.q, answer.z, answer.directions, answer.source)
            self._judge(session.course.readings[-1])
        return True

    def _judge(self, reading: Reading) -> None:
        session = self.session
        done = judge(self.aim, session.course, self.known, reading)
        session.add(*done.events)
        self.known = done.known
        self._tell(f"pose {reading.pose}: {_said(done.found)}")
        for event in done.events:
            if event["event"] == "wanted":
                words = {
                    "again": "read pose {} once more",
                    "check": "read pose {} again, to see whether all still stands",
                }
                self._tell(words[str(event["asked"])].format(event["pose"]))
            elif event["event"] == "judged" and event["as"] != "taken" and event["number"] != reading.number:
                other = session.course.numbered(int(event["number"]))
                if other is not None:
                    self._tell(f"pose {other.pose} (reading {other.number}) does not count: {event['why']}")

    def _strike(self, answer: Strike) -> None:
        session = self.session
        reading = session.course.numbered(answer.number)
        if reading is None:
            self._tell(f"there is no reading {answer.number}")
            return
        session.add(judged(reading, "struck", answer.why or "struck by who measured"))
        self.known = estimate(self.aim, dataset(self.aim, session.course.taken))
        self._tell(f"pose {reading.pose} (reading {reading.number}) is struck")

    def _tell(self, text: str) -> None:
        self.say(text)
        self.way.say(text)


def _said(found: Found) -> str:
    """What was found of a reading, in a line."""
    if found.odd:
        return f"odd: {found.odd}"
    if found.off is None:
        return "read"
    usual = "" if found.expected is None else f" ({number(found.expected)} {found.unit} would be usual)"
    return f"{number(found.off)} {found.unit} from where it was foreseen{usual}"
