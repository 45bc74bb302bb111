"""What an identification leaves: numbers, tables, robot, measurements, C code, figures, report in a run's folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symcal.config import conversion as config
from symcal.config.conversion import FileData
from symcal.data.saved_measurements import save_measurements
from symcal.documents.document import write_document
from symcal.model.contact import constraints, touched_names
from symcal.outputs.names import file_names
from symcal.robot.files import save_robot
from symcal.robot.robot import Robot
from symcal.runs.experiment import Outcome, Progress, identify_experiment
from symcal.runs.folder import require_replaceable, run_folder, write_json, write_table
from symcal.runs.judged import area_of
from symcal.runs.load import Experiment, named_files
from symcal.runs.tables import HEADS, tables

if TYPE_CHECKING:
    from symcal.page import Gallery
    from symcal.plots.style import Drawing
    from symcal.report import Picture


def write_identification(
    experiment: Experiment, target: Path, *, data: Path | None = None, progress: Progress = lambda _: None
) -> Mapping[str, Any]:
    """Measure (or read), identify, evaluate, and write the run's folder; the content of its results.json."""
    inputs = named_files(experiment, data)
    require_replaceable(target, inputs)
    outcome = identify_experiment(experiment, data=data, progress=progress)
    with run_folder(target, inputs) as folder:
        outcome = write(outcome, folder, progress)
    return outcome.content


def write(outcome: Outcome, folder: Path, progress: Progress) -> Outcome:
    """Everything a run leaves: numbers, tables, robot, measurements, C code, figures, report.

    Returns:
        the outcome, with what became of the C code in its content.
    """
    experiment, calibration = outcome.experiment, outcome.calibration
    if experiment.file.outputs.c:
        from symcal.runs.code import with_code

        progress("exporting C")
        outcome = replace(outcome, content=with_code(outcome.content, calibration.robot, folder, experiment.seed))
    write_json(folder / "results.json", outcome.content)
    save_robot(_with_provenance(outcome), folder / "calibrated.yaml")
    _save_measurements(outcome, folder)
    if outcome.planned is not None:
        from symcal.planning.plan_file import write_plan

        motion = outcome.planned.motion if outcome.planned.timed else None
        poses, model = outcome.planned.plan.poses, experiment.model
        touches = touched_names(model.measurement, model.setup, poses) if constraints(model.measurement) else None
        write_plan(folder / "plan.csv", experiment.robot, poses, motion, touches=touches)
    resolved = config.resolved(experiment.file, experiment.document, folder)
    write_document(folder / "experiment.resolved.yaml", resolved | {"seed": experiment.seed})
    (folder / "tables").mkdir()
    for name, rows in tables(outcome.content, calibration, outcome.data, outcome.errors).items():
        write_table(folder / "tables" / f"{name}.csv", rows, HEADS.get(name))
    _write_images(outcome, folder)
    outputs = experiment.file.outputs
    if not (outputs.figures or outputs.report or outputs.page):
        return outcome
    from symcal.plots.save import draw
    from symcal.report import write_report

    progress("drawing, and writing the report" if outputs.report else "drawing")
    report = partial(write_report, outcome.content, path=folder / "report.pdf")
    pictures = draw(_drawings(outcome), folder / "figures", report if outputs.report else None)
    if outputs.page:
        progress("writing the page")
        _write_page(outcome, pictures, folder / "report.html")
    return outcome


def _write_page(outcome: Outcome, pictures: Sequence[Picture], path: Path) -> None:
    from symcal.page import Identified, write_page

    found = Identified(
        outcome.content,
        outcome.calibration,
        outcome.data,
        outcome.errors,
        pictures,
        None if outcome.images is None else outcome.images.test,
        _gallery(outcome),
        area_of(outcome.experiment),
    )
    write_page(found, path)


def _gallery(outcome: Outcome) -> Gallery:
    """Small images of the poses that were measured in images."""
    from symcal.page import Gallery, Thumbnail

    measured = [entry.measured for entry in outcome.measured_in]
    if outcome.images is not None and outcome.images.images is not None:
        measured.append(outcome.images.images.measured)
    sessions = {o.name: o.session for o in outcome.experiment.model.task.observations}
    found: list[Thumbnail] = []
    for each in measured:
        name = each.data.only.name
        session = sessions.get(name) if len(outcome.data.of) > 1 else None
        by = name if len(measured) > 1 else ""
        for label, jpeg in zip(each.data.labels, each.thumbnails, strict=True):
            found.append(Thumbnail(f"{session}/{label}" if session else label, by, jpeg))
    kept = tuple(each for each in found if each.jpeg)
    return Gallery(kept, len(found))


def _drawings(outcome: Outcome) -> tuple[Drawing, ...]:
    """The figures of the run's report, in its order."""
    from symcal.plots.extension import beyond_geometry
    from symcal.plots.halves import halves_map
    from symcal.plots.handover import handover_drawings
    from symcal.plots.identification import identification_drawings
    from symcal.plots.style import drawing

    content, own = outcome.content, (outcome.calibration, outcome.data, outcome.errors)
    drawings = identification_drawings(
        *own, content["against"], outcome.check, config.tolerance_of(outcome.experiment.file)
    )
    if content.get("extension"):
        drawings += (drawing(beyond_geometry, content["extension"]),)
    if outcome.halves is not None:
        halves = outcome.halves
        what = f"two halves of the training poses, {halves.division.said} and identified apart,"
        drawings += (drawing(halves_map, halves.apart, what, "Two halves"),)
    if outcome.handover is not None:
        drawings += handover_drawings(outcome.handover)
    images = outcome.images
    examples = [example for entry in outcome.measured_in for example in entry.examples]
    if images is not None or examples:
        from symcal.images.figures import example_images, image_figures

        if images is not None:
            drawings += (partial(image_figures, images),)
        if examples:
            drawings += (drawing(example_images, examples),)
    return drawings


def _write_images(outcome: Outcome, folder: Path) -> None:
    """The camera and some images, of rendered ones."""
    images = None if outcome.images is None else outcome.images.images
    if images is None and outcome.rendered is None:
        return
    from symcal.images.files import write_images

    if images is not None:
        write_images(images.camera, images.examples, folder)
    if outcome.rendered is not None:
        write_images(outcome.rendered.calibration, outcome.rendered.entry.examples, folder)


def _save_measurements(outcome: Outcome, folder: Path) -> None:
    """One file, or one for each instrument in a folder; of images with what was not measured in the file's head."""
    data, robot = outcome.data, outcome.experiment.robot
    heads: dict[str, tuple[str, ...]] = {}
    if outcome.measured_in:
        from symcal.images.entries import measured_head

        heads = {entry.data.only.name: measured_head(entry.measured) for entry in outcome.measured_in}
    if len(data.of) == 1:
        save_measurements(data, robot, folder / "measurements.csv", heads.get(data.only.name, ()))
        return
    (folder / "measurements").mkdir()
    names = file_names(each.name for each in data.of)
    for each in data.of:
        file = folder / "measurements" / f"{names[each.name]}.csv"
        save_measurements(data.read_by(each.name), robot, file, heads.get(each.name, ()))


def _with_provenance(outcome: Outcome) -> Robot:
    robot = outcome.calibration.robot
    if robot.record is None:
        return robot
    content = outcome.content
    facts = {k: content[k] for k in ("name", "seed", "versions", "inputs", "warnings", "accuracy", "against")}
    layouts = {
        name: {
            "columns": dict(own.columns),
            "delimiter": own.delimiter,
            "decimal": own.decimal,
            "where": dict(own.where),
            "sheet": own.sheet,
            "session": own.session,
        }
        for name, own in config.sources(outcome.experiment.file).items()
        if isinstance(own, FileData)
    }
    if layouts:  # so that new files of the same layout can be read for validation
        facts["layout"] = layouts
    return replace(robot, record=replace(robot.record, provenance=dict(robot.record.provenance) | facts))
