"""report.html: the numbers of results.json, whatever names are; what of others is in it."""

from __future__ import annotations

import copy
import hashlib
import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identifications import content_of, identified, simulated, wired
from page_reader import NASTY, Page

from symcal import plots
from symcal.calibration.results import accuracy_facts
from symcal.data.dataset import unseen
from symcal.instruments import kind_named
from symcal.kinematics import chain, function
from symcal.model.observation import Observation, Place
from symcal.model.task import Task
from symcal.page import Gallery, Identified, Thumbnail
from symcal.page import assembled as page_module
from symcal.page.arm import postures
from symcal.page.assembled import CAP
from symcal.page.gallery import fitting
from symcal.page.headline import headline, ladder
from symcal.page.identification import page
from symcal.page.intervals import intervals
from symcal.page.marks import judged_marks, marks
from symcal.page.render import as_json
from symcal.page.vendored import PLOTLY
from symcal.plots.save import save_figures
from symcal.words import number


@pytest.fixture(scope="module")
def case(configs: Path) -> Any:
    return simulated(configs, "pose")


@pytest.fixture(scope="module")
def content(case: Any) -> dict[str, Any]:
    return content_of(*case)


@pytest.fixture(scope="module")
def shown(case: Any, content: dict[str, Any]) -> Page:
    return Page(page(Identified(content, *case)))


def test_numbers_are_those_of_the_results(shown: Page, content: dict[str, Any], case: Any) -> None:
    test = content["accuracy"]["test"]["after"]["position_mm"]
    assert f"{number(test['rms'])} mm rms position error at held-out poses" in shown.text
    assert f"{number(content['accuracy']['train']['after']['position_mm']['rms'])} mm rms" not in shown.text
    cells = {cell for rows in shown.cells.values() for row in rows for cell in row}
    for part in ("train", "test", "truth"):
        for state in ("before", "offsets_only", "after"):
            rms = content["accuracy"][part][state]["position_mm"]["rms"]
            assert any(f"{rms:.{digits}f}" in cells for digits in range(2, 6))
    for name in content["identification"]["parameters"]:
        assert name in shown.text
    data = case[1]
    head, *rows = shown.cells["points"]
    assert len(rows) == len(data)
    errors = case[2]["test"]["after"]
    held = {row[0]: row[head.index("held out / mm")] for row in rows}
    test_poses = data.part("test")
    for label, size in zip(test_poses.labels, errors.size, strict=True):
        assert float(held[label]) == pytest.approx(size, abs=1e-4)
    scene = shown.scene
    assert scene["marks"]["held"][scene["worst"]] == pytest.approx(test["max"], rel=1e-4)
    assert test["worst"]["size"] == test["max"]
    assert scene["poses"]["label"][scene["marks"]["pose"][scene["worst"]]] == test["worst"]["pose"]
    assert f"at pose {test['worst']['pose']}" in shown.text


def test_it_asks_for_nothing(shown: Page) -> None:
    assert all(address.startswith(("data:", "#")) for address in shown.addresses)
    assert not shown.handlers
    assert shown._open == []


@pytest.mark.parametrize("many", [False, True])
def test_names_are_text(case: Any, content: dict[str, Any], many: bool) -> None:
    calibration, data, errors = case
    found = copy.deepcopy(content)
    found |= {"title": NASTY, "warnings": [NASTY], "inputs": {NASTY: "0" * 64}}
    found["robot"]["name"] = NASTY
    found["identifiability"]["unseen"] = [{"direction": {"a_1": 1.0}, "text": NASTY}]
    found["identification"]["parameters"]["tool_" + NASTY] = found["identification"]["parameters"]["theta_1"]
    labels = tuple(f"{NASTY}{i}" for i in range(len(data)))
    found["accuracy"]["test"]["after"]["position_mm"]["worst"]["pose"] = NASTY
    images = Gallery((Thumbnail(labels[0], NASTY, b"jpeg"),), 1) if many else Gallery()
    whole = page(Identified(found, calibration, replace(data, labels=labels), errors, images=images))
    read = Page(whole)
    assert len(read.scripts) == 5
    assert not read.handlers
    assert read.scene["poses"]["label"] == list(labels)
    assert read.poses == [*labels[:1]] * many
    assert read.cells["points"][1][0] == labels[0]
    assert " ".join(NASTY.split()) in read.text
    assert "\u2028" not in as_json({"a": NASTY})
    assert json.loads(as_json({NASTY: "</script>"})) == {NASTY: "</script>"}


def test_it_stays_small(case: Any, content: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures that do not fit are left out and named."""
    calibration, _, errors = case
    drawn = (plots.error_distribution(errors["test"], "test"), plots.singular_values(calibration.after.identifiability))
    pictures = save_figures(drawn, tmp_path)
    whole = page(Identified(content, *case, pictures))
    assert len(whole.encode()) < CAP
    assert all(picture.caption[:40] in Page(whole).text for picture in pictures)
    bare = len(page(Identified(content, *case)).encode())
    monkeypatch.setattr(page_module, "CAP", (bare + len(whole.encode())) // 2)
    small = page(Identified(content, *case, pictures))
    assert len(small.encode()) <= page_module.CAP
    left_out = Page(small).text.partition("Left out of this page")[2].partition(".")[0]
    assert left_out.endswith(pictures[-1].title)


def test_images_have_the_room_that_is_left(case: Any, content: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """All of them, or as many as fit evenly, and then it is said."""
    rng = np.random.default_rng(1)
    sizes = rng.integers(2_000, 20_000, len(case[1])).tolist()
    images = tuple(Thumbnail(label, "", rng.bytes(n)) for label, n in zip(case[1].labels, sizes, strict=True))
    found = Identified(content, *case, images=Gallery(images, len(images)))
    whole = page(found)
    assert Page(whole).poses == [each.label for each in images]
    assert f"{len(images)} images, one for each pose" in Page(whole).text
    bare = len(page(Identified(content, *case)).encode())
    monkeypatch.setattr(page_module, "CAP_WITH_IMAGES", (bare + len(whole.encode())) // 2)
    some = page(found)
    kept = Page(some).poses
    assert len(some.encode()) <= page_module.CAP_WITH_IMAGES < len(whole.encode())
    assert 0.3 * len(images) < len(kept) < 0.7 * len(images)
    assert f"{len(kept)} of {len(images)} images" in Page(some).text
    assert fitting(found.images, 0).thumbnails == ()


def test_the_worst_of_many_points_is_the_pose_of_the_largest(case: Any) -> None:
    """A row that stands for many points has their rms; what the results call the worst is one point's."""
    calibration, data, errors = case
    after = errors["test"]["after"]
    size = np.full((len(data.part("test")), 20), 1.0)
    size[2], size[4, 7] = 1.5, 3.0  # the largest rms, and the largest error
    pose, point = np.indices(size.shape)
    many = replace(
        after, vectors=size.reshape(-1, 1) * [1.0, 0, 0], pose=pose.ravel(), point=point.ravel(), rotations=None
    )
    q = data.part("test").q
    found = judged_marks(
        calibration, data.part("train"), {"train": errors["train"], "test": {"before": many, "after": many}}, q, "all"
    )
    facts = accuracy_facts({"after": many}, unseen(len(q)))["after"]["position_mm"]["worst"]
    assert found.worst is not None
    assert found.poses.labels[found.rows[found.worst].pose] == facts["pose"] == "unseen 5"
    assert facts["size"] == 3.0
    assert max(found.rows, key=lambda row: row.held_out or 0).pose != found.rows[found.worst].pose


def test_training_residuals_are_no_headline(content: dict[str, Any]) -> None:
    alone = copy.deepcopy(content)
    alone["accuracy"] = {"train": alone["accuracy"]["train"]}
    assert headline(alone)["value"] is None
    assert "nothing here says" in headline(alone)["words"]
    assert ladder(alone) is None
    alone["accuracy"]["cross_validation"] = alone["accuracy"]["train"] | {"folds": 5}
    assert headline(alone)["words"].endswith("cross-validated poses")


def test_cross_validated_errors_come_to_their_rows(case: Any) -> None:
    """In whatever order the folds had them; and they are not asked where poses were kept for a test."""
    calibration, data, errors = case
    after = errors["train"]["after"]
    order = np.random.default_rng(1).permutation(len(after.pose))
    size = np.arange(1.0, len(order) + 1)
    mixed = replace(
        after,
        vectors=np.column_stack([size, 0 * size, 0 * size])[order],
        pose=after.pose[order],
        point=after.point[order],
        rotations=None,
    )
    train = data.part("train")
    found = marks(calibration, train, {"cross_validation": {"after": mixed}})
    assert [row.held_out for row in found.rows] == size.tolist()
    assert found.worst == len(size) - 1
    both = marks(calibration, data, errors | {"cross_validation": {"after": mixed}})
    assert {row.held_out is None for row in both.rows if row.part == "train"} == {True}


def test_very_many_readings_are_thinned(case: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("symcal.page.marks.MOST", 26)
    monkeypatch.setattr("symcal.page.marks._LARGEST", 2)
    calibration, data, errors = case
    found, whole = marks(calibration, data, errors), marks(calibration, data, {})
    assert found.of == len(data)
    assert len(found.rows) <= 26
    assert sum(row.part == "test" for row in found.rows) == 12
    assert found.rows[found.worst or 0].sizes == whole.rows[whole.worst or 0].sizes
    assert len(found.poses) == len(found.rows)


@pytest.mark.parametrize("robot", ["handling_robot", "franka_fr3"])
def test_the_arm_is_that_of_the_kinematics(robot: str, configs: Path) -> None:
    """Ends of its body, axes and what turns with them, against the transforms of `kinematics` at two readings."""
    from symcal.model.model import build_model
    from symcal.robot.files import load_robot

    model = build_model(load_robot(configs / "robots" / f"{robot}.yaml"), Task.of("pose", {"base"}))
    rng = np.random.default_rng(3)
    n = model.robot.dof
    lower, upper = model.robot.ranges
    q, x = rng.uniform(lower, upper, (4, n)), 0.01 * rng.normal(size=len(model.parameters))
    from symcal.data.dataset import Dataset, readings

    data = Dataset(readings("pose"), q, np.full((4, 7), np.nan), ("",) * 4, ("train",) * 4)
    arm = postures(model, model.setup, x, data)
    own = chain(model.robot, model.parameters)
    tool = function("t", {"q": own.q, "x": own.x, "f": own.frames}, {"T": own.tool})
    base = model.moved(model.setup, x).base
    for i in range(4):
        T = np.linalg.solve(base, np.array(tool(q[i], x, model.setup.vector[:24])))
        assert arm.nodes[i, -1] == pytest.approx(T[:3, 3], abs=1e-9)
        assert arm.measured["pose"][i, 0] == pytest.approx(T[:3, 3], abs=1e-9)
        for j, joint in enumerate(model.robot.joints):
            step = q[i].copy()
            step[j] += 0.3 if joint.revolute else 30.0
            moved = np.linalg.solve(base, np.array(tool(step, x, model.setup.vector[:24])))
            axis, at = arm.axes[i, j], arm.nodes[i, arm.joints[j]]
            assert abs(arm.pointers[i, j] @ axis) < 1e-12
            if joint.revolute:  # nodes nearer than 0.5 mm are one
                turn = 0.3 * joint.sign * joint.ratio
                cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
                R = np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross
                assert moved[:3, 3] == pytest.approx(
                    at + R @ (T[:3, 3] - at), abs=1.0
                )  # nodes nearer than 0.5 mm are one
            else:
                assert moved[:3, 3] == pytest.approx(T[:3, 3] + 30.0 * joint.sign * joint.ratio * axis, abs=1e-9)


def test_instruments_that_read_no_points(configs: Path) -> None:
    """A wire alone has sizes and no vectors; with a tracker there are both, each in its own rows."""
    alone = wired(configs)
    read = Page(page(Identified(content_of(*alone), *alone)))
    assert set(map(str, read.scene["marks"]["vector"])) == {"None"}
    assert read.scene["area"] is None
    both = wired(configs, tracked=True)
    read = Page(page(Identified(content_of(*both), *both)))
    assert set(read.scene["marks"]["instrument"]) == {"wire", "tracker"}
    worst = read.scene["worst"]
    assert read.scene["marks"]["instrument"][worst] == "tracker"
    test = both[2]["test"]["after"].statistics
    assert read.scene["marks"]["held"][worst] == pytest.approx(test.max, rel=1e-4)


def test_a_camera_in_the_hand_is_where_the_hand_is(configs: Path) -> None:
    eye = Observation(
        kind_named("pose")(),
        "eye",
        at=Place("tool"),
        target=replace(Observation(kind_named("pose")()).target, name="world", at=Place("world")),
    )
    calibration, data, errors = identified(configs, Task((eye,), base=True, tool=True), 30, 6)
    arm = postures(calibration.model, calibration.setup, calibration.after.x, data)
    assert arm.measured["eye"][:, 0] == pytest.approx(arm.nodes[:, -1], abs=0.5)
    assert marks(calibration, data, errors).rows[0].directed


def test_bars_of_intervals(content: dict[str, Any]) -> None:
    found = intervals(content["identification"]["parameters"])
    for name, p in content["identification"]["parameters"].items():
        bar = found[name]
        assert 0 <= bar["low"] <= bar["at"] <= bar["high"] <= 100
        if not bar["cut"] and abs(p["error"]) > p["half_width_95"]:
            assert (bar["low"] > 50) == (p["error"] > 0)
            assert not bar["low"] <= 50 <= bar["high"]


def test_what_is_of_others_is_as_they_published_it() -> None:
    folder = files("symcal.page").joinpath("vendor", "plotly")
    bundle = folder.joinpath("plotly-gl3d.min.js").read_bytes()
    assert hashlib.sha256(bundle).hexdigest() == PLOTLY["sha256"]
    assert f"v{PLOTLY['version']}" in bundle[:200].decode()
    assert b"</script" not in bundle.lower()
    assert "MIT" in folder.joinpath("LICENSE").read_text()
    assert "Permission is hereby granted, free of charge" in folder.joinpath("LICENSE").read_text()
