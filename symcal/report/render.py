"""A report through a Typst template: text and pictures in, PDF out; it asks only for fonts that Typst brings along."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from symcal.errors import InputError
from symcal.report.camera import camera_text
from symcal.report.identification import identification_text
from symcal.report.paper import paper_text
from symcal.report.plan import plan_text

TEXTS = {"camera": camera_text, "identification": identification_text, "paper": paper_text, "plan": plan_text}
"""The texts of each kind of report; its template has the same name."""


@dataclass(frozen=True, slots=True)
class Picture:
    """An illustration in a file: PDF, name without suffix, width on paper in mm, and its words."""

    file: Path
    name: str
    width_mm: float
    title: str
    caption: str


def write_report(
    content: Mapping[str, Any], pictures: Sequence[Picture], path: Path | str, kind: str = "identification"
) -> None:
    """Write the report of a results dictionary (results.json) as PDF.

    Names and texts reach the template as data and are never read as markup.

    Raises:
        InputError: the file cannot be written.
    """
    import typst

    with TemporaryDirectory(prefix="symcal-report-") as name:
        folder = Path(name)
        for template in files("symcal.report").joinpath("templates").iterdir():
            if template.name.endswith(".typ"):
                (folder / template.name).write_text(template.read_text(encoding="utf-8"), encoding="utf-8")
        placed = []
        for i, picture in enumerate(pictures):
            shutil.copyfile(picture.file, folder / f"figure{i}.pdf")
            placed.append(
                {
                    "file": f"figure{i}.pdf",
                    "name": picture.name,
                    "width": picture.width_mm,
                    "title": picture.title,
                    "caption": picture.caption,
                }
            )
        data = {"text": TEXTS[kind](content), "pictures": placed}
        (folder / "data.json").write_text(json.dumps(data, allow_nan=False), encoding="utf-8")
        pdf = typst.compile(folder / f"{kind}.typ", root=folder)
    try:
        Path(path).write_bytes(pdf)
    except OSError as error:
        raise InputError(f"the report cannot be written: {error.strerror}", file=path) from None
