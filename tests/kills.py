"""Commands killed at random moments and at every step that they take in the file system, and many into one folder.

    python tests/kills.py [N] [COMMAND...]

N kills at random moments, 200 if not said, shared by the commands; and at every command's steps in the file system,
evenly chosen where there are more than `STEPS` (fewer where figures are drawn): with an exchange of folders and, where
a folder is made, with two renames as on file systems that have no exchange. After each kill there is whole what was
there before or what is new; the next command into the same place finds it, and leaves nothing beside it. The commands
run in children that have loaded everything, so that a random moment falls into their work and not into the imports; at
steps what they compute, which takes no step, is computed once.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from camera_scenes import ROBOT, T_WORLD_CAMERA, TRUTH, poses, small_camera, target, target_poses
from cases import TABLE_III
from interrupted import cannot_exchange, count_steps, kill_after, kill_at, together
from measured_arms import measure, write_experiment
from test_cli_handover import calibrated

import symcal.compensation.compensate as compensation
from symcal.camera.files import write_camera, write_target
from symcal.compensation.targets import read_targets
from symcal.export import export_robot
from symcal.model.model import build_model
from symcal.model.task import Scene, pixels_task
from symcal.outputs import whole_folder
from symcal.outputs.manifest import MANIFEST, foreign_files
from symcal.outputs.whole_folder import recover
from symcal.robot.files import load_robot, save_robot
from symcal.runs import identification_folder
from symcal.runs import measure as measuring
from symcal.runs import plan as planning
from symcal.runs.measure import measure_files
from symcal.runs.plan import run_plan
from symcal.runs.run import run
from symcal.vision.render import render_discs

CONFIGS = Path(__file__).resolve().parent.parent / "configs"
STEPS = 60
QUIET = ("outputs.figures=false", "outputs.report=false")
C_MANIFEST = "symcal_export.json"


@dataclass(frozen=True)
class Command:
    """A command of the program, as `work(inputs, out, seed)`: into the folder out, differently by seed.

    made: the names in `out` that it makes. computed: (module, name) of what it computes without a step, by `computing`
        (the work itself if not said) once and for all. steps: how many of its steps at most.
    """

    work: Callable[[Path, Path, int], object]
    made: tuple[str, ...]
    computed: tuple[tuple[Any, str], ...] = ()
    steps: int = STEPS
    computing: Callable[[Path, Path, int], object] | None = None


def _run(figures: bool) -> Callable[[Path, Path, int], object]:
    few = ("plan.poses=14", "data.test_poses=10", *(() if figures else QUIET))
    return lambda _, out, seed: run(CONFIGS / "simulated_arm.yaml", out / "run", seed=seed, overrides=few)


def _identify(inputs: Path, out: Path, seed: int) -> None:
    run(inputs / "experiment.yaml", out / "run", seed=seed, overrides=QUIET, data=inputs / "data.csv", study=False)


def _plan(_: Path, out: Path, seed: int) -> None:
    few = ("plan.method=random", "plan.compare=[]", "plan.poses=20", *QUIET)
    run_plan(CONFIGS / "plan_position.yaml", out / "run", seed=seed, overrides=few)


def _export(to: str) -> Callable[[Path, Path, int], object]:
    return lambda inputs, out, seed: export_robot(load_robot(inputs / f"calibrated{seed}.yaml"), to, out, force=True)


def _compensate(inputs: Path, out: Path, seed: int) -> None:
    robot = load_robot(inputs / f"calibrated{seed}.yaml")
    targets = read_targets(inputs / "targets.csv", robot, "base")
    compensation.write_joints(compensation.compensate(robot, targets, np.random.default_rng(0)), out / "joints.csv")


def _measure(inputs: Path, out: Path, seed: int) -> None:
    files = {name: inputs / f"{name}.yaml" for name in ("camera", "target", "scene")}
    files["robot"] = inputs / "seen.yaml"
    measure_files([inputs / "images"], joints=inputs / f"joints{seed}.csv", out=out / "measurements.csv", **files)


IDENTIFY, PLAN = (identification_folder, "identify_experiment"), (planning, "plan_experiment")
COMMANDS = {
    "run": Command(_run(False), ("run",), (IDENTIFY,)),
    "run with figures": Command(_run(True), ("run",), (IDENTIFY,), steps=10, computing=_run(False)),
    "identify": Command(_identify, ("run",), (IDENTIFY,)),
    "plan": Command(_plan, ("run",), (PLAN,)),
    "export json": Command(_export("json"), ("robot.json", "corrections.csv")),
    "export urdf": Command(_export("urdf"), ("robot.urdf",)),
    "export c": Command(_export("c"), ("c",)),
    "compensate": Command(_compensate, ("joints.csv",), ((compensation, "compensate"),)),
    "measure": Command(_measure, ("measurements.csv",), ((measuring, "measure_images"),)),
}


def write_inputs(folder: Path) -> None:
    """What the commands read: an experiment with its data, two calibrated robots, targets, two images."""
    write_experiment(measure("puma", "standard", np.random.default_rng(5), 25, 10), folder, "long")
    for seed in (1, 2):
        errors = {name: seed * error for name, error in TABLE_III.items()}
        save_robot(calibrated(errors), folder / f"calibrated{seed}.yaml")
    rows = [f"{i},{900 + i},{100 + i},60,{i}" for i in range(50)]
    (folder / "targets.csv").write_text("\n".join(["q1_deg,q2_mm,q3_mm,q4_deg,q5_deg", *rows]) + "\n")
    lens = small_camera()
    model = build_model(ROBOT, pixels_task(Scene(lens, target(), T_WORLD_CAMERA), ("tool", "camera")))
    q = poses(model, 2, np.random.default_rng(6))
    (folder / "images").mkdir()
    for i, pose in enumerate(target_poses(model, q, model.parameters.vector(TRUTH), model.setup)):
        cv2.imwrite(str(folder / "images" / f"{i}.png"), render_discs(lens, target(), pose, np.random.default_rng(i)))
    for seed in (1, 2):
        lines = [",".join([f"{i}.png", f"pose {seed} {i}", *map(repr, map(float, q[i]))]) for i in range(len(q))]
        (folder / f"joints{seed}.csv").write_text("\n".join(["image,pose,q1_rad,q2_mm,q3_mm,q4_rad,q5_rad", *lines]))
    (folder / "scene.yaml").write_text(
        "units: {length: m, angle: deg}\ncamera: {position: [0.1, 2.7, 1.15], look_at: [0.1, 0, 1.15]}\n"
    )
    write_camera(folder / "camera.yaml", lens)
    write_target(folder / "target.yaml", target())
    save_robot(ROBOT, folder / "seen.yaml")  # beside robot.yaml of the experiment


def mark(path: Path) -> str:
    """What is there, told from one number: the seed of a run's folder, else a hash; it must be whole."""
    if not path.exists():
        return "nothing"
    if not path.is_dir():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    run_made = (path / MANIFEST).exists()
    foreign = foreign_files(path, MANIFEST if run_made else C_MANIFEST)
    assert not foreign, f"{path} is not whole: {foreign}"
    if run_made:
        return str(json.loads((path / "results.json").read_text())["seed"])
    return hashlib.sha256((path / C_MANIFEST).read_bytes()).hexdigest()


class Kills:
    """The kills of one command: what it does, into a folder beside its inputs, and what was found after each."""

    def __init__(self, name: str, inputs: Path) -> None:
        self.name, self.command, self.inputs = name, COMMANDS[name], inputs
        self.folder = Path(tempfile.mkdtemp(prefix="out", dir=inputs.parent))
        self.found: Counter[str] = Counter()
        self.models = {}
        for seed in (1, 2):
            self.models[seed] = self.folder / f"model{seed}"
            self.models[seed].mkdir()
            # in a child: what draws the report has threads of its own, which a fork would not take along
            assert together([lambda seed=seed: self.command.work(inputs, self.models[seed], seed)]) == [0]
        self.marks = {seed: [mark(self.models[seed] / name) for name in self.command.made] for seed in (1, 2)}
        assert all(a != b for a, b in zip(self.marks[1], self.marks[2], strict=True))
        self.out = self.folder / "out"

    def fresh(self) -> None:
        """What the first seed made."""
        shutil.rmtree(self.out, ignore_errors=True)
        shutil.copytree(self.models[1], self.out)

    def work(self) -> None:
        self.command.work(self.inputs, self.out, 2)

    def in_child(self) -> None:
        assert together([self.work]) == [0]

    def after(self, killed: bool, next_command: Callable[[], object]) -> None:
        """Look at what a kill left, and at what the next command leaves."""
        for i, made in enumerate(self.command.made):
            now, old, new = mark(self.out / made), self.marks[1][i], self.marks[2][i]
            assert now in (old, new, "nothing"), f"{made} is neither old nor new"
            self.found["old" if now == old else "new" if now == new else "found by the next"] += 1
            if now == "nothing":
                assert whole_folder.exchange is cannot_exchange, "there is no folder"
                recover(self.out / made)
                assert mark(self.out / made) == old, "the old folder is lost"
        self.found["killed"] += killed
        next_command()
        left = sorted(p.name for p in self.out.iterdir())
        assert left == sorted(self.command.made), f"left: {left}"
        for i, made in enumerate(self.command.made):
            assert mark(self.out / made) == self.marks[2][i]

    @contextmanager
    def computed(self) -> Iterator[None]:
        """Let what the command computes be computed once."""
        kept: dict[str, Any] = {}
        before = [(module, name, getattr(module, name)) for module, name in self.command.computed]
        for module, name, function in before:

            def once(*arguments: Any, _name: str = name, _function: Any = function, **named: Any) -> Any:
                if _name not in kept:
                    kept[_name] = _function(*arguments, **named)
                return kept[_name]

            setattr(module, name, once)
        try:
            yield
        finally:
            for module, name, function in before:
                setattr(module, name, function)

    def at_steps(self) -> str:
        """Killed at its steps."""
        with self.computed():
            self.fresh()
            (self.command.computing or self.command.work)(self.inputs, self.out, 2)
            self.fresh()
            steps = count_steps(self.work, self.out)
            chosen = sorted({int(i) for i in np.linspace(0, steps - 1, min(steps, self.command.steps))})
            for step in chosen:
                self.fresh()
                assert kill_at(self.work, step, self.out)
                self.after(True, self.in_child)
        return self.told(f"at {len(chosen)} of {steps} steps")

    def at_random(self, count: int, rng: np.random.Generator) -> str:
        """Killed at random moments, of a time that is measured."""
        self.fresh()
        start = time.monotonic()
        assert together([self.work]) == [0]
        duration = time.monotonic() - start
        for moment in rng.uniform(0, duration, count):
            self.fresh()
            self.after(kill_after(self.work, moment), self.in_child)
        return self.told(f"at {count} random moments within {duration:.2f} s")

    def at_once(self, processes: int = 4, rounds: int = 3) -> str:
        """Several into one place at the same time, while somebody looks whether it is there."""
        self.fresh()
        done, looks, absent = threading.Event(), 0, 0

        def look() -> None:
            nonlocal looks, absent
            while not done.is_set():
                absent += not all(os.path.lexists(self.out / made) for made in self.command.made)
                looks += 1

        looker = threading.Thread(target=look)
        looker.start()
        for _ in range(rounds):
            works = [lambda seed=1 + i % 2: self.command.work(self.inputs, self.out, seed) for i in range(processes)]
            assert together(works) == [0] * processes, "a command failed beside others"
        done.set()
        looker.join()
        for i, made in enumerate(self.command.made):
            assert mark(self.out / made) in (self.marks[1][i], self.marks[2][i])
        assert sorted(p.name for p in self.out.iterdir()) == sorted(self.command.made)
        assert absent == 0 or whole_folder.exchange is cannot_exchange
        return f"{self.name}, {rounds} times {processes} at once: whole; absent in {absent} of {looks} looks"

    def told(self, how: str) -> str:
        found, self.found = self.found, Counter()
        return f"{self.name}, killed {how}: {dict(found)}"


def main(count: int, names: list[str]) -> None:
    """Print a line for every command and way; an error ends it."""
    rng = np.random.default_rng(count)
    exchange = whole_folder.exchange
    with tempfile.TemporaryDirectory(prefix="symcal-kills-") as place:
        inputs = Path(place) / "inputs"
        inputs.mkdir()
        write_inputs(inputs)
        for i, name in enumerate(names):
            kills = Kills(name, inputs)
            for way in (exchange, cannot_exchange) if kills.command.made[0] in ("run", "c") else (exchange,):
                whole_folder.exchange = way
                words = " without an exchange" if way is cannot_exchange else ""
                own = (count + i) // len(names)  # so that all together are as many as asked for
                for line in (
                    kills.at_steps(),
                    *([kills.at_random(own, rng)] if way is exchange and own else []),
                    kills.at_once(),
                ):
                    sys.stdout.write(f"{line}{words}\n")
                    sys.stdout.flush()
            whole_folder.exchange = exchange


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200, sys.argv[2:] or list(COMMANDS))
