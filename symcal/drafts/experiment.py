"""The text of a first experiment: an instrument's template with the guesses of an arm's cell, a plan and its data."""

from __future__ import annotations

import json
import re

from symcal.documents.yaml_dialect import parse_value
from symcal.drafts.cell import Cell, numbers_text
from symcal.drafts.instrument import Draft
from symcal.robot.robot import Robot

_UNITS = {"position": "mm", "distance": "mm", "component": "mm", "orientation": "deg", "image": "px"}
_COLUMN = 33  # where comments stand
_MARKED = re.compile(r"^(.*\S) +# (FILL IN.*)$", re.MULTILINE)


def experiment_text(robot: Robot, title: str, draft: Draft, cell: Cell, name: str) -> str:
    """An experiment file.

    Args:
        title: what the arm is called by people. name: of the experiment, and so of its results.
    """
    text = draft.template.substitute(
        arm=" ".join(title.split()),
        head=_head(name, f"{title}, {draft.name}"),
        plan=_plan(robot, draft, cell),
        data=_data(draft),
        columns=_columns(draft),
        **{f"{entry}_data": _entry_data(draft, entry) for entry in draft.entries},
        **cell.places,
    )
    return _MARKED.sub(lambda found: _said(found[1], found[2]), text)


def _head(name: str, title: str) -> str:
    return "\n".join(
        (
            "# Numbers marked FILL IN are guesses: put your own there before a robot moves. The rest can stay.",
            "schema: symcal/experiment/1",
            f"name: {quoted(name)}",
            f"title: {quoted(title)}",
            "seed: 1",
            _said("units: {length: mm, angle: deg}", "of all numbers in this file"),
            "robot: robot.yaml",
        )
    )


def _plan(robot: Robot, draft: Draft, cell: Cell) -> str:
    """The section `plan`: `symcal plan` works on it as it is."""
    lines = [_said("plan:", "'symcal plan experiment.yaml' chooses the postures"), f"  poses: {draft.poses}"]
    if draft.images:  # every corner counts at every pose that is tried
        lines += [
            "  sample: 2000",
            _said("  among: sample", "from so many random postures; without these two lines from all, which takes"),
            _said("", "minutes with a board"),
        ]
    elif not draft.entries:
        foretold = [draft.poses * share // 4 for share in (2, 3, 4, 6)]
        lines.append(_said(f"  promise: {{counts: {foretold}}}", "numbers of poses for which errors are foretold"))
    if draft.noise:
        units = ", ".join(dict.fromkeys(_UNITS[quantity] for quantity in draft.noise))
        lines.append(
            _said(f"  noise: {_flow(draft.noise)}", f"FILL IN: of the instrument, one standard deviation, {units}")
        )
    first = cell.posture.first_link
    knows = [*(["the table below"] if first else []), *(["the camera's view"] if draft.images else [])]
    known = f"The plan knows of {' and '.join(knows) or 'nothing around'}{', no more' if knows else ''}"
    lines += [
        _said("  area:", "FILL IN: joint readings between which the arm hits nothing, itself included, and no"),
        _said("", f"cable is pulled. {known}"),
    ]
    for joint, ends in zip(robot.joints, cell.area, strict=True):
        lines.append(f"    {quoted(joint.name)}: {numbers_text(ends)}")
    if draft.images or first is not None:
        lines.append("  constraints:")
    if draft.images:
        lines += [
            _said(
                "    view: {whole: true, margin_px: 40}",
                "plan views of the whole board, so far from the image's border;",
            ),
            _said("", "images that show a part of it count as well"),
        ]
    if first is not None:
        lines += [
            _said("    planes:", f"FILL IN: links from the {_nth(first)} on stay 50 mm above z = 0 of the base"),
            f"      - {{name: table, point: [0, 0, 0], normal: [0, 0, 1], margin: 50, first_link: {first}}}",
        ]
    return "\n".join(lines)


def _data(draft: Draft) -> str:
    noise = f"noise: {_flow(draft.noise)}, " if draft.noise else ""
    simulated = f"data: {{source: simulated, {noise}truth: {{sigma_length: 1, sigma_angle: 0.3}}, test_poses: 200}}"
    if draft.entries:
        then = "# Simulated until there are measurements. Then remove the next line, and every '# ' before 'data'."
        return f"{then}\n{simulated}"
    source = "{source: images, files: images, joints: joints.csv}" if draft.images else _file(draft)
    then = "# Simulated until there are measurements. Then remove the next line, and the '# ' before the one after it."
    return f"{then}\n{simulated}\n# data: {source}"


def _entry_data(draft: Draft, entry: str) -> str:
    return f"    # data: {_file(draft, f', where: {{{draft.by}: {entry}}}')}"


def _file(draft: Draft, where: str = "") -> str:
    return f"{{source: file, file: {draft.table}{where}}}"


def _columns(draft: Draft) -> str:
    pose = "" if draft.images else "pose: any name. "
    return f"# Columns of {draft.table}. {pose}q1..: joint readings as the controller shows them (q1_rad if in rad)."


def _said(text: str, comment: str) -> str:
    return f"{text:<{_COLUMN - 1}} # {comment}"


def _flow(numbers: object) -> str:
    assert isinstance(numbers, dict)
    return f"{{{', '.join(f'{name}: {value:g}' for name, value in numbers.items())}}}"


def _nth(count: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(count, f"{count}th")


def quoted(text: str) -> str:
    """A text as a value or key in YAML: in quotes only where it would be read as something else."""
    plain = re.fullmatch(r"[\w][\w ./,+-]*[\w+]|\w", text) is not None
    return text if plain and parse_value(text) == text else json.dumps(text, ensure_ascii=False)
