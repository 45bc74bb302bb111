"""A bench's folder: bench.json, bench.md and the figure of growth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from symcal.bench.against import against, read_bench
from symcal.bench.bench import run_bench
from symcal.bench.contest import Progress
from symcal.bench.tables import TextTable, markdown
from symcal.outputs.whole_file import write_whole
from symcal.runs.folder import require_replaceable, run_folder, write_json

FOLDER = Path("reports") / "bench"


def bench(
    out: Path | None = None,
    *,
    quick: bool = False,
    only: str | None = None,
    earlier: Path | None = None,
    progress: Progress = lambda _: None,
) -> tuple[Path, Mapping[str, Any], list[TextTable]]:
    """Measure and write; `reports/bench` below the current folder when ``out`` is None.

    Args:
        quick, only: as `run_bench`. earlier: the bench.json of another run to compare with.
    Returns:
        the folder, the content of bench.json, and the table that compares, if one was asked for.
    Raises:
        InputError: there is no such subject; the earlier file is no bench.json; the folder cannot be written.
        RefusedError: the folder holds what no run made.
    """
    target = out or FOLDER
    inputs = () if earlier is None else (earlier,)
    old = None if earlier is None else read_bench(earlier)
    require_replaceable(target, inputs)
    content = run_bench(quick=quick, only=only, progress=progress)
    more = [] if old is None else [against(content, old)]
    with run_folder(target, inputs) as folder:
        write_json(folder / "bench.json", content)
        write_whole(folder / "bench.md", markdown(content, more))
        if content["growth"]:
            from symcal.bench.figure import growth_figure
            from symcal.plots.save import save_figures

            progress("drawing")
            save_figures([growth_figure(content["growth"])], folder / "figures")
    return target, content, more
