"""The page of an identification: its results as text, figures and a picture that one can turn and touch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors
from symcal.data.dataset import Dataset
from symcal.outputs.whole_file import write_whole
from symcal.page.area_map import area_map
from symcal.page.assembled import assembled
from symcal.page.gallery import NONE, Gallery
from symcal.page.headline import headline, ladder, nominal
from symcal.page.intervals import intervals
from symcal.page.marks import judged_marks, marks
from symcal.page.points import points_table
from symcal.page.scene import Area, scene
from symcal.report.identification import identification_text
from symcal.report.render import Picture

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """What a page shows of an identification.

    unseen: joint readings of poses that only ``errors`` know, shape (k, dof); None where the data hold all poses.
    images: of the poses. area: of joint readings, the joint limits when None.
    """

    content: Mapping[str, Any]
    calibration: Calibration
    data: Dataset
    errors: Mapping[str, Mapping[str, Errors]]
    pictures: Sequence[Picture] = ()
    unseen: Array | None = None
    images: Gallery = NONE
    area: Area | None = None


def write_page(found: Identified, path: Path | str) -> None:
    """Write the page as one file that asks for nothing else.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, page(found))


def page(found: Identified) -> str:
    """The page as HTML."""
    return assembled("identification", partial(_given, found), found.pictures, found.images)


def _given(found: Identified) -> dict[str, Any]:
    """What the template shows, but for figures and images."""
    content = found.content
    return touchable(found) | {
        "text": identification_text(content),
        "ladder": ladder(content),
    }


def touchable(found: Identified) -> dict[str, Any]:
    """What every page of an identification has: the headline, the arm with its readings, and what came of it."""
    content, own = found.content, (found.calibration, found.data, found.errors)
    shown = marks(*own) if found.unseen is None else judged_marks(*own, found.unseen, content["measurement"]["error"])
    space = scene(found.calibration, shown, found.area, np.random.default_rng(content["seed"]))
    return {
        "against": content["against"],
        "headline": headline(content),
        "nominal": nominal(content),
        "intervals": intervals(content["identification"]["parameters"]),
        "points": points_table(shown, found.calibration.robot, worst=shown.worst),
        "area": area_map(space["area"]),
        "scene": space,
    }
