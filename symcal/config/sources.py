"""Where the measurements of an experiment are: files and images by entry, how they are laid out, their sessions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from symcal.config.experiment import ExperimentFile
from symcal.config.measurements import FileData, ImagesData, ObservationConfig
from symcal.data.layout import Layout
from symcal.documents.document import Document, Key


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


def sources(file: ExperimentFile) -> Mapping[str, FileData | ImagesData | None]:
    """The file of measurements, or the images, of every entry; None where the experiment's own `data` says where they
    are."""
    own = file.data if isinstance(file.data, FileData | ImagesData) else None
    if file.measurement is not None:
        return {file.measurement.type: own}
    return {name: entry.data or own for name, entry in file.measurements.items() if entry.value is None}


def reads_files(file: ExperimentFile) -> bool:
    """Whether any measurement comes from a file, or from images."""
    return any(source is not None for source in sources(file).values())


def layout_of(config: FileData) -> Layout:
    """How the file of measurements is to be read."""
    where = {column: str(value) for column, value in config.where.items()}
    return Layout(config.columns, where, config.delimiter, config.decimal)


def sessions_of(name: str, entry: ObservationConfig, document: Document) -> tuple[str, ...]:
    """The sessions in an entry's data, in their order."""
    key: Key = ("measurements", name, "data")
    if entry.data is None:
        message = "'per: session' needs the data here: they say which sessions there are"
        raise document.error(message, key)
    if not isinstance(entry.data, FileData):
        message = "'per: session' takes the sessions from a file of measurements: measure the images first"
        raise document.error(message, key, found=entry.data.source)
    table = layout_of(entry.data).table(existing(document, entry.data.file, (*key, "file"), "file of measurements"))
    if "session" not in table.columns:
        message = "'per: session' needs a column 'session' in the data, or 'columns: {session: ...}'"
        raise document.error(message, (*key, "columns"), allowed=table.columns)
    return tuple(dict.fromkeys(table.text("session")))
