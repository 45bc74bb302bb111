"""Small studies for tests, and a process that kills itself half way through one.

python tests/studies.py FOLDER [SECONDS]     the long form: a study killed at random moments until it is whole
"""

# ruff: noqa: T201

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

CONFIGS = Path(__file__).resolve().parent.parent / "configs"

STUDY = """\
schema: symcal/study/1
kind: study
name: small
seed: 5
experiment: {experiment}
repetitions: {repetitions}
vary: {vary}
identification: {identification}
judge: {judge}
outputs: {{report: false, figures: false}}
"""


def write_study(
    folder: Path,
    repetitions: int = 40,
    vary: str = "{poses: [12, 20], errors: [fixed, drawn]}",
    judge: str = "{test_poses: 50}",
    identification: str = "{noise: known}",
    experiment: str | Path = CONFIGS / "simulated_arm.yaml",
) -> Path:
    """A study of the simulated arm in a folder."""
    path = folder / "study.yaml"
    words = {"vary": vary, "judge": judge, "identification": identification, "experiment": experiment}
    path.write_text(STUDY.format(repetitions=repetitions, **words))
    return path


DYING = """\
import os, signal, sys
from pathlib import Path
from symcal.trials.study import Execution, run_study

def advance(done, total):
    if done >= total * {share}:
        os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":
    run_study(Path({study!r}), Path({out!r}), execution=Execution(2, shard=8), advance=advance)
"""


def killed_half_way(study: Path, out: Path, share: float = 0.5) -> int:
    """Run a study with two workers in a process that SIGKILL ends when a share of it is kept; its exit status."""
    script = DYING.format(study=str(study), out=str(out), share=share)
    return subprocess.run([sys.executable, "-c", script], check=False).returncode


def main(folder: Path, seconds: float) -> None:
    """Kill the whole study of Simulation II again and again; its table must be that of an undisturbed one."""
    study, whole, broken = CONFIGS / "study_simulation_2.yaml", folder / "whole", folder / "broken"
    command = [sys.executable, "-m", "symcal.cli", "study", str(study), "--workers", "2", "--no-report", "--quiet"]
    subprocess.run([*command, "--out", str(whole)], check=True)
    kills = 0
    while True:
        process = subprocess.Popen([*command, "--out", str(broken)])
        until = time.monotonic() + random.uniform(0.3, 1.0) * seconds
        while process.poll() is None and time.monotonic() < until:
            time.sleep(0.02)
        if process.poll() is not None:
            break
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        kills += 1
    assert process.returncode == 0, process.returncode
    same = (whole / "trials.csv").read_bytes() == (broken / "trials.csv").read_bytes()
    print(f"{kills} kills; the table is {'the same' if same else 'ANOTHER'}")
    sys.exit(not same)


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 8.0)
