"""An experiment with a section `study`: the paper's study in, a run's folder out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symcal.calibration import results
from symcal.calibration.compensation_check import POSES, Handover, hand_over, true_robot
from symcal.calibration.decision import Decision
from symcal.calibration.evaluate import Errors
from symcal.calibration.judgement import decide_run, decided_robot
from symcal.calibration.simulate import concatenate
from symcal.config import conversion as config
from symcal.data.saved_measurements import save_measurements
from symcal.documents.document import write_document
from symcal.export.corrections import COLUMNS, correction_rows
from symcal.export.results import correction_facts, handover_facts
from symcal.paper.content import study_content
from symcal.paper.results import Study
from symcal.paper.study import run_study
from symcal.paper.surroundings import surroundings
from symcal.paper.tables import study_tables
from symcal.planning.plan_file import write_plan, write_waypoints
from symcal.robot.files import save_robot
from symcal.robot.robot import Robot
from symcal.runs.code import with_code
from symcal.runs.folder import require_replaceable, run_folder, write_json, write_table
from symcal.runs.judged import area_of
from symcal.runs.load import Experiment, named_files

if TYPE_CHECKING:
    from symcal.page import Identified
    from symcal.report import Picture

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class StudyOutcome:
    """A study with the experiment that asked for it, and the content of its results.json.

    handover: what compensation with the robot of the certified plan achieves. robot: that one, with the decision about
    it.
    """

    experiment: Experiment
    study: Study
    handover: Handover
    content: Mapping[str, Any]
    robot: Robot


def study_experiment(experiment: Experiment, progress: Progress = lambda _: None) -> StudyOutcome:
    """Run the study of an experiment.

    Raises:
        RefusedError: the experiment is not one that the study can be made of.
    """
    file, document = experiment.file, experiment.document
    study = run_study(file, document, experiment.model, experiment.options, experiment.seed, progress)
    inputs = (document.path, experiment.robot_path, *study.problem.inputs)
    head = results.header(file.name, file.title, experiment.seed, inputs, document.path.parent.resolve())
    assert file.study is not None  # run_study asks for it
    progress("compensating")
    decision, handover = _decision(study, experiment), _handover(study, experiment.seed)
    robot = decided_robot(study.simulation_2["certified"].calibration.robot, decision)
    content = {**head, **study_content(study), **surroundings(study, file.study.sized()), "decision": decision.facts}
    content |= {"controller": correction_facts(robot), "compensation": handover_facts(handover)}
    return StudyOutcome(experiment, study, handover, content, robot)


def _decision(study: Study, experiment: Experiment) -> Decision:
    """Of the robot that the certified plan's measurements identified, by the study's noisy test poses."""
    found, test = study.simulation_2["certified"], study.setting.test_poses
    errors = _test_errors(study)
    tolerance = config.tolerance_of(experiment.file)
    data, options = study.data["certified"], experiment.options
    return decide_run(found.calibration, data, {"test": errors}, {}, options, tolerance, test=test)


def _test_errors(study: Study) -> dict[str, Errors]:
    """Sizes of the certified plan's errors against the noisy measurements of the test poses."""
    found, poses = study.simulation_2["certified"], np.arange(len(study.test))
    return {
        state: Errors(sizes[:, None], poses, np.zeros_like(poses), None)
        for state, sizes in (("before", found.before_measured), ("after", found.after_measured))
    }


def _handover(study: Study, seed: int) -> Handover:
    """Commands over the working area, executed by the true robot."""
    model, robot = study.setting.model, study.simulation_2["certified"].calibration.robot
    rng = np.random.default_rng(seed).spawn(9)[-1]  # the study itself uses the first eight
    truth = true_robot(model, model.parameters.mapping(study.setting.truth))
    return hand_over(robot, truth, study.problem.area.sample(rng, POSES), rng)


def write_study(experiment: Experiment, target: Path, progress: Progress = lambda _: None) -> Mapping[str, Any]:
    """Run the study and write its folder; the content of its results.json."""
    inputs = named_files(experiment)
    require_replaceable(target, inputs)
    outcome = study_experiment(experiment, progress)
    with run_folder(target, inputs) as folder:
        outcome = write(outcome, folder, progress)
    return outcome.content


def write(outcome: StudyOutcome, folder: Path, progress: Progress = lambda _: None) -> StudyOutcome:
    """Everything that the study leaves: numbers, tables, plans, the calibrated robot and its measurements, C code,
    figures, report and page.

    Returns:
        the outcome, with what became of the C code in its content.
    """
    experiment, study = outcome.experiment, outcome.study
    robot, tables = experiment.robot, folder / "tables"
    calibrated = outcome.robot
    if experiment.file.outputs.c:
        progress("exporting C")
        outcome = replace(outcome, content=with_code(outcome.content, calibrated, folder, experiment.seed))
    write_json(folder / "results.json", outcome.content)
    save_robot(_with_provenance(outcome), folder / "calibrated.yaml")
    save_measurements(study.data["certified"], robot, folder / "measurements.csv")
    write_plan(folder / "plan.csv", robot, study.plans["certified"].poses, study.plans["certified"].motion)
    resolved = experiment.file.model_dump(mode="json", by_alias=True, exclude_none=True)
    write_document(folder / "experiment.resolved.yaml", resolved | {"seed": experiment.seed})
    tables.mkdir()
    for name, table in study_tables(study).items():
        write_table(tables / f"{name}.csv", table)
    write_table(tables / "corrections.csv", correction_rows(calibrated), COLUMNS)
    for name, plan in study.plans.items():
        write_plan(tables / f"plan_{name}.csv", robot, plan.poses, plan.motion)
        write_waypoints(tables / f"waypoints_{name}.csv", robot, plan.motion)
    outputs = experiment.file.outputs
    if not (outputs.figures or outputs.report or outputs.page):
        return outcome
    from symcal.page import write_study_page
    from symcal.paper.plots import study_drawings
    from symcal.paper.report import paper_text, write_paper_report
    from symcal.plots.handover import handover_drawings
    from symcal.plots.save import draw

    progress("drawing, and writing the report" if outputs.report else "drawing")
    report = partial(write_paper_report, outcome.content, path=folder / "report.pdf")
    drawings = (*study_drawings(study), *handover_drawings(outcome.handover))
    pictures = draw(drawings, folder / "figures", report if outputs.report else None)
    if outputs.page:
        progress("writing the page")
        write_study_page(touched(outcome, pictures), paper_text(outcome.content), folder / "report.html")
    return outcome


def touched(outcome: StudyOutcome, pictures: Sequence[Picture]) -> Identified:
    """What the certified plan's measurements identified, for the page on which one can touch it."""
    from symcal.page import Identified

    study = outcome.study
    train, test = study.data["certified"], study.test
    data = replace(concatenate(train, test), labels=(*train.labels, *test.labels))
    calibration, area = study.simulation_2["certified"].calibration, area_of(outcome.experiment)
    errors = {"test": _test_errors(study)}
    return Identified(outcome.content, calibration, data, errors, pictures, area=area)


def _with_provenance(outcome: StudyOutcome) -> Robot:
    """The robot that the certified plan's measurements identified."""
    robot = outcome.robot
    if robot.record is None:
        return robot
    keys = ("name", "seed", "versions", "inputs", "warnings", "accuracy", "against")
    facts = {key: outcome.content[key] for key in keys}
    return replace(robot, record=replace(robot.record, provenance=dict(robot.record.provenance) | facts))
