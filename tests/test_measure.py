"""From rendered images to image points: known and unknown scenes, and images that cannot be measured."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from camera_scenes import ROBOT, T_WORLD_CAMERA, TRUTH, poses, small_camera, target, target_poses

from symcal.camera.camera import project_points
from symcal.camera.target import Target
from symcal.errors import InputError, RefusedError
from symcal.images.measure import measure_images
from symcal.images.shots import Shot, read_shots
from symcal.model.model import build_model
from symcal.model.task import Scene, pixels_task
from symcal.vision.render import Look, render_discs

LENS = small_camera()
LOOK = Look(noise=0.01)


@pytest.fixture(scope="module")
def scene():
    """Images of a robot with errors; camera and mount stand where nobody said."""
    rng = np.random.default_rng(8)
    model = build_model(ROBOT, pixels_task(Scene(LENS, target(), T_WORLD_CAMERA), ("tool", "camera")))
    q = poses(model, 12, rng)
    offset = {"camera_x": 25.0, "camera_rx": 0.01, "camera_ry": -0.01, "tool_x": 3.0, "tool_rz": 0.02}
    true = target_poses(model, q, model.parameters.vector(TRUTH), model.setup.moved(offset, ("P1", "P2", "P3")))
    images = [render_discs(LENS, target(), pose, np.random.default_rng(i), LOOK) for i, pose in enumerate(true)]
    points = np.einsum("nij,kj->nki", true[:, :3, :3], target().points) + true[:, None, :3, 3]
    return q, images, project_points(LENS, points)


def shots_of(q, images):
    return [Shot(f"{i}.png", f"pose {i}", "train", q[i], lambda image=image: image) for i, image in enumerate(images)]


def test_camera_and_mount_are_found_from_the_images(scene):
    q, images, truth = scene
    found = measure_images(shots_of(q, images), ROBOT, LENS, target())
    assert found.failures == ()
    assert found.found
    error = found.data.z.reshape(-1, 3, 2) - truth
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert found.data.sigma is None  # the residuals of an identification tell it
    assert found.data.labels[3] == "pose 3"
    assert np.linalg.norm(found.T_world_camera[:3, 3] - T_WORLD_CAMERA[:3, 3]) < 60


def test_a_scene_that_is_roughly_known_is_believed(scene):
    q, images, truth = scene
    found = measure_images(shots_of(q[:2], images[:2]), ROBOT, LENS, target(), T_world_camera=T_WORLD_CAMERA)
    assert not found.found
    assert np.sqrt(np.mean((found.data.z.reshape(-1, 3, 2) - truth[:2]) ** 2)) < 0.03


def test_without_a_mount_the_names_of_equal_discs_are_consistent_and_it_says_so(scene):
    q, images, truth = scene
    found = measure_images(shots_of(q, images), ROBOT, LENS, target(mount=False))
    assert "alike" in found.notes[0]
    turns = [np.abs(found.data.z.reshape(-1, 3, 2) - np.roll(truth, k, axis=1)).max() for k in range(3)]
    assert min(turns) < 0.2


def test_a_marked_disc_leaves_no_doubt():
    rng = np.random.default_rng(3)
    mark = Target.triangle(200.0, 25.0, marked="P2", mount=target().mount)
    model = build_model(ROBOT, pixels_task(Scene(LENS, mark, T_WORLD_CAMERA), ("tool", "camera")))
    q = poses(model, 6, rng)
    true = target_poses(model, q, np.zeros(len(model.parameters)), model.setup)
    images = [render_discs(LENS, mark, pose, rng, LOOK) for pose in true]
    found = measure_images(shots_of(q, images), ROBOT, LENS, replace(mark, mount=None))
    points = np.einsum("nij,kj->nki", true[:, :3, :3], mark.points) + true[:, None, :3, 3]
    assert found.notes == ()
    assert np.sqrt(np.mean((found.data.z.reshape(-1, 3, 2) - project_points(LENS, points)) ** 2)) < 0.05


def test_every_image_that_fails_is_named_with_its_reason(scene, tmp_path):
    q, images, _ = scene
    height, width = images[0].shape
    bad = {
        "black.png": np.zeros((height, width), np.uint8),
        "small.png": images[0][:500, :500],
        "blurred.png": cv2.GaussianBlur(images[0], (0, 0), 25),
        "empty.png": np.full((height, width), 120, np.uint8),
    }
    files = []
    for name, image in {"good.png": images[0], **bad}.items():
        cv2.imwrite(str(tmp_path / name), image)
        files.append(tmp_path / name)
    (tmp_path / "text.png").write_text("no image")
    (tmp_path / "cut.png").write_bytes((tmp_path / "good.png").read_bytes()[:20000])
    (tmp_path / "stray.png").write_bytes((tmp_path / "good.png").read_bytes())
    files += [tmp_path / name for name in ("text.png", "cut.png", "stray.png")]
    readings = ",".join(repr(float(v)) for v in q[0])
    names = ["good.png", *bad, "text.png", "cut.png", "missing.png"]
    table = tmp_path / "joints.csv"
    head = "image,q1_rad,q2_mm,q3_mm,q4_rad,q5_rad,q4_direction,payload_kg"
    table.write_text("\n".join([head, *(f"{name},{readings},-1,3" for name in names)]) + "\n")
    table = read_shots(table, ROBOT, files)
    assert dict(table.left).keys() == {"missing.png", "stray.png"}
    found = measure_images(table.shots, ROBOT, LENS, target(), T_world_camera=T_WORLD_CAMERA)
    assert found.images == ("good.png",)
    assert {k: v.tolist() for k, v in found.data.conditions.items()} == {"q4_direction": [-1.0], "payload": [3.0]}
    reasons = dict(found.failures)
    assert reasons.keys() == {*bad, "text.png", "cut.png"}
    for name, word in {"black": "black", "small": "size", "text": "not an image", "cut": "cut"}.items():
        assert word in reasons[f"{name}.png"]


def test_nothing_to_measure_is_refused_with_the_reasons(scene):
    q, images, _ = scene
    dark = [np.zeros_like(image) for image in images[:3]]
    with pytest.raises(RefusedError, match="black"):
        measure_images(shots_of(q, dark), ROBOT, LENS, target(), T_world_camera=T_WORLD_CAMERA)
    with pytest.raises(RefusedError, match="say where the camera"):
        measure_images(shots_of(q, dark), ROBOT, LENS, target())


def test_tables_of_joint_readings_are_read_strictly(tmp_path):
    table = tmp_path / "joints.csv"
    table.write_text("file,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\na.png,0,900,0,0,0\n")
    with pytest.raises(InputError, match="'image'"):
        read_shots(table, ROBOT, [])
    table.write_text("image,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\na.png,0,900,0,0,0\na.png,0,900,0,0,0\n")
    with pytest.raises(InputError, match="twice"):
        read_shots(table, ROBOT, [])
