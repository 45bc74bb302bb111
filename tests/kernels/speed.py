"""Position and Jacobian of the handling robot, by every path, against CasADi's own compiled map.

python tests/kernels/speed.py [PATHS [ROWS]]        python tests/kernels/speed.py c,numpy 40,1000

CasADi's generated C (-O3 -march=native) is loaded as an external function, mapped over N rows and called through
`Function.buffer()` into arrays made once. All variants take turns in one process; medians and minima of their times,
and the ratio of the map's time to theirs. `c+` is the call that is prepared once, `c=` fills arrays that are given.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np

from symcal.kernels import batch_function, path_in_use
from symcal.runs.load import load

ROUNDS, LONG_ROUNDS, LONG = 300, 10, 20_000
SAMPLE_S = 2e-4  # short, so that most samples are not interrupted
EXPERIMENT = Path(__file__).parents[2] / "configs" / "handling_robot.yaml"


def arm() -> tuple[ca.Function, np.ndarray]:
    """(q, x, setup) -> p, J; and the setup."""
    model = load(EXPERIMENT).model
    q, x, setup = (ca.SX.sym(*size) for size in (("q", 5), ("x", 15), ("setup", model.setup.vector.size)))
    outputs = [ca.densify(f(q, x, setup)) for f in (model.measurement.predict, model.measurement.jacobian)]
    return ca.Function("arm", [q, x, setup], ca.cse(outputs), ["q", "x", "setup"], ["p", "J"]), model.setup.vector


def poses(n: int) -> np.ndarray:
    low, high = [-2.8, 850.0, 0.0, 0.0, -3.0], [2.8, 1350.0, 700.0, 3.0, 3.0]
    return np.random.default_rng(1).uniform(low, high, (n, 5))


def compiled_map(function: ca.Function, folder: Path) -> ca.Function:
    generator = ca.CodeGenerator("map.c")
    generator.add(function)
    source = generator.generate(f"{folder}/")
    library = folder / "map.so"
    subprocess.run(["cc", "-O3", "-march=native", "-fPIC", "-shared", "-o", library, source, "-lm"], check=True)
    return ca.external(function.name(), str(library))


def mapped(external: ca.Function, n: int, q: np.ndarray, x: np.ndarray, setup: np.ndarray) -> Callable[[], object]:
    kept = [q, x, setup, np.empty((n, 3)), np.empty((n, 15, 3))]
    buffer, run = external.map("rows", "serial", n, [1, 2], []).buffer()
    for i, array in enumerate(kept[:3]):
        buffer.set_arg(i, memoryview(array))
    for i, array in enumerate(kept[3:]):
        buffer.set_res(i, memoryview(array))
    return lambda _=(kept, buffer): run()


def call(function: ca.Function, path: str, arguments: tuple[np.ndarray, ...]) -> Callable[[], object]:
    f = batch_function(function, backend=path.rstrip("+="))
    if path.endswith("+"):
        return f.prepared(*arguments)
    if path.endswith("="):
        out = f(*arguments)
        return lambda: f(*arguments, out=out)
    return lambda: f(*arguments)


def measure(runs: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    times: dict[str, list[float]] = {name: [] for name in runs}
    repeats = {}
    for name, run in runs.items():
        run()
        start = time.perf_counter()
        run()
        repeats[name] = max(1, int(SAMPLE_S / (time.perf_counter() - start)))
    for _ in range(rounds):
        for name, run in runs.items():
            start = time.perf_counter()
            for _ in range(repeats[name]):
                run()
            times[name].append((time.perf_counter() - start) / repeats[name])
    return times


def main(paths: list[str], rows: list[int]) -> None:
    function, setup = arm()
    x = np.random.default_rng(0).normal(0, 0.003, 15)
    print(path_in_use(), path_in_use().processor, sep="\n")  # noqa: T201
    with tempfile.TemporaryDirectory() as folder:
        external = compiled_map(function, Path(folder))
        for n in rows:
            arguments = (poses(n), x, setup)
            runs = {"map": mapped(external, n, *arguments)} | {path: call(function, path, arguments) for path in paths}
            times = measure(runs, ROUNDS if n < LONG else LONG_ROUNDS)
            middle, least = ({k: f(v) for k, v in times.items()} for f in (statistics.median, min))
            for name in runs:
                print(  # noqa: T201
                    f"N = {n:6}  {name:10} {middle[name] / n * 1e9:9.1f} ns a row, least {least[name] / n * 1e9:9.1f};"
                    f" {middle['map'] / middle[name]:6.2f} times the map, least {least['map'] / least[name]:6.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    given = sys.argv[1:]
    main(
        given[0].split(",") if given else ["c", "c=", "c+", "numpy", "portable"],
        [int(n) for n in given[1].split(",")] if len(given) > 1 else [40, 1000, 100_000],
    )
