"""The page of an identification: its results as text, figures and a picture that one can turn and touch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors
from symcal.data.dataset import Dataset
from symcal.outputs.side_by_side import side_by_side
from symcal.outputs.whole_file import write_whole
from symcal.page.area_map import area_map
from symcal.page.headline import headline, ladder
from symcal.page.intervals import intervals
from symcal.page.marks import judged_marks, marks
from symcal.page.pictures import Embedded, embedded, thumbnail
from symcal.page.points import points_table
from symcal.page.render import render
from symcal.page.scene import Area, scene
from symcal.report.identification import identification_text
from symcal.report.render import Picture

Array = NDArray[np.float64]

CAP = 3_000_000
"""Bytes of a page without images; figures that go beyond are left out and named."""
CAP_WITH_IMAGES = 10_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """What a page shows of an identification.

    unseen: joint readings of poses that only ``errors`` know, shape (k, dof); None where the data hold all poses.
    images: pixels by the label of the pose that they show. area: of joint readings, the joint limits when None.
    """

    content: Mapping[str, Any]
    calibration: Calibration
    data: Dataset
    errors: Mapping[str, Mapping[str, Errors]]
    pictures: Sequence[Picture] = ()
    unseen: Array | None = None
    images: Mapping[str, NDArray[Any]] | None = None
    area: Area | None = None


def write_page(found: Identified, path: Path | str) -> None:
    """Write the page as one file that asks for nothing else.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, page(found))


def page(found: Identified) -> str:
    """The page as HTML; what stands on it is made on two cores where there are two."""
    work: list[Callable[[], Any]] = [partial(_given, found), *(partial(embedded, each) for each in found.pictures)]
    given, *every = side_by_side(work)
    whole = render("identification", given | {"figures": every, "left_out": ()})
    excess = len(whole.encode()) - (CAP_WITH_IMAGES if given["scene"]["images"] else CAP)
    if excess <= 0:
        return whole
    kept = _without_last(every, excess)
    left_out = [each.title for each in every[len(kept) :]]
    return render("identification", given | {"figures": kept, "left_out": left_out})


def _given(found: Identified) -> dict[str, Any]:
    """What the template shows, but for the figures."""
    content, own = found.content, (found.calibration, found.data, found.errors)
    shown = marks(*own) if found.unseen is None else judged_marks(*own, found.unseen, content["measurement"]["error"])
    space = scene(found.calibration, shown, found.area, np.random.default_rng(content["seed"]))
    images = {label: thumbnail(pixels) for label, pixels in (found.images or {}).items() if label in shown.poses.labels}
    return {
        "text": identification_text(content),
        "against": content["against"],
        "headline": headline(content),
        "ladder": ladder(content),
        "intervals": intervals(content["identification"]["parameters"]),
        "points": points_table(shown, found.calibration.robot, worst=shown.worst),
        "area": area_map(space["area"]),
        "scene": space | {"images": images},
    }


def _without_last(every: Sequence[Embedded], excess: int) -> Sequence[Embedded]:
    """The figures without as many of the last as take up the bytes in excess, and those that name what is left out."""
    freed = np.cumsum([len(each.address) - 500 for each in reversed(every)])
    return every[: max(len(every) - 1 - int(np.searchsorted(freed, excess)), 0)]
