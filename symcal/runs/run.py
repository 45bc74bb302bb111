"""`symcal run`: an experiment file in, a run's folder out, whatever the experiment asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from symcal.outputs.names import file_name
from symcal.runs.identification_folder import write_identification
from symcal.runs.load import load

Progress = Callable[[str], None]


def run(
    path: Path,
    out: Path | None = None,
    *,
    seed: int | None = None,
    overrides: Sequence[str] = (),
    data: Path | None = None,
    study: bool = True,
    progress: Progress = lambda _: None,
) -> tuple[Path, Mapping[str, Any]]:
    """Run an experiment and write its folder; `reports/<name>` below the current folder when ``out`` is None.

    Args:
        study: the whole study of an experiment that has one; False for a single identification.
    Returns:
        the folder, and the content of its results.json.

    Example:
        >>> from pathlib import Path
        >>> import symcal as sc
        >>> folder, results = sc.run(
        ...     Path("configs/simulated_arm.yaml"),
        ...     Path("arm"),
        ...     overrides=["outputs.report=false", "outputs.figures=false"],
        ... )
        >>> (folder / "calibrated.yaml").is_file()
        True
    """
    experiment = load(path, seed=seed, overrides=overrides)
    target = out or Path("reports") / file_name(experiment.file.name)
    if experiment.file.study is not None and study:
        from symcal.runs.study import write_study

        return target, write_study(experiment, target, progress)
    return target, write_identification(experiment, target, data=data, progress=progress)
