"""CSV files of measurements, written: deg and mm, one row per reading, as `symcal.data.measurement_file` reads them."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.data.conditions import written_conditions
from symcal.data.dataset import Dataset
from symcal.instruments import Instrument
from symcal.outputs.whole_file import write_whole
from symcal.robot.robot import Robot

_AT_ONCE = 10_000  # rows of the table, whose numbers are objects for a while


def joint_columns(robot: Robot) -> list[str]:
    """Names of the columns of joint readings, with their units."""
    return [f"q{i}_{'deg' if joint.revolute else 'mm'}" for i, joint in enumerate(robot.joints, start=1)]


def reading_columns(kind: Instrument) -> list[str]:
    """Names of the columns of a reading, with their units."""
    return [name if unit is None else f"{name}_{unit}" for name, unit in kind.file_columns]


def save_measurements(data: Dataset, robot: Robot, path: Path | str, head_lines: Sequence[str] = ()) -> None:
    """Write the canonical CSV (deg and mm) of one instrument's data that `load_measurements` reads back.

    Args:
        head_lines: what stands before the table, a comment each.
    Raises:
        InputError: the file cannot be written.

    Example:
        >>> from pathlib import Path
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> sc.save_measurements(data, robot, "measurements.csv")
        >>> print(Path("measurements.csv").read_text().split()[0])
        pose,q1_deg,q2_mm,q3_mm,q4_deg,q5_deg,point,x_mm,y_mm,z_mm,split
    """
    head = ["pose", *joint_columns(robot)]
    q = np.where([joint.revolute for joint in robot.joints], np.rad2deg(data.q), data.q)
    conditions = written_conditions(data, robot)
    head += conditions
    kind = data.only.instrument
    size, width = len(kind.columns), sum(quantity.size for quantity in kind.quantities)
    named = kind.reads != "frame"
    head += ["point"] if named else []
    head += reading_columns(kind)
    if data.sigma is not None:
        head += [f"{name}_{quantity.unit}" for quantity in kind.quantities for name in quantity.sigma_columns]
    features = data.only.features or ("",)
    z = data.z.reshape(len(data), len(features), size)
    sigma = None if data.sigma is None else data.sigma.reshape(len(data), len(features), width)
    pose, place = np.nonzero(np.isfinite(z).any(axis=2))
    written = BytesIO()  # which gives its bytes away without copying them
    written.writelines(f"# {' '.join(line.split())}\n".encode() for line in head_lines)
    written.write(_csv([[*head, "split"]]))
    for first in range(0, len(pose), _AT_ONCE):
        own, which = pose[first : first + _AT_ONCE], place[first : first + _AT_ONCE]
        read = [q[own], *(values[own] for values in conditions.values())]
        measured = [z[own, which][:, : len(kind.file_columns)], *(() if sigma is None else (sigma[own, which],))]
        points = [[features[k] for k in which.tolist()]] if named else []
        poses = own.tolist()
        names, splits = ([of[i] for i in poses] for of in (data.labels, data.split))
        written.write(_csv(zip(names, *_cells(read), *points, *_cells(measured), splits, strict=True)))
    write_whole(path, written.getvalue())


def _csv(rows: Iterable[Iterable[object]]) -> bytes:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def _cells(values: Sequence[NDArray[np.float64]]) -> list[list[float | str]]:
    """Columns of numbers, which are written with all their digits; nothing where nothing was measured."""
    found: list[list[float | str]] = []
    for column in np.column_stack(values).T:
        cells: list[float | str] = column.tolist()
        for i in np.flatnonzero(~np.isfinite(column)).tolist():
            cells[i] = ""
        found.append(cells)
    return found
