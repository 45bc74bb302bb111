"""What commands say in the terminal: a spinner while they work, short tables when they are done."""

from __future__ import annotations

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


def output() -> Console:
    """The terminal; elsewhere lines are wide enough for the tables."""
    console = Console(soft_wrap=True)
    return console if console.is_terminal else Console(soft_wrap=True, width=160)


def print_camera(content: Any) -> None:
    """The camera's numbers, the verdict, and the views to take again."""
    console = output()
    table = Table("", "value", "std. deviation", box=None, pad_edge=False)
    for name, entry in content["intrinsics"].items():
        table.add_row(name, f"{entry['value']:.7g}", f"{entry['sigma']:.2g}" if entry["free"] else "held")
    console.print(table)
    console.print(f"[bold]{content['grade']}[/bold]: {escape(content['summary'])}")
    for finding in content["findings"]:
        console.print(f"  - {escape(finding)}")
    for entry in content["retake"]:
        console.print(f"take again: {escape(entry['view'])}: {escape(entry['why'])}")


def print_measured(measured: Any) -> None:
    """How many images were measured, where the camera was found, and every image that failed with its reason."""
    console = output()
    data = measured.data
    seen = data.z.shape[1] // 2
    console.print(f"{len(data)} images measured, up to {seen} points each")
    if measured.found:
        x, y, z = measured.T_world_camera[:3, 3]
        console.print(f"the camera was found at ({x:.0f}, {y:.0f}, {z:.0f}) mm in world, by the nominal robot")
    for name, reason in measured.failures:
        console.print(f"not measured: {escape(name)}: {escape(reason)}")
    for note in measured.notes:
        console.print(f"[bold]warning:[/bold] {escape(note)}")


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
    noise = [
        f"{found[key]:.3g} {unit}"
        for key, unit in (("noise_sigma_mm", "mm"), ("noise_sigma_deg", "deg"), ("noise_sigma_px", "px"))
        if found.get(key) is not None
    ]
    parts = [
        f"{seen['rank']} of {seen['parameters']} directions seen",
        f"{found['effective_parameters']:.1f} parameters' worth learnt",
        *([f"noise {', '.join(noise)}"] if noise else []),
        found["message"],
    ]
    return "; ".join(parts)


def print_accuracy(content: Any) -> None:
    """Errors of every state on every set, and the warnings."""
    console = output()
    seen, found = content.get("identifiability"), content.get("identification")
    if seen:
        if not found["converged"]:
            console.print("[bold]the identification did not converge: its numbers must not be used[/bold]")
        console.print(escape(_learnt(seen, found)))
    table = Table("data", "state", "mean mm", "rms mm", "p95 mm", "max mm", "rms deg", box=None, pad_edge=False)
    for data, states in content["accuracy"].items():
        for state, quantities in states.items():
            if isinstance(quantities, dict):
                p = quantities["position_mm"]
                turn = quantities.get("orientation_deg")
                numbers = [f"{p[k]:.4g}" for k in ("mean", "rms", "p95", "max")]
                table.add_row(data, state, *numbers, f"{turn['rms']:.4g}" if turn else "")
    console.print(table)
    against = (
        f"errors against {content['against']}{', truth: against exact poses' if 'truth' in content['accuracy'] else ''}"
    )
    console.print(f"{against}; before: nominal kinematics with base and tool fitted on the training data")
    for warning in content["warnings"]:
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


def print_plan(content: Any) -> None:
    """How good a plan is, and how good random ones are."""
    from symcal.report.plan_verdict import plan_verdict

    console = output()
    console.print(escape(plan_verdict(content)[0]))
    found, random = content["plan"], content["plan"]["random"]
    table = Table("", "this plan", *(["random (median)"] if random else []), box=None, pad_edge=False)
    for key, label in (
        ("d_efficiency_lower_bound", "D-efficiency, at least"),
        ("g_efficiency", "G-efficiency"),
        ("mean_pose_rms_mm", "foretold error, mean, mm"),
        ("worst_pose_rms_mm", "foretold error, worst pose, mm"),
    ):
        cells = [found[key], *([random[key]] if random else [])]
        table.add_row(label, *("-" if value is None else f"{value:.4g}" for value in cells))
    console.print(table)
    for warning in content["warnings"]:
        console.print(f"[bold]warning:[/bold] {escape(warning)}")


def print_robot(robot: Any) -> None:
    """A robot's links and limits, in mm and deg."""
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
        console.print(f"\n{name}: {seen.numerical_rank} of {len(seen.names)} parameter directions can be seen")
        for direction in seen.unseen():
            console.print(f"  - {direction.text}")
    for line in data:
        console.print(f"\nmeasurements: {escape(line)}")
    for note in found.notes:
        console.print(f"[bold]warning:[/bold] {escape(note)}")
