"""Task regions and the predicted error over them."""

from __future__ import annotations

import numpy as np
import pytest
from planning_cases import handling

from symcal import kinematics
from symcal.errors import InputError, RefusedError
from symcal.model.measurement import Setup
from symcal.model.observe import observe
from symcal.model.parameter_set import parameter_set
from symcal.model.task import Task
from symcal.planning.information import pose_information
from symcal.planning.region import TaskRegion, area_region, box_region, csv_region, region_accuracy, tool_points
from symcal.planning.worst_pose import FeasibleSet, feasible_set, largest


def test_box_region_has_its_tool_in_the_box(rng):
    info = handling()
    lower, upper = np.array([-400.0, 100.0, 900.0]), np.array([0.0, 500.0, 1200.0])
    region = box_region(info, lower, upper, rng, count=300)
    measure = info.measurement.predict
    for q in region.poses[:50]:
        p = np.array(measure(q, np.zeros(len(info.names)), info.setup.vector)).ravel()
        assert ((p >= lower) & (p <= upper)).all()
    assert info.area.contains(region.poses).all()
    with pytest.raises(RefusedError, match="feasible"):
        box_region(info, upper + 1e5, upper + 2e5, rng, count=10)


def test_csv_region_reads_units_and_refuses_an_empty_file(tmp_path):
    info = handling()
    file = tmp_path / "task.csv"
    file.write_text("q1_deg,q2_m,q3_mm,q4_deg,q5_deg\n90,1.1,50,45,-30\n")
    region = csv_region(file, info.measurement.chain.robot)
    np.testing.assert_allclose(region.poses, [[np.pi / 2, 1100, 50, np.pi / 4, -np.pi / 6]])
    file.write_text("q1_deg,q2_m,q3_mm,q4_deg,q5_deg\n")
    with pytest.raises(InputError, match="no poses"):
        csv_region(file, info.measurement.chain.robot)


def test_unseen_parameters_that_matter_elsewhere_are_told(rng):
    """What a point on the last axis does not show does not move it either; a point beside the axis shows more."""
    info = handling()
    assert region_accuracy(info, area_region(info.area, rng, count=100)).hidden_mm < 1e-5
    robot = info.measurement.chain.robot
    names = tuple(n for n in info.names if n not in ("a_5", "theta_5"))
    aside = observe(kinematics.chain(robot, parameter_set(robot)), *Task.of("position").observations)
    setup = Setup(robot.base, robot.tool, np.array([[100.0, 0.0, 0.0]]))
    seen = pose_information(aside, setup, {"position": 0.06}, names)
    assert region_accuracy(seen, area_region(seen.area, rng, count=100)).hidden_mm < 1e-5
    everything = pose_information(aside, setup, {"position": 0.06})
    assert everything.rank > info.rank


def test_alignment_takes_out_where_the_base_is(rng):
    """With a free base part of the error is a rigid motion; what is left is smaller, and shifts and turns vanish."""
    robot = handling().measurement.chain.robot
    measurement = observe(kinematics.chain(robot, parameter_set(robot, base=True)), *Task.of("position").observations)
    setup = Setup(robot.base, robot.tool, np.zeros((1, 3)))
    info = pose_information(measurement, setup, {"position": 0.06}, area=handling().area)
    region = area_region(info.area, rng, count=400)
    plain, aligned = region_accuracy(info, region), region_accuracy(info, region, aligned=True)
    posterior = info.posterior(info.area.sample(rng, 40))
    assert aligned.mean_rms(posterior) < plain.mean_rms(posterior)
    shift = np.zeros(len(info.names))
    shift[info.names.index("base_x")] = 1.0
    np.testing.assert_allclose(plain.function.full(region.poses) @ shift, [[1.0, 0.0, 0.0]] * 400, atol=1e-9)
    np.testing.assert_allclose(aligned.function.full(region.poses) @ shift, 0.0, atol=1e-9)
    turn = np.zeros(len(info.names))
    turn[info.names.index("base_rz")] = 1.0
    np.testing.assert_allclose(aligned.function.full(region.poses) @ turn, 0.0, atol=1e-7)


def test_tool_points_are_what_the_measurement_predicts(rng):
    info = handling()
    poses = info.area.sample(rng, 20)
    predicted = [np.array(info.measurement.predict(q, np.zeros(15), info.setup.vector)).ravel() for q in poses]
    np.testing.assert_allclose(tool_points(info)(poses)[0], predicted, atol=1e-9)


def test_largest_of_a_finite_set_is_its_maximum(rng):
    info = handling()
    sample = info.area.sample(rng, 500)
    weight = np.linalg.inv(info.total(sample[:40]))
    values, poses = largest(info.function, weight, FeasibleSet(sample, None), rng)
    every = np.einsum("kij,ij->k", info.matrices(sample), weight)
    assert values[0] == pytest.approx(every.max())
    np.testing.assert_array_equal(poses[0], sample[np.argmax(every)])


@pytest.mark.parametrize("constrained", [False, True])
def test_polished_maximum_beats_a_denser_sample_and_stays_feasible(rng, constrained):
    info = handling()
    feasible = (lambda q: q[:, 2] + 300 * np.cos(q[:, 3]) < 500.0) if constrained else None
    where = feasible_set(info.area, rng, 1000, feasible)
    weight = np.linalg.inv(info.total(info.area.sample(rng, 40)))
    values, poses = largest(info.function, weight, where, rng)
    dense = feasible_set(info.area, rng, 40_000, feasible)
    assert values[0] >= info.function.weighted(dense.sample, weight).max() * (1 - (0.01 if constrained else 1e-9))
    assert info.area.contains(poses).all()
    assert feasible is None or feasible(poses).all()


def test_region_without_area_is_only_its_poses(rng):
    info = handling()
    poses = info.area.sample(rng, 30)
    accuracy = region_accuracy(info, TaskRegion(poses))
    known = info.posterior(info.area.sample(rng, 40))
    assert accuracy.mean_rms(known) == pytest.approx(np.sqrt(np.mean(accuracy.at(poses, known) ** 2)))
