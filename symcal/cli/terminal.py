"""What commands say in the terminal: a spinner while they work, short tables when they are done."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table


@contextmanager
def spinner(quiet: bool) -> Iterator[Callable[[str], None]]:
    """A spinner that names the current step; nothing when not a terminal or quiet."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda _: None
        return
    with console.status("starting") as status:
        yield lambda step: status.update(escape(step))


@contextmanager
def trial_progress(quiet: bool) -> Iterator[tuple[Callable[[str], None], Callable[[int, int], None]]]:
    """A bar with the rate and the time that is left; nothing when not a terminal or quiet.

    It has no thread of its own: the process may be copied while it is shown.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield (lambda _: None), (lambda _, __: None)
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} trials{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, auto_refresh=False, transient=True) as bar:
        task = bar.add_task("starting", total=1, rate="")
        began: list[tuple[float, int]] = []

        def advance(done: int, total: int) -> None:
            now = time.monotonic()
            began.append((now, done)) if not began else None
            seconds = now - began[0][0]
            rate = f", {(done - began[0][1]) / seconds:.3g}/s" if seconds > 0 else ""
            bar.update(task, completed=done, total=total, rate=rate, refresh=True)

        yield (lambda step: bar.update(task, description=escape(step), refresh=True)), advance


def output() -> Console:
    """The terminal; elsewhere lines are wide enough for the tables. A name with colons is no name of an emoji."""
    console = Console(soft_wrap=True, emoji=False)
    return console if console.is_terminal else Console(soft_wrap=True, width=160, emoji=False)


def print_camera(content: Any) -> None:
    """The camera's numbers, the verdict, and the views to take again."""
    console = output()
    used, whole = sum(view["used"] for view in content["views"]), len(content["views"]) + len(content["refusals"])
    console.print(f"{escape(content['board'])}: {used} of {whole} views used, rms {content['rms_px']:.7g} px")
    table = Table("", "value", "std. deviation", box=None, pad_edge=False)
    for name, entry in content["intrinsics"].items():
        table.add_row(name, f"{entry['value']:.7g}", f"{entry['sigma']:.2g}" if entry["free"] else "held")
    console.print(table)
    if content["note"]:
        console.print(escape(content["note"]))
    console.print(f"[bold]{content['grade']}[/bold]: {escape(content['summary'])}")
    for finding in content["findings"]:
        console.print(f"  - {escape(finding)}")
    again = "look at" if content["source"] == "corners" else "take again"
    for entry in content["retake"]:
        console.print(f"{again}: {escape(entry['view'])}: {escape(entry['why'])}")


def print_measured(measured: Any) -> None:
    """How many images were measured, where the camera was found, and every image that failed with its reason."""
    console = output()
    data = measured.data
    seen = len(data.only.features)
    console.print(f"{len(data)} images measured, up to {seen} points each")
    if measured.where:
        console.print(escape(measured.where))
    for name, reason in measured.failures:
        console.print(f"not measured: {escape(name)}: {escape(reason)}")
    for note in measured.notes:
        console.print(f"[bold]warning:[/bold] {escape(note)}")


def print_trials(content: Any) -> None:
    """The cells of a study, what it answers, and what to be careful with."""
    from symcal.trials.need import bounds, judged_words, label, millimetres

    console, asked = output(), content["question"]
    share = f"{100 * asked['share']:g} %"
    heads = ("cell", "trials", f"{judged_words(asked)}, median mm", f"in {share} at most mm", "95 % sure")
    table = Table(*heads, *(["within"] if asked["tolerance_mm"] is not None else []), box=None, pad_edge=False)
    for cell in content["cells"][:_CELLS]:
        found = cell["judged_mm"]["at_share"]
        median = cell["judged_mm"]["median"]["value"]
        cells = [label(cell, content["varied"]), str(cell["trials"]["ok"])]
        cells += [millimetres(median), millimetres(found["value"]), bounds(found)]
        within = cell["within"]
        table.add_row(*map(escape, cells), *([f"{100 * within['share']:.1f} %"] if within else []))
    console.print(table)
    if len(content["cells"]) > _CELLS:
        console.print(f"and {len(content['cells']) - _CELLS} cells more, in results.json")
    for answer in content["answers"][:_CELLS]:
        console.print(escape(answer["text"]))
    path, machine = content["identification"], content["machine"]
    because = f" because {path['because']}" if path["because"] else ""
    console.print(escape(f"identified {path['path']}{because}; {machine['kernels']} on {machine['processor']}"))
    for warning in content["warnings"]:
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


_CELLS = 40


def print_study(content: Any) -> None:
    """The paper's simulations: exact, and with noise against random plans and the paper's figures."""
    console = output()
    one, two = content["simulation_1"], content["simulation_2"]
    console.print(f"Simulation I: {one['position_error_mm'][-1]:.1e} mm after {one['iterations']} iterations")
    columns = ("mean mm", "max mm", "true rms mm", "expected mm", "/ Cramer-Rao", "beats random")
    table = Table("Simulation II, plan", *columns, box=None, pad_edge=False)
    for name, plan in two["plans"].items():
        again = plan["repetitions"]
        numbers = [again[key]["median"] for key in ("measured_mean_mm", "measured_max_mm", "true_rms_mm")]
        cells = [f"{value:.4f}" for value in (*numbers, plan["expected_rms_mm"], plan["true_rms_over_cramer_rao"])]
        table.add_row(name, *cells, f"{plan['beats_random_expected']:.1%}")
    for name, paper in two["paper"].items():
        table.add_row(f"paper, {name}", f"{paper['after']['mean_mm']:.4f}", f"{paper['after']['max_mm']:.4f}")
    console.print(table)
    console.print(f"medians of {two['repetitions']} repetitions; mean and max against noisy measurement")
    for warning in content["warnings"]:
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


def _learnt(seen: Any, found: Any) -> str:
    """What was seen and learnt, the noise, and how the fit ended, in a line."""
    from symcal.report.measured import noise_groups

    groups = noise_groups(found)
    named = any(group != each["quantity"] for group, each in groups.items())
    noise = [f"{f'{group} ' if named else ''}{each['sigma']:.3g} {each['unit']}" for group, each in groups.items()]
    parts = [
        f"{seen['rank']} of {seen['parameters']} directions seen",
        f"{found['effective_parameters']:.1f} parameters' worth learnt",
        *([f"noise {', '.join(noise)}"] if noise else []),
        found["message"],
    ]
    return "; ".join(parts)


def print_accuracy(content: Any) -> None:
    """Errors of every state on every set, those of every instrument where there are several, known values, warnings."""
    from symcal.report.decision import warnings_beside
    from symcal.report.measured import fitted_before

    console = output()
    seen, found = content.get("identifiability"), content.get("identification")
    if seen:
        if not found["converged"] and "decision" not in content:  # which says it
            console.print("[bold]the identification did not converge: its numbers must not be used[/bold]")
        console.print(escape(_learnt(seen, found)))
    console.print(_accuracy_table(content))
    if len(content.get("instruments", {})) > 1:
        console.print(_instrument_table(content["instruments"]))
    for line in _known(content.get("known", {})):
        console.print(escape(line))
    against = (
        f"errors against {content['against']}{', truth: against exact poses' if 'truth' in content['accuracy'] else ''}"
    )
    console.print(f"{against}; before: nominal kinematics with {fitted_before(content)} fitted on the training data")
    for warning in warnings_beside(content):
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


def print_frames(content: Any) -> None:
    """Where base and tool are, of a robot whose poses are data: what was asked for."""
    from symcal.words import GIVEN

    for name in ("base", "tool") if content["robot"]["name"] == GIVEN else ():
        xyz, rpy = (", ".join(f"{v:.4f}" for v in content["frames"][name][key]) for key in ("xyz_mm", "rpy_deg"))
        of = "base in world" if name == "base" else "tool on the flange"
        output().print(f"{of}: xyz ({xyz}) mm, rpy ({rpy}) deg", highlight=False)


def print_decision(content: Any) -> None:
    """Accepted, on what grounds, and with which cautions; what is refused ends the command with its reasons."""
    decision, console = content["decision"], output()
    if decision["accepted"]:
        console.print(f"[bold]accepted[/bold]{escape(decision['sentence'].removeprefix('accepted'))}")
    for caution in decision["cautions"]:
        console.print(f"[bold]caution:[/bold] {escape(caution)}")


def print_second(content: Any) -> None:
    """What a second calibration says of the recorded one, or why there is none, where no warning has said it."""
    decision, text = content["decision"], content["halves"]["text"]
    said = (*content["warnings"], *decision["cautions"], *(reason["text"] for reason in decision["reasons"]))
    if not any(text in each for each in said):
        output().print(escape(text))


def _accuracy_table(content: Any) -> Table:
    """Of the quantity that judges, and of attitudes: their column stands beside every position, as it always has."""
    from symcal.report.measured import POSITION, judged

    what = judged(content)
    rows = [
        (data, state, quantities)
        for data, states in content["accuracy"].items()
        for state, quantities in states.items()
        if isinstance(quantities, dict)
    ]
    turns = what.key == POSITION or any(quantities.get("orientation_deg") for *_, quantities in rows)
    heads = [f"{name} {what.unit}" for name in ("mean", "rms", "p95", "max")]
    table = Table("data", "state", *heads, *(["rms deg"] if turns else []), box=None, pad_edge=False)
    for data, state, quantities in rows:
        turn = quantities.get("orientation_deg")
        numbers = [f"{quantities[what.key][k]:.4g}" for k in ("mean", "rms", "p95", "max")]
        table.add_row(data, state, *numbers, *([f"{turn['rms']:.4g}" if turn else ""] if turns else []))
    return table


def _instrument_table(instruments: Any) -> Table:
    """Errors of every instrument in its own unit, before and after."""
    table = Table("instrument", "data", "state", "rms", "max", "unit", "count", box=None, pad_edge=False)
    for name, facts in instruments.items():
        for data, states in facts["accuracy"].items():
            for state in ("before", "after"):
                if state in states:
                    found = states[state]
                    numbers = f"{found['rms']:.4g}", f"{found['max']:.4g}"
                    table.add_row(escape(name), data, state, *numbers, facts["unit"], str(found["count"]))
    return table


def _known(known: Any) -> list[str]:
    """What is known between things and what it came out as, a line each."""
    from symcal.report.known import known_numbers

    lines = []
    for name, facts in known.items():
        (first, second), (value, sigma, found) = facts["between"], known_numbers(facts)
        check = "" if facts["used"] else " (took no part: a check)"
        lines.append(f"known {name}: {facts['type']} from {first} to {second} {value} +- {sigma}; found {found}{check}")
    return lines


_PROVEN = {"d_efficiency_lower_bound": "d_efficiency_lower_bound", "g_efficiency": "g_efficiency_lower_bound"}


def print_plan(content: Any) -> None:
    """How good a plan is, and how good random ones are."""
    from symcal.report.plan_verdict import plan_verdict
    from symcal.words import rounded_down

    console = output()
    console.print(escape(plan_verdict(content)[0]))
    proof = content["plan"]["certificate"].get("proof")
    found, random = content["plan"], content["plan"]["random"]
    table = Table("", "this plan", *(["random (median)"] if random else []), box=None, pad_edge=False)
    for key, label in (
        ("d_efficiency_lower_bound", "D-efficiency, at least"),
        ("g_efficiency", "G-efficiency"),
        ("mean_pose_rms_mm", "foretold error, mean, mm"),
        ("worst_pose_rms_mm", "foretold error, worst pose, mm"),
    ):
        cells = [found[key], *([random[key]] if random else [])]
        shown = rounded_down if key in _PROVEN else "{:.4g}".format
        sure = None if proof is None or key not in _PROVEN else proof[_PROVEN[key]]
        name = label if sure is None else f"{label} (searched)"
        table.add_row(name, *("-" if value is None else shown(value) for value in cells))
        if sure is not None:
            table.add_row(f"{label.split(',')[0]}, proven", rounded_down(sure), *(["-"] if random else []))
    console.print(table)
    _print_instruments(console, content.get("instruments", []))
    for warning in content["warnings"]:
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


def _print_instruments(console: Console, sets: Sequence[Any]) -> None:
    """What sets of instruments bring at the poses of a plan."""
    if not sets:
        return
    table = Table("instruments", "directions", "mean mm", "worst mm", "", box=None, pad_edge=False)
    for each in sets:
        if each["mean_mm"] is None:
            cells = ["-", "-", "-", escape(each["refused"])]
        else:
            note = "after one rigid alignment" if each["aligned"] else ""
            shown = [f"{each[key]:.4g}" for key in ("mean_mm", "worst_mm")]
            cells = [f"{each['rank']} of {each['parameters']}", *shown, note]
        table.add_row(escape(" + ".join(each["instruments"])), *cells)
    console.print(table)


def print_findings(findings: Any) -> None:
    """What an examination found, a line each: on a terminal as a table that breaks its lines, elsewhere as they are."""
    console = output()
    if not console.is_terminal:
        for each in findings:
            do = f" -> {each.do}" if each.do else ""
            console.print(f"{each.state:6}  {each.subject}: {each.found}{do}", markup=False, highlight=False)
        return
    looks = {"ok": "green", "note": "yellow", "broken": "bold red"}
    table = Table(box=None, pad_edge=False, show_header=False)
    for overflow in ("ellipsis", "ellipsis", "fold"):
        table.add_column(overflow=overflow)
    for each in findings:
        said = escape(each.found) + (f"\n[bold]{escape(each.do)}[/bold]" if each.do else "")
        table.add_row(f"[{looks[each.state]}]{each.state}[/]", escape(each.subject), said)
    console.print(table)


def print_robot(robot: Any) -> None:
    """A robot's links and limits, in mm and deg; its joint terms, and what it is known to weigh."""
    import numpy as np

    console = output()
    kinds = [k for k in ("theta", "d", "a", "alpha", "beta") if any(k in link.parameters for link in robot.links)]
    console.print(f"{escape(robot.name)}: {robot.dof} joints, {robot.convention} convention (rad shown in deg)")
    table = Table("link", "joint", "kind", "limits", *(f"{k} {'mm' if k in 'ad' else 'deg'}" for k in kinds), box=None)
    for i, link in enumerate(robot.links, start=1):
        joint = link.joint
        shown = [joint.lower, joint.upper]
        if joint.revolute:
            shown = np.rad2deg(shown).tolist()
        cells = [
            ""
            if k not in link.parameters
            else f"{link.parameters[k] if k in 'ad' else np.rad2deg(link.parameters[k]):.7g}"
            for k in kinds
        ]
        limits = f"{shown[0]:.6g} .. {shown[1]:.6g}" if np.isfinite(joint.lower) else "none"
        table.add_row(str(i), escape(joint.name), joint.kind, limits, *cells)
    console.print(table)
    _print_terms(console, robot)


def _print_terms(console: Console, robot: Any) -> None:
    """Joint terms with their numbers, and what gravity pulls at."""
    from symcal.joints.arm import Payload
    from symcal.robot.terms import DOWN
    from symcal.units import SHOWN
    from symcal.words import listed

    names = [joint.name for joint in robot.joints]
    if robot.terms:
        table = Table("joint", "term", "number", "value", "unit", "depends on", box=None)
        for term in robot.terms:
            words = [escape(names[term.joint - 1]), term.kind, escape(term.said)]
            for p in term.parameters:
                unit, factor = SHOWN[p.unit]
                table.add_row(*words[:2], p.name, f"{p.value * factor:.7g}", unit, words[2])
        console.print()
        console.print(table)
    carried = [f"{m.kg:g} kg on {[*names, 'the flange'][m.on - 1]}" for m in robot.masses]
    carried += [f"a payload of {robot.payload.kg:g} kg"] if robot.payload != Payload() else []
    facts = [f"gravity along ({', '.join(f'{v:g}' for v in robot.down)}) of the base"] if robot.down != DOWN else []
    facts += [f"masses: {escape(listed(carried))}"] if carried else []
    if facts:
        console.print("; ".join(facts))


def print_compensation(result: Any) -> None:
    table = result.table()
    counts = table["status"].value_counts()
    console = output()
    console.print(
        f"{len(table)} targets: " + ", ".join(f"{count} {escape(str(status))}" for status, count in counts.items())
    )


def print_check(found: Any, data: Sequence[str] = ()) -> None:
    """Pose at zero and what measurements can see; then what is said about the measurements that are there."""
    import numpy as np

    from symcal.spatial import matrix_rpy

    console = output()
    pose = found.pose_at_zero
    xyz = ", ".join(f"{v:.6f}" for v in pose[:3, 3])
    rpy = ", ".join(f"{v:.6f}" for v in np.rad2deg(matrix_rpy(pose[:3, :3])))
    console.print(f"\ntool in world with all readings at zero: xyz ({xyz}) mm, rpy ({rpy}) deg")
    for name, seen in found.seen.items():
        console.print(f"\n{escape(name)}: {seen.numerical_rank} of {len(seen.names)} parameter directions can be seen")
        for direction in seen.unseen():
            console.print(f"  - {escape(direction.text)}")
    if found.instruments:
        console.print()
        console.print(_added_table(found.instruments))
    for line in data:
        console.print(f"\nmeasurements: {escape(line)}")
    for note in found.notes:
        console.print(f"[bold]warning:[/bold] {escape(note)}")


def _added_table(instruments: Any) -> Table:
    """What every instrument reads of what, and what it adds to the rank of those before it."""
    heads = ("instrument", "on", "reads", "of", "unknown", "rows per pose", "rank alone", "rank added")
    table = Table(*heads, box=None, pad_edge=False)
    for each in instruments:
        words = (each.name, each.on, each.reads, each.of, _in_short(each.unknown))
        table.add_row(*map(escape, words), str(each.rows), str(each.alone), str(each.added))
    return table


def _in_short(names: Sequence[str]) -> str:
    """Names of parameters, the axes of one frame together: `tracker (x, y, z), wire_offset`."""
    from symcal.parameters import FRAME_AXES

    frames: dict[str, list[str]] = {}
    for name in names:
        of, _, axis = name.rpartition("_")
        frames.setdefault(of if of and axis in FRAME_AXES else name, []).append(axis)
    return ", ".join(of if of in names else f"{of} ({', '.join(axes)})" for of, axes in frames.items())
