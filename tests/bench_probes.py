"""What `bench_acceptance.py` measures inside one fresh process; each prints JSON.

python tests/bench_probes.py kernels N ROUNDS | identifications ROUNDS | first | poses N | twelve FOLDER
"""

from __future__ import annotations

import gc
import json
import sys
import time
from pathlib import Path

import numpy as np


def kernels(size: str, rounds: str) -> object:
    """Ratios to CasADi's generated C through `map` and `buffer`, medians of rounds in turn."""
    from symcal.bench import positions
    from symcal.bench.arms import handling_robot
    from symcal.bench.case import case_of
    from symcal.bench.contest import hold
    from symcal.bench.machine import one_core
    from symcal.bench.peers import casadi_map
    from symcal.bench.rounds import Pace

    case = case_of(handling_robot())
    with one_core(), casadi_map.compiled(case.function) as generated:
        if generated is None:
            return None
        whole = positions.contest(case, int(size), generated, slow=False)
        names = [e.contender.name for e in whole.entries if e.contender.name.startswith("symcal")]
        found = hold(whole, Pace(10 * int(rounds) + 1, 0.005, 10.0), (*names, positions.CASADI_C))
    return {entry["name"]: entry["ratio"]["median"] for entry in found["entries"]}


def identifications(rounds: str) -> object:
    from symcal.bench import identifications as contest
    from symcal.bench.arms import handling_robot
    from symcal.bench.case import case_of
    from symcal.bench.contest import hold
    from symcal.bench.machine import one_core
    from symcal.bench.peers import casadi_map
    from symcal.bench.rounds import Pace

    repeated = contest.repeat(case_of(handling_robot()), 1000)
    with one_core(), casadi_map.compiled(repeated.case.function) as generated:
        whole = contest.contest(repeated, generated, slow=False)
        ours = ("symcal, 1000 at once", "symcal, single")
        found = hold(whole, Pace(6 * int(rounds) + 1, 0.005, 10.0), (*ours, str(whole.reference)))
    by_name = {entry["name"]: entry for entry in found["entries"]}
    batch, single = (by_name[name] for name in ours)
    return {
        "parameters": len(repeated.free),
        "batch": batch["ratio"]["median"],
        "single": single["ratio"]["median"],
        "difference": max(batch["difference"], single["difference"]),
    }


def first() -> object:
    """Milliseconds of building a model and identifying from arrays: the first time, and again."""
    import symcal as sc
    from symcal.bench.arms import handling_robot, random_errors, random_postures
    from symcal.bench.peers.elements import elements
    from symcal.bench.peers.numpy_batch import positions  # nothing of the package is built before the first time

    robot, rng = handling_robot(), np.random.default_rng(5)
    q = random_postures(robot, 40, rng)
    _ = sc.build_model, sc.identify  # loaded

    def once(readings: np.ndarray) -> tuple[float, object]:
        began = time.perf_counter()
        model = sc.build_model(robot, sc.Task.of("position"))
        sc.identify(model, q, readings, sigma=0.05)
        return (time.perf_counter() - began) * 1e3, model

    names = tuple(robot.link_parameters)
    z = positions(elements(robot, names), q, random_errors(names, rng)) + rng.normal(0, 0.05, (40, 3))
    return {"first": once(z)[0], "again": min(once(z)[0] for _ in range(3))}


def poses(count: str) -> object:
    """Seconds and peak memory of identifying one arm, base and tool unknown, from so many simulated positions."""
    import symcal as sc
    from symcal.bench.arms import handling_robot, random_postures

    robot, rng = handling_robot(), np.random.default_rng(1)
    smr = sc.Target("smr", sc.Place("tool"), {"P": (40.0, 0.0, 60.0)})
    task = sc.Task((sc.Observation(sc.Tracker(), "tracker", target=smr),), base=True, tool=True)
    truth = {"theta_4": 0.002, "alpha_2": -0.004, "d_5": 0.3}
    model = sc.build_model(robot, task)
    data = sc.simulate(model, truth, random_postures(robot, int(count), rng), sc.Noise(position=0.05), rng)
    sc.identify(robot, data.take(range(300)), task)  # kernels are warm
    gc.collect()
    before = _peak_from_now()
    wall, cpu = time.perf_counter(), time.process_time()
    sc.identify(robot, data, task)
    return {
        "wall": time.perf_counter() - wall,
        "cpu": time.process_time() - cpu,
        "peak": _memory("VmHWM"),
        "before": before,
    }


def twelve(folder: str) -> object:
    """An experiment that plans forty poses for an arm of twelve axes, `twelve.yaml`."""
    import symcal as sc
    from symcal.bench.arms import revolute_arm
    from symcal.documents.document import write_document

    robot = revolute_arm(12)
    sc.save_robot(robot, Path(folder) / "arm.yaml")
    experiment = {
        "schema": "symcal/experiment/1",
        "name": "twelve",
        "seed": 1,
        "units": {"length": "mm", "angle": "deg"},
        "robot": "arm.yaml",
        "measurement": {"type": "position"},
        "plan": {"method": "certified", "poses": 40, "noise": {"position": 0.1}},
    }
    write_document(Path(folder) / "twelve.yaml", experiment)
    return len(robot.link_parameters)


def _peak_from_now() -> float:
    """Forget the peak so far (Linux); memory now, MB."""
    Path("/proc/self/clear_refs").write_text("5")
    return _memory("VmRSS")


def _memory(key: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith(key))


if __name__ == "__main__":
    probe = {f.__name__: f for f in (kernels, identifications, first, poses, twelve)}[sys.argv[1]]
    sys.stdout.write(json.dumps(probe(*sys.argv[2:])) + "\n")
