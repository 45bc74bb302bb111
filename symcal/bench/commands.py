"""Whole commands as a user types them, each in a process of its own, and what it costs peers to be imported."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from symcal.bench.arms import handling_robot, random_errors
from symcal.bench.contest import LEFT_OUT, Progress
from symcal.bench.machine import version
from symcal.bench.processes import Ended, run_process, symcal_command
from symcal.bench.rounds import quartiles
from symcal.documents.document import write_document
from symcal.robot.files import save_robot

SUBJECT = "commands"

ALONE = "python, nothing imported"
_IMPORTS = {"jax": "jax", "pin": "pinocchio", "figaroh": "figaroh.calibration"}


def run(rounds: int, progress: Progress, *, slow: bool) -> dict[str, Any]:
    """Every command in turn, ``rounds`` times after one that is not measured; ``slow``: with identifications too."""
    with tempfile.TemporaryDirectory(prefix="symcal-bench-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        commands, absent = _commands(_experiment(folder), folder, slow=slow)
        found: dict[str, list[Ended]] = {}
        for who, command in commands.items():
            progress(f"commands: {who}")
            first = run_process(command, folder=folder)
            if first.status == 0:
                found[who] = []
            else:
                last = first.said.splitlines()[-1] if first.said else "no word"
                absent[who] = f"ended with {first.status}: {last.strip(' │')[:200]}"
        for _ in range(rounds):
            for who, ends in found.items():
                progress(f"commands: {who}")
                ends.append(run_process(commands[who], folder=folder))
    return {
        "subject": SUBJECT,
        "name": "whole commands, with the start of their process, caches warm",
        "size": 1,
        "unit": "command",
        "reference": ALONE,
        "compared": "nothing",
        "entries": [_entry(who, ends, found[ALONE]) for who, ends in found.items()],
        "absent": absent,
    }


def _entry(who: str, ends: list[Ended], alone: list[Ended]) -> dict[str, Any]:
    wall = np.array([end.wall for end in ends])
    cpu = [end.cpu for end in ends]
    peaks = [end.peak for end in ends if end.peak is not None]
    return {
        "name": who,
        "what": "",
        "difference": 0.0,
        # processor time where the system tells it, as everywhere
        "seconds": quartiles(wall if None in cpu else np.array(cpu, dtype=float)),
        "wall": quartiles(wall),
        "rounds": len(ends),
        "ratio": quartiles(np.array([a.wall / b.wall for a, b in zip(alone, ends, strict=True)])),
        "peak_mb": max(peaks) if peaks else None,
    }


def _commands(experiment: Path, folder: Path, *, slow: bool) -> tuple[dict[str, list[str]], dict[str, str]]:
    def python(code: str) -> list[str]:
        return [sys.executable, "-c", code]

    identify = ("identify", str(experiment), "--quiet", "--out", str(folder / "run"))
    commands = {
        ALONE: python("pass"),
        "import numpy, casadi": python("import numpy, casadi"),
        "import symcal, load_robot": python("import symcal; symcal.load_robot"),
        "symcal --help": symcal_command("--help"),
        "symcal check": symcal_command("check", str(experiment)),
        "symcal identify --no-report": symcal_command(*identify, "--no-report"),
        "symcal identify": symcal_command(*identify),
    }
    absent = {}
    if not slow:
        for who in ("symcal identify --no-report", "symcal identify"):
            del commands[who]
            absent[who] = LEFT_OUT
    for package, module in _IMPORTS.items():
        who = f"import {module}"
        if version(package) is None:
            absent[who] = "not installed"
        elif slow:
            commands[who] = python(f"import {module}")
        else:
            absent[who] = LEFT_OUT
    return commands, absent


def _experiment(folder: Path) -> Path:
    """Simulated positions of the handling robot, 40 to learn from and 200 to judge by, with base and tool unknown."""
    robot = handling_robot()
    save_robot(robot, folder / "robot.yaml")
    names = tuple(robot.link_parameters)
    errors = random_errors(names, np.random.default_rng(3))
    write_document(
        folder / "experiment.yaml",
        {
            "schema": "symcal/experiment/1",
            "name": "bench",
            "seed": 1,
            "units": {"length": "mm", "angle": "deg"},
            "robot": "robot.yaml",
            "measurement": {"type": "position", "points": {"P": [40, 0, 60]}, "estimate": ["base", "tool"]},
            "plan": {"poses": 40},
            "data": {
                "source": "simulated",
                "truth": {
                    "units": {"length": "mm", "angle": "rad"},
                    "errors": {name: float(value) for name, value in zip(names, errors, strict=True)},
                },
                "noise": {"distribution": "normal", "position": 0.05},
                "test_poses": 200,
            },
        },
    )
    return folder / "experiment.yaml"
