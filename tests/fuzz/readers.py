"""Everything of symcal that reads what people write, with good inputs to start from."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np

import symcal as sc

from .finished import beside, finished, read_calibrated, read_manifest, read_results

ROOT = Path(__file__).resolve().parent.parent.parent
CONFIGS = ROOT / "configs"


@dataclass(frozen=True, slots=True)
class Reader:
    """read: takes a path. seeds: good inputs, made in a folder of their own. suffix: of the files."""

    read: Callable[[Path], object]
    seeds: Callable[[Path], list[bytes]]
    suffix: str = ".yaml"


ARM = b"""name: arm
convention: standard
units: {length: mm, angle: deg}
links:
  - {joint: revolute, name: turn, limits: [-170, 170], theta: 0, d: 300, a: 0, alpha: -90}
  - {joint: prismatic, name: reach, limits: [0, 700], d: 0, alpha: 0, beta: 0}
  - {joint: revolute, name: wrist, limits: [-175, 175], theta: 0, a: 50, alpha: 90}
tool: {xyz: [0, 0, 120], rpy: [0, 0, 90]}
scales: {alpha_2: 2}
"""

URDF = b"""<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="a"><inertial><origin xyz="0 0 0.1"/><mass value="2.5"/></inertial></link>
  <link name="b"/>
  <link name="tip"/>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="a"/><origin xyz="0 0 0.3" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2.9" upper="2.9" velocity="1.5" effort="10"/>
  </joint>
  <joint name="reach" type="prismatic">
    <parent link="a"/><child link="b"/><origin xyz="0.1 0 0" rpy="0 1.5708 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.7" velocity="1" effort="10"/>
  </joint>
  <joint name="mount" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0 0.05 0" rpy="0 0 1"/></joint>
</robot>
"""

_JOINTS = "pose,q1_deg,q2_mm,q3_deg"


def _table(head: str, *columns: tuple[float, float], text: str = "", rows: int = 8) -> bytes:
    rng = np.random.default_rng(1)
    lines = [f"{_JOINTS},{head}" if head else _JOINTS]
    for i in range(rows):
        q = [rng.uniform(-90, 90), rng.uniform(0, 700), rng.uniform(-90, 90)]
        cells = [f"{value:.4f}" for value in [*q, *(rng.uniform(a, b) for a, b in columns)]]
        lines.append(",".join([f"p{i}", *cells, *([text] if text else [])]))
    return ("\n".join(lines) + "\n").encode()


_XYZ = ((-500.0, 500.0),) * 3
TABLES = {
    "position": [
        _table("x_mm,y_mm,z_mm", *_XYZ),
        _table("x_m,y_m,z_m,sigma_mm,point", *((-0.5, 0.5),) * 3, (0.1, 0.2), text="P"),
        _table("A_x_mm,A_y_mm,A_z_mm,B_x_mm,B_y_mm,B_z_mm", *_XYZ, *_XYZ),
        _table("x_mm,y_mm,z_mm,split", *_XYZ, text="train"),
        _table("x_mm,y_mm,z_mm,session", *_XYZ, text="monday").replace(b",", b";"),
    ],
    "pose": [
        _table("x_mm,y_mm,z_mm,roll_deg,pitch_deg,yaw_deg", *_XYZ, *((-90.0, 90.0),) * 3),
        _table("x_m,y_m,z_m,qx,qy,qz,qw", *((-0.5, 0.5),) * 3, (0.5, 0.5), (0.5, 0.5), (-0.5, -0.5), (0.5, 0.5)),
    ],
    "distance": [_table("distance_mm", (100.0, 900.0)), _table("distance_m,sigma_mm", (0.1, 0.9), (0.1, 0.2))],
    "pixels": [_table("u_px,v_px,point", (0.0, 640.0), (0.0, 480.0), text="P")],
    "fixed_point": [_table(""), _table("point", text="P")],
}


@cache
def arm() -> sc.Robot:
    return robot_of(ARM)


def robot_of(content: bytes) -> sc.Robot:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.yaml"
        path.write_bytes(content)
        return sc.load_robot(path)


def _measurements(kind: str, path: Path) -> object:
    return sc.load_measurements(path, arm(), kind)


def _configs(folder: Path) -> list[bytes]:
    """The experiments of the project, whose relative paths lead to the project's files."""
    for name in ("robots", "vision"):
        if not (folder / name).exists():
            shutil.copytree(CONFIGS / name, folder / name)
    return [path.read_bytes() for path in sorted(CONFIGS.glob("*.yaml")) if not path.name.startswith("study_")]


def _studies(folder: Path) -> list[bytes]:
    """The studies of the project, whose experiments and plans are copied beside them."""
    for name in ("robots", "vision", "plans"):
        if not (folder / name).exists():
            shutil.copytree(CONFIGS / name, folder / name)
    for path in CONFIGS.glob("*.yaml"):
        shutil.copy(path, folder / path.name)
    return [path.read_bytes() for path in sorted(CONFIGS.glob("study_*.yaml"))]


def _study(path: Path) -> object:
    from symcal.trials.load import read_study

    return read_study(path)


def _robots(_: Path) -> list[bytes]:
    return [ARM, *(path.read_bytes() for path in sorted((CONFIGS / "robots").glob("*.yaml")))]


@cache
def _calibrated() -> bytes:
    """A calibrated robot with everything that such a file holds."""
    import tempfile

    robot, rng = arm(), np.random.default_rng(3)
    task = sc.Task.of("position", ("base",))
    q = rng.uniform(robot.lower, robot.upper, (20, robot.dof))
    truth = {"theta_1": 0.01, "d_1": 0.5, "a_3": -0.4}
    data = sc.simulate(sc.build_model(robot, task), truth, q, sc.Noise(position=0.05), rng)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibrated.yaml"
        sc.save_robot(sc.identify(robot, data, task).robot, path)
        return path.read_bytes()


def _experiment(path: Path) -> object:
    from symcal.runs.load import load

    return load(path)


def _set(path: Path) -> object:
    """The file is one `--set` option, as the system hands it over."""
    from symcal.config.conversion import load_experiment

    text = path.read_bytes().replace(b"\0", b"").decode("utf-8", "surrogateescape")
    return load_experiment(CONFIGS / "simulated_arm.yaml", [text])


def _board(path: Path) -> object:
    text = path.read_bytes().replace(b"\0", b"").decode("utf-8", "surrogateescape")
    board = sc.parse_board(text)
    return board.points, str(board)


def _images(_: Path) -> list[bytes]:
    grey = np.random.default_rng(2).integers(0, 255, (24, 32)).astype(np.uint8)
    colour = np.dstack([grey, grey.T[:24, :24].repeat(2, axis=1)[:, :32], 255 - grey])
    formats = (".png", ".jpg", ".bmp", ".tiff", ".pgm", ".ppm", ".webp")
    pictures = [
        cv2.imencode(suffix, picture)[1].tobytes()
        for suffix in formats
        for picture in (grey, colour)
        if (suffix, picture is colour) not in ((".pgm", True), (".ppm", False))
    ]
    deep = [cv2.imencode(s, grey.astype(np.uint16) * 16)[1].tobytes() for s in (".png", ".tiff", ".pgm")]
    return [*pictures, *deep, cv2.imencode(".tiff", grey.astype(np.float32))[1].tobytes()]


def _image(path: Path) -> object:
    from symcal.vision.images import is_black, read_image

    return is_black(read_image(path))


def _targets(path: Path) -> object:
    from symcal.compensation.targets import read_targets

    return read_targets(path, arm())


def _plan(path: Path) -> object:
    from symcal.planning.plan_file import read_plan
    from symcal.planning.region import csv_region

    return csv_region(path, arm()), read_plan(path, arm())


def _shots(path: Path) -> object:
    from symcal.images.shots import read_shots

    return read_shots(path, arm(), [Path(f"{i}.png") for i in range(8)])


def _corners(path: Path) -> object:
    from symcal.vision.corners import load_corners

    return load_corners(path, (640, 480))


def _corner_list(_: Path) -> list[bytes]:
    rows = [
        f"v{v},{i},{i % 4 * 25},{i // 4 * 25},{100 + 20 * (i % 4) + v},{90 + 21 * (i // 4)}"
        for v in range(3)
        for i in range(16)
    ]
    return ["\n".join(["view,id,X_mm,Y_mm,u,v", *rows]).encode()]


def _camera(path: Path) -> object:
    from symcal.camera.files import read_camera

    return read_camera(path)


def _target(path: Path) -> object:
    from symcal.camera.files import read_target

    return read_target(path)


def _vision(pattern: str) -> Callable[[Path], list[bytes]]:
    covariance = f"covariance: {(np.eye(9) * 0.01).tolist()}\n".encode()
    files = [path.read_bytes() for path in sorted((CONFIGS / "vision").glob(pattern))]
    extra = [file + covariance for file in files if b"intrinsics" in file and b"covariance" not in file]
    return lambda _: [*files, *extra]


def _urdf(path: Path) -> object:
    from symcal.robot.urdf import load_urdf

    return load_urdf(path, "base", "tip")


_SETS = (
    "seed=7",
    "identification.loss=cauchy",
    "data.truth.errors.theta_1=0.01",
    "name=x",
    "title='a b'",
    "identification.fix=[theta_1, d_1]",
    "plan.poses=10",
    "units.length=m",
    "data={source: file, file: x.csv}",
)
_BOARDS = (
    "chessboard:9x6:25mm",
    "asymmetric_circles:4x11:2cm",
    "circles:4x5:0.02m",
    "charuco:5x7:30mm:22mm:DICT_4X4_50",
    "charuco:12x9:30mm:22mm",
    "aprilgrid:6x6:30mm:9mm",
)

READERS: dict[str, Reader] = {
    "robot": Reader(lambda path: sc.load_robot(path).reach, _robots),
    "calibrated": Reader(
        partial(read_calibrated, ARM),
        lambda _: [_calibrated(), (finished(ARM) / "calibrated.yaml").read_bytes()],
    ),
    "results": Reader(partial(read_results, ARM), lambda folder: beside(ARM, folder, "results.json"), ".json"),
    "manifest": Reader(read_manifest, lambda folder: beside(ARM, folder, "manifest.json"), ".json"),
    "experiment": Reader(_experiment, _configs),
    "study": Reader(_study, _studies),
    "set": Reader(_set, lambda _: [text.encode() for text in _SETS], ".txt"),
    "urdf": Reader(_urdf, lambda _: [URDF], ".urdf"),
    "camera": Reader(_camera, _vision("*cam*.yaml")),
    "target": Reader(_target, _vision("target.yaml")),
    "targets": Reader(
        _targets,
        lambda _: [_table("", rows=5), _table("x_mm,y_mm,z_mm", *((-300.0, 300.0),) * 3, rows=5)],
        ".csv",
    ),
    "plan": Reader(_plan, lambda _: [_table(""), *TABLES["position"][:2]], ".csv"),
    "shots": Reader(
        _shots,
        lambda _: ["\n".join(["image,q1_deg,q2_mm,q3_deg", *(f"{i}.png,{i},{i},{i}" for i in range(8))]).encode()],
        ".csv",
    ),
    "corners": Reader(_corners, _corner_list, ".csv"),
    "board": Reader(_board, lambda _: [text.encode() for text in _BOARDS], ".txt"),
    "image": Reader(_image, _images, ".img"),
    **{
        kind: Reader(partial(_measurements, kind), partial(lambda tables, _: tables, tables), ".csv")
        for kind, tables in TABLES.items()
    },
}
