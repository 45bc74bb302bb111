"""Pairs of poses of a hand and an eye, as easy_handeye2 and MoveIt write them, and a solver that is not ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def poses(rotation: Rotation, position: Array) -> Array:
    t = np.tile(np.eye(4), (len(position), 1, 1))
    t[:, :3, :3], t[:, :3, 3] = rotation.as_matrix(), position
    return t


def pairs(
    rng: np.random.Generator, eye: str, count: int = 30, mm: float = 0.2, mrad: float = 0.5
) -> tuple[Array, Array, Array]:
    """Flange in base and marker in camera, shape (N, 4, 4) each in m, and the camera in the hand, or in the base."""
    seed = int(rng.integers(1 << 31))
    x = poses(Rotation.from_euler("xyz", [[20.0, -10.0, 95.0]], degrees=True), np.array([[0.04, -0.06, 0.11]]))[0]
    other = poses(Rotation.from_euler("xyz", [[170.0, 15.0, 40.0]], degrees=True), np.array([[0.5, 0.1, 0.05]]))[0]
    flange = poses(
        Rotation.random(count, random_state=seed), rng.uniform([0.1, -0.4, 0.1], [0.9, 0.4, 0.9], (count, 3))
    )
    # other: the marker, in the base or in the hand
    seen = np.linalg.inv(flange @ x) @ other if eye == "hand" else np.linalg.inv(x) @ flange @ other
    noise = poses(Rotation.from_rotvec(rng.normal(0, mrad * 1e-3, (count, 3))), rng.normal(0, mm * 1e-3, (count, 3)))
    return flange, seen @ noise, x


def _transform(t: Array) -> dict[str, dict[str, float]]:
    q = Rotation.from_matrix(t[:3, :3]).as_quat()
    return {
        "translation": dict(zip("xyz", map(float, t[:3, 3]), strict=True)),
        "rotation": dict(zip("xyzw", map(float, q), strict=True)),
    }


def write_easy(path: Path, flange: Array, seen: Array, eye: str, kind: str = "") -> Path:
    """As `message_to_yaml` writes a SampleList."""
    robot = flange if eye == "hand" else np.linalg.inv(flange)
    parameters = {"name": "", "calibration_type": kind, "robot_base_frame": "", "freehand_robot_movement": False}
    samples = [{"robot": _transform(a), "tracking": _transform(b)} for a, b in zip(robot, seen, strict=True)]
    path.write_text(yaml.safe_dump({"parameters": parameters, "samples": samples}, sort_keys=False))
    return path


def write_moveit(path: Path, flange: Array, seen: Array) -> Path:
    """As the calibration plugin emits its samples."""
    rows = [
        f"- effector_wrt_world:\n{_listed(a)}  object_wrt_sensor:\n{_listed(b)}"
        for a, b in zip(flange, seen, strict=True)
    ]
    path.write_text("".join(rows))
    return path


def _listed(t: Array) -> str:
    return "".join(f"    - {value:.17g}\n" for value in t.ravel())


def write_csv(path: Path, flange: Array, seen: Array) -> Path:
    head = [f"{of}{c}" for of in ("flange_", "") for c in ("x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw")]
    lines = [",".join(["pose", *head])]
    for i, both in enumerate(zip(flange, seen, strict=True)):
        cells = [[*(t[:3, 3] * 1000), *Rotation.from_matrix(t[:3, :3]).as_quat()] for t in both]
        lines.append(",".join([str(i), *(repr(float(cell)) for row in cells for cell in row)]))
    path.write_text("\n".join(lines))
    return path


def park_martin(flange: Array, seen: Array) -> Array:
    """X of A X = X B of all pairs of poses, by F. C. Park and B. J. Martin, Robot sensor calibration, 1994.

    A = inv(F_i) F_j of flanges, B = S_i inv(S_j) of what the eye in the hand has seen.
    """
    first, second = np.triu_indices(len(flange), 1)
    a = np.linalg.inv(flange[first]) @ flange[second]
    b = seen[first] @ np.linalg.inv(seen[second])
    alpha, beta = (Rotation.from_matrix(t[:, :3, :3]).as_rotvec() for t in (a, b))
    u, s, v = np.linalg.svd(beta.T @ alpha)  # (M^T M)^(-1/2) M^T of M = sum beta alpha^T
    rotation = v.T @ u.T
    assert np.linalg.det(rotation) > 0
    assert s.min() > 0
    left = (a[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    right = (np.einsum("ij,nj->ni", rotation, b[:, :3, 3]) - a[:, :3, 3]).ravel()
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, np.linalg.lstsq(left, right, rcond=None)[0]
    return out
