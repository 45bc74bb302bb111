"""Models of equal content are built once; whatever is done with what they were made from changes none of them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pytest
from cases import ARM, front_half, handling, measure, random_errors

from symcal import (
    Distance,
    Noise,
    Observation,
    Place,
    Target,
    Task,
    Tracker,
    identify,
    load_robot,
    save_robot,
    simulate,
)
from symcal.instruments.position import Position
from symcal.model import model as module
from symcal.model.content import NoContentError, content
from symcal.model.model import build_model
from symcal.robot.robot import Robot


def copied(robot: Robot) -> Robot:
    """The same robot in other objects."""
    links = tuple(replace(link, parameters=dict(link.parameters)) for link in robot.links)
    return replace(robot, links=links, base=robot.base.copy(), tool=robot.tool.copy())


def task(x: float = 40.0, frame: np.ndarray | None = None) -> Task:
    target = Target("smr", Place("flange"), {"P": (x, 0.0, 60.0)})
    at = Place("world", frame=np.eye(4) if frame is None else frame, unknown=True)
    return Task((Observation(Tracker(), "tracker", target=target), Observation(Distance(), "wire", at, target)), True)


def test_equal_content_is_built_once() -> None:
    first, again = build_model(handling(), task()), build_model(copied(handling()), task())
    assert again.kernels is first.kernels
    assert again.residuals is first.residuals
    assert again.robot is not first.robot


@pytest.mark.parametrize(
    "what", ["parameter", "limit", "base", "sign of zero", "scale", "point", "kind", "fix", "prior"]
)
def test_other_content_is_another_model(what: str) -> None:
    robot, asked = copied(handling()), task()
    first = build_model(robot, asked)
    if what == "parameter":
        links = list(robot.links)
        links[1] = replace(links[1], parameters={**links[1].parameters, "a": 1.0 + links[1].parameters.get("a", 0.0)})
        robot = replace(robot, links=tuple(links))
    elif what == "limit":
        links = list(robot.links)
        links[0] = replace(links[0], joint=replace(links[0].joint, upper=links[0].joint.upper + 1e-12))
        robot = replace(robot, links=tuple(links))
    elif what == "base":
        robot = replace(robot, base=robot.base + np.array([[0, 0, 0, 1e-9], [0] * 4, [0] * 4, [0] * 4]))
    elif what == "sign of zero":
        robot = replace(robot, tool=np.where(robot.tool == 0, -0.0, robot.tool))
    elif what == "scale":
        robot = replace(robot, scales={**robot.scales, "theta_4": 0.123})
    elif what == "point":
        asked = task(41.0)
    elif what == "kind":
        wire = replace(asked.observations[1], instrument=Distance(offset=3.0))
        asked = replace(asked, observations=(asked.observations[0], wire))
    elif what == "fix":
        asked = replace(asked, fix=("theta_4",))
    else:
        asked = replace(asked, priors={"theta_4": 0.01})
    assert build_model(robot, asked).kernels is not first.kernels


def test_what_is_done_with_the_originals_changes_nothing() -> None:
    rng = np.random.default_rng(0)
    robot, frame = copied(handling()), np.eye(4)
    asked = task(frame=frame)
    model = build_model(robot, asked)
    q, x = front_half(7, rng), rng.normal(size=len(model.parameters)) * 1e-3
    setup = model.setup.vector.copy()
    before = [kernel(q, x, setup, np.ones((7, n))) for kernel, n in zip(model.residuals, (3, 1), strict=True)]
    robot.base[:3, 3] = 1e3  # of the very arrays and mappings that the model was made from
    frame[:3, 3] = 1e3
    robot.links[3].parameters["a"] = 777.0  # type: ignore[index]
    fresh = build_model(copied(handling()), task())
    assert fresh.kernels is model.kernels
    assert np.array_equal(fresh.setup.vector, setup)
    assert np.array_equal(fresh.measurement.chain.robot.base, handling().base)
    assert all("a" not in p.parameters or p.parameters["a"] != 777.0 for p in fresh.measurement.chain.robot.links)
    for kernel, n, old in zip(fresh.residuals, (3, 1), before, strict=True):
        for mine, theirs in zip(kernel(q, x, setup, np.ones((7, n))), old, strict=True):
            assert np.array_equal(mine, theirs)
    changed = build_model(robot, asked)  # and these are another robot now
    assert changed.kernels is not model.kernels
    assert changed.parameters.items[changed.parameters.index("a_4")].nominal == 777.0


def test_a_record_and_data_are_no_part_of_a_model(tmp_path) -> None:
    rng = np.random.default_rng(1)
    asked = Task.of("position")
    data = measure(build_model(handling(), asked), {"theta_4": 1e-3}, 30, rng, 0.05)
    calibrated = identify(handling(), data, asked).robot
    save_robot(calibrated, tmp_path / "r.yaml")
    read = load_robot(tmp_path / "r.yaml")
    assert read.record is not None
    assert build_model(read, asked).kernels is build_model(replace(read, record=None), asked).kernels
    held = Observation(Tracker(), "t", target=Target("smr", Place("flange"), {"P": (1.0, 2.0, 3.0)}), data=data)
    model = build_model(handling(), Task((held,)))
    assert model.task.observations[0].data is data
    assert model.measurement.observations[0].data is None  # what is kept does not hold them
    assert build_model(handling(), Task((replace(held, data=None),))).kernels is model.kernels


def test_not_more_models_are_kept_than_there_is_room_for() -> None:
    first = build_model(handling(), task(1.0)).kernels
    for i in range(module._MODELS):
        build_model(handling(), task(2.0 + i))
    assert module._kept.cache_info().currsize <= module._MODELS
    assert build_model(handling(), task(1.0)).kernels is not first


def test_an_instrument_that_does_not_say_what_it_holds_is_built_anew() -> None:
    class Odd(Position):
        pass

    @dataclass(frozen=True)
    class Holding(Position):
        how: object = print  # of functions it is not known what they do

    with pytest.raises(NoContentError):
        content(Holding())
    plain, odd, holding = (
        Task((Observation(kind, "t", target=Target("smr", Place("flange"), {"P": (1.0, 2.0, 3.0)})),))
        for kind in (Position(), Odd(), Holding())
    )
    assert build_model(handling(), odd).kernels is not build_model(handling(), plain).kernels
    assert build_model(handling(), holding).kernels is not build_model(handling(), holding).kernels


def test_threads_share_a_model_and_get_the_same_bits() -> None:
    rng = np.random.default_rng(4)
    asked = Task.of("pose", {"base"})
    model = build_model(ARM, asked)
    sets = [measure(model, random_errors(model, rng), 25, rng, 0.05, 1e-4) for _ in range(6)]
    module._kept.cache_clear()
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda data: identify(ARM, data, asked).after.x, sets))
    for data, x in zip(sets, found, strict=True):
        assert np.array_equal(identify(ARM, data, asked).after.x, x)


def test_kept_models_identify_as_new_ones_do() -> None:
    rng = np.random.default_rng(5)
    asked = task()
    truth = {"theta_4": 2e-3, "wire_x": 900.0, "wire_y": 1200.0}
    data = simulate(
        build_model(handling(), asked), truth, front_half(40, rng), Noise(position=0.05, distance=0.03), rng
    )
    kept = identify(handling(), data, asked)
    module._kept.cache_clear()
    assert np.array_equal(identify(handling(), data, asked).after.x, kept.after.x)
