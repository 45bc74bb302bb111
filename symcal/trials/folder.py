"""What a finished study leaves in its folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from symcal.documents.document import write_document
from symcal.runs.folder import write_json
from symcal.trials.description import Description
from symcal.trials.export import write_csv, write_parquet
from symcal.trials.load import Study
from symcal.trials.machine import Machine
from symcal.trials.results import study_content
from symcal.trials.store import Store


def write(
    study: Study,
    description: Description,
    store: Store,
    machine: Machine,
    folder: Path,
    parquet: bool,
    report: bool,
    progress: Callable[[str], None],
) -> Mapping[str, Any]:
    """Numbers, the table of all trials, figures and report; the content of results.json."""
    content = study_content(study, description, store, machine)
    write_json(folder / "results.json", content)
    progress("writing the table of trials")
    write_csv(folder / "trials.csv", description, store)
    if parquet:
        write_parquet(folder / "trials.parquet", description, store, machine)
    file = study.file
    said = file.model_dump(mode="json", by_alias=True, exclude_none=True)
    write_document(folder / "study.resolved.yaml", said)
    wanted = file.outputs
    if not report or not (wanted.figures or wanted.report):
        return content
    from symcal.plots.save import save_figures
    from symcal.trials.figures import study_figures
    from symcal.trials.report import write_study_report

    progress("drawing")
    pictures = save_figures(study_figures(content, store), folder / "figures")
    if wanted.report:
        progress("writing the report")
        write_study_report(content, pictures, folder / "report.pdf")
    return content
