"""Tours: permutations from the start, short, and shortest where all can be tried."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from handling_arm import handling_chain
from hypothesis import given
from hypothesis import strategies as st

from symcal.errors import InputError
from symcal.planning.area import working_area
from symcal.planning.ordering import joint_speeds, joint_time, shortest_tour, tour_of
from symcal.planning.tour_search import _Search

ROBOT = handling_chain().robot
AREA = working_area(ROBOT)
START = np.array([np.pi / 4, 1100, 0, np.pi / 2, 0])
SPEEDS = np.array([1.5, 300.0, 500.0, 2.0, 3.0])


def poses_of(seed, count):
    return AREA.snapped(np.random.default_rng(seed), count)


def test_the_slowest_joint_decides():
    a, b = np.zeros(5), np.array([0.3, -600.0, 500.0, 1.0, 0.0])
    assert joint_time(a, b, SPEEDS) == pytest.approx(2.0)
    assert joint_time(b, a, SPEEDS) == pytest.approx(2.0)


@given(st.integers(0, 2**32 - 1), st.integers(0, 12))
def test_a_tour_visits_every_pose_once_and_counts_its_time(seed, count):
    poses = poses_of(seed, count)
    tour = shortest_tour(poses, START, SPEEDS)
    assert sorted(tour.order.tolist()) == list(range(count))
    walked, here = 0.0, START
    for i in tour.order:
        walked += max(abs(b - a) / s for a, b, s in zip(here, poses[i], SPEEDS, strict=True))
        here = poses[i]
    assert tour.total == pytest.approx(walked)


@pytest.mark.parametrize("seed", range(6))
def test_small_tours_are_the_shortest_of_all_orders(seed):
    poses = poses_of(seed, 7)
    best = min(tour_of(order, poses, START, SPEEDS).total for order in itertools.permutations(range(7)))
    assert shortest_tour(poses, START, SPEEDS).total <= best * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_shorter_than_random_orders_and_than_nearest_neighbour(seed):
    rng = np.random.default_rng(seed)
    poses = poses_of(seed, 40)
    tour = shortest_tour(poses, START, SPEEDS)
    random = [tour_of(rng.permutation(40), poses, START, SPEEDS).total for _ in range(200)]
    assert tour.total < 0.6 * min(random)
    greedy, left, here = [], list(range(40)), START
    while left:
        nearest = min(left, key=lambda i: joint_time(here, poses[i], SPEEDS))
        left.remove(nearest)
        greedy.append(nearest)
        here = poses[nearest]
    assert tour.total <= tour_of(greedy, poses, START, SPEEDS).total


def test_no_reversal_and_no_move_of_one_pose_helps():
    poses = poses_of(11, 15)
    tour = shortest_tour(poses, START, SPEEDS)
    order = tour.order.tolist()
    for i, j in itertools.combinations(range(16), 2):
        turned = order[:i] + order[i:j][::-1] + order[j:]
        assert tour_of(turned, poses, START, SPEEDS).total >= tour.total - 1e-9
    for i, j in itertools.product(range(15), range(15)):
        moved = order[:i] + order[i + 1 :]
        moved.insert(j, order[i])
        assert tour_of(moved, poses, START, SPEEDS).total >= tour.total - 1e-9


def test_hundreds_of_poses_are_visited_once_and_faster_than_by_nearest_neighbour():
    poses = poses_of(5, 300)
    tour = shortest_tour(poses, START, SPEEDS)
    assert sorted(tour.order.tolist()) == list(range(300))
    greedy, left, here = [], list(range(300)), START
    while left:
        nearest = left[int(np.argmin(joint_time(here, poses[left], SPEEDS)))]
        left.remove(nearest)
        greedy.append(nearest)
        here = poses[nearest]
    assert tour.total < 0.9 * tour_of(greedy, poses, START, SPEEDS).total
    again = shortest_tour(poses, START, SPEEDS)
    assert np.array_equal(again.order, tour.order)


def test_equal_poses_follow_each_other_and_cost_nothing_more():
    poses = poses_of(3, 12)
    once = shortest_tour(poses, START, SPEEDS)
    many = shortest_tour(np.concatenate([poses, poses[::-1], poses[:4]]), START, SPEEDS)
    assert sorted(many.order.tolist()) == list(range(28))
    assert many.total == pytest.approx(once.total)


def test_blocked_ways_are_avoided_where_they_can_be():
    poses = poses_of(7, 9)
    free = shortest_tour(poses, START, SPEEDS)
    blocked = np.zeros((10, 10), dtype=bool)
    for a, b in itertools.pairwise([0, *(free.order[:4] + 1)]):
        blocked[a, b] = blocked[b, a] = True
    walked = [0, *(shortest_tour(poses, START, SPEEDS, blocked).order + 1)]
    assert not any(blocked[a, b] for a, b in itertools.pairwise(walked))


@given(st.integers(0, 2**32 - 1), st.integers(5, 25))
def test_every_move_of_the_search_saves_what_it_says(seed, count):
    """Witness: the length of the path, added up anew."""
    rng = np.random.default_rng(seed)
    points = rng.random((count, 2))
    cost = np.abs(points[:, None] - points[None]).max(axis=2)
    search = _Search(cost, [0, *(1 + rng.permutation(count - 1)).tolist()])

    def length():
        path = search.path[:-1]
        return float(cost[path[:-1], path[1:]].sum())

    before = length()
    saved = search.repair(list(range(count)))
    assert length() == pytest.approx(before - saved, abs=1e-9)
    before = length()
    search.kick(rng, 30)
    assert length() <= before + 1e-9
    assert search.path[0] == 0
    assert sorted(search.path) == list(range(count + 1))
    assert [search.path[i] for i in search.at] == list(range(count + 1))


def test_poses_that_coincide_take_no_time():
    tour = shortest_tour(np.repeat(START[None], 5, axis=0), START, SPEEDS)
    assert tour.total == 0


def test_speeds_are_stated_or_asked_for_never_guessed():
    with pytest.raises(InputError, match="gives no speed for waist, lift, reach, elbow, wrist"):
        joint_speeds(ROBOT)
    fast = replace(ROBOT, links=tuple(replace(link, joint=replace(link.joint, speed=2.0)) for link in ROBOT.links))
    np.testing.assert_array_equal(joint_speeds(fast), np.full(5, 2.0))
    np.testing.assert_array_equal(joint_speeds(fast, SPEEDS.tolist()), SPEEDS)
    for wrong in ([1.0, 2.0], [1, 1, 1, 1, 0.0], [1, 1, 1, 1, np.inf]):
        with pytest.raises(InputError, match="5 positive speeds"):
            joint_speeds(ROBOT, wrong)
