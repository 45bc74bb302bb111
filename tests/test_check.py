"""What `symcal check` says about a model: known from the literature and from hand."""

from __future__ import annotations

import numpy as np
import pytest
from measured_arms import ARMS, arm

from symcal.model.model import build_model
from symcal.model.task import Task
from symcal.robot.files import load_robot
from symcal.robot.robot import Link, Robot
from symcal.runs.check import check_model, check_robot, parallel_axes, pose_at_zero


@pytest.mark.parametrize("convention", ["standard", "craig"])
def test_the_ur_stretched_out(convention):
    """All joints at zero: the arm lies along -x at the height of the shoulder, wrists to the side and down."""
    pose = pose_at_zero(arm("ur", convention))
    np.testing.assert_allclose(pose[:3, 3], [-612.7 - 571.55, -174.15 - 116.55, 180.7 - 119.85], atol=1e-9)


@pytest.mark.parametrize("kind", ARMS)
def test_both_conventions_describe_one_arm(kind):
    np.testing.assert_allclose(pose_at_zero(arm(kind, "standard")), pose_at_zero(arm(kind, "craig")), atol=1e-9)


@pytest.mark.parametrize("kind", ARMS)
@pytest.mark.parametrize("convention", ["standard", "craig"])
def test_a_full_pose_sees_four_numbers_per_joint_and_six_more(kind, convention):
    """[Everett1988]: 4R + 2P + 6 identifiable numbers, base and tool included, for six revolute joints."""
    seen = check_robot(arm(kind, convention)).seen["pose, base and tool unknown"]
    assert seen.numerical_rank == 4 * 6 + 6


def test_position_alone_sees_three_fewer():
    """A tool that is a point has no orientation; on the last axis its turn about that axis is not seen either."""
    task = Task.of("position", frozenset({"base", "tool"}), {"P": (60.0, 10.0, 130.0)})
    (seen,) = check_model(build_model(arm("puma", "standard"), task)).seen.values()
    assert seen.numerical_rank == 4 * 6 + 6 - 3
    on_axis = check_robot(arm("puma", "standard")).seen["position, base and tool point unknown"]
    assert on_axis.numerical_rank == 4 * 6 + 6 - 3 - 2


def test_the_papers_robot_at_nominal(configs):
    """Position of the last origin: four of the fifteen directions of Table I are unseen there."""
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    found = check_model(build_model(robot, Task.of("position")))
    (seen,) = found.seen.values()
    assert seen.numerical_rank == 11
    texts = " ".join(direction.text for direction in seen.unseen())
    for name in ("theta_5", "d_3", "d_4", "theta_4", "a_4", "alpha_4"):
        assert name in texts


@pytest.mark.parametrize("convention", ["standard", "craig"])
def test_parallel_axes_without_beta_are_named(convention):
    good = arm("ur", convention)
    assert parallel_axes(good) == ()
    bare = tuple(Link(k.joint, {n: v for n, v in k.parameters.items() if n != "beta"}) for k in good.links)
    notes = parallel_axes(Robot(good.name, convention, bare, good.base, good.tool))
    links = ("link 2", "link 3") if convention == "standard" else ("link 3", "link 4")
    assert len(notes) == 2
    assert all(link in note for link, note in zip(links, notes, strict=True))
    assert "'A2' and 'A3'" in notes[0]
