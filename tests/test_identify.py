"""From data to a calibrated robot: known truth comes back, whatever is unknown around the robot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import ARM, PLANAR, TRIANGLE, handling, measure, prismatic, random_errors, revolute
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import random_frame, seeds

from symcal.calibration.calibrate import Calibration, baseline_model, calibrate
from symcal.calibration.evaluate import evaluate, expected_position_rms
from symcal.calibration.identify import identify
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import Model, State, build_model
from symcal.model.task import Task
from symcal.placing.placement import place, stated
from symcal.robot.robot import Robot
from symcal.solvers import SOLVERS
from symcal.spatial import inverse, transform

POINT = {"P": (30.0, 20.0, 80.0)}
POINTS = dict(zip("abc", TRIANGLE, strict=True))


@cache
def model_of(
    robot: Robot, kind: str, estimate: frozenset[str], points: tuple[str, ...] = (), invert: bool = False
) -> Model:
    places = {k: POINTS[k] for k in points} or POINT
    return build_model(robot, Task.of(kind, estimate, places, invert=invert))  # type: ignore[arg-type]


def elsewhere(model: Model, base: np.ndarray, tool: np.ndarray) -> Model:
    """The model with the robot in another place: where it really is."""
    return replace(model, setup=replace(model.setup, base=base, tool=tool))


def errors_of(model: Model, rng: np.random.Generator, offsets: float) -> dict[str, float]:
    """Link errors, with joint zeros off by up to ``offsets`` (rad; 2 mm)."""
    errors = {k: v for k, v in random_errors(model, rng).items() if k in model.robot.parameters}
    for name in model.offsets:
        errors[name] = float(rng.uniform(-1, 1) * (offsets if name.startswith("theta") else 2.0))
    return errors


def position_rms(calibration: Calibration, data: Dataset, state: str = "after") -> float:
    return float(np.sqrt(np.mean(evaluate(calibration.states[state], data).size ** 2)))


CASES = {
    "position, base and tool": ("position", {"base", "tool"}, (), False),
    "position, three points of a known tool": ("position", {"base"}, ("a", "b", "c"), False),
    "position, three points of an unknown tool": ("position", {"base", "tool"}, ("a", "b", "c"), False),
    "position, unknown points": ("position", {"base", "points"}, ("a", "b", "c"), False),
    "position, all known": ("position", set(), ("a", "b", "c"), False),
    "pose, base and tool": ("pose", {"base", "tool"}, (), False),
    "pose, tool only": ("pose", {"tool"}, (), False),
    "pose, base only": ("pose", {"base"}, (), False),
    "pose, eye in hand": ("pose", {"base", "tool"}, (), True),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("half_turn", [False, True])
def test_a_six_axis_arm_five_metres_away_with_joints_off_by_two_degrees(case: str, half_turn: bool) -> None:
    """Held-out errors end at what the noise leaves, from tens of millimetres, without any first value."""
    kind, estimate, points, invert = CASES[case]
    rng = np.random.default_rng(len(case) + half_turn)
    model = model_of(ARM, kind, frozenset(estimate), points, invert)
    base = random_frame(rng, 3000.0) if "base" in estimate else np.eye(4)
    if half_turn:
        if "base" not in estimate:
            pytest.skip("the base is known")
        base[:3, :3] = Rotation.from_rotvec([0, 0, np.pi]).as_matrix()
    tool = random_frame(rng, 200.0) if "tool" in estimate and (kind == "pose" or points) else np.eye(4)
    truth = elsewhere(model, base, tool)
    errors = errors_of(model, rng, np.deg2rad(2))
    data = measure(truth, errors, 50, rng, 0.05, 1e-4)
    test = measure(truth, errors, 100, rng)
    found = calibrate(model, None, data, Options())
    assert found.after.converged
    assert found.notes == () or "off by" in found.notes[0]
    assert found.after.sigmas["position"] == pytest.approx(0.05, rel=0.2)
    before, offsets, after = (position_rms(found, test, name) for name in ("before", "offsets_only", "after"))
    assert before > 5.0
    assert offsets < before / 2
    expected = float(np.sqrt(np.mean(expected_position_rms(model, found.after, test.q) ** 2)))
    assert expected < 0.1
    assert 0.5 < after / expected < 2.0


@pytest.mark.parametrize("kind", ["position", "pose"])
@pytest.mark.parametrize(("degrees", "poses"), [(5, 15), (20, 25)])
def test_large_errors_are_not_taken_for_noise(kind: str, degrees: float, poses: int) -> None:
    """Few poses, unknown noise: what nominal kinematics leaves is a thousand sigmas and hides every direction."""
    model = model_of(ARM, kind, frozenset({"base", "tool"}))
    for seed in range(4):
        rng = np.random.default_rng(seed)
        truth = elsewhere(model, random_frame(rng, 3000.0), np.eye(4))
        errors = errors_of(model, rng, np.deg2rad(degrees))
        found = calibrate(model, None, measure(truth, errors, poses, rng, 0.05, 1e-4), Options(), mistakes=())
        assert found.after.sigmas["position"] == pytest.approx(0.05, rel=0.6)
        assert position_rms(found, measure(truth, errors, 100, rng)) < 0.25


@given(seeds, st.sampled_from(["pose", "position"]))
@settings(max_examples=12)
def test_noise_free_data_are_explained_to_rounding_wherever_the_frames(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    model = model_of(ARM, kind, frozenset({"base", "tool"}))
    truth = elsewhere(model, random_frame(rng, 5000.0), random_frame(rng, 200.0) if kind == "pose" else np.eye(4))
    errors = errors_of(model, rng, 0.01)
    found = calibrate(model, None, measure(truth, errors, 40, rng), Options())
    assert position_rms(found, measure(truth, errors, 50, rng)) < 1e-7


def test_a_known_truth_comes_back_in_identifiable_coordinates() -> None:
    """Base against first link: height with d_1, and heading with theta_1, an exact and straight gauge."""
    task = Task.of("pose", frozenset({"base"}), fix=("base_x", "base_y", "base_rx", "base_ry"))
    links = list(ARM.links)
    links[1] = replace(links[1], parameters={k: v for k, v in links[1].parameters.items() if k != "d"})  # d_4 is enough
    model = build_model(replace(ARM, links=tuple(links)), task)
    rng = np.random.default_rng(2)
    base = transform(Rotation.from_rotvec([0, 0, 0.7]).as_matrix(), np.array([0.0, 0.0, 40.0]))
    errors = errors_of(model, rng, 0.02)
    data = measure(elsewhere(model, base, np.eye(4)), errors, 40, rng)
    found = calibrate(model, None, data, Options())
    seen = found.after.identifiability
    assert seen.rank == seen.numerical_rank == len(seen.names) - 2
    assert {tuple(sorted(d.direction)) for d in seen.unseen()} == {("base_z", "d_1"), ("base_rz", "theta_1")}
    step = inverse(found.setup.base) @ base
    assert np.abs(step[:2, 3]).max() < 1e-9  # what was held stayed
    errors |= {"base_z": float(step[2, 3]), "base_rz": float(np.arctan2(step[1, 0], step[0, 0]))}
    x = model.parameters.vector(errors)[model.parameters.indices(seen.names)]
    estimate = found.after.x[model.parameters.indices(seen.names)]
    assert np.abs(seen.seen.T @ ((estimate - x) / seen.scales)).max() < 1e-8
    # the gauge: what base and first link share is the base's, and the link stays at nominal
    assert abs(found.after.x[model.parameters.index("theta_1")]) < 1e-6
    assert abs(found.after.x[model.parameters.index("d_1")]) < 1e-4
    listed = found.robot.record
    assert listed is not None
    assert {name for name, sigma in listed.sigmas.items() if sigma is None} == set(task.fix)
    # it keeps its plausible size, and so does the base's share in it; what the data tell has next to none left
    scales = dict(zip(model.parameters.names, model.parameters.scales * found.after.factor, strict=True))
    for frame, link in (("base_z", "d_1"), ("base_rz", "theta_1")):
        for name in (frame, link):
            assert listed.sigmas[name] == pytest.approx(scales[link], rel=0.05)
    assert all(listed.sigmas[name] < 1e-3 * scales[name] for name in ("alpha_3", "a_4", "theta_5"))  # type: ignore[operator]


GANTRY = Robot("gantry", "craig", tuple(prismatic(theta=0.0, d=0.0, a=0.0, alpha=a) for a in (0.0, 1.57, 1.57)))
TURNTABLE = Robot("turntable", "craig", (revolute(theta=0.0, d=100.0, a=0.0, alpha=0.0),))
SLIDE = Robot("slide", "craig", (prismatic(theta=0.0, d=100.0, a=0.0, alpha=0.0),))


@pytest.mark.parametrize("robot", [GANTRY, TURNTABLE, SLIDE, PLANAR], ids=lambda robot: robot.name)
@pytest.mark.parametrize("kind", ["position", "pose"])
def test_small_and_degenerate_robots(robot: Robot, kind: str) -> None:
    """Frames that the data leave open are no obstacle: what can be seen is predicted."""
    rng = np.random.default_rng(3)
    model = model_of(robot, kind, frozenset({"base", "tool"}))
    truth = elsewhere(model, random_frame(rng, 3000.0), np.eye(4))
    errors = errors_of(model, rng, 0.01)
    found = calibrate(model, None, measure(truth, errors, 40, rng, 0.05, 1e-4), Options())
    assert found.after.identifiability.rank < len(found.after.free)
    assert position_rms(found, measure(truth, errors, 100, rng)) < 0.06
    assert not any("check the order" in note for note in found.notes)


def test_one_pose_is_refused() -> None:
    model = model_of(ARM, "pose", frozenset({"base", "tool"}))
    with pytest.raises(RefusedError, match="poses or more"):
        calibrate(model, None, measure(model, {}, 1, np.random.default_rng(1), 0.1, 1e-3), Options())


def test_no_pose_for_training_is_refused() -> None:
    model = model_of(ARM, "pose", frozenset())
    data = measure(model, {}, 5, np.random.default_rng(1), 0.1, 1e-3)
    with pytest.raises(RefusedError, match="no pose is marked for training"):
        calibrate(model, None, replace(data, split=("test",) * 5), Options())


def test_only_training_poses_are_used() -> None:
    model = model_of(ARM, "pose", frozenset({"base", "tool"}))
    rng = np.random.default_rng(4)
    data = measure(model, errors_of(model, rng, 0.01), 40, rng, 0.05, 1e-4)
    alone = calibrate(model, None, data, Options())
    wrong = replace(measure(model, {}, 20, rng), split=("test",) * 10 + ("unused",) * 10)
    both = replace(
        data,
        q=np.vstack([wrong.q, data.q]),
        z=np.vstack([wrong.z + 100, data.z]),
        labels=wrong.labels + data.labels,
        split=wrong.split + data.split,
    )
    assert np.array_equal(calibrate(model, None, both, Options()).after.x, alone.after.x)


def test_the_sign_of_a_quaternion_does_not_matter() -> None:
    model = model_of(ARM, "pose", frozenset({"base", "tool"}))
    rng = np.random.default_rng(4)
    data = measure(model, errors_of(model, rng, 0.01), 40, rng, 0.05, 1e-4)
    z = data.z.copy()
    z[::2, 3:] *= -1
    found = calibrate(model, None, replace(data, z=z), Options())
    assert np.allclose(found.after.x, calibrate(model, None, data, Options()).after.x, atol=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_solver_is_the_one_asked_for_and_the_result_the_same(solver: str) -> None:
    model = model_of(ARM, "pose", frozenset({"base", "tool"}))
    rng = np.random.default_rng(5)
    truth = elsewhere(model, random_frame(rng), random_frame(rng, 100))
    data = measure(truth, errors_of(model, rng, 0.01), 40, rng, 0.05, 1e-4)
    found = calibrate(model, None, data, Options(solver=solver))  # type: ignore[arg-type]
    reference = calibrate(model, None, data, Options())
    assert found.after.solution.solver == found.offsets.solution.solver == solver
    assert np.array_equal(found.setup.base, reference.setup.base)  # frames are always placed by the same
    assert np.abs((found.after.x - reference.after.x) / model.parameters.scales).max() < 1e-4


def test_the_calibrated_robot_is_the_state_that_was_identified() -> None:
    """Its numbers, frames, sigmas and covariance; and back to nominal again."""
    model = model_of(handling(), "position", frozenset({"base", "tool"}))
    rng = np.random.default_rng(6)
    data = measure(elsewhere(model, random_frame(rng), np.eye(4)), errors_of(model, rng, 0.005), 40, rng, 0.05)
    found = calibrate(model, None, data, Options())
    robot = found.robot
    record = robot.record
    assert record is not None
    again = build_model(robot, Task.of("position", points=POINT))
    mine = State(again, again.setup, np.zeros(len(again.parameters)))
    assert np.allclose(evaluate(mine, data).vectors, evaluate(found.states["after"], data).vectors, atol=1e-8)
    before = build_model(robot.nominal(), Task.of("position", points=POINT))
    start = State(before, before.setup, np.zeros(len(before.parameters)))
    assert np.allclose(evaluate(start, data).vectors, evaluate(found.states["before"], data).vectors, atol=1e-8)
    index = [list(record.errors).index(n) for n in found.after.free]
    sigmas = [record.sigmas[name] for name in found.after.free]
    assert np.allclose(np.sqrt(np.diag(record.covariance)[index]), np.array(sigmas, dtype=float), rtol=1e-9)
    assert record.provenance["size_factor"] == found.after.factor
    assert record.provenance["learnt"] == dict(zip(found.after.free, found.after.posterior.learnt, strict=True))
    assert record.provenance["trouble"] == ""


def test_the_fair_baseline_fits_both_frames_whatever_the_task_estimates() -> None:
    assert baseline_model(model_of(ARM, "pose", frozenset({"base", "tool"}))) is None
    for estimate in (frozenset(), frozenset({"base"})):
        model = model_of(ARM, "pose", estimate)
        baseline = baseline_model(model)
        assert baseline is not None
        assert baseline.task.base
        assert baseline.task.tool
        rng = np.random.default_rng(7)
        truth = elsewhere(model, np.eye(4), transform(np.eye(3), rng.normal(size=3)))
        data = measure(truth, errors_of(model, rng, 0.01), 40, rng, 0.05, 1e-4)
        found = calibrate(model, baseline, data, Options())
        assert (found.before_raw is None) == ("base" in estimate)
        fitted = calibrate(model_of(ARM, "pose", frozenset({"base", "tool"})), None, data, Options())
        assert position_rms(found, data, "before") == pytest.approx(position_rms(fitted, data, "before"), rel=1e-6)


def test_held_numbers_stay_and_unknown_names_are_refused() -> None:
    rng = np.random.default_rng(8)
    model = model_of(ARM, "pose", frozenset({"base", "tool"}))
    data = measure(elsewhere(model, random_frame(rng), np.eye(4)), errors_of(model, rng, 0.01), 40, rng, 0.05, 1e-4)
    fixed = ("theta_2", "a_3", "tool_rx", "tool_ry", "tool_rz")
    found = identify(ARM, data, Task.of("pose", frozenset({"base", "tool"}), fix=fixed))
    errors = dict(zip(found.model.parameters.names, found.after.x, strict=True))
    assert [errors[name] for name in fixed] == [0.0] * 5
    assert np.allclose(found.setup.tool[:3, :3], np.eye(3), atol=1e-12)  # as the robot has it, not as fitted
    with pytest.raises(InputError, match="no such parameter"):
        identify(ARM, data, Task.of("pose", fix=("theta_9",)))


def test_a_prior_on_a_frame_is_about_the_stated_frame() -> None:
    """A mount known to 0.05 mm pulls to its drawing, not to where wrong kinematics would have put it."""
    rng = np.random.default_rng(9)
    priors = dict.fromkeys(("tool_x", "tool_y", "tool_z"), 0.01) | dict.fromkeys(
        ("tool_rx", "tool_ry", "tool_rz"), 1e-4
    )
    task = Task.of("pose", frozenset({"base", "tool"}), priors=priors)
    model = build_model(replace(ARM, tool=transform(np.eye(3), np.array([10.0, 20.0, 90.0]))), task)
    data = measure(
        elsewhere(model, random_frame(rng), model.setup.tool), errors_of(model, rng, 0.02), 40, rng, 0.05, 1e-4
    )
    found = calibrate(model, None, data, Options())
    assert np.abs(found.robot.tool[:3, 3] - [10, 20, 90]).max() < 0.05
    assert np.abs(stated(model, model.setup)).max() < 1e-12
    moved = model.setup.moved({"tool_x": 0.3, "tool_rz": 0.02, "base_ry": -0.01})
    back = moved.moved(model.parameters.mapping(stated(model, moved)))
    assert np.allclose(back.tool, model.setup.tool, atol=1e-12)
    assert np.allclose(back.base, model.setup.base, atol=1e-12)


@pytest.mark.parametrize("kind", ["position", "pose"])
def test_frames_placed_on_a_straight_row_of_poses_are_right_there(kind: str) -> None:
    """What such poses leave open of base and tool is taken somewhere, and does no harm on the way between them."""
    model = model_of(ARM, kind, frozenset({"base", "tool"}))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        truth = elsewhere(model, random_frame(rng, 3000.0), random_frame(rng, 100.0) if kind == "pose" else np.eye(4))
        q = np.array([0.0, -0.8, 1.0, 0.3, 0.7, 0.0]) + 0.5 * np.linspace(-1, 1, 59)[:, None] * rng.normal(size=6)
        seen = simulate(truth, {}, q[::2], Noise("normal", 0.05, 1e-4), rng)
        setup = place(model, seen, Options())
        state = State(model, setup, np.zeros(len(model.parameters)))
        off = evaluate(state, simulate(truth, {}, q[1::2], Noise(), rng)).size
        # sigma root of unknowns over poses: nine of a point, twelve of a pose
        assert np.sqrt(np.mean(off**2)) < 1.5 * 0.05 * np.sqrt(9 / 30)


@pytest.mark.parametrize("estimate", [{"base", "tool"}, {"base", "points"}])
def test_gross_errors_do_not_mislead_registration_and_robust_fit(estimate: set[str]) -> None:
    rng = np.random.default_rng(10)
    points = ("a", "b", "c") if "points" in estimate else ()
    model = model_of(ARM, "position", frozenset(estimate), points)
    truth, errors = elsewhere(model, random_frame(rng, 3000.0), np.eye(4)), errors_of(model, rng, 0.02)
    data, test = measure(truth, errors, 60, rng, 0.05), measure(truth, errors, 100, rng)
    z = data.z.copy()
    z[:3] += 50 * rng.normal(size=z[:3].shape)
    spoilt = replace(data, z=z)
    robust = calibrate(model, None, spoilt, Options(loss="huber"))
    linear = calibrate(model, None, spoilt, Options())
    assert position_rms(robust, test) < 0.1 < 1.0 < position_rms(linear, test)


def test_known_and_estimated_noise_weigh_the_same_when_they_agree() -> None:
    rng = np.random.default_rng(11)
    model = model_of(ARM, "pose", frozenset({"base", "tool"}))
    truth = elsewhere(model, random_frame(rng), np.eye(4))
    data = measure(truth, errors_of(model, rng, 0.01), 60, rng, 0.05, 1e-4)
    known = calibrate(model, None, data, Options(sigma={"position": 0.05, "orientation": 1e-4}))
    half = calibrate(model, None, data, Options(sigma={"orientation": 1e-4}))
    free = calibrate(model, None, data, Options())
    assert (known.after.estimated, half.after.estimated) == ((), ("position",))
    assert known.after.chi_squared / known.after.dof == pytest.approx(1.0, abs=0.25)
    for one in (half, free):
        assert position_rms(one, data) == pytest.approx(position_rms(known, data), rel=0.01)


def test_a_point_without_coordinates_is_refused_in_words() -> None:
    with pytest.raises(InputError, match="needs x, y and z"):
        build_model(ARM, Task.of("position", (), {"A": None}))
