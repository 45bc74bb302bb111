"""Several instruments in one experiment: files in, one error for each mistake, sessions, places that nobody trained."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import ARM
from known_truth import Scenario, Witness, frame, kind
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import symcal as sc
from symcal.calibration.evaluate import evaluate_each
from symcal.camera.camera import Camera
from symcal.camera.target import Target as Marks
from symcal.config import conversion as config
from symcal.data.dataset import merged
from symcal.data.dataset import readings as readings_of
from symcal.errors import InputError, RefusedError
from symcal.instruments import seen_by
from symcal.model.measurement import Setup
from symcal.model.model import nominal_setup
from symcal.runs.check import check_model
from symcal.runs.experiment import identify_experiment
from symcal.runs.load import load
from symcal.runs.plan import plan_experiment
from symcal.runs.run import run
from symcal.runs.validate import validate_robot
from symcal.spatial import look_at, transform

Array = NDArray[np.float64]
Write = Callable[..., Path]

ROBOT = replace(
    ARM, links=tuple(replace(x, joint=replace(x.joint, name=f"j{i}")) for i, x in enumerate(ARM.links, start=1))
)
QUIET = "outputs: {report: false, figures: false}"
JOINTS = ",".join(f"q{i}_deg" for i in range(1, 7))
TRACKER = "tracker: {instrument: position, target: smr, data: {source: file, file: tracker.csv}}"
WIRE = (
    "wire: {instrument: distance, offset: unknown, at: {on: world, place: unknown}, target: smr, "
    "data: {source: file, file: wires.csv, where: {anchor: A}}}"
)
SMR = "smr: {on: flange, points: {P: unknown}}"


def errors(rng: np.random.Generator) -> dict[str, float]:
    return {n: float(rng.normal() * (0.3 if n[:2] in ("a_", "d_") else 0.002)) for n in ARM.parameters}


def readings(o: sc.Observation, setup: Setup, q: Array, truth: Mapping[str, float], noise: Array) -> Array:
    exact = Witness(Scenario(sc.Task((o,)), setup, {})).residual(np.deg2rad(q), truth)
    return np.hstack([v.real for v in exact]) + noise


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tracker and two wires on the same poses; three sessions of one tracker, of which the last one tests."""
    rng, path = np.random.default_rng(12), tmp_path_factory.mktemp("several")
    sc.save_robot(ROBOT, path / "robot.yaml")
    truth, base = errors(rng), frame(rng, 1200.0)
    target = sc.Target("smr", sc.Place("flange"), {"P": None})
    tracker = sc.Observation(kind("position"), "tracker", target=target)
    wire = sc.Observation(kind("distance", offset=None), "wire", at=sc.Place("world", unknown=True), target=target)
    q, point = np.round(np.rad2deg(rng.uniform(-2, 2, (48, 6))), 3), rng.uniform(30, 90, (1, 3))
    split = np.where(np.arange(48) % 4, "train", "test")
    at = readings(tracker, Setup(base, np.eye(4), point), q, truth, 0.05 * rng.normal(size=(48, 3)))
    table(path / "tracker.csv", "x_mm,y_mm,z_mm,split", q, [[*p, s] for p, s in zip(at, split, strict=True)])
    lines = []
    for name, anchor in (("A", [900.0, -700.0, 300.0]), ("B", [-800.0, -900.0, 600.0])):
        place = base @ transform(np.eye(3), np.array(anchor))
        place[:3, :3] = np.eye(3)
        setup = Setup(base, np.eye(4), point, {"wire": place}, {"wire_offset": 21.0})
        lines += [
            [name, d, s]
            for d, s in zip(readings(wire, setup, q, truth, 0.03 * rng.normal(size=(48, 1))), split, strict=True)
        ]
    table(path / "wires.csv", "anchor,distance_mm,split", np.vstack([q, q]), lines)
    rows, poses = [], []
    for s in range(3):
        place = np.eye(4) if s == 0 else frame(rng, 1800.0)
        own = replace(tracker, at=sc.Place("world", unknown=True))
        q = np.round(np.rad2deg(rng.uniform(-2, 2, (24, 6))), 3)
        setup = Setup(base, np.eye(4), rng.uniform(30, 90, (1, 3)), {"tracker": place})
        seen = readings(own, setup, q, truth, 0.05 * rng.normal(size=(24, 3)))
        rows += [[f"2026-11-0{s + 1} (a)", *p, "train" if s < 2 else "test"] for p in seen]
        poses.append(q)
    table(path / "sessions.csv", "session,x_mm,y_mm,z_mm,split", np.vstack(poses), rows, restart=24)
    return path


def table(path: Path, columns: str, q: Array, rows: list[list[object]], restart: int = 48) -> None:
    """A CSV whose pose names restart after so many rows."""
    lines = [f"pose,{JOINTS},{columns}"]
    for i, (pose, row) in enumerate(zip(q, rows, strict=True)):
        cells = [f"{v:.4f}" if isinstance(v, float) else str(np.asarray(v).item() if np.ndim(v) else v) for v in row]
        lines.append(",".join([str(i % restart), *(f"{v:.3f}" for v in pose), *cells]))
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def write(folder: Path, request: pytest.FixtureRequest) -> Write:
    def made(*measurements: str, targets: str = SMR, top: str = "base: unknown", more: str = "") -> Path:
        path = folder / f"{abs(hash((request.node.name, measurements, targets, top, more)))}.yaml"
        lines = [
            "name: several",
            "units: {length: mm, angle: deg}",
            "robot: robot.yaml",
            QUIET,
            top,
            "targets:",
            f"  {targets}",
            "measurements:",
            *(f"  {m}" for m in measurements),
            more,
        ]
        path.write_text("\n".join(lines) + "\n")
        return path

    return made


def test_a_tracker_and_a_wire_are_identified_together_and_each_in_its_own_unit(write: Write, tmp_path: Path) -> None:
    _, found = run(write(TRACKER, WIRE), tmp_path / "out")
    assert found["identification"]["converged"]
    noise = {name: each["sigma"] for name, each in found["identification"]["noise"].items()}
    assert noise["tracker position"] == pytest.approx(0.05, rel=0.3)
    assert noise["wire distance"] == pytest.approx(0.03, rel=0.4)
    assert found["identification"]["parameters"]["wire_offset"]["identified"] == pytest.approx(21.0, abs=0.5)
    after = {n: each["accuracy"]["test"]["after"]["rms"] for n, each in found["instruments"].items()}
    before = {n: each["accuracy"]["test"]["before"]["rms"] for n, each in found["instruments"].items()}
    assert after["tracker"] < 0.15 < 0.3 < before["tracker"]
    assert after["wire"] < 0.06 < 0.2 < before["wire"]
    assert found["accuracy"]["test"]["after"]["position_mm"]["rms"] == after["tracker"]
    assert sorted(p.name for p in (tmp_path / "out" / "measurements").iterdir()) == ["tracker.csv", "wire.csv"]


def test_two_wires_know_more_than_one(write: Write) -> None:
    second = WIRE.replace("wire:", "second:").replace("anchor: A", "anchor: B")
    one, both = (
        identify_experiment(load(write(*each, top="base: known")), progress=lambda _: None).calibration.after
        for each in ((WIRE,), (WIRE, second))
    )
    shared = [name for name in one.free if name in ARM.parameters]
    sigma = [dict(zip(fit.free, fit.posterior.sigmas, strict=True)) for fit in (one, both)]
    assert all(sigma[1][name] <= sigma[0][name] * 1.2 for name in shared)
    assert np.mean([sigma[1][name] / sigma[0][name] for name in shared]) < 0.9


def test_the_short_form_and_its_long_form_are_the_same(write: Write, folder: Path) -> None:
    long = identify_experiment(load(write(TRACKER)), progress=lambda _: None).calibration
    path = folder / "short.yaml"
    path.write_text(
        f"name: short\nunits: {{length: mm, angle: deg}}\nrobot: robot.yaml\n{QUIET}\n"
        "measurement: {type: position, points: {P: null}, estimate: [base, points]}\n"
        "data: {source: file, file: tracker.csv}\n"
    )
    short = identify_experiment(load(path), progress=lambda _: None).calibration
    np.testing.assert_allclose(short.after.x, long.after.x, rtol=1e-6, atol=1e-9)
    assert short.after.identifiability.rank == long.after.identifiability.rank


SESSIONS = (
    "tracker: {instrument: position, at: {on: world, place: unknown, per: session}, "
    "target: smr, data: {source: file, file: sessions.csv}}"
)
PER_SESSION = "smr: {on: flange, points: {P: unknown}, per: session}"


def test_sessions_have_places_of_their_own_and_one_noise(write: Write) -> None:
    outcome = identify_experiment(
        load(write(SESSIONS, targets=PER_SESSION, top="base: known")), progress=lambda _: None
    )
    found, fit = outcome.content, outcome.calibration.after
    assert list(fit.sigmas) == ["position"]
    assert fit.sigmas["position"] == pytest.approx(0.05, rel=0.2)
    assert len(found["instruments"]) == 3
    assert not any(name.startswith("tracker_2026-11-03") for name in fit.free)
    last = found["instruments"]["tracker_2026-11-03__a_"]["accuracy"]
    assert list(last) == ["test"]
    assert last["test"]["after"]["fitted"] == 9
    assert last["test"]["after"]["rms"] < 0.15 < last["test"]["before"]["rms"]
    assert any("no training pose tells" in note for note in found["warnings"])


def test_degrees_of_freedom_of_fitted_places_are_taken_off(write: Write) -> None:
    outcome = identify_experiment(
        load(write(SESSIONS, targets=PER_SESSION, top="base: known")), progress=lambda _: None
    )
    each = evaluate_each(outcome.calibration.states["after"], outcome.data.part("test"))["tracker_2026-11-03__a_"]
    plain = float(np.sqrt(np.mean(each.size**2)))
    assert each.statistics.rms == pytest.approx(plain * np.sqrt(24 / (24 - 9 / 3)))


def test_python_needs_no_file(folder: Path) -> None:
    smr = sc.Target("smr", sc.Place("flange"), {"P": None})
    found = sc.identify(
        ROBOT,
        [
            sc.Observation(sc.Tracker(), target=smr, data=folder / "tracker.csv"),
            sc.Observation(
                sc.Distance(offset=None),
                at=sc.Place("world", unknown=True),
                target=smr,
                data=sc.load_measurements(folder / "wires.csv", ROBOT, sc.Distance(), where={"anchor": "A"}),
                noise={"distance": 0.03},
            ),
        ],
        base="unknown",
    )
    assert found.after.converged
    assert set(found.after.sigmas) == {"position position", "distance distance"}
    assert found.after.estimated == ("position position",)
    with pytest.raises(InputError, match="has no data"):
        sc.identify(ROBOT, [sc.Observation(sc.Tracker(), target=smr)])


def test_check_says_what_each_instrument_adds(write: Write) -> None:
    tracker, wire = check_model(load(write(TRACKER, WIRE)).model).instruments
    assert (tracker.name, tracker.rows, wire.rows) == ("tracker", 3, 1)
    assert tracker.added == tracker.alone
    assert wire.added == 4  # its anchor and its offset; what the robot has the tracker sees already
    assert "wire_offset" in wire.unknown


@pytest.mark.long
def test_a_plan_compares_the_instruments(write: Write) -> None:
    tracker, wire = (
        t.replace("target: smr", f"target: smr, noise: {n}")
        for t, n in ((TRACKER, "{position: 0.05}"), (WIRE, "{distance: 0.03}"))
    )
    path = write(
        tracker,
        wire,
        targets="smr: {on: flange, points: {P: [20, 30, 80]}}",
        more="plan: {poses: 24, method: exchange, promise: {counts: [24]}}",
    )
    alone, refused, both = plan_experiment(load(path)).findings.instruments
    assert (alone.instruments, both.instruments) == (("tracker",), ("tracker", "wire"))
    assert refused.mean_mm is None
    assert "every place on world" in refused.refused
    assert alone.mean_mm is not None
    assert both.mean_mm is not None
    assert both.mean_mm < alone.mean_mm


def test_a_calibration_by_several_is_validated_by_any_of_them(write: Write, folder: Path, tmp_path: Path) -> None:
    run(write(TRACKER, WIRE), tmp_path / "out")
    calibrated = tmp_path / "out" / "calibrated.yaml"
    with pytest.raises(InputError, match="--instrument"):
        validate_robot(calibrated, folder / "tracker.csv")
    by_tracker = validate_robot(calibrated, folder / "tracker.csv", instrument="tracker")["accuracy"]["test"]
    assert by_tracker["after"]["position_mm"]["rms"] < 0.15 < by_tracker["before"]["position_mm"]["rms"]
    by_wire = validate_robot(calibrated, folder / "wires.csv", instrument="wire")["accuracy"]["test"]
    assert by_wire["after"]["distance_mm"]["rms"] < 0.06 < by_wire["before"]["distance_mm"]["rms"]
    moved = validate_robot(calibrated, folder / "sessions.csv", instrument="tracker", refit=("base", "points"))
    assert moved["accuracy"]["test"]["after"]["position_mm"]["rms"] > 1  # three mountings are not one


def test_sessions_are_validated_each_at_its_own_place(write: Write, folder: Path, tmp_path: Path) -> None:
    run(write(SESSIONS, targets=PER_SESSION, top="base: known"), tmp_path / "out")
    calibrated = tmp_path / "out" / "calibrated.yaml"
    lines = (folder / "sessions.csv").read_text().splitlines()
    known = [line for line in lines if "2026-11-03" not in line]
    (tmp_path / "known.csv").write_text("\n".join(known) + "\n")
    found = validate_robot(calibrated, tmp_path / "known.csv")["accuracy"]["test"]
    assert found["after"]["position_mm"]["rms"] < 0.12 < found["before"]["position_mm"]["rms"]
    refitted = validate_robot(calibrated, tmp_path / "known.csv", refit=("tracker",))["accuracy"]["test"]["after"]
    assert refitted["position_mm"]["fitted"] == 2 * 6
    strangers = [line.replace("2026-11-01", "2027-01-01") for line in known]
    (tmp_path / "strangers.csv").write_text("\n".join(strangers) + "\n")
    with pytest.raises(InputError, match="knows no such session"):
        validate_robot(calibrated, tmp_path / "strangers.csv")


def test_what_the_data_do_not_tell_stays_where_it_was_said_to_be(write: Write) -> None:
    gauge = (
        "gauge: {instrument: component, at: {on: base, place: unknown, near: {xyz: [100, 200, 300]}}, target: smr, "
        "data: {source: simulated}}"
    ).replace(", data: {source: simulated}", "")
    path = write(
        gauge,
        targets="smr: {on: flange, points: {P: [20, 30, 80]}}",
        top="base: known",
        more="data: {source: simulated, truth: {}, noise: {component: 0.02}, test_poses: 0}\nplan: {poses: 60}",
    )
    found = identify_experiment(load(path), progress=lambda _: None)
    assert found.content["frames"]["gauge"]["xyz_mm"][:2] == pytest.approx([100, 200], abs=1.0)


MISTAKES = {
    "no such place": (WIRE.replace("on: world", "on: wurld"), SMR, "base: known", "did you mean 'world'"),
    "a link that is not there": (TRACKER, SMR.replace("flange", "j9"), "base: known", "no such place on this robot"),
    "a kind that is not registered": (
        TRACKER.replace("position", "positon"),
        SMR,
        "base: known",
        "did you mean 'position'",
    ),
    "no such target": (TRACKER.replace("target: smr", "target: smrr"), SMR, "base: known", "did you mean 'smr'"),
    "base and every place": (WIRE, SMR, "base: unknown", "moving the robot is moving everything"),
    "place and points": (
        TRACKER,
        "smr: {on: flange, place: unknown, points: {P: unknown}}",
        "base: known",
        "moving one is moving the others",
    ),
    "both on one body": (
        TRACKER.replace("target:", "at: {on: tool}, target:"),
        SMR,
        "base: known",
        "the joints cancel",
    ),
    "two trackers at one spot": (
        TRACKER + "\n  " + TRACKER.replace("tracker:", "second:"),
        SMR,
        "base: known",
        "both on world without a place",
    ),
    "no anchor": (
        TRACKER + "\n  " + WIRE.replace("at: {on: world, place: unknown}, ", ""),
        SMR,
        "base: known",
        "where does it stand?",
    ),
    "a noise of another kind": (
        WIRE.replace("target:", "noise: {position: 1}, target:"),
        SMR,
        "base: known",
        "allowed: per, distance",
    ),
    "a key of another kind": (TRACKER.replace("target:", "offset: 3, target:"), SMR, "base: known", "unknown key"),
    "a filter without rows": (WIRE.replace("anchor: A", "anchor: C"), SMR, "base: known", "no row has 'C'"),
    "per session without sessions": (
        TRACKER.replace("target:", "at: {on: world, place: unknown, per: session}, target:"),
        SMR,
        "base: known",
        "column 'session'",
    ),
    "no data": ("tracker: {instrument: position, target: smr}", SMR, "base: unknown", "nothing to identify from"),
    "base without a world": (
        TRACKER.replace("target:", "at: {on: base}, target:"),
        SMR,
        "base: unknown",
        "nothing that measures stands on world",
    ),
    "tool that nobody uses": (TRACKER, SMR, "tool: unknown", "is on the tool"),
    "near without unknown": (
        WIRE.replace("place: unknown", "near: {xyz: [1, 2, 3]}"),
        SMR,
        "base: known",
        "belongs to 'place: unknown'",
    ),
    "an axis of nothing": (
        TRACKER,
        "smr: {on: flange, points: {P: unknown}, axes: {z: [0, 0, 0]}}",
        "base: known",
        "cannot be the zero vector",
    ),
    "a name of the robot's": (TRACKER.replace("tracker:", "tool:", 1), SMR, "base: known", "a name of the robot's own"),
    "a target nobody reads": (
        TRACKER,
        SMR + "\n  spare: {on: flange, points: {Q: unknown}}",
        "base: known",
        "no instrument reads this target",
    ),
    "the same rows twice": (
        WIRE + "\n  " + WIRE.replace("wire:", "again:"),
        SMR,
        "base: known",
        "reads the same rows as 'wire'",
    ),
    "held where nothing is said": (
        TRACKER,
        SMR,
        "base: unknown\nidentification: {fix: [smr_P_z]}",
        "nothing is said of where",
    ),
    "a prior on nothing": (WIRE, SMR, "base: known\nidentification: {priors: {wire_x: 1}}", "nothing is said of where"),
    "two shares held out": (
        TRACKER.replace("tracker.csv", "tracker.csv, split: {test_fraction: 0.2}") + "\n  " + WIRE,
        SMR,
        "base: unknown",
        "held out for all instruments together",
    ),
    "a target of axes for points": (
        TRACKER,
        "smr: {on: flange, axes: {z: [0, 0, 1]}}",
        "base: known",
        "the target has none",
    ),
    "a session beside sessions": (
        SESSIONS.replace("at:", "session: x, at:"),
        PER_SESSION,
        "base: known",
        "leave 'session' out",
    ),
    "one name for two": (TRACKER.replace("tracker:", "smr:", 1), SMR, "base: known", "are both called 'smr'"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_each_mistake_is_one_clear_error(name: str, write: Write, tmp_path: Path) -> None:
    entry, targets, top, words = MISTAKES[name]
    with pytest.raises((InputError, RefusedError)) as caught:
        run(write(entry, targets=targets, top=top), tmp_path / "out")
    assert words in str(caught.value)
    assert not (tmp_path / "out").exists()
    if isinstance(caught.value, InputError):
        assert caught.value.file is not None


def test_two_instruments_of_one_name_are_a_key_that_stands_twice(write: Write) -> None:
    with pytest.raises(InputError, match="stands here twice"):
        load(write(TRACKER, TRACKER))


def test_a_posture_is_one_posture(write: Write, folder: Path) -> None:
    text = (folder / "wires.csv").read_text().replace("\n3,", "\n3,1", 1)
    (folder / "bent.csv").write_text(text)
    with pytest.raises(InputError, match="pose '3' has another joint readings"):
        identify_experiment(load(write(TRACKER, WIRE.replace("wires.csv", "bent.csv"))), progress=lambda _: None)


def test_paths_of_instruments_are_relative_to_the_resolved_file(write: Write, tmp_path: Path) -> None:
    experiment = load(write(TRACKER, WIRE))
    resolved = config.resolved(experiment.file, experiment.document, tmp_path)
    assert (tmp_path / resolved["measurements"]["wire"]["data"]["file"]).resolve().name == "wires.csv"


def seen_on_the_way(task: sc.Task, setup: Setup, rng: np.random.Generator, truth: dict[str, float]) -> sc.Dataset:
    """Fifty poses at which at least three points are in the image, with noise of 0.05 px and 0.05 mm."""
    model = replace(sc.build_model(ROBOT, task), setup=setup)
    q = rng.uniform(-2.4, 2.4, (20000, 6))
    exact = sc.simulate(model, {}, q, sc.Noise(), rng)
    (camera,) = (part for part in model.measurement.parts if part.observation.instrument.is_camera)
    q = q[camera.seen(exact.z).sum(axis=1) >= 6][:50]
    assert len(q) == 50
    return sc.simulate(model, truth, q, sc.Noise(position=0.05, image=0.05), rng)


LENS = Camera(1600, 1200, 1500.0, 1500.0, 800.0, 600.0)
PLATE = Marks(tuple("ABCD"), np.array([[0.0, 0, 0], [120, 0, 0], [0, 100, 0], [120, 100, 30]]), 5.0)
CORNERS = {name: (float(x), float(y), float(z)) for name, (x, y, z) in zip("ABCD", PLATE.points, strict=True)}


def test_a_camera_in_the_hand_finds_its_mount(rng: np.random.Generator) -> None:
    board = sc.Target("board", sc.Place("world", transform(np.eye(3), np.array([500.0, 200, 0]))), CORNERS, marks=PLATE)
    eye = sc.Observation(seen_by(LENS, calibrate=False), "eye", at=sc.Place("tool", unknown=True), target=board)
    task = sc.Task((eye,), base=True)
    mount = transform(Rotation.from_rotvec([0.1, -0.2, 0.4]).as_matrix(), np.array([30.0, -20, 60]))
    setup = nominal_setup(ROBOT, task)
    setup = replace(setup, base=transform(np.eye(3), np.array([20.0, 10, 5])), places={**setup.places, "eye": mount})
    found = sc.identify(ROBOT, seen_on_the_way(task, setup, rng, errors(rng)), task)
    assert found.after.sigmas["image"] == pytest.approx(0.05, rel=0.25)
    assert np.abs(found.model.moved(found.setup, found.after.x).places["eye"] - mount)[:3, 3].max() < 3
    assert np.abs(found.model.moved(found.setup, found.after.x).places["eye"] - mount)[:3, :3].max() < 0.01


def test_a_fixed_camera_and_a_tracker_share_the_robot(rng: np.random.Generator) -> None:
    plate = sc.Target("plate", sc.Place("tool"), CORNERS, marks=PLATE)
    smr = sc.Target("smr", sc.Place("flange"), {"P": (20.0, 30.0, 40.0)})
    eye = sc.Observation(seen_by(LENS, calibrate=False), "eye", at=sc.Place("world", unknown=True), target=plate)
    task = sc.Task((eye, sc.Observation(sc.Tracker(), "tracker", target=smr)), base=True, tool=True)
    setup = nominal_setup(ROBOT, task)
    tool = transform(Rotation.from_rotvec([0.2, 0.1, -0.3]).as_matrix(), np.array([10.0, 20, 90]))
    place = look_at(np.array([1500.0, 900, 700]), np.array([0.0, 0, 400]))
    setup = replace(setup, base=frame(rng, 100.0, 0.2), tool=tool, places={"eye": place})
    found = sc.identify(ROBOT, seen_on_the_way(task, setup, rng, errors(rng)), task)
    assert found.after.converged
    assert found.after.sigmas["eye image"] == pytest.approx(0.05, rel=0.25)
    assert found.after.sigmas["tracker position"] == pytest.approx(0.05, rel=0.35)
    moved = found.model.moved(found.setup, found.after.x)
    assert np.linalg.norm(moved.places["eye"][:3, 3] - place[:3, 3]) < 5


def test_one_posture_is_one_whoever_names_its_session() -> None:
    q = np.zeros((1, 6))
    tracker = sc.Dataset(readings_of("position", ("P",)), q, np.ones((1, 3)), ("0",), ("train",))
    wire = sc.Dataset(readings_of("distance", ("P",)), q + 1e-6, np.ones((1, 1)), ("mon/0",), ("train",))
    both = merged([tracker, wire], ["mon", ""])
    assert both.labels == ("mon/0",)
    assert np.isfinite(both.z).all()
    with pytest.raises(InputError, match="another split"):
        merged([tracker, replace(wire, split=("test",))], ["mon", ""])
