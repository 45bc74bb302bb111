"""A report through a Typst template: text and pictures in, PDF out; it asks only for fonts that Typst brings along."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from symcal.errors import InputError
from symcal.outputs.whole_file import write_whole
from symcal.report.camera import camera_text
from symcal.report.identification import identification_text
from symcal.report.plan import plan_text

TEXTS = {"camera": camera_text, "identification": identification_text, "plan": plan_text}
"""The texts of each kind of report; its template has the same name."""

_TEMPLATES = files("symcal.report").joinpath("templates")


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

    Raises:
        InputError: the file cannot be written.

    Example:
        >>> from pathlib import Path
        >>> import symcal as sc
        >>> bare = ["outputs.report=false", "outputs.figures=false"]
        >>> folder, results = sc.run(Path("configs/simulated_arm.yaml"), Path("arm"), overrides=bare)
        >>> sc.write_report(results, [], "again.pdf")
        >>> Path("again.pdf").is_file()
        True
    """
    write_whole(path, report_pdf(content, pictures, kind))


def report_pdf(content: Mapping[str, Any], pictures: Sequence[Picture], kind: str) -> bytes:
    """The report of a results dictionary (results.json) as PDF.

    Raises:
        InputError: as `rendered`.
    """
    return rendered(TEXTS[kind](content), pictures, _TEMPLATES.joinpath(f"{kind}.typ"))


def rendered(text: Mapping[str, Any], pictures: Sequence[Picture], template: Traversable) -> bytes:
    """A report as PDF from its text and its own template, beside which the common ones stand.

    Names and texts reach the template as data and are never read as markup.

    Raises:
        InputError: the folder of temporary files cannot be used.
    """
    try:
        with TemporaryDirectory(prefix="symcal-report-") as name:
            return _compiled(text, pictures, template, Path(name))
    except OSError as error:
        raise InputError(
            f"the report cannot be made, because temporary files cannot be written: {error.strerror or error}",
            file=error.filename,
        ) from None


def _compiled(text: Mapping[str, Any], pictures: Sequence[Picture], template: Traversable, folder: Path) -> bytes:
    import typst

    for part in (*_TEMPLATES.iterdir(), template):
        if part.name.endswith(".typ"):
            (folder / part.name).write_text(part.read_text(encoding="utf-8"), encoding="utf-8")
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
    data = {"text": text, "pictures": placed}
    (folder / "data.json").write_text(json.dumps(data, allow_nan=False), encoding="utf-8")
    return bytes(typst.compile(folder / template.name, root=folder))
