"""The tables of an identification's folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors
from symcal.calibration.outliers import Outlier
from symcal.calibration.thinned import listed
from symcal.data.dataset import Dataset
from symcal.export.corrections import COLUMNS, correction_rows
from symcal.outputs.csv_text import Rows

HEADS = {"outliers": tuple(column.name for column in fields(Outlier)), "corrections": COLUMNS}
"""Columns of tables that may have no rows."""

_MANY = 12  # points of a target, beyond which people want to see poses


def tables(
    content: Mapping[str, Any], calibration: Calibration, data: Dataset, errors: Mapping[str, Mapping[str, Errors]]
) -> dict[str, Rows]:
    """Parameters, accuracy, errors per observation (per pose of targets with many points; some of very many poses, see
    `listed`), correlation, outliers, the corrections as a controller asks for them, what residuals were tested for, and
    halves of the training poses.

    Args:
        content: of results.json. errors: by data (`train`, `test`) and state.
    """
    parameters = [{"parameter": name, **entry} for name, entry in content["identification"]["parameters"].items()]
    accuracy = [
        {"data": data, "state": state, "quantity": quantity, **{k: v for k, v in values.items() if k != "worst"}}
        for data, states in content["accuracy"].items()
        for state, quantities in states.items()
        if isinstance(quantities, dict)
        for quantity, values in quantities.items()
    ]
    known, halves = calibration.after.posterior, content.get("halves") or {}
    matrix = [
        {"parameter": name, **dict(zip(known.names, row, strict=True))}
        for name, row in zip(known.names, known.correlation().tolist(), strict=True)
    ]
    return {
        "parameters": parameters,
        "accuracy": accuracy,
        "errors": _error_table(data, errors),
        "correlation": matrix,
        "outliers": content["outliers"],
        "corrections": correction_rows(calibration.robot),
        **({"model_check": content["model_check"]["tests"]} if "model_check" in content else {}),
        **({"halves": halves["divisions"]} if halves.get("divisions") else {}),
    }


def _error_table(data: Dataset, errors: Mapping[str, Mapping[str, Errors]]) -> list[dict[str, object]]:
    features = data.of[0].features if len(data.of) == 1 else ()
    rows: list[dict[str, object]] = []
    for split in ("train", "test"):
        if split not in errors:
            continue
        labels = data.part(split).labels
        labels = labels or tuple(str(i + 1) for i in range(int(max(e.pose.max() for e in errors[split].values())) + 1))
        for state, found in ((name, listed(every)) for name, every in errors[split].items()):
            many, named = int(np.bincount(found.pose).max()) > _MANY, bool(features) and bool(found.point.max())
            for at, shown in _by_pose(found) if many else _by_reading(found):
                row: dict[str, object] = {"data": split, "state": state, "pose": labels[found.pose[at]]}
                point = features[found.point[at]] if named else ""
                rows.append(row | ({"points": shown.pop("points")} if many else {"point": point}) | shown)
    return rows


def _by_reading(found: Errors) -> Iterator[tuple[int, dict[str, float]]]:
    """Every reading: its place, its components, and their norm."""
    turns = np.full(len(found.size), np.nan) if found.turns is None else np.rad2deg(found.turns)
    names = (*(f"{name}_{found.unit}" for name in found.names), found.key, "orientation_deg")
    for k, values in enumerate(np.column_stack([found.vectors, found.size, turns]).tolist()):
        yield k, dict(zip(names, values, strict=True))


def _by_pose(found: Errors) -> Iterator[tuple[int, dict[str, float]]]:
    """Every pose that shows many points: a place of it, how many, their mean components, rms and largest norm."""
    for pose in np.unique(found.pose):
        own = np.flatnonzero(found.pose == pose)
        mean, norms = found.vectors[own].mean(axis=0), found.size[own]
        row: dict[str, float] = {"points": len(own)}
        row |= {f"mean_{name}_{found.unit}": float(v) for name, v in zip(found.names, mean, strict=True)}
        yield int(own[0]), row | {found.key: float(np.sqrt(np.mean(norms**2))), f"max_{found.unit}": float(norms.max())}
