"""The measurements of an experiment: simulated, read from a file, or measured in images."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile, FileData, ImagesData, RenderedData, SimulatedData, TableData
from symcal.data.dataset import Dataset, merged, with_random_test
from symcal.data.measurement_file import measurements_in
from symcal.documents.document import Document, Key
from symcal.errors import InputError, RefusedError
from symcal.model.model import Model
from symcal.model.observation import Observation
from symcal.readers.sheets import SUFFIXES
from symcal.robot.robot import Robot
from symcal.runs.load import Experiment

if TYPE_CHECKING:
    from symcal.images.entries import EntryImages
    from symcal.images.rendered_boards import RenderedBoards
    from symcal.planning.drive_plan import Planned

Progress = Callable[[str], None]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MeasuredData:
    """The measurements of a run, and the files read.

    Of simulated ones also the true robot, and the test poses, if any, without noise. images: what was measured in them.
    rendered: of rendered ones their truth, and the model with the camera as it was calibrated.
    """

    data: Dataset
    inputs: tuple[Path, ...] = ()
    truth: Robot | None = None
    exact: Dataset | None = None
    images: tuple[EntryImages, ...] = ()
    rendered: RenderedBoards | None = None


def measurements(
    file: ExperimentFile,
    document: Document,
    model: Model,
    rng: np.random.Generator,
    *,
    data: Path | None = None,
    planned: Planned | None = None,
    progress: Progress = lambda _: None,
) -> MeasuredData:
    """The measurements of an experiment, simulated, read, or measured in images.

    Args:
        data: a file instead of the experiment's. planned: poses that simulated data train at, instead of random ones.
    Raises:
        InputError: there are none, or they cannot be read. RefusedError: images that cannot be believed.
    """
    source = file.data
    if isinstance(source, SimulatedData) and data is None:
        from symcal.runs.simulated import simulated_data

        return simulated_data(file, source, document, model, rng, planned)
    if isinstance(source, RenderedData) and data is None:
        from symcal.images.rendered_boards import render_boards

        poses = None if planned is None else planned.plan.poses
        drawn = render_boards(file, source, document, model, rng, progress, poses)
        entries = (drawn.entry,)
        return MeasuredData(drawn.entry.data, drawn.inputs, drawn.truth, drawn.exact, entries, drawn)
    given = config.sources(file)
    if data is not None:
        if len(given) > 1:
            message = "several instruments measure: give each its file under 'measurements', not --data"
            raise InputError(message, key="--data", found=data)
        (layout,) = given.values()
        if layout is None or isinstance(layout, ImagesData) or data.suffix.lower() in _TABLES:
            layout = layout if isinstance(layout, FileData) else FileData(source="file", file=str(data))
        beside = config.joints_of(layout, document, ("data",))
        read = [_read(o, layout, (data,), beside, model) for o in model.task.observations]
        whole = _drawn(merged(read, [o.session for o in model.task.observations]), layout, rng)
        return MeasuredData(whole, (*_within((data,)), *beside))
    sets: list[Dataset] = []
    paths: list[Path] = []
    images: list[EntryImages] = []
    seen: dict[object, str] = {}
    for o in model.task.observations:
        own = given.get(o.of)
        if own is None:
            message = "there is nothing to identify from: give 'data' here, or measurements with --data"
            key: Key = ("data",) if file.measurement is not None else ("measurements", o.of, "data")
            raise document.error(message, key)
        here: Key = ("data",) if own is file.data else ("measurements", o.of, "data")
        if isinstance(own, ImagesData):
            shown = (own.joints, *own.listed)
            if shown in seen:
                message = (
                    f"'{o.name}' would be measured in the same images as '{seen[shown]}': give each its own 'data'"
                )
                raise document.error(message, (*here, "files"))
            seen[shown] = o.name
            measured, joints = _measured(o, own, document, here, model, progress)
            images.append(measured)
            sets.append(measured.data)
            paths.append(joints)
            continue
        where: Key = (*here, "file")
        files = config.files_of(own, document, here)
        beside = config.joints_of(own, document, here)
        chosen = json.dumps(own.model_dump(exclude={"file", "split", "delimiter", "decimal"}), sort_keys=True)
        rows = (files, o.instrument.name, chosen, o.features, o.session)
        if rows in seen:
            message = f"'{o.name}' reads the same rows as '{seen[rows]}', and each would count twice: see 'where'"
            raise document.error(message, where, found=", ".join(path.name for path in files))
        seen[rows] = o.name
        sets.append(_read(o, own, files, beside, model))
        paths += (*_within(files), *beside)
    sessions = [o.session for o in model.task.observations]
    layouts = {name: layout for name, layout in given.items() if layout is not None}
    shares = {layout.split.test_fraction for layout in layouts.values()}
    if len(shares) > 1:
        (_, first), *others = layouts.items()
        odd = next(name for name, own in others if own.split.test_fraction != first.split.test_fraction)
        message = "poses are held out for all instruments together: say the same 'test_fraction' for every one, or none"
        found = layouts[odd].split.test_fraction
        raise document.error(message, ("measurements", odd, "data", "split"), found=found)
    measured_data = _drawn(merged(sets, sessions), next(iter(layouts.values())), rng)
    if images and "train" not in measured_data.split:
        raise RefusedError("no pose is for training: none of those that the joints file calls so was measured")
    return MeasuredData(measured_data, tuple(dict.fromkeys(paths)), images=tuple(images))


def describe_data(experiment: Experiment) -> tuple[str, ...]:
    """What the file of measurements holds and what looks wrong in it, or that it is not there.

    Raises:
        InputError: it is there and cannot be read.
    """
    given = [source for source in config.sources(experiment.file).values() if source is not None]
    if not given:
        return ()
    for source in given:
        try:
            if isinstance(source, ImagesData):
                config.existing(experiment.document, source.joints, ("data", "joints"), "file of joint readings")
            else:
                config.files_of(source, experiment.document, ("data",))
        except InputError as error:
            return (str(error),)
    if any(isinstance(source, ImagesData) for source in given):
        return ("images are measured when the experiment is run",)
    rng = np.random.default_rng(experiment.seed)
    measured = measurements(experiment.file, experiment.document, experiment.model, rng).data
    counts = [f"{measured.split.count(s)} {s}" for s in ("train", "test", "unused") if s in measured.split]
    return (f"{len(measured)} poses ({', '.join(counts)})", *measured.notes)


def _measured(
    o: Observation, source: ImagesData, document: Document, key: Key, model: Model, progress: Progress
) -> tuple[EntryImages, Path]:
    """What one instrument reads in its images, and the file of their joint readings."""
    from symcal.images.entries import measure_entry
    from symcal.images.shots import read_shots
    from symcal.runs.camera import image_files

    joints = config.existing(document, source.joints, (*key, "joints"), "file of joint readings")
    try:
        files = image_files([document.resolve(path, (*key, "files")) for path in source.listed])
        shots = read_shots(joints, model.robot, files, config.split_of(source.split))
        return measure_entry(o, shots, model.robot, progress), joints
    except InputError as error:
        if error.file is not None:
            raise
        raise document.error(error.message, key, found=error.found, allowed=error.allowed) from None


_TABLES = (".csv", ".txt", *SUFFIXES)
"""Files given instead of the experiment's that are tables, whatever its own are."""


def _within(files: Sequence[Path]) -> tuple[Path, ...]:
    """Files, and those in folders (of bags)."""
    found: list[Path] = []
    for path in files:
        found += sorted(each for each in path.iterdir() if each.is_file()) if path.is_dir() else [path]
    return tuple(found)


def _drawn(data: Dataset, layout: TableData | ImagesData, rng: np.random.Generator) -> Dataset:
    """With a random share held out where the file says so."""
    fraction = layout.split.test_fraction
    return data if fraction is None else with_random_test(data, fraction, rng)


def _read(o: Observation, source: TableData, files: Sequence[Path], beside: Sequence[Path], model: Model) -> Dataset:
    """What one observation has read; of a session of its own only the rows of that."""
    layout = config.layout_of(source)
    return measurements_in(
        config.table_of(source, files, beside, model.robot),
        model.robot,
        o.instrument,
        layout,
        point_names=o.features,
        split=config.split_of(source.split),
        session=o.session if o.name != o.of else None,
        alone=len(model.task.observations) == 1,
        name=o.name,
    )
