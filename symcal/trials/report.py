"""The report of a study as text: results in, strings for its template out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from symcal.outputs.whole_file import write_whole
from symcal.report.render import Picture, rendered
from symcal.trials.need import bounds, judged_words, label, millimetres
from symcal.words import number, percent, plural, symbol

Content = Mapping[str, Any]

_ROWS = 60  # of a table: a grid of thousands is in results.json


def write_study_report(content: Content, pictures: Sequence[Picture], path: Path | str) -> None:
    """Write the report of a study (results.json) as PDF.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, rendered(study_text(content), pictures, files("symcal.trials").joinpath("trials.typ")))


def study_text(content: Content) -> dict[str, Any]:
    """Everything that the template prints.

    Args:
        content: the results dictionary (results.json) of a study.
    """
    return {
        "title": content["title"],
        "subtitle": _subtitle(content),
        "version": content["versions"].get("symcal", ""),
        "verdict": [f"{answer['text']}." for answer in content["answers"][:6]],
        "warnings": list(content["warnings"])[:12],
        "errors": _errors(content),
        "coverage": _coverage(content),
        "parameters": _parameters(content),
        "facts": _facts(content),
        "inputs": [[path, digest] for path, digest in content["inputs"].items()],
    }


def _subtitle(content: Content) -> str:
    cells = plural(len(content["cells"]), "cell")
    robot = content["robot"]
    return (
        f"{robot['name']}: {plural(robot['dof'], 'joint')}. {content['trials']} trials: "
        f"{plural(content['repetitions'], 'repetition')} of {cells} of the experiment “{content['experiment']}”."
    )


def _errors(content: Content) -> dict[str, Any]:
    """Quantiles of the judged error by cell."""
    question, rows = content["question"], []
    within = question["tolerance_mm"] is not None
    for cell in content["cells"][:_ROWS]:
        found = cell["judged_mm"]
        at = found["at_share"]
        row = [
            label(cell, content["varied"]),
            str(cell["trials"]["ok"]),
            millimetres(found["p05"]["value"]),
            millimetres(found["median"]["value"]),
            millimetres(at["value"]),
            bounds(at),
        ]
        if within:
            held = cell["within"]
            row.append(f"{_share(held['share'])} ({_share(held['low'])} to {_share(held['high'])})")
        rows.append(row)
    share = percent(question["share"])
    head = ["cell", "trials", "5\u00a0%", "median", share, "95\u00a0% confidence"]
    caption = (
        f"The {judged_words(question)} at {question['test_poses']} test poses, mm: what so many of the trials stay "
        f"below, and bounds of the {share} quantile. Trials that failed or were refused count as larger than any."
    )
    if within:
        head.append("within")
        caption += f" Within: share of the trials within {question['tolerance_mm']:g} mm, with its 95 % bounds."
    if len(content["cells"]) > _ROWS:
        caption += f" The other {len(content['cells']) - _ROWS} cells are in results.json."
    return {"head": head, "rows": rows, "caption": caption}


def _share(value: float) -> str:
    return f"{100 * value:.1f}\u00a0%"


def _coverage(content: Content) -> dict[str, Any]:
    """Foretold and found errors, and the intervals of positions, by cell."""
    rows = []
    for cell in content["cells"][:_ROWS]:
        if not cell["coverage"]:
            continue
        found, held = cell["expected"], cell["coverage"]["position"]
        error = "" if found["ratio_error"] is None else f" ± {number(found['ratio_error'], 1)}"
        rows.append(
            [
                label(cell, content["varied"]),
                number(cell["before_rms_mm"]),
                number(found["foretold_rms_mm"]),
                number(found["found_rms_mm"]),
                f"{number(found['ratio'])}{error}",
                f"{_share(held['share'])} ({_share(held['low'])} to {_share(held['high'])})",
                f"{cell['rank']['least']} to {cell['rank']['most']}",
            ]
        )
    head = ["cell", "before", "foretold", "found", "ratio", "positions held", "directions"]
    caption = (
        "Rms errors over trials and test poses, mm: of the nominal robot (median), as the covariances foretold and as "
        "they were found; in how many trials the 95 % interval of a position held the truth; directions seen."
    )
    return {"head": head, "rows": rows, "caption": caption}


def _parameters(content: Content) -> dict[str, Any]:
    """Intervals of parameters, over all cells."""
    from symcal.trials.statistics import pooled

    cells = [cell["coverage"]["parameters"] for cell in content["cells"] if cell["coverage"]]
    names = list(dict.fromkeys(name for own in cells for name in own))
    rows = []
    for name in names:
        own = [each[name] for each in cells if name in each]
        told, rest = (pooled([each[key] for each in own]) for key in ("held", "held_untold"))
        rows.append([symbol(name), _share(told.of / max(told.of + rest.of, 1)), _held(told), _held(rest)])
    caption = (
        "95 % intervals of parameters, over all cells: the share of the trials in which the data took at least half of "
        "the uncertainty away, and in how many of these, and of the others, the interval held the true error."
    )
    return {
        "head": ["parameter", "told by data", "held where told", "held elsewhere"],
        "rows": rows,
        "caption": caption,
    }


def _held(share: Any) -> str:
    return f"{_share(share.value)} ({_share(share.low)} to {_share(share.high)})" if share.of else "–"


def _facts(content: Content) -> list[list[str]]:
    """How it was made."""
    question, path, machine = content["question"], content["identification"], content["machine"]
    truth = "noisy readings" if question["against"] == "measurement" else "the simulated truth"
    because = f", because {path['because']}" if path["because"] else ""
    versions = ", ".join(f"{name} {version}" for name, version in content["versions"].items())
    return [
        ["streams", f"trial t draws from SeedSequence({content['seed']}, spawn_key=(t,)) alone"],
        ["judged by", f"{question['test_poses']} random test poses, the same in all trials, against {truth}"],
        ["identification", f"{path['path']}{because}; noise {path['noise']}, sizes of the errors {path['sizes']}"],
        ["processor", machine["processor"]],
        ["kernels", machine["kernels"]],
        ["program", machine["program"]],
        ["versions", versions],
    ]
