"""What `symcal check` says of a study: its grid, how many trials, and how they are identified."""

from __future__ import annotations

from pathlib import Path

from symcal.trials.identify import one_by_one
from symcal.trials.load import load_study
from symcal.trials.need import said
from symcal.trials.setting import build_setting
from symcal.words import listed, plural


def check_study(path: Path) -> list[str]:
    """Sentences about a study that can be run.

    Raises:
        InputError, RefusedError: as of `symcal.trials.load.load_study`.
    """
    study = load_study(path)
    description = study.description
    cells = len(description.cells)
    lines = [
        f"{study.file.name}: {description.trials} trials, {description.repetitions} of each of {plural(cells, 'cell')} "
        f"of {study.experiment.file.title or study.experiment.file.name}"
    ]
    lines += [f"  {axis}: {', '.join(_shown(axis, value) for value in study.axes[axis])}" for axis in study.varied]
    for task in range(len(description.tasks)):
        setting = build_setting(description, task)
        names = listed([o.name for o in setting.model.task.observations])
        why = one_by_one(description, setting)
        how = f"one by one, because {why}" if why else "at once, one in each lane of the processor"
        lines.append(f"{len(setting.model.parameters)} parameters by {names}: identified {how}")
    return lines


def _shown(axis: str, value: object) -> str:
    return " + ".join(value) if isinstance(value, tuple) else said(axis, value)
