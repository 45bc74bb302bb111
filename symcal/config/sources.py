"""Where the measurements of an experiment are: files and images by entry, how they are laid out, their sessions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from symcal.config.data_sources import BagData, FileData, ImagesData, PairsData, RecordedData, TableData, TrajectoryData
from symcal.config.experiment import ExperimentFile
from symcal.config.measurements import ObservationConfig
from symcal.data.layout import Layout
from symcal.documents.document import Document, Key
from symcal.documents.table import Table
from symcal.errors import InputError
from symcal.readers.streams import Matching
from symcal.robot.given import NO_JOINTS, is_given
from symcal.robot.robot import Robot
from symcal.words import GIVEN


def existing(document: Document, path: str, key: Key, what: str) -> Path:
    """A file named in the experiment, as an absolute path that is there."""
    resolved = document.resolve(path, key)
    try:
        there = resolved.exists()  # what kind of file it is the reader says
    except OSError:
        there = False
    if not there:
        raise document.error(f"the {what} is not there", key, found=resolved)
    return resolved


def sources(file: ExperimentFile) -> Mapping[str, TableData | ImagesData | None]:
    """The file of measurements, or the images, of every entry; None where the experiment's own `data` says where they
    are."""
    own = file.data if isinstance(file.data, TableData | ImagesData) else None
    if file.measurement is not None:
        return {file.measurement.type: own}
    return {name: entry.data or own for name, entry in file.measurements.items() if entry.value is None}


def reads_files(file: ExperimentFile) -> bool:
    """Whether any measurement comes from a file, or from images."""
    return any(source is not None for source in sources(file).values())


def layout_of(config: TableData) -> Layout:
    """How the file of measurements is to be read; of what is no file of tables, the ordinary one."""
    if not isinstance(config, FileData):
        return Layout()
    where = {column: str(value) for column, value in config.where.items()}
    return Layout(config.columns, where, config.delimiter, config.decimal, config.sheet, config.session == "file")


_PATTERN = "*?["


def like(path: Path) -> tuple[Path, ...]:
    """The files that a pattern names, by name; the path itself where it is none."""
    try:
        if not any(sign in path.name for sign in _PATTERN) or path.exists():
            return (path,)
        return tuple(sorted(each for each in path.parent.glob(path.name) if each.is_file()))
    except (OSError, ValueError):
        return (path,)


def joints_of(config: TableData, document: Document, key: Key) -> tuple[Path, ...]:
    """The file of joint readings beside the measurements, if any."""
    if not isinstance(config, TrajectoryData | PairsData) or config.joints is None:
        return ()
    return (existing(document, config.joints, (*key, "joints"), "file of joint readings"),)


def table_of(config: TableData, files: Sequence[Path], joints: Sequence[Path], robot: Robot) -> Table:
    """The table of measurements that a source gives.

    Args:
        files: of the measurements. joints: of joint readings beside them, see `joints_of`.
    Raises:
        InputError: anything that cannot be read, or pairs of poses for a robot whose joints they lack.
    """
    if isinstance(config, FileData):
        return layout_of(config).table(files)
    of = [(joint.name, joint.revolute) for joint in robot.joints]
    (path,) = files
    if isinstance(config, BagData):
        from symcal.readers.bags import Bag, read_bag

        frames = None if config.frames is None else (config.frames[0], config.frames[1])
        names = None if config.joint_names is None else tuple(config.joint_names)
        return read_bag(path, of, Bag(config.joint_topic, config.topic, frames, names), _matching(config))
    if isinstance(config, TrajectoryData):
        from symcal.readers.trajectories import read_trajectory

        return read_trajectory(path, joints[0], of, _matching(config))
    from symcal.readers.hand_eye import read_pairs, with_joints

    pairs = read_pairs(path, config.eye)
    if joints:
        return with_joints(pairs, joints[0], of)
    if not is_given(robot):
        message = f"{NO_JOINTS}: say 'robot: {GIVEN}', or 'joints:', a file of joint readings beside them"
        raise InputError(message, file=path)
    return pairs


def _matching(config: RecordedData) -> Matching:
    return Matching(
        config.match,
        config.tolerance_s,
        config.still_s,
        config.settle_s,
        config.still_rad,
        config.still_mm,
        config.time_shift_s,
    )


def files_of(config: TableData, document: Document, key: Key) -> tuple[Path, ...]:
    """The files of measurements of an entry, those of a pattern by name; key: of the entry's data.

    Raises:
        InputError: one is not there, nothing is like a pattern, or a file stands twice.
    """
    found: list[Path] = []
    where: Key = (*key, "file")
    if not isinstance(config, FileData):
        return (existing(document, config.file, where, "file of measurements"),)
    for path in config.listed:
        resolved = document.resolve(path, where)
        own = like(resolved)
        if not own:
            raise document.error("no file of measurements is like this pattern", where, found=resolved)
        if own == (resolved,):
            own = (existing(document, path, where, "file of measurements"),)
        for each in own:
            if each in found:
                raise document.error("this file stands here twice", where, found=each.name)
            found.append(each)
    return tuple(found)


def sessions_of(name: str, entry: ObservationConfig, document: Document) -> tuple[str, ...]:
    """The sessions in an entry's data, in their order."""
    key: Key = ("measurements", name, "data")
    if entry.data is None:
        message = "'per: session' needs the data here: they say which sessions there are"
        raise document.error(message, key)
    if not isinstance(entry.data, FileData):
        message = "'per: session' takes the sessions from a file of measurements with 'source: file'"
        if entry.data.source == "images":
            message += ": measure the images first"
        raise document.error(message, key, found=entry.data.source)
    table = layout_of(entry.data).table(files_of(entry.data, document, key))
    if "session" not in table.columns:
        message = "'per: session' needs a column 'session' in the data, or 'columns: {session: ...}'"
        raise document.error(message, (*key, "columns"), allowed=table.columns)
    return tuple(dict.fromkeys(table.text("session")))
