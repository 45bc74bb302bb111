"""Postures that touch: constraints, known values, growth that nothing sees; plans and simulations of them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import ARM
from hypothesis import given, settings
from hypothesis import strategies as st
from known_truth import SCENARIOS, Scenario, Witness, kind, measured, told
from numpy.typing import NDArray

import symcal as sc
from symcal.calibration.calibrate import calibrate
from symcal.config import conversion as config
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Fit, Options
from symcal.fit.residual_rows import rows_of
from symcal.instruments.noise import Noise
from symcal.model import contact
from symcal.model.contact import TOUCHING, constraints, contact_postures, projected, touched, touched_names
from symcal.model.growth import growth, lengths
from symcal.model.model import Model, build_model
from symcal.placing.placement import stated
from symcal.planning.plan_problem import plan_problem
from symcal.planning.search import select_poses
from symcal.runs.check import check_model
from symcal.runs.data import measurements
from symcal.runs.experiment import identify_experiment
from symcal.runs.load import load
from symcal.runs.run import run
from symcal.spatial import transform

Array = NDArray[np.float64]

PIN = np.array([450.0, 50.0, 250.0])
ASIDE = np.array([0.0, 120.0, 0.0])
BALL = (20.0, -10.0, 60.0)
LIMIT = np.full(6, 2.8)
QUIET = ["outputs.report=false", "outputs.figures=false"]


def pin(name: str = "pin", at: Array = PIN, *, known: bool = False, tilt: float | None = None) -> sc.Observation:
    target = sc.Target("ball", sc.Place("flange"), {"c": BALL if known else None}, near={"c": BALL})
    place = sc.Place("base", transform(np.eye(3), at), unknown=not known)
    return sc.Observation(kind("fixed_point", tilt=tilt), name, at=place, target=target)


def random(rng: np.random.Generator) -> Callable[[int], Array]:
    return lambda count: rng.uniform(-2.2, 2.2, (count, 6))


def spread_of_growth(model: Model, after: Fit) -> float:
    """Standard deviation of the growth of all lengths after a fit."""
    slope = model.measurement.growth[model.parameters.indices(after.free)]
    return float(np.sqrt(slope @ after.posterior.covariance @ slope))


def truth_of(model: Model, rng: np.random.Generator, size: float = 1.0) -> dict[str, float]:
    """Errors of links of so many times their plausible sizes."""
    items = [p for p in model.parameters.items if p.name in ARM.parameters]
    return {p.name: float(rng.normal() * p.scale * size) for p in items}


# --------------------------------------------------------------------------------------------------------- projections


@settings(max_examples=12)
@given(st.integers(0, 10**6), st.sampled_from(["one_pin", "two_sockets", "three_planes"]))
def test_a_projected_posture_lies_on_the_constraint_in_an_independent_model(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    scenario = SCENARIOS[name](rng)
    model = replace(told(name, scenario), setup=scenario.setup)
    q = measured(model, scenario, rng)[:12]
    missed = Witness(scenario).residual(q, {})
    norms = np.column_stack([np.linalg.norm(r.real, axis=1) for r in missed])
    assert np.all(norms.min(axis=1) < TOUCHING)
    assert np.all(np.abs(q) <= LIMIT)
    np.testing.assert_array_equal(norms < TOUCHING, touched(model.measurement, scenario.setup, q))


def test_a_projection_moves_the_joints_no_further_than_it_must(rng: np.random.Generator) -> None:
    """Beside SciPy's constrained minimum of the same length."""
    from scipy.optimize import minimize

    model = build_model(ARM, sc.Task((pin(known=True),)))
    (part,) = constraints(model.measurement)
    begin = contact_postures(model, 2, random(rng), (-LIMIT, LIMIT)) + 0.02 * rng.normal(size=(2, 6))
    q, met = projected(model, part, begin, np.zeros(len(model.parameters)), -LIMIT, LIMIT)
    assert met.all()
    witness = Witness(Scenario(model.task, model.setup, {}))
    for start, found in zip(begin, q, strict=True):
        on = {"type": "eq", "fun": lambda p: witness.residual(p[None], {})[0][0].real}
        best = minimize(lambda p, s=start: np.sum((p - s) ** 2), start, constraints=on, options={"ftol": 1e-14})
        assert np.linalg.norm(found - start) < 1.02 * np.sqrt(best.fun)


def test_the_stem_leans_no_further_than_the_socket_allows(rng: np.random.Generator) -> None:
    tilt = np.deg2rad(40)
    model = build_model(ARM, sc.Task((pin(known=True, tilt=tilt),)))
    q = contact_postures(model, 40, random(rng), (-LIMIT, LIMIT))
    flange = Witness(Scenario(model.task, model.setup, {})).stations(q, {})["flange"].real
    assert np.all(np.arccos(-flange[:, 2, 2]) < tilt)


def test_a_place_out_of_reach_is_refused_in_words(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contact, "_HOPELESS", 500)
    model = build_model(ARM, sc.Task((pin(at=np.array([3000.0, 0, 0]), known=True),)))
    with pytest.raises(RefusedError, match="within reach"):
        contact_postures(model, 10, random(rng), (-LIMIT, LIMIT))


# ---------------------------------------------------------------------------------------------------------- simulation


def test_noise_moves_the_place_and_the_residual_at_the_truth_is_that_noise(rng: np.random.Generator) -> None:
    model = build_model(ARM, sc.Task((pin("left"), pin("right", PIN + ASIDE))))
    truth = truth_of(model, rng, 0.5)
    q = contact_postures(model, 400, random(rng), (-LIMIT, LIMIT))
    data = sc.simulate(model, truth, q, Noise(position=0.3), rng)
    exact = Witness(Scenario(model.task, model.setup, {})).residual(data.q, truth)
    for k, r in enumerate(exact):
        own = np.isfinite(data.z[:, 3 * k])
        assert own.sum() == 200
        assert np.std(r.real[own]) == pytest.approx(0.3, rel=0.08)
    assert set(touched_names(model.measurement, model.setup, q)) == {"left", "right"}


def test_a_measured_file_comes_back_as_it_went(tmp_path: Path, rng: np.random.Generator) -> None:
    model = build_model(ARM, sc.Task((pin(),)))
    q = contact_postures(model, 20, random(rng), (-LIMIT, LIMIT))
    data = sc.simulate(model, {}, q, Noise(position=0.1), rng)
    sc.save_measurements(data, ARM, tmp_path / "m.csv")
    assert "x_mm" not in (tmp_path / "m.csv").read_text().splitlines()[0]
    again = sc.load_measurements(tmp_path / "m.csv", ARM, "fixed_point", point_names=("c",))
    np.testing.assert_allclose(again.q, data.q, atol=1e-12)
    np.testing.assert_array_equal(again.z, data.z)


# ------------------------------------------------------------------------------------------------------ absolute length


def test_uniform_growth_changes_no_residual_whatever_the_noise(rng: np.random.Generator) -> None:
    model = build_model(ARM, sc.Task((pin(),)))
    q = contact_postures(model, 30, random(rng), (-LIMIT, LIMIT))
    data = sc.simulate(model, truth_of(model, rng, 0.3), q, Noise(position=2.0), rng)
    names, share = model.parameters.names, 0.07
    x = share * lengths(model.parameters)
    x[[names.index(f"pin_{c}") for c in "xyz"]] = share * PIN
    x[[names.index(f"ball_c_{c}") for c in "xyz"]] = share * np.array(BALL)
    assert growth(model.measurement.growth, x) == pytest.approx(1 + share)
    rows = rows_of(model.measurement, data, model.setup)
    np.testing.assert_allclose(rows(x)[0], rows(np.zeros(len(x)))[0], rtol=1e-9)


def test_slopes_with_noise_are_those_of_finite_differences(rng: np.random.Generator) -> None:
    """Away from a residual of zero the growth has a slope of its own."""
    model = build_model(ARM, sc.Task((pin(),)))
    q = contact_postures(model, 4, random(rng), (-LIMIT, LIMIT))
    data = sc.simulate(model, {}, q, Noise(position=3.0), rng)
    rows, x = rows_of(model.measurement, data, model.setup), np.zeros(len(model.parameters))
    jacobian, step = rows(x)[1], 1e-5
    for i in range(len(x)):
        moved = step * np.eye(len(x))[i] * model.parameters.scales[i]
        slope = (rows(moved)[0] - rows(-moved)[0]) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, i] * model.parameters.scales[i], slope, atol=1e-6, rtol=1e-6)


def test_the_arm_does_not_shrink_however_many_and_noisy_the_contacts(rng: np.random.Generator) -> None:
    """Least squares of the plain residual would shrink it: by that pull, and not by chance, none is left."""
    model = build_model(ARM, sc.Task((pin(),)))
    grown, pull = [], []
    for _ in range(8):
        truth = truth_of(model, rng, 0.3)
        q = contact_postures(model, 400, random(rng), (-LIMIT, LIMIT))
        data = sc.simulate(model, truth, q, Noise(position=1.0), rng)
        after = calibrate(model, None, data, Options(sigma={"position": 1.0}, scales="stated")).after
        sigma = spread_of_growth(model, after)
        off = growth(model.measurement.growth, after.x) - growth(
            model.measurement.growth, model.parameters.vector(truth)
        )
        grown.append(off / sigma)
        pull.append(sigma * after.equations)  # of sum |r|^2 by g, times the variance: in its standard deviations
    assert np.mean(pull) > 0.4
    assert abs(np.mean(grown)) < 4 / np.sqrt(len(grown)) * 0.5 + 0.3 * np.mean(pull)


def test_a_robot_far_from_nominal_does_not_release_its_length(rng: np.random.Generator) -> None:
    """Errors ten times their plausible sizes are found, and a common factor with them; it is not one of the growth."""
    model = build_model(ARM, sc.Task((pin("left"), pin("right", PIN + ASIDE))))
    truth = truth_of(model, rng, 10.0)
    q = contact_postures(model, 120, random(rng), (-LIMIT, LIMIT))
    data = sc.simulate(model, truth, q, Noise(position=0.05), rng)
    after = calibrate(model, None, data, Options()).after
    size = np.linalg.norm(model.measurement.growth * model.parameters.scales)
    assert after.factor > 4
    assert abs(growth(model.measurement.growth, after.x) - 1) < 2 * size
    assert after.sigmas["left position"] == pytest.approx(0.05, rel=0.3)


def test_a_known_distance_tells_the_length_and_a_wrong_one_is_refused(rng: np.random.Generator) -> None:
    true = PIN + ASIDE
    target = sc.Target("right", sc.Place("base", transform(np.eye(3), true), unknown=True), {"O": (0.0, 0.0, 0.0)})

    def task(value: float) -> sc.Task:
        gap = sc.Observation(
            kind("distance"),
            "gap",
            sc.Place("base", unknown=True),
            target,
            noise={"distance": 0.02},
            place_name="left",
            value=(value,),
        )
        return sc.Task((pin("left"), pin("right", true), gap))

    model = build_model(ARM, task(120.0))
    q = contact_postures(model, 120, random(rng), (-LIMIT, LIMIT))
    truth = truth_of(model, rng, 1.0)
    data = sc.simulate(model, truth, q, Noise(position=0.02), rng)
    free = build_model(ARM, sc.Task((pin("left"), pin("right", true))))
    spread = []
    for each in (free, model):
        after = calibrate(each, None, data, Options(sigma={}, scales="estimated"), mistakes=()).after
        spread.append(spread_of_growth(each, after))
    assert spread[1] < 0.5 * spread[0]
    after = calibrate(build_model(ARM, task(121.0)), None, data, Options(), mistakes=())
    assert any("what is known of 'gap'" in note for note in after.notes)
    after = calibrate(model, None, data, Options())
    assert not any("what is known of 'gap'" in note for note in after.notes)
    with pytest.raises(RefusedError, match="shrinks the arm by"):
        calibrate(build_model(ARM, task(115.0)), None, data, Options(), mistakes=())
    with pytest.raises(RefusedError, match="half of the poses are off"):
        calibrate(build_model(ARM, task(60.0)), None, data, Options(), mistakes=())


# --------------------------------------------------------------------------------------------------------------- plans


@pytest.mark.parametrize(("name", "count"), [("pin", 30), pytest.param("plane", 80, marks=pytest.mark.long)])
@pytest.mark.long
def test_a_plan_of_contacts_beats_random_ones_by_the_forecast_and_in_simulation(
    name: str, count: int, configs: Path
) -> None:
    experiment = load(configs / f"{name}.yaml", overrides=[*QUIET, "plan.sample=600"])
    rng, task = np.random.default_rng(3), experiment.model.task
    # so small that the model is linear at the noise, from gauge to gauge
    small = {p.name: 0.1 * p.scale for p in experiment.model.parameters.items if not p.unknown}
    model = build_model(experiment.robot, replace(task, scales=small))
    problem = plan_problem(experiment.file, experiment.document, model, rng)
    assert problem.pool is not None
    assert len(problem.pool) == 600
    assert touched(model.measurement, model.setup, problem.pool).any(axis=1).all()
    plan = select_poses(
        problem.info,
        count,
        rng,
        criterion="D",
        region=problem.region,
        aligned=problem.aligned,
        candidates=problem.pool,
        random=40,
    )
    assert plan.random is not None
    assert plan.certificate.d_efficiency_lower_bound > max(0.85, plan.random.d_efficiency_lower_bound)
    assert plan.prediction.mean_pose_rms_mm < plan.random.mean_pose_rms_mm

    sigma = problem.info.sigmas
    noise = Noise(by_instrument={g.observation: {g.quantity: sigma[g.name]} for g in model.measurement.groups})
    index = model.parameters.indices(problem.info.names)
    chance = problem.pool[rng.permutation(len(problem.pool))[:count]]
    posterior = problem.info.basis.T @ problem.info.posterior(chance)
    white = np.linalg.inv(np.linalg.cholesky(posterior @ posterior.T)) @ problem.info.basis.T / problem.info.scales

    def found(q: Array) -> float:
        """Mean squared error over draws on the seen directions, in what is foretold of the random poses."""
        errors = []
        for _ in range(12):
            truth = {p.name: float(rng.normal() * p.scale) for p in model.parameters.items if not p.unknown}
            data = sc.simulate(model, truth, q, noise, rng)
            fitted = calibrate(model, None, data, Options(sigma=sigma, scales="stated"))
            off = fitted.after.x - stated(model, fitted.setup) - model.parameters.vector(truth)
            errors.append(white @ off[index])
        return float(np.mean(np.square(errors)))

    whole = white * problem.info.scales @ problem.info.posterior(plan.poses)
    foretold = float(np.mean(np.sum(whole**2, axis=1)))
    assert foretold < 0.98
    assert found(plan.poses) == pytest.approx(foretold, rel=0.25)
    assert found(chance) == pytest.approx(1.0, rel=0.25)


def test_candidates_are_moved_to_what_they_are_nearest_to(
    rng: np.random.Generator, configs: Path, tmp_path: Path
) -> None:
    experiment = load(configs / "pin.yaml")
    model, dof = experiment.model, experiment.robot.dof
    limits = (np.full(dof, -3.0), np.full(dof, 3.0))
    q = contact_postures(model, 40, lambda n: rng.uniform(-3, 3, (n, dof)), limits)
    near = q + 1e-3 * rng.normal(size=q.shape)
    lines = ["pose," + ",".join(f"q{i}_deg" for i in range(1, dof + 1))]
    lines += [f"{k}," + ",".join(repr(float(v)) for v in np.rad2deg(row)) for k, row in enumerate(near)]
    (tmp_path / "c.csv").write_text("\n".join(lines) + "\n")
    with_them = load(configs / "pin.yaml", overrides=[f"plan.candidates={tmp_path / 'c.csv'}", "plan.sample=100"])
    problem = plan_problem(with_them.file, with_them.document, with_them.model, rng)
    assert problem.candidates is not None
    assert problem.touches is not None
    assert problem.touches(problem.candidates) == touched_names(model.measurement, model.setup, q)
    assert np.abs(problem.candidates - near).max() < 0.02


# --------------------------------------------------------------------------------------------------------------- files


def test_check_says_that_contacts_see_no_length(configs: Path) -> None:
    found = check_model(load(configs / "pin.yaml").model)
    assert any("nothing that is read has a length" in note for note in found.notes)
    assert any("only known values" in note for note in found.notes)


def test_both_sockets_know_what_is_between_them_in_every_session(sessions: Path) -> None:
    """A value between two entries that have a place for each session holds in every session."""
    experiment = load(sessions)
    assert [o.name for o in experiment.model.task.values] == ["gap_a", "gap_b"]
    outcome = identify_experiment(experiment, progress=lambda _: None)
    frames = outcome.content["frames"]
    apart = np.linalg.norm(np.subtract(frames["left_a"]["xyz_mm"], frames["right_a"]["xyz_mm"]))
    assert apart == pytest.approx(120, abs=0.1)
    test = outcome.errors["test"]
    assert test["after"].statistics.rms < 0.5 * test["before"].statistics.rms
    assert test["after"].fitted == 6


@pytest.fixture(scope="module")
def measured_sessions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sockets 120 mm apart at two places, the second of which tests."""
    folder, rng = tmp_path_factory.mktemp("sessions"), np.random.default_rng(20170829)
    links = tuple(replace(x, joint=replace(x.joint, name=f"j{i}")) for i, x in enumerate(ARM.links, start=1))
    sc.save_robot(replace(ARM, links=links), folder / "robot.yaml")
    rows = []
    for session, shift in (("a", np.zeros(3)), ("b", np.array([-60.0, -150.0, 40.0]))):
        model = build_model(ARM, sc.Task((pin("left", PIN + shift), pin("right", PIN + shift + ASIDE))))
        truth = truth_of(model, np.random.default_rng(5))
        q = contact_postures(model, 80, random(rng), (-LIMIT, LIMIT))
        data = sc.simulate(model, truth, q, Noise(position=0.1), rng)
        for pose, z in zip(data.q, data.z, strict=True):
            socket = "left" if np.isfinite(z[0]) else "right"
            rows.append([session, socket, *(repr(float(v)) for v in pose)])
    head = "place,socket," + ",".join(f"q{i}_rad" for i in range(1, 7))
    (folder / "data.csv").write_text("\n".join([head, *(",".join(row) for row in rows)]) + "\n")
    entry = (
        "{instrument: fixed_point, at: {on: base, place: unknown, per: session}, target: ball, data: {source: file, "
        "file: data.csv, columns: {session: place}, where: {socket: NAME}, "
        "split: {column: session, train: [a], test: [b]}}}"
    )
    lines = [
        "name: sessions",
        "units: {length: mm, angle: deg}",
        "robot: robot.yaml",
        "outputs: {report: false, figures: false}",
        "targets: {ball: {on: flange, points: {c: unknown}}}",
        "measurements:",
        *(f"  {name}: {entry.replace('NAME', name)}" for name in ("left", "right")),
        "  gap: {instrument: distance, at: left, target: right, value: 120, noise: 0.05}",
    ]
    (folder / "sessions.yaml").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def sessions(measured_sessions: Path, tmp_path: Path) -> Path:
    """The experiment in a folder of the test's own."""
    shutil.copytree(measured_sessions, tmp_path, dirs_exist_ok=True)
    return tmp_path / "sessions.yaml"


GAP = "gap: {instrument: distance, at: left, target: right, value: 120, noise: 0.05}"
MISTAKES = {
    "a value without its noise": (GAP.replace(", noise: 0.05", ""), "say how well the value is known"),
    "a value with data": (
        GAP.replace("value: 120", "value: 120, data: {source: file, file: data.csv}"),
        "has no 'data'",
    ),
    "a value between strangers": (GAP.replace("at: left", "at: middle"), "no entry of this name"),
    "a value of a thing that nobody measures": (
        GAP.replace("at: left", "at: {on: base, place: unknown}"),
        "nothing else is measured of this thing",
    ),
    "a value across joints": (
        GAP.replace("target: right", "target: {on: flange, points: {P: [0, 0, 0]}}"),
        "joints move these two",
    ),
    "two values for one distance": (GAP.replace("120", "[120, 130]"), "a number for each column"),
    "a contact with a value": (
        GAP.replace("instrument: distance", "instrument: fixed_point").replace("120", "[0, 0, 0]"),
        "a contact has no value",
    ),
    "a value with an unknown of its own": (
        GAP.replace("value:", "offset: unknown, value:"),
        "unknown numbers of its own",
    ),
    "a value that is no number": (GAP.replace("120", ".nan"), "NaN is not a number"),
    "readings without a joint between": (
        GAP.replace("value: 120", "data: {source: file, file: data.csv}")
        .replace("target: right", "target: {on: base}")
        .replace("at: left", "at: {on: base, place: {xyz: [1, 2, 3]}}"),
        "both off the robot",
    ),
    "a tilt of nothing": (GAP + "\n  third: {instrument: fixed_point, tilt: 0, at: {on: base}, target: ball}", "tilt"),
    "two balls in one socket": (
        GAP + "\n  third: {instrument: plane, at: {on: base, place: unknown}, target: {on: flange, points: "
        "{a: [0, 0, 1], b: [0, 0, 2]}}, data: {source: file, file: data.csv}}",
        "one point of the robot touches",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_each_mistake_is_one_clear_error(name: str, sessions: Path, tmp_path: Path) -> None:
    entry, words = MISTAKES[name]
    sessions.write_text(sessions.read_text().replace(GAP, entry))
    with pytest.raises((InputError, RefusedError)) as caught:
        run(sessions, tmp_path / "out")
    assert words in str(caught.value)
    assert not (tmp_path / "out").exists()
    if isinstance(caught.value, InputError):
        assert caught.value.file is not None


SLIPS: dict[str, Callable[[list[str]], list[str]]] = {
    "a joint of the wrong sign": lambda q: [q[0], str(-float(q[1])), *q[2:]],
    "two joints exchanged": lambda q: [q[0], q[2], q[1], *q[3:]],
    "degrees that are radians": lambda q: [str(np.deg2rad(float(v))) for v in q],
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_in_the_joints_is_refused(slip: str, sessions: Path, tmp_path: Path) -> None:
    head, *rows = (tmp_path / "data.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    mistaken = [",".join([*row[:2], *SLIPS[slip](row[2:])]) for row in cells]
    (tmp_path / "data.csv").write_text("\n".join([head, *mistaken]) + "\n")
    with pytest.raises(RefusedError, match="which posture touched what"):
        run(sessions, tmp_path / "out")
    assert not (tmp_path / "out").exists()


# --------------------------------------------------------------------------------------------------------- real sockets


@pytest.mark.parametrize(
    ("arm", "extend", "most"),
    [("panda_1", "none", 0.66), pytest.param("panda_2", "auto", 0.43, marks=pytest.mark.long)],
)
def test_real_sockets_at_other_places_are_met(
    arm: str, extend: str, most: float, configs: Path, symcal_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean distance to the group's mean, which the test computes itself from the calibrated robot's poses."""
    monkeypatch.setenv("SYMCAL_DATA", str(symcal_data))
    experiment = load(configs / "real" / f"{arm}.yaml", overrides=[*QUIET, f"identification.extend={extend}"])
    outcome = identify_experiment(experiment, progress=lambda _: None)
    model, after = outcome.calibration.model, outcome.calibration.states["after"]
    setup = model.moved(after.setup, after.x)
    errors = model.parameters.mapping(after.x)
    distances = []
    for part in model.measurement.parts:
        own = outcome.data.read_by(part.observation.name)
        if own.split[0] != "test":
            continue
        x = model.parameters.vector({n: errors[n] for n in model.robot.parameters})
        flange = model.flange(own.q, x, setup.vector[:24])[0]
        ball = flange[:, :3, :3] @ setup.points[0] + flange[:, :3, 3]
        distances.append(np.linalg.norm(ball - ball.mean(axis=0), axis=1))
    mean = float(np.mean(np.concatenate(distances)))
    assert mean <= most
    assert mean == pytest.approx(outcome.content["accuracy"]["test"]["after"]["position_mm"]["mean"], abs=1e-4)
    assert outcome.content["accuracy"]["test"]["before"]["position_mm"]["mean"] > 5


def test_measured_postures_need_no_planner(configs: Path) -> None:
    """A simulated run of the shipped pin: errors against the truth a small part of what they were."""
    experiment = load(configs / "pin.yaml", overrides=QUIET)
    found = measurements(experiment.file, experiment.document, experiment.model, np.random.default_rng(1))
    assert found.exact is not None
    outcome = identify_experiment(experiment, progress=lambda _: None)
    truth = outcome.content["accuracy"]["truth"]
    assert truth["after"]["position_mm"]["rms"] < 0.1 * truth["before"]["position_mm"]["rms"]
    assert config.sources(experiment.file).keys() == {"left", "right"}
