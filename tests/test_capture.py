"""A measurement that is led: what is promised, what is noticed, and that nothing is lost.

`capture_draws.py` and `capture_kills.py` are the long forms.
"""

from __future__ import annotations

import json
import os
import socket
import threading
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from capture_draws import TOLERANCE, lead, quick_plan, run, tool_frames
from capture_kills import disturbed, undisturbed

from symcal.calibration.simulate import simulate
from symcal.capture.aim import Aim, aim_of
from symcal.capture.course import Course, Reading, Wanted, course_of
from symcal.capture.estimate import dataset, estimate
from symcal.capture.instruments import way_to
from symcal.capture.journal import JOURNAL, SCHEMA, opened
from symcal.capture.judging import judge
from symcal.capture.lines import Missed, Read, Request, Stop, Strike, answer, asked, greeting, request_line
from symcal.capture.outlook import outlook
from symcal.capture.promise import first_ground, forecast, ground
from symcal.capture.simulated import Mishaps, Simulated, simulated
from symcal.capture.watched_folder import WatchedFolder
from symcal.drafts.files import write_first_files
from symcal.drafts.instrument import draft_named
from symcal.drafts.robot_file import of_arm
from symcal.errors import InputError, RefusedError
from symcal.instruments.noise import Noise
from symcal.planning.plan_file import write_plan
from symcal.runs.load import load
from symcal.vision.render import render_board


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return quick_plan(tmp_path_factory.mktemp("capture"))


@pytest.fixture(scope="module")
def aim(plan: Path) -> Aim:
    return aim_of(plan, TOLERANCE)


@pytest.fixture(scope="module")
def there(aim: Aim) -> Simulated:
    return simulated(aim, 3)


@pytest.fixture(scope="module")
def sixteen(aim: Aim, there: Simulated) -> Course:
    """Sixteen poses of the plan, all good."""
    course = Course()
    for i in range(16):
        course = read(aim, course, i, there.read(i + 1, aim.poses[i], np.zeros(6)))
        course = course.after({"event": "judged", "number": i + 1, "as": "taken", "why": "", "proof": True})
    return course


def read(aim: Aim, course: Course, pose: int, z: np.ndarray | None, of: Wanted | None = None) -> Course:
    """The course with a reading that nobody has looked at."""
    wanted = of or Wanted(aim.names[pose])
    event = {"event": "reading", "number": course.last + 1, "q": aim.poses[pose], "z": z, "from": np.zeros(6)}
    return course.after(event | asdict(wanted))


# --------------------------------------------------------------------------------------------------- what is promised


def test_the_accuracy_is_that_of_drawn_robots(aim: Aim, sixteen: Course) -> None:
    aim = replace(aim, region=aim.region[:80])
    known = estimate(aim, dataset(aim, sixteen.taken))
    assert known is not None
    found, rng = ground(aim, known).accuracy, np.random.default_rng(4)
    model, index = aim.model, aim.model.parameters.indices(aim.parameters)
    at = np.asarray(model.points(aim.region, known.fit.x, known.setup.vector)[0])
    root, off = np.linalg.cholesky(known.covariance), []
    for _ in range(400):
        x = known.fit.x.copy()
        x[index] += aim.scales * (root @ rng.normal(size=len(index)))
        off.append(np.asarray(model.points(aim.region, x, known.setup.vector)[0]) - at)
    rms = np.sqrt(np.mean(np.sum(np.square(off), axis=2), axis=1))
    assert found.sure == pytest.approx(np.quantile(rms, 0.95), rel=0.08)
    assert found.expected == pytest.approx(np.sqrt(np.mean(rms**2)), rel=0.05)


def test_a_pose_to_come_counts_as_it_will_when_it_is_measured(aim: Aim, sixteen: Course) -> None:
    known = estimate(aim, dataset(aim, sixteen.taken))
    assert known is not None
    start = ground(aim, known)
    gains, left = start.gains(range(16, 40)), []
    for number in range(16, 40):
        rows = start.rows[number]
        more = np.linalg.inv(np.linalg.inv(start.covariance) + rows.T @ rows)
        np.testing.assert_allclose(start.with_pose(number).covariance, more, rtol=1e-5, atol=1e-9)
        left.append(np.trace(start.weight @ (start.covariance - more)))
    np.testing.assert_allclose(gains, left, rtol=1e-4)
    assert start.best(range(16, 40)) == 16 + int(np.argmax(left))


def test_what_no_pose_tells_is_a_floor(aim: Aim, sixteen: Course) -> None:
    known = estimate(aim, dataset(aim, sixteen.taken))
    assert known is not None
    start = ground(aim, known)
    assert forecast(start, 1e-6, (), range(16, 40)).poses is None
    assert forecast(start, start.accuracy.sure, (), range(16, 40)).poses == 0
    hidden = replace(start, rows=start.rows * (np.arange(len(start.weight)) > 5))  # the first six are never told
    assert forecast(hidden, 1e-6, (), range(16, 40)).floor > 1.5 * forecast(start, 1e-6, (), range(16, 40)).floor


def test_at_first_the_best_poses_are_those_of_what_is_plausible(aim: Aim) -> None:
    assert first_ground(aim, ()).accuracy.sure > 100 > first_ground(aim, range(30)).accuracy.sure


@pytest.mark.parametrize(("order", "most"), [("best", 18), pytest.param("plan", 40, marks=pytest.mark.long)])
def test_a_capture_keeps_what_it_promised(aim: Aim, order: str, most: int) -> None:
    found = run(aim, 3, order, Mishaps())  # type: ignore[arg-type]
    assert found.outlook.ending == "reached"
    assert found.fitted <= found.error + 1e-9
    assert found.fitted <= TOLERANCE
    assert len({each.pose for each in found.course.readings}) <= most


@pytest.mark.long
def test_noise_that_nobody_states_is_told_by_what_is_left(tmp_path: Path) -> None:
    aim = aim_of(quick_plan(tmp_path, stated=False), TOLERANCE)
    _, end, known = lead(aim, simulated(aim, 8), "best")
    assert end.ending == "reached"
    assert known is not None
    (name,) = known.fit.estimated
    squares, dof = known.fit.by_group[name]
    assert known.noise[name] > known.fit.sigmas[name]  # its upper limit
    assert squares / dof == pytest.approx(1.0, abs=0.2)


def test_a_model_that_lacks_something_promises_nothing(aim: Aim, sixteen: Course) -> None:
    """The robot bends by half a millimetre as the noise of its own, the same each time."""
    bent = np.random.default_rng(5).normal(scale=0.5, size=(16, 3))
    readings = [replace(each, z=each.z + off) for each, off in zip(sixteen.readings, bent, strict=True)]
    course = replace(sixteen, readings=tuple(readings))
    known = estimate(aim, dataset(aim, course.taken))
    assert known is not None
    assert known.misfit is not None
    end = outlook(replace(aim, planned=32), course, known)
    assert end.ending == "impossible"
    assert "beyond the noise that is stated" in end.why


# ----------------------------------------------------------------------------------------------------- what is noticed


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda z: z / 1000, "metres, labelled as millimetres"),
        (lambda z: z / 25.4, "inches, labelled as millimetres"),
        (lambda z: z + np.array([0, 3, 0]), "from where the others put it"),
    ],
)
def test_a_wrong_reading_is_read_again(aim: Aim, there: Simulated, sixteen: Course, wrong: object, said: str) -> None:
    known = estimate(aim, dataset(aim, sixteen.taken))
    right = there.read(17, aim.poses[16], np.zeros(6))
    assert callable(wrong)
    course = read(aim, sixteen, 16, wrong(right))
    done = judge(aim, course, known, course.readings[-1])
    assert said in done.found.odd
    assert done.course.wanted == Wanted(aim.names[16], "again", 17)
    course = read(aim, done.course, 16, right, done.course.wanted)
    done = judge(aim, course, done.known, course.readings[-1])
    assert [each.standing for each in done.course.readings[-2:]] == ["struck", "taken"]


def test_a_robot_that_stayed_is_named(aim: Aim, there: Simulated, sixteen: Course) -> None:
    known = estimate(aim, dataset(aim, sixteen.taken))
    course = read(aim, sixteen, 16, there.read(40, aim.poses[30], np.zeros(6)))
    assert f"stood at pose {aim.names[30]}" in judge(aim, course, known, course.readings[-1]).found.odd
    course = read(aim, sixteen, 16, sixteen.readings[4].z)
    assert "has not read anew" in judge(aim, course, known, course.readings[-1]).found.odd


def test_what_noise_alone_forbids_is_said(aim: Aim, there: Simulated, sixteen: Course) -> None:
    course = sixteen
    for i in range(16, 28):
        course = read(aim, course, i, there.read(i + 1, aim.poses[i], np.zeros(6)))
        course = course.after({"event": "judged", "number": i + 1, "as": "taken", "why": "", "proof": True})
    known = estimate(aim, dataset(aim, course.taken))
    end = outlook(replace(aim, tolerance=0.003), course, known)
    assert end.ending == "impossible"
    assert "at this noise (0.0500 mm)" in end.why
    early = outlook(replace(aim, tolerance=0.003), sixteen, estimate(aim, dataset(aim, sixteen.taken)))
    assert early.next is not None
    assert "out of sight" in early.said


def test_an_instrument_that_is_not_as_precise_as_stated_is_told(aim: Aim) -> None:
    _, end, _ = lead(aim, replace(simulated(aim, 3), noise={"position": 1.0}), "best")  # twenty times as much
    assert end.ending == "mistaken"
    assert "reads otherwise each time" in end.why


@pytest.mark.parametrize("moves", ["target", pytest.param("base", marks=pytest.mark.long)])
def test_a_bump_is_told_within_two_poses_and_can_be_undone(aim: Aim, moves: str) -> None:
    there = simulated(aim, 4, Mishaps(bump=11, moves=moves))  # type: ignore[arg-type]
    course, end, known = lead(aim, there, "best")
    assert end.ending == "moved"
    assert len({r.pose for r in course.readings if r.number >= 11 and r.of.asked == "pose"}) <= 2
    assert all(each.number < 11 for each in course.taken)
    assert "something has moved" in end.why

    back, beside = simulated(aim, 4), course.taken[-1]
    pose = aim.number(beside.pose)
    of = Wanted(beside.pose, "check", beside.number, course.moved or 0)
    course = read(aim, course, pose, back.read(course.last + 1, aim.poses[pose], np.zeros(6)), of)
    done = judge(aim, course, known, course.readings[-1])
    assert done.course.moved is None
    assert not done.course.standing("held")
    assert outlook(aim, done.course, done.known).next is not None


@pytest.mark.long
def test_slips_and_drop_outs_do_no_harm(aim: Aim) -> None:
    found = run(aim, 6, "best", Mishaps(outliers=0.15, misses=0.15))
    assert found.outlook.ending == "reached"
    assert found.error <= 1.5 * TOLERANCE
    assert found.course.standing("struck")


def test_all_readings_in_another_unit_are_told(aim: Aim, there: Simulated) -> None:
    course, known = Course(), None
    while not course.mistaken and len(course.readings) < 12:
        i = len({each.pose for each in course.readings})
        of = course.wanted
        pose = i if of is None else aim.number(of.pose)
        z = there.read(course.last + 1, aim.poses[pose], np.zeros(6))
        course = read(aim, course, pose, None if z is None else z / 1000, of)
        done = judge(aim, course, known, course.readings[-1])
        course, known = done.course, done.known
    assert course.mistaken
    assert "metres, labelled as millimetres" in course.words


# ------------------------------------------------------------------------------------------------ what is said and kept


def test_lines_say_what_was_meant(aim: Aim) -> None:
    request = Request(7, Wanted(aim.names[3]), aim.poses[3], np.array([1.0, -1, 1, 1, -1, -1]))
    again = asked(aim, request_line(aim, request))
    assert again is not None
    np.testing.assert_allclose(again.q, request.q, rtol=0, atol=1e-15)
    assert (again.number, again.directions.tolist()) == (7, request.directions.tolist())
    assert greeting(aim).endswith("-> x_mm y_mm z_mm")
    assert asked(aim, "SAY 12 poses\n") is None

    def said(*lines: str) -> object:
        return answer(aim, request, lines)

    found = said("# a remark", "at 0 0 0 0 0 90", "from + + - - 0 0", "ok 1 2 nan")
    assert isinstance(found, Read)
    assert found.q[5] == pytest.approx(np.pi / 2)
    assert found.directions.tolist() == [1, 1, -1, -1, 0, 0]
    np.testing.assert_array_equal(found.z, [1, 2, np.nan])
    assert said("MISS no sight") == Missed("no sight")
    assert said("strike 5 the lamp") == Strike(5, "the lamp")
    assert said("STOP") == said() == Stop()


@pytest.mark.parametrize(
    "line", ["1 2", "1 2 3 4", "a b c", "inf 1 2", "nan nan nan", "AT 1 2", "FROM + +", "STRIKE five"]
)
def test_a_line_that_means_nothing_is_named(aim: Aim, line: str) -> None:
    request = Request(1, Wanted("1"), aim.poses[0], np.zeros(6))
    with pytest.raises(InputError, match=r"wanted|was read"):
        answer(aim, request, [line])


def test_a_journal_forgets_the_line_that_a_crash_cut_off(tmp_path: Path) -> None:
    events = [{"event": "begin", "schema": SCHEMA}, {"event": "missed", "number": 1, "pose": "2", "why": "dark"}]
    with opened(tmp_path) as journal:
        for event in events:
            journal.add(event)
        with pytest.raises(RefusedError, match="another capture"), opened(tmp_path):
            pass
    with (tmp_path / JOURNAL).open("a") as file:
        file.write('{"event": "reading", "num')
    with opened(tmp_path) as journal:
        assert journal.events == events
        journal.add({"event": "settled"})
    assert [json.loads(line)["event"] for line in (tmp_path / JOURNAL).read_text().splitlines()] == [
        "begin",
        "missed",
        "settled",
    ]
    (tmp_path / JOURNAL).write_text('{"event": "begin", "schema": "symcal/capture/0"}\n')
    with pytest.raises(InputError, match="another version"), opened(tmp_path):
        pass
    (tmp_path / JOURNAL).write_text("poses\n")
    with pytest.raises(InputError, match="no event"), opened(tmp_path):
        pass


def test_a_session_is_gone_on_with_and_identified(plan: Path, symcal) -> None:
    told = "--instrument", "simulated:3", "--out", "session", "--tolerance", "0.1mm"
    code, _, err = symcal("capture", plan, *told, "--most", "6")
    assert code == 1
    assert "6 poses were read" in err
    first = (Path("session") / JOURNAL).read_bytes()
    code, out, err = symcal("capture", plan, *told, "--json")
    assert code == 0, err
    found = json.loads(out)["results"]
    assert found["ending"] == "reached"
    assert (Path("session") / JOURNAL).read_bytes().startswith(first)
    table = pd.read_csv("session/measurements.csv", comment="#")
    assert table["pose"][table["split"] == "train"].astype(str).str.split().str[0].nunique() == found["poses"]
    code, out, err = symcal("identify", "session/session.yaml", "--out", "identified", "--no-report")
    assert "written to identified" in out, err  # accepted or not
    results = json.loads(Path("identified/results.json").read_text())
    assert results["identification"]["noise"]["position"]["sigma"] == pytest.approx(0.05)
    code, _, err = symcal("capture", plan, *told, "--afresh", "--most", "2")
    assert "2 poses were read" in err
    assert set(pd.read_csv("session/measurements.csv", comment="#")["split"]) == {"train", "unused"}


def test_lines_on_standard_input(plan: Path, symcal, monkeypatch) -> None:
    import io

    monkeypatch.setattr("sys.stdin", io.StringIO("1 2 3\nMISS dark\n4 5 6\nSTRIKE 1 wrong lens\nSTOP\n"))
    code, out, _ = symcal("capture", plan, "--instrument", "-", "--out", "session", "--quiet")
    assert code == 0
    lines = out.splitlines()
    assert lines[0].startswith("CAPTURE 1 q1_deg")
    assert [line.split()[1] for line in lines if line.startswith("MEASURE")] == ["1", "2", "3", "4", "4"]
    events = [json.loads(line) for line in (Path("session") / JOURNAL).read_text().splitlines()]
    assert [r.standing for r in course_of(events).readings] == ["struck", "taken"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--instrument", "telnet:1"), "no such way to an instrument"),
        (("--instrument", "tcp://here"), "expected tcp://HOST:PORT"),
        (("--instrument", "serial:/dev/ttyUSB0"), "expected serial:DEVICE:BAUD"),
        (("--instrument", "simulated:x"), "a seed is a number"),
        (("--tolerance", "0.1deg"), "a length with its unit"),
        (("--order", "worst"), "no such order"),
    ],
)
def test_what_cannot_be_is_one_error(plan: Path, symcal, arguments: tuple[str, ...], said: str) -> None:
    code, _, err = symcal("capture", plan, *arguments, "--out", "session")
    assert code == 1
    assert said in err
    assert "Traceback" not in err


def test_a_folder_that_is_no_plan(tmp_path: Path, symcal) -> None:
    code, _, err = symcal("capture", tmp_path)
    assert code == 1
    assert "there is no such file" in err


def test_another_plan_or_other_files_are_left_alone(plan: Path, tmp_path: Path, symcal) -> None:
    symcal("capture", plan, "--instrument", "simulated:3", "--out", "session", "--most", "2")
    other = tmp_path / "other"
    other.mkdir()
    quick_plan(other)
    (other / "plan" / "plan.csv").write_text((plan / "plan.csv").read_text().rpartition("40,")[0])
    code, _, err = symcal("capture", other / "plan", "--instrument", "simulated:3", "--out", "session")
    assert code == 1
    assert "begun with another plan" in err
    Path("mine").mkdir()
    Path("mine/notes.txt").write_text("mine")
    code, _, err = symcal("capture", plan, "--instrument", "simulated:3", "--out", "mine")
    assert code == 1
    assert "holds other files (notes.txt)" in err
    assert [path.name for path in Path("mine").iterdir()] == ["notes.txt"]


def test_backlash_is_come_to_from_both_sides(tmp_path: Path) -> None:
    folder = quick_plan(tmp_path)
    file = folder / "experiment.resolved.yaml"
    file.write_text(f"{file.read_text()}\nidentification: {{extend: [backlash]}}\n")
    aim = aim_of(folder, TOLERANCE)
    sides = np.array([aim.directions(number) for number in range(1, 21)])
    np.testing.assert_array_equal(sides.sum(axis=0), 0)
    assert np.linalg.matrix_rank(sides) == 6
    line = request_line(aim, Request(1, Wanted("1"), aim.poses[0], aim.directions(1)))
    assert " FROM " in line
    data = dataset(aim, [Reading(1, Wanted("1"), aim.poses[0], np.zeros(3), aim.directions(1))])
    assert set(data.conditions) == {f"q{i}_direction" for i in range(1, 7)}


def test_a_server_that_goes_away_comes_back(plan: Path, aim: Aim, there: Simulated, symcal) -> None:
    """An instrument of a few lines, which hangs up after every third answer."""
    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        count = 0
        while count < 8:
            with listening.accept()[0] as connection, connection.makefile("rw", newline="\n") as lines:
                for line in lines:
                    request = asked(aim, line)
                    if request is not None:
                        count += 1
                        z = there.read(request.number, request.q, request.directions)
                        lines.write("STOP\n" if z is None or count == 8 else f"{' '.join(map(str, z))}\n")
                        lines.flush()
                        if count % 3 == 0:
                            break

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
    code, _, err = symcal("capture", plan, "--instrument", address, "--out", "session", "--tolerance", "0.1mm")
    thread.join(timeout=60)
    listening.close()
    assert code == 0, err
    table = pd.read_csv("session/measurements.csv", comment="#")
    assert len(table) == 7
    assert table["pose"].is_unique


def test_a_serial_port_is_spoken_to_line_by_line(aim: Aim) -> None:
    """A pseudo-terminal: who answers has said no more than a line when the next request is due."""
    pytest.importorskip("serial")
    tty = pytest.importorskip("tty")
    theirs, ours = os.openpty()
    tty.setraw(ours)
    heard: list[str] = []

    def serve() -> None:
        waiting = b""
        while len(heard) < 3:
            waiting += os.read(theirs, 64)
            *lines, waiting = waiting.split(b"\n")
            for line in lines:
                heard.append(line.decode())
                request = asked(aim, heard[-1])
                if request is not None:
                    os.write(theirs, f"{request.number}.5 2 3\n".encode())

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    with way_to(f"serial:{os.ttyname(ours)}:115200", aim) as way:
        for number in (1, 2):
            found = way.ask(Request(number, Wanted(f"pose {number}"), aim.poses[0], np.zeros(6)))
            assert isinstance(found, Read)
            assert found.z.tolist() == [number + 0.5, 2, 3]
    thread.join(timeout=10)
    assert [line.split()[0] for line in heard] == ["CAPTURE", "MEASURE", "MEASURE"]
    os.close(ours)
    os.close(theirs)
    with pytest.raises(InputError, match="the port cannot be opened"), way_to("serial:/dev/nothing:9600", aim):
        pass


@pytest.mark.long
def test_images_that_come_into_a_folder_are_measured(tmp_path: Path) -> None:
    """A board that is seen by the nominal robot, rendered where forward kinematics of our own has it."""
    write_first_files(of_arm("ur5e"), draft_named("board"), tmp_path)
    file = (tmp_path / "experiment.yaml").rename(tmp_path / "experiment.resolved.yaml")
    experiment = load(file)
    poses = np.deg2rad([[0.0, -65, 55, 100, 90, 0], [5.0, -60, 50, 95, 85, 30]])
    write_plan(tmp_path / "plan.csv", experiment.robot, poses, names=["near", "far"])
    aim = aim_of(tmp_path)
    o, folder = aim.observation, tmp_path / "images"
    folder.mkdir()
    assert o.instrument.camera is not None
    assert o.target.board is not None
    assert o.at.frame is not None
    for i, name in ((0, "near"), (1, "far")):
        camera = tool_frames(experiment.robot, poses[[i]])[0] @ o.at.frame
        picture = render_board(
            o.instrument.camera, o.target.board, np.linalg.inv(camera) @ o.target.at.nominal, np.random.default_rng(i)
        )
        cv2.imwrite(str(folder / f"cell_{name}.png"), picture)
    told: list[Request] = []
    way = WatchedFolder(aim, folder, ["cell_near.png"], told.append)
    found = way.ask(Request(1, Wanted("far"), poses[1], np.zeros(6)))
    assert isinstance(found, Read)
    assert found.source == "cell_far.png"
    model = aim.model
    exact = simulate(model, {}, poses[[1]], Noise(), np.random.default_rng(0)).z[0]
    both = np.isfinite(exact) & np.isfinite(found.z)
    assert both.sum() > 40
    assert np.sqrt(np.mean((exact - found.z)[both] ** 2)) < 0.1
    assert told[0].number == 1
    cv2.imwrite(str(folder / "near.png"), np.zeros((480, 640), dtype=np.uint8))
    assert isinstance(way.ask(Request(2, Wanted("near"), poses[0], np.zeros(6))), Missed)
    with pytest.raises(InputError, match="no such folder"):
        WatchedFolder(aim, tmp_path / "nowhere", (), told.append)


def test_killed_at_any_moment_it_loses_nothing(plan: Path, aim: Aim, tmp_path: Path) -> None:
    whole = undisturbed(plan, aim, tmp_path / "whole")
    table, count = disturbed(plan, aim, tmp_path / "killed", 4, np.random.default_rng(2))
    assert count == 4
    assert table == whole
