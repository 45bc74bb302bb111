"""What issue 16 asks of speed and scale, line by line: bound, measured, met or not; ten minutes on a quiet machine.

python tests/bench_acceptance.py --old CHECKOUT [--only fr3,study] [--rounds 5] [--data FOLDER]

Seconds in the bounds are of a machine on which the version before takes 5 s for the FR3 set and 30 s for the study of
the handling robot. Where ``--old`` names a checkout of that version it is measured in turn with this one, and bounds in
seconds are scaled by what it took; without it they hold as they are. A part that this version lacks says 'not there'.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median

from symcal.bench.processes import run_process

ROOT = Path(__file__).resolve().parent.parent
FR3_S, HANDLING_S = 5.0, 30.0  # of the version before, on the machine that the bounds are of

PROBES = Path(__file__).resolve().parent / "bench_probes.py"


@dataclass(frozen=True)
class Line:
    """bound: as text. measured: as text. met: None where nothing was measured."""

    what: str
    bound: str
    measured: str
    met: bool | None


@dataclass(frozen=True)
class Run:
    """Of one process. said: the end of its standard error. out: what it printed."""

    status: int
    wall: float
    cpu: float
    said: str
    out: str


@dataclass(frozen=True)
class Setting:
    old: Path | None
    rounds: int
    data: str
    scratch: Path

    def new(self, *arguments: str, **more: str) -> Run:
        return process(ROOT, ("-m", "symcal.cli", *arguments), self.environment(ROOT) | more)

    def before(self, *arguments: str) -> Run:
        assert self.old is not None
        return process(self.old, ("-m", "symcal.cli", *arguments), self.environment(self.old))

    def probe(self, *arguments: str, where: Path = ROOT, **more: str) -> Run:
        """One of `bench_probes.py`, on this version or another."""
        return process(where, (str(PROBES), *arguments), self.environment(where) | more)

    def environment(self, where: Path) -> dict[str, str]:
        return {"PYTHONPATH": str(where), "SYMCAL_DATA": self.data, "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}

    def out(self) -> tuple[str, str]:
        return "--out", str(Path(tempfile.mkdtemp(dir=self.scratch)) / "run")


def process(folder: Path, arguments: tuple[str, ...], environment: dict[str, str]) -> Run:
    """Python on arguments, in a folder."""
    with tempfile.NamedTemporaryFile("r") as printed:
        ended = run_process([sys.executable, *arguments], environment, folder, Path(printed.name))
        return Run(ended.status, ended.wall, ended.cpu or 0.0, ended.said or "no word", printed.read())


def least(wanted: float, found: float, what: str, unit: str = "") -> Line:
    return Line(what, f">= {wanted:g}{unit}", f"{found:.4g}{unit}", found >= wanted)


def most(wanted: float, found: float, what: str, unit: str = " s", note: str = "") -> Line:
    return Line(what, f"<= {wanted:.3g}{unit}", f"{found:.4g}{unit}{note}", found <= wanted)


def absent(what: str, why: str = "not there") -> Line:
    return Line(what, "", why.splitlines()[-1][:110], None)


def in_turn(rounds: int, *runs: Callable[[], Run]) -> list[list[Run]]:
    """Each once unmeasured, which warms caches, then all of them in turn."""
    first = [run() for run in runs]
    if any(run.status for run in first):
        return [[run] for run in first]
    return [list(column) for column in zip(*([run() for run in runs] for _ in range(rounds)), strict=True)]


def wall(runs: list[Run]) -> float:
    return median(run.wall for run in runs)


def bounded(what: str, bound: float, scale: float, runs: list[Run], before: list[Run] | None = None) -> Line:
    if runs[0].status:
        return absent(what, f"ended with {runs[0].status}: {runs[0].said}")
    note = f" (processor {median(run.cpu for run in runs):.3g} s"
    note += ")" if before is None else f", before {wall(before):.3g} s)"
    return most(bound * scale, wall(runs), what, note=note)


FR3 = "configs/real/franka_fr3.yaml"


@cache
def fr3_scale(s: Setting) -> float:
    """How much slower this machine is than that of the bounds, by the version before on the FR3 set."""
    if s.old is None or not s.data:
        return 1.0
    (runs,) = in_turn(max(1, s.rounds // 2), lambda: s.before("identify", FR3, "-q", *s.out()))
    return wall(runs) / FR3_S


def kernels(s: Setting) -> Iterator[Line]:
    for size, bound in ((1000, 8.0), (40, 1.2), (100_000, 4.0)):
        found = json.loads(s.probe("kernels", str(size), str(s.rounds)).out or "null")
        what = f"position and Jacobian, N = {size}, times CasADi C"
        if found is None:
            yield absent(what)
            continue
        yield least(bound, found["symcal, in place"], f"{what}, results in place")
        yield Line(f"{what}, fresh results", f">= {bound:g}", f"{found['symcal']:.4g}", found["symcal"] >= bound)
        if size == 1000:
            yield least(0.5, max(found["symcal, NumPy, in place"], found["symcal, NumPy"]), f"{what}, without compiler")


def identifications(s: Setting) -> Iterator[Line]:
    run = s.probe("identifications", str(s.rounds))
    if run.status:
        yield absent("identifications", run.said)
        return
    found = json.loads(run.out)
    yield least(50, found["batch"], "1000 identifications of 11 parameters, times SciPy lm with exact slopes")
    yield least(2, found["single"], "a single sc.identify with a built model, times SciPy lm")
    yield most(1e-10, found["difference"], "costs, relative to SciPy at 1e-12", "")
    s.probe("first")  # kernels are warm
    firsts = [json.loads(s.probe("first").out) for _ in range(s.rounds)]
    scale = fr3_scale(s)
    yield most(30 * scale, median(each["first"] for each in firsts), "build and identify, first in a process", " ms")
    yield most(30 * scale, median(each["again"] for each in firsts), "build and identify, again", " ms")


def fr3(s: Setting) -> Iterator[Line]:
    if not s.data:
        yield absent("FR3", "no data: name their folder by --data or SYMCAL_DATA")
        return
    runs = [
        lambda: s.new("identify", FR3, "-q", *s.out()),
        lambda: s.new("identify", FR3, "-q", "--no-report", *s.out()),
    ]
    if s.old is None:
        whole, bare = in_turn(s.rounds, *runs)
        before, scale = None, 1.0
    else:
        whole, bare, before = in_turn(s.rounds, *runs, lambda: s.before("identify", FR3, "-q", *s.out()))
        scale = wall(before) / FR3_S
    yield bounded("identify franka_fr3.yaml with report", 2.5, scale, whole, before)
    yield bounded("identify franka_fr3.yaml --no-report", 1.2, scale, bare, before)


def cold(s: Setting) -> Iterator[Line]:
    """With no kernel in the cache: no bound, to be stated."""
    for name in (FR3, "configs/handling_robot.yaml"):
        if name == FR3 and not s.data:
            continue
        run = s.new("run", name, "-q", *s.out(), XDG_CACHE_HOME=tempfile.mkdtemp(dir=s.scratch))
        yield Line(f"run {name}, cold", "", f"{run.wall:.3g} s" if not run.status else run.said[-80:], None)


def handling(s: Setting) -> Iterator[Line]:
    name, rounds = "configs/handling_robot.yaml", max(1, s.rounds // 3)
    runs = [
        lambda: s.new("run", name, "-q", *s.out()),
        lambda: s.new("run", name, "-q", *s.out(), SYMCAL_KERNELS="numpy"),
    ]
    before, scale = None, 1.0
    if s.old is None:
        compiled, without = in_turn(rounds, *runs)
    else:
        compiled, without, before = in_turn(rounds, *runs, lambda: s.before("run", name, "-q", *s.out()))
        scale = wall(before) / HANDLING_S
    yield bounded("run handling_robot.yaml with a compiler", 15, scale, compiled, before)
    yield bounded("run handling_robot.yaml without", 30, scale, without, before)


def start(s: Setting) -> Iterator[Line]:
    scale = fr3_scale(s)
    helped, checked, alone = in_turn(
        s.rounds,
        lambda: s.new("--help"),
        lambda: s.new("check", "configs/handling_robot.yaml"),
        lambda: process(ROOT, ("-c", "pass"), s.environment(ROOT)),
    )
    yield bounded("symcal --help", 0.4, scale, helped)
    yield bounded("symcal check handling_robot.yaml", 0.8, scale, checked)
    yield Line("python that imports nothing", "", f"{wall(alone):.3g} s", None)


def poses(s: Setting) -> Iterator[Line]:
    scale = fr3_scale(s)
    for count, seconds, megabytes in ((100_000, 3.0, 300.0), (1_000_000, 40.0, None)):
        run = s.probe("poses", str(count))
        what = f"{count} poses identified"
        if run.status:
            yield absent(what, run.said)
            continue
        found = json.loads(run.out)
        yield most(seconds * scale, found["wall"], what, note=f" (processor {found['cpu']:.3g} s)")
        memory = f"{what}, most memory of the process while it does"
        if megabytes is None:
            yield Line(memory, "bounded", f"{found['peak']:.0f} MB (before {found['before']:.0f} MB)", None)
        else:
            yield most(megabytes, found["peak"], memory, " MB", f" (before {found['before']:.0f} MB)")


def planned(s: Setting, experiment: str, *sets: str) -> tuple[Run, dict[str, object] | None]:
    flag, folder = s.out()
    run = s.new("plan", experiment, "-q", *(each for pair in sets for each in ("--set", pair)), flag, folder)
    results = Path(folder) / "results.json"
    return run, json.loads(results.read_text())["plan"] if results.exists() else None


def plans(s: Setting) -> Iterator[Line]:
    bare = ("plan.compare=[]", "plan.prove=false", "outputs.figures=false", "outputs.report=false")
    what = "a plan of 1000 poses with order, numbers alone"
    (runs,) = in_turn(1, lambda: planned(s, "configs/plan_position.yaml", "plan.poses=1000", *bare)[0])
    yield bounded(what, 8, fr3_scale(s), runs)
    whole = ("plan.compare=[]", "plan.prove=false", "plan.poses=1000")
    run, _ = planned(s, "configs/plan_position.yaml", *whole)
    yield Line("the same with figures and report", "", f"{run.wall:.3g} s", None)
    twelve = s.scratch / "twelve.yaml"
    s.probe("twelve", str(s.scratch))
    for name, path, bound in (
        ("12 axes", str(twelve), 0.99),
        ("7 axes", "configs/plan_fr3.yaml", 0.995),
        ("camera with free intrinsics", "configs/plan_camera.yaml", 0.97),
    ):
        run, plan = planned(s, path, *bare)
        if plan is None:
            yield absent(f"plan, {name}", run.said)
            continue
        found = float(str(plan["d_efficiency_lower_bound"]))
        line = least(bound, found, f"plan, {name}: D-efficiency at least")
        yield Line(line.what, line.bound, f"{found:.5f} (search {plan['search_seconds']:.3g} s)", line.met)


def study(s: Setting) -> Iterator[Line]:
    file = "configs/study_simulation_2.yaml"
    scale = fr3_scale(s)
    for what, bound, more in (
        ("study of 10 000 repetitions, two cores", 10.0, {}),
        ("the same without a compiler", 30.0, {"SYMCAL_KERNELS": "numpy"}),
    ):
        (runs,) = in_turn(
            max(1, s.rounds // 2),
            lambda more=more: s.new("study", file, "-q", "--workers", "2", "--no-report", *s.out(), **more),
        )
        yield bounded(what, bound, scale, runs)


PARTS: dict[str, Callable[[Setting], Iterator[Line]]] = {
    "kernels": kernels,
    "identifications": identifications,
    "start": start,
    "fr3": fr3,
    "handling": handling,
    "poses": poses,
    "plans": plans,
    "study": study,
    "cold": cold,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", type=Path, help="checkout of the version before")
    parser.add_argument("--only", default=",".join(PARTS), help=f"some of {', '.join(PARTS)}")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--data", default=os.environ.get("SYMCAL_DATA", ""), help="folder of the measured sets")
    given = parser.parse_args()
    wanted = given.only.split(",")
    if unknown := set(wanted) - set(PARTS):
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    scratch = Path(tempfile.mkdtemp(prefix="symcal-acceptance-"))
    setting = Setting(given.old and given.old.resolve(), given.rounds, given.data, scratch)
    say = sys.stdout.write
    say(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores\n")
    try:
        for name in wanted:
            for line in PARTS[name](setting):
                met = {True: "met", False: "NOT MET", None: "-"}[line.met]
                say(f"{met:8s}{line.what:78s} {line.bound:>12s}   {line.measured}\n")
                sys.stdout.flush()
        if fr3_scale.cache_info().currsize:
            say(f"seconds scaled by {fr3_scale(setting):.3g} where the FR3 set did not say otherwise\n")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


if __name__ == "__main__":
    main()
