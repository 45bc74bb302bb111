"""Fitness functions against a slow implementation, pose by pose, with finite differences in place of Jacobians."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from handling_arm import front_view, handling_chain, own_setup

from symcal.errors import InputError
from symcal.kinematics import forward
from symcal.model.measurement import Setup
from symcal.model.observe import observe
from symcal.model.task import Task
from symcal.planning.area import working_area
from symcal.planning.criteria import criterion
from symcal.planning.fitness import Reading, Weights, condition_numbers, paper_fitness, sound_fitness
from symcal.planning.information import pose_information
from symcal.planning.region import TaskRegion, region_accuracy

SIGMA = 0.1 / np.sqrt(3)
MODEL = handling_chain()
VIEW = front_view(MODEL)
AREA = working_area(MODEL.robot, {"waist": (-np.pi / 2, np.pi / 2)})
READINGS = [
    Reading(*items)
    for items in itertools.product(
        ("per_pose", "stacked"), ("image", "projection", "position"), ("target", "tool"), ("sum", "mean")
    )
]


@pytest.fixture(scope="module")
def info():
    setup = Setup(MODEL.robot.base, MODEL.robot.tool, np.zeros((1, 3)))
    return pose_information(observe(MODEL, *Task.of("position").observations), setup, {"position": SIGMA}, area=AREA)


@pytest.fixture(scope="module")
def basis(info):
    return info.scales[:, None] * info.basis


FORWARD = forward(MODEL)


def tool_at(q, x):
    return np.array(FORWARD(q, x, own_setup(MODEL.robot).vector)[0])


def in_camera(point):
    r, t = VIEW.T_world_camera[:3, :3], VIEW.T_world_camera[:3, 3]
    return r.T @ (point - t)


def slow_rows(q, reading):
    """One block of rows for each target point, by central differences."""
    n, h = len(MODEL.parameters), 1e-5
    offsets = VIEW.target.points @ VIEW.T_tool_target[:3, :3].T + VIEW.T_tool_target[:3, 3]
    k = np.array([[VIEW.camera.fx, 0, VIEW.camera.cx], [0, VIEW.camera.fy, VIEW.camera.cy]])
    blocks = []
    for offset in offsets:
        moved = offset if reading.point == "target" else np.zeros(3)

        def world(x, moved=moved):
            tool = tool_at(q, x)
            return tool[:3, :3] @ moved + tool[:3, 3]

        tool = tool_at(q, np.zeros(n))
        seen = in_camera(tool[:3, :3] @ offset + tool[:3, 3])
        jacobian = np.column_stack([(in_camera(world(h * e)) - in_camera(world(-h * e))) / (2 * h) for e in np.eye(n)])
        if reading.rows == "position":
            blocks.append(jacobian / seen[2])
        elif reading.rows == "image":
            blocks.append(k @ jacobian / seen[2])
        elif reading.rows == "projection":

            def pixel(p):
                return k @ p / p[2]

            slope = np.column_stack([(pixel(seen + 1e-3 * e) - pixel(seen - 1e-3 * e)) / 2e-3 for e in np.eye(3)])
            blocks.append(slope @ jacobian)
    return blocks


def slow_fitness(plan, basis, weights, reading):
    per_pose, angles, areas = [], [], []
    stacks = [[], [], []]
    for q in plan:
        blocks = [block @ basis for block in slow_rows(q, reading)]
        per_pose.append(sum(np.linalg.cond(block) for block in blocks))
        for stack, block in zip(stacks, blocks, strict=True):
            stack.append(block)
        tool = tool_at(q, np.zeros(15))
        seen = [in_camera(tool[:3, :3] @ p + tool[:3, 3]) for p in VIEW.tool_points]
        angles.append(sum(np.arccos(p[2] / np.linalg.norm(p)) for p in seen))
        (u1, v1), (u2, v2), (u3, v3) = (
            (VIEW.camera.fx * p[0] / p[2] + VIEW.camera.cx, VIEW.camera.fy * p[1] / p[2] + VIEW.camera.cy) for p in seen
        )
        areas.append(abs(u1 * v2 + u2 * v3 + u3 * v1 - u1 * v3 - u2 * v1 - u3 * v2))
    total = np.sum if reading.over == "sum" else np.mean
    stacked = sum(np.linalg.cond(np.vstack(stack)) for stack in stacks)
    condition = total(per_pose) if reading.conditioning == "per_pose" else stacked
    return weights.observability * condition + weights.angle * total(angles) + weights.area * total(areas)


@pytest.mark.parametrize("reading", READINGS, ids=lambda r: f"{r.conditioning}-{r.rows}-{r.point}-{r.over}")
def test_paper_fitness_is_equation_12_in_every_reading(reading, basis):
    weights = Weights(0.5, 2.0, -1e-3)
    plans = AREA.sample(np.random.default_rng(3), 12).reshape(2, 6, 5)
    expected = [slow_fitness(plan, basis, weights, reading) for plan in plans]
    np.testing.assert_allclose(paper_fitness(VIEW, basis, weights, reading)(plans), expected, rtol=2e-5)


def test_over_all_fifteen_columns_the_stacked_condition_number_is_infinite():
    every = np.diag(MODEL.parameters.scales)
    plans = AREA.sample(np.random.default_rng(3), 40)[None]
    stacked = Reading("stacked", "position", "tool")
    assert np.isinf(paper_fitness(VIEW, every, Weights(), stacked)(plans)[0])


def test_camera_terms_alone_prefer_a_target_near_the_axis_and_facing_the_camera(basis):
    poses = AREA.sample(np.random.default_rng(0), 400)
    angle = paper_fitness(VIEW, basis, Weights(0.0, 1.0, 0.0))(poses[:, None])
    area = paper_fitness(VIEW, basis, Weights(0.0, 0.0, -1.0))(poses[:, None])
    points, facing = VIEW.observe(poses)
    off_axis = np.hypot(points[..., 0], points[..., 1]).mean(axis=1) / points[..., 2].mean(axis=1)
    assert np.corrcoef(angle, off_axis)[0, 1] > 0.99
    assert np.corrcoef(-area, np.abs(facing).mean(axis=1))[0, 1] > 0.8


def test_sound_fitness_is_that_of_the_stacked_jacobian(info):
    plans = AREA.sample(np.random.default_rng(1), 120).reshape(3, 40, 5)
    sample = AREA.even(2000)
    mean = np.mean([row.T @ row for row in info.rows(sample)], axis=0)
    by_error = criterion("I", accuracy=region_accuracy(info, TaskRegion(sample)))
    for plan, d, condition, predicted in zip(
        plans,
        sound_fitness(info, criterion("D"))(plans),
        sound_fitness(info, criterion("cond"), whitened=True)(plans),
        sound_fitness(info, by_error)(plans),
        strict=True,
    ):
        stacked = np.vstack(list(info.rows(plan)))
        values = np.linalg.svd(stacked, compute_uv=False)
        assert d == pytest.approx(-2 * np.sum(np.log(values)) / info.rank)
        relative = np.linalg.eigvals(np.linalg.solve(mean, stacked.T @ stacked)).real
        assert condition == pytest.approx(0.5 * np.log(relative.max() / relative.min()), rel=1e-6)
        covariance = np.linalg.inv(stacked.T @ stacked)
        square = np.mean([np.trace(row @ covariance @ row.T) for row in info.rows(sample)]) * SIGMA**2
        assert predicted == pytest.approx(np.log(square), rel=1e-6)


def test_sound_fitness_counts_what_is_known_besides_the_plan(info):
    poses = AREA.sample(np.random.default_rng(1), 50)
    fixed = info.total(poses[:10])
    merit = criterion("D")
    rest = sound_fitness(info, merit, fixed=fixed)(poses[None, 10:])
    np.testing.assert_allclose(rest, sound_fitness(info, merit)(poses[None]))


def test_sound_fitness_takes_camera_terms_into_account(info):
    plans = AREA.sample(np.random.default_rng(1), 80).reshape(2, 40, 5)
    weights = Weights(1.0, 3.0, -1e-4)
    merit = criterion("D")
    bare = sound_fitness(info, merit)(plans)
    terms = paper_fitness(VIEW, np.eye(15), Weights(0.0, 3.0, -1e-4))(plans)
    np.testing.assert_allclose(sound_fitness(info, merit, view=VIEW, weights=weights)(plans), bare + terms)
    with pytest.raises(InputError, match="camera"):
        sound_fitness(info, merit, weights=weights)


def test_one_pose_forty_times_is_no_plan(info):
    plan = np.repeat(AREA.sample(np.random.default_rng(1), 1), 40, axis=0)[None]
    usual = AREA.sample(np.random.default_rng(2), 40)[None]
    for name in ("D", "cond", "E"):
        score = sound_fitness(info, criterion(name))
        assert score(plan)[0] > score(usual)[0] + 5


@pytest.mark.parametrize("k", [2, 3, 5])
def test_condition_numbers_are_those_of_the_singular_values(k):
    rng = np.random.default_rng(k)
    a = rng.normal(size=(50, k, 8)) * np.logspace(0, 3, k)[:, None]
    np.testing.assert_allclose(condition_numbers(a @ a.swapaxes(1, 2)), np.linalg.cond(a), rtol=1e-6)
    a[:, -1] = a[:, 0]
    assert np.all(condition_numbers(a @ a.swapaxes(1, 2)) > 1e6)
    assert np.isinf(condition_numbers(np.zeros((k, k))))


def test_behind_the_camera_there_is_no_image(basis):
    reversed_view = VIEW.T_world_camera.copy()
    reversed_view[:3, :3] = reversed_view[:3, :3] @ np.diag([-1.0, 1.0, -1.0])
    from symcal.planning.camera_view import camera_view

    away = camera_view(MODEL, VIEW.setup, VIEW.camera, reversed_view, VIEW.target, VIEW.T_tool_target)
    plans = AREA.sample(np.random.default_rng(0), 20)[None]
    assert paper_fitness(away, basis, Weights(0.0, 0.0, -1.0))(plans)[0] == 0.0
    assert paper_fitness(away, basis, Weights(0.0, 1.0, 0.0))(plans)[0] > 3 * np.pi / 2
