"""The report of the paper's study as text: results in, strings for the template `paper` out, section by section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from symcal.outputs.whole_file import write_whole
from symcal.paper.report.chance import chance
from symcal.paper.report.errata import errata
from symcal.paper.report.fitness import fitness
from symcal.paper.report.made import choices, counterparts, made
from symcal.paper.report.plans import plans
from symcal.paper.report.robot import robot
from symcal.paper.report.simulations import simulation_1, simulation_2
from symcal.paper.report.unseen import unseen
from symcal.paper.report.verdict import key_table, study_verdict
from symcal.report.handover import handover_text
from symcal.report.render import Picture, rendered
from symcal.words import plural

__all__ = ["paper_text", "write_paper_report"]


def write_paper_report(content: Mapping[str, Any], pictures: Sequence[Picture], path: Path | str) -> None:
    """Write the report of a study (results.json) as PDF.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, rendered(paper_text(content), pictures, files("symcal.paper.report").joinpath("paper.typ")))


def paper_text(content: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that the template `paper` prints.

    Args:
        content: the results dictionary (results.json) of a study.
    """
    return {
        "title": content.get("title") or content["name"],
        "subtitle": _subtitle(content),
        "version": content["versions"].get("symcal", ""),
        "verdict": study_verdict(content),
        "warnings": list(content.get("warnings", [])),
        "handover": handover_text(content),
        "blocks": [
            *key_table(content),
            *robot(content),
            *plans(content),
            *simulation_1(content),
            *simulation_2(content),
            *unseen(content),
            *chance(content),
            *fitness(content),
            {"kind": "handover"},
            *errata(),
            *choices(content),
            *counterparts(),
            *made(content),
        ],
    }


def _subtitle(content: Mapping[str, Any]) -> str:
    found = content["simulation_2"]
    return (
        "After L. Ding, E. Li, Z. Liang and M. Tan, “A Novel Kinematic Calibration Method for a Handling Robot Based "
        f"on Optimal Trajectory Planning”: the same robot, {content['measurement']['poses']['train']} poses, "
        f"{plural(len(content['simulation_2']['plans']), 'plan')}, both simulations, the second "
        f"{found['repetitions']} times."
    )
