"""scene.yaml: roughly where a fixed camera stands."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symcal.config.plan import PlacementConfig
from symcal.documents.document import Strict, read_document, validate
from symcal.robot.schema import RobotUnits
from symcal.units import ANGLE, LENGTH

Array = NDArray[np.float64]


class SceneFile(Strict):
    """`camera`: a `position` that looks at a point, or a `frame` (z along the view, y down), in world."""

    schema_: Literal["symcal/scene/1"] = Field(default="symcal/scene/1", alias="schema")
    units: RobotUnits
    camera: PlacementConfig


def read_scene(path: Path | str) -> Array:
    """T_world_camera of a scene.yaml, shape (4, 4), mm.

    Raises:
        InputError: with file, line and key.
    """
    document = read_document(path)
    file = validate(document, SceneFile)
    return file.camera.matrix(LENGTH[file.units.length], ANGLE[file.units.angle])
