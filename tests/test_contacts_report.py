"""What reports, tables, figures and validations say of postures that touch something: their words, and their numbers
against sums made here."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identifications import SMR, content_of, identified, simulated
from matplotlib.figure import Figure
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from symcal import plots
from symcal.calibration.calibrate import baseline_model, calibrate
from symcal.calibration.evaluate import evaluate_each
from symcal.calibration.record import recorded_task
from symcal.calibration.results import calibration_facts
from symcal.cli.terminal import print_accuracy
from symcal.errors import InputError
from symcal.fit.estimation import Options
from symcal.instruments.constraint import FixedPoint, Plane
from symcal.instruments.distance import Distance
from symcal.instruments.position import Position
from symcal.model.observation import Observation, Place
from symcal.model.task import Task
from symcal.plots.plan_space import plan_in_space
from symcal.report import write_report
from symcal.report.identification import identification_text
from symcal.report.instruments import instruments_text
from symcal.report.measured import noise_words, observers_named
from symcal.report.parameter_table import parameter_table
from symcal.report.plan import plan_text
from symcal.report.verdict import verdict
from symcal.robot.files import load_robot
from symcal.runs.data import measurements
from symcal.runs.experiment import Outcome, identify_experiment
from symcal.runs.identification_folder import write as write_run
from symcal.runs.load import load
from symcal.runs.plan import plan_experiment
from symcal.runs.plan import write as write_plan_run
from symcal.runs.validate import validate_robot
from symcal.words import fixed, number

MIDDLE = (
    "measurements.middle={instrument: fixed_point, at: {on: base, place: unknown, near: {xyz: [500, 0, 20]}}, "
    "target: ball, noise: 0.05}"
)
PLATE = (
    "measurements.plate={instrument: plane, tilt: 60, radius: 10, at: {on: base, place: unknown, "
    "near: {xyz: [450, 0, 0]}}, target: ball, noise: 0.02}"
)
SESSIONS = """
name: sockets
title: Sockets by session
seed: 3
units: {{length: mm, angle: deg}}
robot: {robot}
targets:
  ball: {{on: flange, points: {{centre: {{near: [0, 0, 120]}}}}}}
measurements:
  socket:
    instrument: fixed_point
    tilt: 70
    at: {{on: base, place: unknown, per: session}}
    target: ball
    data: {{source: file, file: contacts.csv}}
  gap: {{instrument: distance, at: socket_left, target: socket_middle, value: 90.138782, noise: 0.02}}
  check: {{instrument: distance, at: socket_left, target: socket_right, value: 150, noise: 0.02}}
outputs: {{report: false, figures: false}}
"""


@pytest.fixture(scope="module")
def folder(configs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Contacts with three sockets, one of them held out, as a file of sessions."""
    path = tmp_path_factory.mktemp("contacts")
    experiment = load(configs / "pin.yaml", overrides=[MIDDLE, "plan.poses=75", "data.test_poses=0"])
    found = measurements(experiment.file, experiment.document, experiment.model, np.random.default_rng(5)).data
    lines = ["pose,session,split," + ",".join(f"q{i}_rad" for i in range(1, 7))]
    for name in ("left", "middle", "right"):
        for label, q in zip((own := found.read_by(name)).labels, own.q, strict=True):
            lines.append(",".join([label, name, "test" if name == "right" else "train", *map(repr, q.tolist())]))
    (path / "contacts.csv").write_text("\n".join(lines) + "\n")
    (path / "sockets.yaml").write_text(SESSIONS.format(robot=configs / "robots" / "ur5.yaml"))
    return path


@pytest.fixture(scope="module")
def sessions(folder: Path) -> Outcome:
    return identify_experiment(load(folder / "sockets.yaml"), progress=lambda _: None)


@pytest.fixture(scope="module")
def plate(configs: Path) -> Outcome:
    overrides = [PLATE, "plan.poses=60", "data.test_poses=30"]
    return identify_experiment(load(configs / "pin.yaml", overrides=overrides), progress=lambda _: None)


@pytest.fixture(scope="module")
def calibrated(sessions: Outcome, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run")
    write_run(sessions, path, lambda _: None)
    return path / "calibrated.yaml"


def _plain(found: Outcome) -> dict[str, Any]:
    return dict(json.loads(json.dumps(found.content)))


# ---------------------------------------------------------------------------------------------- numbers of results.json


def _turn(axis: str, angle: float) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return out


def _ball(found: Outcome, q: np.ndarray) -> np.ndarray:
    """The ball's centre in the base by the identified numbers of links and ball, shape (N, 3)."""
    out = []
    for pose in q:
        t = np.eye(4)
        for link, reading in zip(found.calibration.robot.links, pose, strict=True):
            p = dict.fromkeys(("theta", "d", "a", "alpha", "beta"), 0.0) | dict(link.parameters)
            shift = np.eye(4)
            shift[:3, 3] = p["a"], 0.0, p["d"]  # Tz(d) Tx(a)
            t = t @ _turn("z", p["theta"] + reading) @ shift @ _turn("x", p["alpha"]) @ _turn("y", p["beta"])
        out.append(t[:3, :3] @ found.content["frames"]["points_mm"]["ball_centre"] + t[:3, 3])
    return np.array(out)


def test_places_that_held_out_poses_tell_are_the_mean_of_their_contacts(sessions: Outcome) -> None:
    for name in ("left", "middle", "right"):
        at = _ball(sessions, sessions.data.read_by(f"socket_{name}").q)
        place = np.array(sessions.content["frames"][f"socket_{name}"]["xyz_mm"])
        np.testing.assert_allclose(at.mean(axis=0), place, atol=1e-5 if name == "right" else 0.05)
        part = "test" if name == "right" else "train"
        after = sessions.content["instruments"][f"socket_{name}"]["accuracy"][part]["after"]
        taken = 1 if name == "right" else 0  # three numbers of a place, three of a contact
        rms = np.sqrt(np.sum((at - place) ** 2) / (len(at) - taken))
        assert after["rms"] == pytest.approx(rms, rel=1e-6)
    assert sessions.content["settled"] == {"things": ["socket_right"], "numbers": {}, "unknown": []}
    parameters = sessions.content["identification"]["parameters"]
    assert {name for name, p in parameters.items() if p["unplaced"]} == {f"socket_right_{a}" for a in "xyz"}


def test_what_is_known_is_found_as_the_distance_of_the_places(sessions: Outcome) -> None:
    known, frames = sessions.content["known"], sessions.content["frames"]
    assert list(known) == ["gap", "check"]
    for name, ends, used in (("gap", ("left", "middle"), True), ("check", ("left", "right"), False)):
        facts = known[name]
        first, second = (np.array(frames[f"socket_{end}"]["xyz_mm"]) for end in ends)
        assert facts["between"] == [f"socket_{end}" for end in ends]
        assert facts["found"] == pytest.approx([float(np.linalg.norm(first - second))], abs=1e-6)
        assert facts["used"] is used
        assert (facts["unit"], facts["sigma"]) == ("mm", [0.02])
    assert known["gap"]["found"] == pytest.approx([90.138782], abs=0.1)
    assert known["check"]["found"] == pytest.approx([150.0], abs=3.0)


def test_the_growth_that_contacts_do_not_see_has_the_spread_of_its_covariance(sessions: Outcome) -> None:
    model = sessions.calibration.model
    slope = model.measurement.growth
    nominal = [p.nominal if p.unit == "mm" and not p.unknown else 0.0 for p in model.parameters.items]
    assert slope @ nominal == pytest.approx(1.0)  # all lengths by one share are a growth of that share
    record = sessions.calibration.robot.record
    assert record is not None
    length = sessions.content["identifiability"]["length"]
    assert length["sigma"] == pytest.approx(float(np.sqrt(slope @ record.covariance @ slope)), rel=1e-9)
    assert length["growth"] == pytest.approx(float(slope @ sessions.calibration.after.x), abs=1e-12)
    assert length["known"]
    said = identification_text(_plain(sessions))["identifiability"]["length"]
    assert said["title"] == "What contacts cannot see"
    assert f"{number(100 * length['sigma'], 2)} %" in said["text"]


# ------------------------------------------------------------------------------------------------------------ the words


def test_the_report_names_places_once_and_leaves_out_what_is_not_read(sessions: Outcome, tmp_path: Path) -> None:
    text = identification_text(_plain(sessions))
    assert "Measurements of socket (contacts with a fixed point, 3 sessions), 50 training" in text["subtitle"]
    frames = {row["label"]: row for row in text["frames"]}
    assert not [label for label in frames if "_O" in label]  # the end of a known value is no point that is read
    assert frames["socket_right on base"]["estimated"] == "x, y, z from held-out poses"
    assert frames["socket_left on base"]["estimated"] == "x, y, z estimated"
    rows = [row["name"] for row in text["parameters"]["rows"]]
    assert "socket_left_x" in rows
    assert "socket_right_x" not in rows
    notes = " ".join(text["parameters"]["notes"])
    assert "Left out: 3 parameters of socket right, which no training pose tells." in notes
    assert "held at nominal" not in notes
    gap, check = text["known"]["rows"]
    assert gap[1] == "distance from socket_left to socket_middle"
    assert check[1] == "distance from socket_left to socket_right (a check)"
    assert gap[2:4] == ["90.139 mm", "0.020 mm"]
    write_report(_plain(sessions), (), tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").stat().st_size > 10_000


def test_sessions_of_an_entry_share_what_is_said_of_them(sessions: Outcome) -> None:
    found = instruments_text(_plain(sessions))
    assert found is not None
    (group,) = found["groups"]
    assert group["reads"] == "contacts with a fixed point of ball centre on flange"
    assert [row[0] for row in group["rows"]] == ["socket_left", "socket_middle", "socket_right"]
    assert [row[1:4:2] for row in group["rows"]] == [["25", "–"], ["25", "–"], ["–", "25"]]
    assert found["counted"] == "contacts"


def test_contacts_are_not_readings(sessions: Outcome, plate: Outcome) -> None:
    content = _plain(sessions)
    assert content["against"] == "noisy contacts"
    first = verdict(content)[0]
    assert first.startswith("The robot's distance from the fixed point that it touches fell from ")
    assert first.endswith("rms on 25 held-out contacts.")
    assert "observation" not in " ".join(verdict(content))
    assert noise_words(content).endswith("mm per axis of each contact (estimated from the training data)")
    words = noise_words(_plain(plate))
    assert "0.0500 mm per axis of each contact with left (given)" in words
    assert "0.0200 mm of the height of each contact with plate (given)" in words
    assert "(left and right)" in verdict(_plain(plate))[0]
    assert "held at its stated size whatever the factor" in dict(identification_text(content)["facts"])["sizes"]
    assert "by marginal likelihood" in dict(identification_text(content)["facts"])["sizes"]


def test_readings_that_have_lengths_leave_nothing_out(configs: Path) -> None:
    text = identification_text(content_of(*simulated(configs, "position")))
    assert text["identifiability"]["length"] is None
    assert text["known"] is None
    assert "whatever the factor" not in dict(text["facts"])["sizes"]


def test_the_terminal_says_what_is_known(sessions: Outcome, capsys: pytest.CaptureFixture[str]) -> None:
    print_accuracy(_plain(sessions))
    said = capsys.readouterr().out
    found = sessions.content["known"]["gap"]["found"][0]
    assert f"known gap: distance from socket_left to socket_middle 90.139 mm +- 0.020 mm; found {found:.3f} mm" in said
    assert "(took no part: a check)" in said


def test_many_sessions_are_named_by_their_entry() -> None:
    one = {"name": "tracker", "entry": "tracker", "reads": "positions"}
    many = [{"name": f"wire_{i}", "entry": "wire", "reads": "distances"} for i in range(9)]
    alone = {"name": "socket_front", "entry": "socket", "reads": "contacts with a fixed point"}
    assert observers_named([one, *many, alone]) == (
        "tracker (positions), wire (distances, 9 sessions) and socket_front (contacts with a fixed point)"
    )


def test_numbers_of_an_instrument_that_only_held_out_poses_have_are_said(configs: Path) -> None:
    start = np.eye(4)
    start[:3, 3] = 900.0, -700.0, 300.0
    wire = Observation(Distance(offset=None), "wire", Place("world", start, unknown=True), SMR)
    tracker = Observation(Position(), "tracker", target=SMR)
    trained, data, _ = identified(configs, Task((wire, tracker), base=True), 40, 30)
    z = data.z.copy()
    z[np.ix_([split == "train" for split in data.split], [0])] = np.nan  # nothing of the wire was read in training
    model, held_out = trained.model, replace(data, z=z)
    found = calibrate(model, baseline_model(model), held_out, Options())
    facts = json.loads(json.dumps(calibration_facts(found, held_out.part("test"))))
    assert facts["settled"]["things"] == ["wire"]
    place = facts["frames"]["wire"]["xyz_mm"]
    points = model.points(held_out.part("test").q, found.after.x, found.after.setup.vector)[0].reshape(-1, 3)
    read = held_out.part("test").z[:, 0]
    best = least_squares(
        lambda y: np.linalg.norm(points - y[:3], axis=1) + y[3] - read, [*start[:3, 3], 0.0], x_scale=[1, 1, 1, 1]
    ).x
    assert place == pytest.approx(best[:3], abs=1e-3)
    assert facts["settled"]["numbers"]["wire_offset"]["value"] == pytest.approx(best[3], abs=1e-3)
    table = parameter_table(facts["identification"]["parameters"], facts["settled"])
    assert not [row["name"] for row in table["rows"] if row["name"].startswith("wire")]
    assert f"The held-out poses give wire offset {fixed(best[3], 3)} mm." in " ".join(table["notes"])
    nothing = calibration_facts(found, None)
    assert "wire" not in nothing["frames"]
    assert "wire_offset" in nothing["settled"]["unknown"]


# ---------------------------------------------------------------------------------------------------------- the figures


def _drawn(figure: Figure) -> list[np.ndarray]:
    """Points of every cloud of contacts in the panels, shape (k, 2) each."""
    return [
        np.column_stack(line.get_data())
        for axes in figure.axes
        for line in axes.lines
        if axes.name != "3d" and line.get_linestyle() == "None" and len(np.atleast_1d(line.get_xdata())) > 1
    ]


def test_every_contact_is_drawn_about_its_place_before_and_after(sessions: Outcome) -> None:
    illustration = plots.contacts(sessions.calibration, sessions.data)
    clouds = _drawn(illustration.figure)
    assert len(clouds) == 3 * 4  # x-y and x-z, before and after
    for i, name in enumerate(("socket_left", "socket_middle", "socket_right")):
        part = sessions.data.part("test" if name == "socket_right" else "train")
        at = _ball(sessions, sessions.data.read_by(name).q)
        place = np.array(sessions.content["frames"][name]["xyz_mm"])
        np.testing.assert_allclose(clouds[4 * i + 2], (at - place)[:, :2], atol=1e-6)
        np.testing.assert_allclose(clouds[4 * i + 3], (at - place)[:, ::2], atol=1e-6)
        before = evaluate_each(sessions.calibration.states["before"], part)[name]
        np.testing.assert_allclose(clouds[4 * i], before.vectors[:, :2])
        rms = sessions.content["instruments"][name]["accuracy"]["test" if name == "socket_right" else "train"]
        shown = " → ".join(number(rms[state]["rms"]) for state in ("before", "after"))
        assert f"{name} {shown} mm" in illustration.caption
    limits = [axes.get_xlim()[1] for axes in illustration.figure.axes if axes.name != "3d"]
    assert all(np.abs(cloud).max() < limit for cloud, limit in zip(clouds, limits, strict=True))
    assert "Held-out places were fitted to their own contacts" in illustration.caption


def test_heights_over_a_plane_are_drawn_in_the_order_of_the_contacts(plate: Outcome) -> None:
    illustration = plots.contacts(plate.calibration, plate.data)
    clouds = _drawn(illustration.figure)
    assert len(clouds) == 4 + 4 + 2
    heights = np.concatenate(
        [
            evaluate_each(plate.calibration.states["after"], plate.data.part(part))["plate"].vectors[:, 0]
            for part in ("train", "test")
        ]
    )
    np.testing.assert_allclose(clouds[-1], np.column_stack([np.arange(1, len(heights) + 1), heights]))
    assert "of a plane the heights" in illustration.caption
    labels = [axes.get_ylabel() for axes in illustration.figure.axes]
    assert labels.count("height / mm") == 2


def test_of_many_places_the_training_ones_and_the_worst_are_drawn(sessions: Outcome) -> None:
    illustration = plots.contacts(sessions.calibration, sessions.data, most=2)
    assert len(_drawn(illustration.figure)) == 2 * 4
    assert "Of 3 places those of the training and the held-out ones with the largest residuals" in illustration.caption
    assert "socket_right" not in illustration.caption


def test_the_line_of_held_out_poses_ends_at_their_error(sessions: Outcome) -> None:
    parts = {part: sessions.data.part(part) for part in ("train", "test")}
    illustration = plots.convergence(sessions.calibration, parts)
    train, test = (line.get_ydata() for line in illustration.figure.axes[0].lines[:2])
    for values, part in ((train, "train"), (test, "test")):
        accuracy = sessions.content["accuracy"][part]["after"]["position_mm"]
        assert float(np.asarray(values)[-1]) == pytest.approx(accuracy["rms"], rel=1e-5)
    assert float(np.max(test)) < 10.0
    assert "fitted to these" in illustration.caption


def test_figures_of_contacts_say_what_their_axes_are(sessions: Outcome) -> None:
    figures = {
        i.name: i
        for i in plots.identification_figures(sessions.calibration, sessions.data, sessions.errors, "contacts")
    }
    assert list(figures).index("contacts") == 2
    caption = figures["residuals_per_axis"].caption
    assert "along the axes of its place" in caption
    assert "world" not in caption
    assert "observation" not in caption + figures["error_distribution"].caption
    assert "predicted_error" not in figures


# ---------------------------------------------------------------------------------------------------------------- plans


def test_a_plan_says_what_each_posture_touches(configs: Path, tmp_path: Path) -> None:
    quick = ["plan.poses=16", "plan.sample=300", "plan.random=20", "outputs={figures: false, report: false}"]
    outcome = plan_experiment(load(configs / "pin.yaml", overrides=quick))
    write_plan_run(outcome, tmp_path, lambda _: None)
    with (tmp_path / "plan.csv").open() as file:
        touches = [row["touches"] for row in csv.DictReader(file)]
    with (tmp_path / "tables" / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["touches"] for row in rows] == touches
    assert set(touches) == {"left", "right"}
    illustration = plan_in_space(outcome.findings)
    counts = [f"{name} in {touches.count(name)} poses" for name in ("left", "right")]
    assert " and ".join(counts) in illustration.caption
    assert {"left", "right"} <= {text.get_text() for text in illustration.figure.legends[0].get_texts()}
    text = plan_text(json.loads(json.dumps(outcome.content)))
    assert "candidate" not in json.dumps(text)
    assert text["promise"] == "What is foretold"  # nothing is foretold over numbers of poses
    facts = dict(text["facts"])
    assert facts["method"] == "certified: greedy choice and exchange over the pool"
    assert "0.0500 mm per axis of each contact with left" in facts["noise planned with"]
    assert "contacts of a noise of 0.0500 mm (left)" in " ".join(text["verdict"])


# ----------------------------------------------------------------------------------------------------------- validation


def test_a_place_that_nobody_trained_must_be_fitted_first(calibrated: Path, folder: Path, sessions: Outcome) -> None:
    with pytest.raises(InputError, match=r"where 'socket_right' stands no training pose told.*--refit socket"):
        validate_robot(calibrated, folder / "contacts.csv")
    found = validate_robot(calibrated, folder / "contacts.csv", refit=("socket",))
    test = found["accuracy"]["test"]["after"]["position_mm"]
    assert test["fitted"] == 9
    at = [_ball(sessions, sessions.data.read_by(f"socket_{name}").q) for name in ("left", "middle", "right")]
    squares = sum(float(np.sum((each - each.mean(axis=0)) ** 2)) for each in at)
    assert test["rms"] == pytest.approx(np.sqrt(squares / (75 - 3)), rel=1e-4)
    assert found["against"] == "noisy contacts"


def test_a_session_that_nobody_knows_is_fitted_or_refused(
    calibrated: Path, folder: Path, sessions: Outcome, tmp_path: Path
) -> None:
    head, *rows = (folder / "contacts.csv").read_text().splitlines()
    new = tmp_path / "new.csv"
    new.write_text("\n".join([head, *(row.replace("left", "elsewhere") for row in rows if ",left," in row)]) + "\n")
    with pytest.raises(InputError, match=r"knows no such session.*--refit socket"):
        validate_robot(calibrated, new)
    found = validate_robot(calibrated, new, refit=("socket",))["accuracy"]["test"]
    at = _ball(sessions, sessions.data.read_by("socket_left").q)
    rms = np.sqrt(np.sum((at - at.mean(axis=0)) ** 2) / (len(at) - 1))
    assert found["after"]["position_mm"]["rms"] == pytest.approx(rms, rel=1e-4)
    assert found["before"]["position_mm"]["rms"] > 3 * rms


def test_a_known_session_is_judged_where_it_was_found(
    calibrated: Path, folder: Path, sessions: Outcome, tmp_path: Path
) -> None:
    head, *rows = (folder / "contacts.csv").read_text().splitlines()
    known = tmp_path / "known.csv"
    known.write_text("\n".join([head, *(row for row in rows if ",left," in row)]) + "\n")
    found = validate_robot(calibrated, known)["accuracy"]["test"]["after"]["position_mm"]
    own = sessions.content["instruments"]["socket_left"]["accuracy"]["train"]["after"]
    assert found["rms"] == pytest.approx(own["rms"], rel=1e-6)


def test_constraints_come_back_from_the_record(plate: Outcome, calibrated: Path) -> None:
    record = plate.calibration.robot.record
    assert record is not None
    back = {o.name: o for o in recorded_task(record.provenance, "after", calibrated).observations}
    assert back["plate"].instrument == Plane(radius=10.0, tilt=pytest.approx(np.deg2rad(60)))
    assert back["left"].instrument == FixedPoint(tilt=pytest.approx(np.deg2rad(60)))
    for name in ("plate", "left"):
        frame = back[name].at.frame
        assert frame is not None
        np.testing.assert_allclose(frame[:3, 3], plate.content["frames"][name]["xyz_mm"], atol=1e-9)
        assert back[name].at.on == "base"
    loaded = load_robot(calibrated).record
    assert loaded is not None
    told = {name: each["unplaced"] for name, each in loaded.provenance["measurements"].items()}
    assert told["socket_left"] == []
    assert told["socket_right"] == ["socket_right_x", "socket_right_y", "socket_right_z"]
    (right,) = (
        o for o in recorded_task(loaded.provenance, "after", calibrated).observations if o.name == "socket_right"
    )
    assert right.instrument == FixedPoint(tilt=pytest.approx(np.deg2rad(70)))
