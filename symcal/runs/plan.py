"""`symcal plan`: an experiment file in, a plan with its bounds and its promise out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from symcal.calibration import results
from symcal.calibration.extend import planned_model
from symcal.config import conversion as config
from symcal.documents.csv_file import read_table
from symcal.documents.document import write_document
from symcal.outputs.csv_text import rows_of
from symcal.outputs.names import file_name
from symcal.planning.plan_file import write_plan, write_waypoints
from symcal.planning.plan_study import PlanStudy, find
from symcal.planning.results import (
    constraint_facts,
    method_facts,
    order_facts,
    plan_facts,
    plan_notes,
    plan_tables,
    promise_facts,
    region_words,
)
from symcal.runs.folder import require_replaceable, run_folder, write_json, write_table
from symcal.runs.load import Experiment, load, named_files

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class PlanOutcome:
    """A plan with all that is known about it, and the content of its results.json."""

    experiment: Experiment
    findings: PlanStudy
    content: Mapping[str, Any]


def run_plan(
    path: Path,
    out: Path | None = None,
    *,
    seed: int | None = None,
    overrides: Sequence[str] = (),
    progress: Progress = lambda _: None,
) -> tuple[Path, Mapping[str, Any]]:
    """Plan an experiment and write its folder; `reports/<name>-plan` below the current folder when ``out`` is None.

    Returns:
        the folder, and the content of its results.json.
    """
    experiment = load(path, seed=seed, overrides=overrides)
    target, inputs = out or Path("reports") / f"{file_name(experiment.file.name)}-plan", named_files(experiment)
    require_replaceable(target, inputs)
    outcome = plan_experiment(experiment, progress)
    with run_folder(target, inputs) as folder:
        write(outcome, folder, progress)
    return target, outcome.content


def plan_experiment(experiment: Experiment, progress: Progress = lambda _: None) -> PlanOutcome:
    """Search, certify, order, foretell.

    Raises:
        InputError, RefusedError: as `symcal.planning.plan_problem.plan_problem` and
        `symcal.planning.drive_plan.find_plan` do.
    """
    file, document = experiment.file, experiment.document
    model = planned_model(experiment.model, file.identification.groups)
    found = find(file, document, model, experiment.seed, progress)
    problem, planned = found.problem, found.planned
    shares = constraint_facts(problem, file.plan.distance)
    inputs = (document.path, experiment.robot_path, *problem.inputs)
    content = {
        **results.header(file.name, file.title, experiment.seed, inputs, document.path.parent.resolve()),
        "kind": "plan",
        "robot": results.robot_facts(experiment.robot),
        "measurement": results.measurement_facts(experiment.model.task, {"planned": len(planned.plan)}),
        "warnings": [*plan_notes(problem, planned), *shares["infeasible_candidates"]],
        "identifiability": results.identifiability_facts(problem.info.seen),
        "plan": plan_facts(planned.plan, problem.info.measurement),
        "methods": method_facts(found.methods),
        "promise": promise_facts(found.promise, found.band, found.needed),
        "instruments": [asdict(each) for each in found.instruments],
        "aligned": problem.aligned,
        "order": order_facts(planned),
        "constraints": shares,
        "region": region_words(file.plan.region, bool(problem.measuring)),
        "candidates": None if problem.candidates is None else len(problem.candidates),
        "pool": None if problem.pool is None else len(problem.pool),
        "touching": problem.touches is not None,
    }
    return PlanOutcome(experiment, found, content)


def write(outcome: PlanOutcome, folder: Path, progress: Progress) -> None:
    """Everything that planning leaves: numbers, plan.csv, tables, figures, report, page."""
    experiment, found = outcome.experiment, outcome.findings
    planned, problem = found.planned, found.problem
    poses = planned.plan.poses
    touches = None if problem.touches is None else problem.touches(poses)
    write_json(folder / "results.json", outcome.content)
    write_plan(
        folder / "plan.csv",
        experiment.robot,
        poses,
        planned.motion if planned.timed else None,
        names=planned.names,
        touches=touches,
    )
    resolved = config.resolved(experiment.file, experiment.document, folder)
    write_document(folder / "experiment.resolved.yaml", resolved | {"seed": experiment.seed})
    (folder / "tables").mkdir()
    tool = problem.arm.motion(poses)[0]
    errors = found.accuracy.at(poses, problem.info.posterior(poses))
    for name, table in plan_tables(experiment.robot, planned, outcome.content, tool, errors, touches).items():
        write_table(folder / "tables" / f"{name}.csv", table)
    if planned.timed:
        write_waypoints(folder / "tables" / "waypoints.csv", experiment.robot, planned.motion)
    if problem.candidates is not None:
        _write_choice(outcome, folder / "tables" / "candidates.csv")
    outputs = experiment.file.outputs
    if not (outputs.figures or outputs.report or outputs.page):
        return
    from symcal.plots.plan import plan_drawings
    from symcal.plots.save import draw
    from symcal.report import write_report

    progress("drawing, and writing the report" if outputs.report else "drawing")
    report = partial(write_report, outcome.content, path=folder / "report.pdf", kind="plan")
    pictures = draw(plan_drawings(found), folder / "figures", report if outputs.report else None)
    if outputs.page:
        from symcal.page.plan import PlanShown, write_plan_page

        progress("writing the page")
        write_plan_page(PlanShown(outcome.content, found, experiment.model, pictures), folder / "report.html")


def _write_choice(outcome: PlanOutcome, path: Path) -> None:
    """The file of candidates with a column `split`: `train` for the chosen ones, `test` for the rest."""
    document, plan = outcome.experiment.document, outcome.experiment.file.plan
    table = read_table(document.resolve(str(plan.candidates), ("plan", "candidates")))
    names = table.text("pose") if "pose" in table.columns else [str(i + 1) for i in range(len(table))]
    chosen = set(outcome.findings.planned.names)
    columns = {name: table.text(name) for name in table.columns}
    columns["split"] = ["train" if name in chosen else "test" for name in names]
    write_table(path, rows_of(columns))
