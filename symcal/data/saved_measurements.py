"""CSV files of measurements, written: deg and mm, one row per reading, as `symcal.data.measurement_file` reads them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from io import StringIO
from math import isfinite
from pathlib import Path

import numpy as np

from symcal.data.conditions import written_conditions
from symcal.data.dataset import Dataset
from symcal.outputs.whole_file import write_whole
from symcal.robot.robot import Robot


def save_measurements(data: Dataset, robot: Robot, path: Path | str, head_lines: Sequence[str] = ()) -> None:
    """Write the canonical CSV (deg and mm) of one instrument's data that `load_measurements` reads back.

    Args:
        head_lines: what stands before the table, a comment each.
    Raises:
        InputError: the file cannot be written.
    """
    units = ["deg" if joint.revolute else "mm" for joint in robot.joints]
    head = ["pose", *(f"q{i}_{unit}" for i, unit in enumerate(units, start=1))]
    q = np.where([joint.revolute for joint in robot.joints], np.rad2deg(data.q), data.q)
    conditions = written_conditions(data, robot)
    head += conditions
    rows: list[list[object]] = []
    kind = data.only.instrument
    size, width = len(kind.columns), sum(quantity.size for quantity in kind.quantities)
    named = kind.reads != "frame"
    head += ["point"] if named else []
    head += [name if unit is None else f"{name}_{unit}" for name, unit in kind.file_columns]
    features = data.only.features or ("",)
    read = np.asarray(np.isfinite(data.z).reshape(len(data), len(features), size).any(axis=2))
    joints, z, given = q.tolist(), data.z.tolist(), [[float(v) for v in values] for values in conditions.values()]
    sigma = None if data.sigma is None else data.sigma.tolist()
    for i in range(len(data)):
        for k, name in enumerate(features):
            if read[i, k]:
                cells = z[i][size * k :][: len(kind.file_columns)]
                cells += [] if sigma is None else sigma[i][width * k : width * (k + 1)]
                own = [values[i] for values in given]
                rows.append([data.labels[i], *joints[i], *own, *([name] if named else []), *cells, data.split[i]])
    if data.sigma is not None:
        head += [f"{name}_{quantity.unit}" for quantity in kind.quantities for name in quantity.sigma_columns]
    text = StringIO()
    text.writelines(f"# {' '.join(line.split())}\n" for line in head_lines)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*head, "split"])
    writer.writerows([[_cell(c) for c in row] for row in rows])
    write_whole(path, text.getvalue())


def _cell(value: object) -> object:
    """A number with all its digits; nothing where nothing was measured."""
    if not isinstance(value, float):
        return value
    return repr(value) if isfinite(value) else ""
