"""What every config gives, recorded: so that rebuilding the house changes no number. Long form of test_goldens.py.

    python tests/goldens.py record [names]     writes tests/goldens/<name>.json
    python tests/goldens.py check [names]      runs the configs again and compares

Identification numbers agree to 1e-6 relative or 1e-9 absolute (singular values: of the largest), plans by certificate
and forecast to 0.1 %, terminal tables letter by letter.
"""

from __future__ import annotations

import io
import json
import math
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

ROOT = Path(__file__).resolve().parents[1]
FOLDER = Path(__file__).with_name("goldens")
REAL = tuple(f"real/{path.stem}" for path in sorted((ROOT / "configs" / "real").glob("*.yaml")))
RUNS = (*REAL, "simulated_arm", "vision", "handling_robot")
PLANS = ("plan_position", "plan_fr3", "plan_camera")
QUICK = ("real/franka_fr3", "real/tiago_mocap", "real/two_axis_positioner", "simulated_arm")
PLAIN = ("outputs.report=false", "outputs.figures=false", "outputs.c=false")

_NUMBERS = ("identification", "identifiability", "accuracy", "frames", "expected_position_rms_mm", "simulation_2")
_FORECAST = (
    "d_efficiency_lower_bound",
    "g_efficiency",
    "mean_pose_rms_mm",
    "worst_pose_rms_mm",
    "rank",
)


def key(name: str) -> str:
    return name.replace("/", "_")


def observed(name: str) -> dict[str, Any]:
    """The numbers and the terminal's table of a config, run now."""
    from rich.console import Console

    from symcal.cli import terminal
    from symcal.runs.plan import run_plan
    from symcal.runs.run import run

    path = ROOT / "configs" / f"{name}.yaml"
    text = io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        if name in PLANS:
            _, content = run_plan(path, Path(folder) / "out", overrides=PLAIN[:2])
            return {"plan": {figure: content["plan"][figure] for figure in _FORECAST}}
        _, content = run(path, Path(folder) / "out", overrides=PLAIN)
    with mock.patch.object(terminal, "output", return_value=Console(file=text, width=160, soft_wrap=True)):
        (terminal.print_study if "simulation_2" in content else terminal.print_accuracy)(content)
    numbers = {part: content[part] for part in _NUMBERS if part in content}
    numbers.get("identifiability", {}).pop("unseen", None)  # a choice of words, and of a basis
    decision = content["decision"]["sentence"]
    return json.loads(json.dumps({"table": text.getvalue().splitlines(), "decision": decision, **numbers}))


def differences(golden: Any, found: Any, where: str = "") -> Iterator[str]:
    """Where two records differ by more than they may."""
    if isinstance(golden, dict) and isinstance(found, dict):
        for name in golden:
            if name not in found:
                yield f"{where}.{name} is gone"
            else:
                yield from differences(golden[name], found[name], f"{where}.{name}")
    elif isinstance(golden, list) and isinstance(found, list):
        if len(golden) != len(found):
            yield f"{where}: {len(golden)} entries became {len(found)}"
        largest = max((abs(v) for v in golden if isinstance(v, float)), default=0.0)
        for i, (a, b) in enumerate(zip(golden, found, strict=False)):
            if where.endswith("singular_values"):
                if abs(a - b) > 1e-6 * largest:
                    yield f"{where}[{i}]: {a} became {b}"
            else:
                yield from differences(a, b, f"{where}[{i}]")
    elif isinstance(golden, float) and isinstance(found, float | int):
        relative = 1e-3 if where.startswith(".plan") else 1e-6
        if not math.isclose(golden, found, rel_tol=relative, abs_tol=1e-9):
            yield f"{where}: {golden} became {found}"
    elif golden != found and not where.endswith((".message", ".iterations")):
        yield f"{where}: {golden!r} became {found!r}"


def compare(name: str) -> list[str]:
    """What is no longer as it was recorded."""
    golden = json.loads((FOLDER / f"{key(name)}.json").read_text(encoding="utf-8"))
    found = observed(name)
    for record in (golden, found):  # how a solver put its last step into words is no number
        record["table"] = [line.split("; converged")[0] for line in record.get("table", [])]
    return list(differences(golden, found))


def main(what: str, names: tuple[str, ...]) -> int:
    os.environ.setdefault("SYMCAL_DATA", str(ROOT.parent / "shared" / "data"))
    bad = 0
    for name in names or RUNS + PLANS:
        if what == "record":
            FOLDER.mkdir(exist_ok=True)
            (FOLDER / f"{key(name)}.json").write_text(json.dumps(observed(name), indent=1) + "\n", encoding="utf-8")
            sys.stdout.write(f"{name}: recorded\n")
        else:
            found = compare(name)
            bad += bool(found)
            sys.stdout.write("\n".join([f"{name}: {len(found) or 'no'} differences", *found[:20], ""]))
        sys.stdout.flush()
    return bad


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], tuple(sys.argv[2:])))
