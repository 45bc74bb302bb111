"""Six-axis arms that are not among the shipped configs, measured by a simulated laser tracker.

The robots are the UR10e (Universal Robots' published DH table; three parallel axes) and the Puma 560 ([Craig2005]
sec. 3.7), each in both link conventions. Beta stands where neighbouring axes are parallel.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from symcal.calibration.simulate import simulate
from symcal.instruments.noise import Noise
from symcal.model.model import build_model
from symcal.model.task import Task
from symcal.robot.files import save_robot
from symcal.robot.robot import Convention, Joint, Link, Robot

NOISE = 0.05  # mm, per axis
POINTS = {"SMR1": (60.0, 10.0, 130.0), "SMR2": (-45.0, 50.0, 90.0)}

_UR = {"d": (180.7, 0, 0, 174.15, 119.85, 116.55), "a": (0, -612.7, -571.55, 0, 0, 0), "alpha": (90, 0, 0, 90, -90, 0)}
_PUMA = {"d": (660.4, 0, 149.1, 433.1, 0, 56.3), "a": (0, 431.8, 20.3, 0, 0, 0), "alpha": (-90, 0, 90, -90, 90, 0)}
_PARALLEL = {"ur": (2, 3), "puma": (2,)}  # links between parallel axes, standard convention

ARMS = ("ur", "puma")


def arm(kind: str, convention: Convention) -> Robot:
    """The nominal arm, with joints A1..A6; base at the origin, tool at the flange."""
    table = _UR if kind == "ur" else _PUMA
    moved = int(convention == "craig")  # a craig link carries a and alpha of the standard link before it
    links = []
    for i in range(6):
        before = i - moved
        numbers = {
            "theta": 0.0,
            "d": float(table["d"][i]),
            "a": float(table["a"][before]) if before >= 0 else 0.0,
            "alpha": float(np.deg2rad(table["alpha"][before])) if before >= 0 else 0.0,
        }
        if before + 1 in _PARALLEL[kind]:
            numbers["beta"] = 0.0
        links.append(Link(Joint("revolute", f"A{i + 1}", -2.6, 2.6), numbers))
    return Robot(f"{kind} {convention}", convention, tuple(links), np.eye(4), np.eye(4))


@dataclass(frozen=True)
class Measured:
    """Readings (N, 6) rad, measured points (N, 6) mm, split, and the errors that were put in (rad, mm)."""

    robot: Robot
    q: np.ndarray
    z: np.ndarray
    split: tuple[str, ...]
    truth: dict[str, float]


def measure(kind: str, convention: Convention, rng: np.random.Generator, train: int = 60, test: int = 60) -> Measured:
    """Joint offsets of up to two degrees, small errors elsewhere, the tracker anywhere in the hall."""
    nominal = arm(kind, convention)
    base = np.eye(4)
    base[:3, :3] = Rotation.random(rng=rng).as_matrix()
    base[:3, 3] = rng.uniform(-3000, 3000, 3)
    placed = Robot(nominal.name, convention, nominal.links, base, np.eye(4))
    truth = {n: float(rng.normal() * (0.3 if n[0] in "ad" and n[1] == "_" else 1e-3)) for n in nominal.parameters}
    truth |= {f"theta_{i}": float(np.deg2rad(v)) for i, v in enumerate((1.2, -2.0, 1.5, 2.0, -1.0, 1.8), start=1)}
    model = build_model(placed, Task.of("position", points=POINTS))
    q = rng.uniform(nominal.lower, nominal.upper, (train + test, 6))
    data = simulate(model, truth, q, Noise("normal", NOISE), rng)
    return Measured(nominal, q, data.z, ("train",) * train + ("test",) * test, truth)


def write_long(measured: Measured, path: Path) -> None:
    """One row per pose and point; degrees and millimetres; q1..q6."""
    rows = ["pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,point,x_mm,y_mm,z_mm,split"]
    for i, (q, z) in enumerate(zip(np.rad2deg(measured.q), measured.z, strict=True)):
        for k, name in enumerate(POINTS):
            cells = [*(f"{v:.9f}" for v in q), name, *(f"{v:.6f}" for v in z[3 * k : 3 * k + 3])]
            rows.append(",".join([f"N{i}", *cells, measured.split[i]]))
    path.write_text("\n".join(rows) + "\n")


def write_wide(measured: Measured, path: Path) -> None:
    """One row per pose as a German spreadsheet saves it: semicolons, decimal commas, a byte order mark, CRLF, an
    empty last column; joint names."""
    head = [*(f"A{i}_deg" for i in range(1, 7)), *(f"{name}_{c}_mm" for name in POINTS for c in "xyz"), "Zweck", ""]
    rows = [";".join(head)]
    for q, z, split in zip(np.rad2deg(measured.q), measured.z, measured.split, strict=True):
        cells = [*(f"{v:.9f}" for v in q), *(f"{v:.6f}" for v in z)]
        rows.append(";".join([*(c.replace(".", ",") for c in cells), {"train": "Lernen", "test": "Prüfen"}[split], ""]))
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(rows).encode() + b"\r\n")


_EXPERIMENT = """\
name: tracker
seed: 3
units: {{length: mm, angle: deg}}
robot: robot.yaml
measurement: {{type: position, points: {{SMR1: null, SMR2: null}}, estimate: [base, points]}}
data: {{source: file, file: data.csv{data}}}
outputs: {{report: false, figures: false}}
"""


def write_experiment(measured: Measured, folder: Path, layout: str) -> Path:
    """Robot, measurements and experiment of a tracker campaign in a folder; the experiment's path."""
    save_robot(measured.robot, folder / "robot.yaml")
    write = write_long if layout == "long" else write_wide
    write(measured, folder / "data.csv")
    wide = ", decimal: ',', split: {column: Zweck, train: [Lernen], test: [Prüfen]}"
    path = folder / "experiment.yaml"
    path.write_text(_EXPERIMENT.format(data="" if layout == "long" else wide), encoding="utf-8")
    return path
