"""`symcal watch`: a calibrated robot and today's readings in, a verdict out; and the plan of such checks."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration import results
from symcal.calibration.record import recorded_task
from symcal.calibration.tolerance import parse_tolerance
from symcal.documents.read import TABLE_LIMIT, read_bytes
from symcal.errors import InputError, RefusedError, SymcalError
from symcal.outputs.names import file_name
from symcal.outputs.whole_file import require_place
from symcal.planning.area import WorkingArea, working_area
from symcal.planning.plan_file import write_plan
from symcal.planning.plan_problem import plan_problem
from symcal.planning.sampling import feasible_poses
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot
from symcal.runs.folder import require_replaceable, run_folder, write_json, write_table
from symcal.runs.load import load
from symcal.runs.new_measurements import chosen_instrument, new_measurements
from symcal.watch import ALPHA, OFFSET, POSES
from symcal.watch.check import check
from symcal.watch.history import Row, row, with_row
from symcal.watch.plan import POOL, plan_check
from symcal.watch.reference import Reference, reference_of
from symcal.watch.results import check_facts, plan_facts
from symcal.watch.words import plan_remarks, remarks, verdict

Array = NDArray[np.float64]
Progress = Callable[[str], None]

_RESOLVED = "experiment.resolved.yaml"
_SNAP = 0.4  # of coordinates at the border of the area, as in plans


@dataclass(frozen=True, slots=True)
class _Room:
    """Where the poses of a check may be: which can be measured, shape (K, dof), in which area; what is said of it."""

    pool: Array
    area: WorkingArea
    inputs: tuple[Path, ...]
    note: str


def watch_plan(
    calibrated: Path,
    out: Path | None = None,
    *,
    poses: int = POSES,
    experiment: Path | None = None,
    offset: str = OFFSET,
    alpha: float = ALPHA,
    moved: bool = False,
    instrument: str | None = None,
    seed: int = 1,
    progress: Progress = lambda _: None,
) -> tuple[Path, dict[str, Any]]:
    """Plan the poses of a check; `reports/<robot>-watch-plan` below the current folder when ``out`` is None.

    Args:
        experiment: whose area and constraints hold; that beside the calibrated robot when None, and else the limits of
            the robot's joints.
    Returns:
        the folder, and the content of its results.json.
    Raises:
        InputError, RefusedError: as `symcal.watch.reference.reference_of` and `symcal.watch.plan.plan_check`.
    """
    _check_alpha(alpha)
    robot, reference, _ = _reference(calibrated, instrument, moved=moved)
    target = out or Path("reports") / f"{file_name(robot.name)}-watch-plan"
    require_replaceable(target, [calibrated, *([] if experiment is None else [experiment])])
    progress("looking for poses that can be measured")
    room = _room(robot, calibrated, experiment, np.random.default_rng(seed))
    progress("choosing poses")
    wanted = _offsets(offset, reference)
    plan = plan_check(reference, room.pool, room.area, poses, offsets=wanted, alpha=alpha, moved=moved)
    content = {
        **results.header(robot.name, f"Poses of a check of {robot.name}", seed, (calibrated, *room.inputs), Path.cwd()),
        "kind": "watch plan",
        **plan_facts(reference, plan, wanted, alpha, moved=moved),
        "room": room.note,
    }
    content["remarks"] = [room.note, *plan_remarks(content)]
    with run_folder(target, (calibrated, *room.inputs)) as folder:
        write_json(folder / "results.json", content)
        write_plan(folder / "plan.csv", robot, plan.poses)
        progress("drawing")
        _draw_plan(content, folder / "figures")
    return target, content


def watch(
    calibrated: Path,
    data: Path,
    out: Path | None = None,
    *,
    alpha: float = ALPHA,
    offset: str = OFFSET,
    moved: bool = False,
    instrument: str | None = None,
    history: Path | None = None,
    date: str | None = None,
    progress: Progress = lambda _: None,
) -> dict[str, Any]:
    """Check a calibrated robot by new readings; the content of results.json.

    Args:
        moved: the instrument was set up anew. history: a CSV file that gets a row. date: of the readings, ISO 8601;
            when their file was last written when None.
    Raises:
        InputError: anything wrong in the files. RefusedError: it cannot be judged, and why.
    """
    _check_alpha(alpha)
    when = _date(date, data)
    if out is not None:
        require_replaceable(out, (calibrated, data, *([] if history is None else [history])))
    if history is not None:
        _check_history(history, (calibrated, data))
    robot, reference, own = _reference(calibrated, instrument, moved=moved)
    progress("reading the measurements")
    new, _ = new_measurements(robot, data, own, ())
    progress("checking")
    found = check(reference, new, alpha=alpha, offsets=_offsets(offset, reference), moved=moved)
    content: dict[str, Any] = {
        **results.header(robot.name, f"Check of {robot.name}", 0, (calibrated, data), Path.cwd()),
        "kind": "watch",
        "date": when,
        **check_facts(reference, found),
    }
    content["sentence"] = verdict(content)
    content["remarks"] = [*remarks(content), *new.notes]
    rows: list[Row] = []
    if history is not None:
        digests = [hashlib.sha256(read_bytes(path, TABLE_LIMIT)).hexdigest() for path in (calibrated, data)]
        rows = with_row(history, row(content, when, digests[0], data.name, digests[1]))
    if out is not None:
        with run_folder(out, (calibrated, data)) as folder:
            write_json(folder / "results.json", content)
            (folder / "tables").mkdir()
            write_table(folder / "tables" / "tests.csv", [{"test": k, **v} for k, v in content["tests"].items()])
            progress("drawing")
            _draw(content, rows, folder / "figures")
    return content


def _reference(calibrated: Path, instrument: str | None, *, moved: bool) -> tuple[Robot, Reference, Sequence[Any]]:
    robot = load_robot(calibrated)
    if robot.record is None:
        message = "this robot has no 'calibration': watch takes the calibrated.yaml of a run"
        raise InputError(message, file=calibrated)
    own = chosen_instrument(recorded_task(robot.record.provenance, "after", calibrated), instrument)
    if len(own) > 1:
        if not moved:
            raise RefusedError(
                f"'{own[0].of}' had a place of its own in each session of the calibration: none of them is known to "
                "hold today; '--moved' finds it from these readings"
            )
        own = own[:1]
    return robot, reference_of(robot, own, calibrated), own


def _check_alpha(alpha: float) -> None:
    if not 1e-6 <= alpha <= 0.5:
        message = "a rate of false alarms is between 0.000001 and 0.5"
        raise InputError(message, key="--alpha", found=alpha)


def _check_history(history: Path, inputs: Sequence[Path]) -> None:
    try:
        require_place(history, inputs)
    except InputError as error:
        raise InputError(error.message, file=error.file, key="--history", found=error.found) from None


def _date(given: str | None, data: Path) -> str:
    if given is None:
        try:
            return datetime.fromtimestamp(data.stat().st_mtime).isoformat(timespec="minutes")
        except OSError as error:
            raise InputError(f"the file cannot be read: {error.strerror}", file=data) from None
    try:
        datetime.fromisoformat(given)
    except ValueError:
        message = "a date is written like 2026-11-30 or 2026-11-30T06:00"
        raise InputError(message, key="--date", found=given) from None
    return given


def _offsets(text: str, reference: Reference) -> dict[str, float]:
    try:
        given = parse_tolerance(text)
    except InputError as error:
        message = "expected an angle, a length or both, each with its unit, such as 0.5mrad,0.1mm"
        raise InputError(message, key="--offset", found=error.found) from None
    usual = parse_tolerance(OFFSET)
    angle, length = given.orientation or usual.orientation, given.position or usual.position
    assert angle is not None
    assert length is not None
    return {h.name: angle if h.units[0] == "rad" else length for h in reference.joints}


def _room(robot: Robot, calibrated: Path, experiment: Path | None, rng: np.random.Generator) -> _Room:
    """By an experiment; by the joints' limits where there is none."""
    beside = calibrated.parent / _RESOLVED
    path = experiment or (beside if beside.is_file() else None)
    why = "there is no experiment beside the calibrated robot"
    if path is not None:
        try:
            return _of_experiment(path, robot, rng)
        except SymcalError as error:
            if experiment is not None:
                raise
            why = f"the experiment beside the calibrated robot cannot be used ({error})"
    area = working_area(robot)
    note = (
        f"{why}: poses keep the joints' limits and nothing else; see that the arm hits nothing at each of them, or "
        "name the experiment with --experiment"
    )
    return _Room(feasible_poses(rng, area, (), POOL, snap=_SNAP), area, (), note)


def _of_experiment(path: Path, robot: Robot, rng: np.random.Generator) -> _Room:
    found = load(path)
    if found.robot.dof != robot.dof:
        message = "this experiment is of another robot"
        raise InputError(message, file=path, key="robot", found=f"{found.robot.dof} joints, not {robot.dof}")
    problem = plan_problem(found.file, found.document, found.model, rng)
    pool = problem.choices
    if pool is None:
        pool = feasible_poses(rng, problem.area, problem.measuring, POOL, snap=_SNAP)
    return _Room(pool, problem.area, (path, *problem.inputs), f"area and constraints are those of {path.name}")


def _draw_plan(content: Mapping[str, Any], folder: Path) -> None:
    from symcal.plots.save import save_figures
    from symcal.watch.figures import plan_figure

    save_figures([plan_figure(content)], folder)


def _draw(content: Mapping[str, Any], rows: list[Row], folder: Path) -> None:
    from symcal.plots.save import save_figures
    from symcal.watch.figures import check_figure, history_figure

    drawn = [check_figure(content)]
    if rows:
        drawn.append(history_figure(rows, list(content["joints"])))
    save_figures(drawn, folder)
