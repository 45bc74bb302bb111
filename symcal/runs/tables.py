"""The tables of an identification's folder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from symcal.calibration.evaluate import Errors
from symcal.calibration.identify import Calibration
from symcal.data.dataset import Dataset
from symcal.export.corrections import corrections


def tables(
    content: Mapping[str, Any], calibration: Calibration, data: Dataset, errors: Mapping[str, Mapping[str, Errors]]
) -> dict[str, pd.DataFrame]:
    """Parameters, accuracy, errors per observation, correlation, and the corrections as a controller asks for them.

    Args:
        content: of results.json. errors: by data (`train`, `test`) and state.
    """
    parameters = pd.DataFrame(
        [{"parameter": name, **entry} for name, entry in content["identification"]["parameters"].items()]
    )
    accuracy = pd.DataFrame(
        [
            {"data": data, "state": state, "quantity": quantity, **values}
            for data, states in content["accuracy"].items()
            for state, quantities in states.items()
            if isinstance(quantities, dict)
            for quantity, values in quantities.items()
        ]
    )
    known = calibration.after.posterior
    matrix = pd.DataFrame(known.correlation(), columns=list(known.names))
    matrix.insert(0, "parameter", list(known.names))
    return {
        "parameters": parameters,
        "accuracy": accuracy,
        "errors": _error_table(data, errors),
        "correlation": matrix,
        "corrections": corrections(calibration.robot),
    }


def _error_table(data: Dataset, errors: Mapping[str, Mapping[str, Errors]]) -> pd.DataFrame:
    features = data.of[0].features if len(data.of) == 1 else ()
    rows: list[dict[str, object]] = []
    for split in ("train", "test"):
        if split not in errors:
            continue
        labels = data.part(split).labels
        labels = labels or tuple(str(i + 1) for i in range(int(max(e.pose.max() for e in errors[split].values())) + 1))
        for state, found in errors[split].items():
            for k, norm in enumerate(found.size):
                row: dict[str, object] = {
                    "data": split,
                    "state": state,
                    "pose": labels[found.pose[k]],
                    "point": features[found.point[k]] if features and found.point.max() else "",
                }
                names = found.names
                row |= {f"{name}_{found.unit}": value for name, value in zip(names, found.vectors[k], strict=True)}
                row[found.key] = norm
                row["orientation_deg"] = np.nan if found.turns is None else np.rad2deg(found.turns[k])
                rows.append(row)
    return pd.DataFrame(rows)
