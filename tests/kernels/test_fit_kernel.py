"""The compiled identification at the portable level: no sine of libm, the same bits from every compiler and form."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from test_kernel_path import needs_compiler, of_this_machine

import symcal as sc
from symcal.fit.many import ManyFits, fit_many
from symcal.fit.many_system import system_of
from symcal.kernels import compile
from symcal.kernels.fit_source import ENTRY, Given, Layout, fit_source
from symcal.kernels.path import Choice, kernels_by
from symcal.model.model import Model, build_model
from symcal.model.task import Task

Array = NDArray[np.float64]
SIGMA = 0.05
ROBOT = Path(__file__).resolve().parents[2] / "configs" / "robots" / "handling_robot.yaml"


def model_of(choice: Choice) -> Model:
    """The paper's robot with a rotated base that is found: sines of joints, of errors, of their sums, of constants."""
    robot = sc.load_robot(ROBOT)
    with kernels_by(choice):
        return build_model(robot, Task.of("position", {"base", "tool"}, {"P": (40.0, 0.0, 60.0)}))


def measured(rng: np.random.Generator) -> tuple[Array, Array]:
    """Poses and readings of eleven robots, whose errors are found among priors."""
    model = model_of("auto")
    q = rng.uniform(model.robot.lower, model.robot.upper, (30, model.robot.dof))
    z = []
    for _ in range(11):
        errors = dict(zip(model.kinematic, rng.normal(0, 0.2, 15) * model.parameters.scales[:15], strict=True))
        z.append(sc.simulate(model, errors, q, sc.Noise(position=SIGMA), rng).z)
    return q, np.array(z)


def same(one: ManyFits, other: ManyFits) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("x", "cost", "factor"))


@pytest.mark.parametrize("given", ["pose", "reading"])
def test_the_portable_source_asks_libm_for_no_sine(given: Given) -> None:
    """Outside of the lanes, whose own sines ask it beyond their range only."""
    model = model_of("portable")
    system = system_of(model, None, moved=False)
    lanes = files("symcal.kernels").joinpath("lanes.h").read_text()
    assert system.rows is not None
    program = system.rows.program
    assert program is not None
    for portable in (True, False):
        text = fit_source(program, Layout(system.places, given, given, None), portable=portable)
        assert text.startswith(lanes)
        code = [line for line in text.removeprefix(lanes).splitlines() if not line.startswith("#")]
        assert not re.findall(r"(?<!\w)(?:sin|cos)\(", "\n".join(code))
        for name in ("sin", "cos"):
            *_, defined = re.findall(rf"#define real_{name}\(a\) (\w+)\(a\)", text)
            assert defined == (f"scalar_{name}" if portable else name)
    scalar = re.findall(r"const double p\w+ = real_(?:sin|cos)\(", text)
    assert bool(scalar) == (given == "pose")


@needs_compiler
def test_portable_bits_do_not_depend_on_how_poses_are_given(rng: np.random.Generator) -> None:
    """Poses of all problems are worked out once, in scalars; those of each in lanes: the bits are the same."""
    model = model_of("portable")
    q, z = measured(rng)
    shared = fit_many(model, q, z, SIGMA)
    assert same(shared, fit_many(model, np.broadcast_to(q, (len(z), *q.shape)), z, SIGMA))
    setups = np.broadcast_to(model.setup.vector, (len(q), model.setup.vector.size))
    assert same(shared, fit_many(model, q, z, SIGMA, setup=setups))


@pytest.mark.parametrize("name", ["gcc", "clang", "ziglang"])
@pytest.mark.parametrize("optimisation", ["-O1", "-O3"])
def test_portable_bits_are_those_of_any_compiler(
    name: str, optimisation: str, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    compiler = of_this_machine(name)
    if compiler is None:
        pytest.skip(f"{name} is not installed here")
    q, z = measured(rng)
    wanted = fit_many(model_of("portable"), q, z, SIGMA)
    asked = []

    def load(source: str, _: str, entry: str, *, portable: bool) -> object:
        asked.append((entry, portable))
        return compile.load_library(source, optimisation, entry, portable=portable)

    monkeypatch.setattr(compile, "find_compiler", lambda: compiler)
    monkeypatch.setattr("symcal.kernels.compiled.load_library", load)
    assert same(fit_many(model_of("portable"), q, z, SIGMA), wanted)
    assert (ENTRY, True) in asked
    assert all(portable for _, portable in asked)


@needs_compiler
@pytest.mark.parametrize("choice", ["c", "numpy", "vm"])
def test_what_is_asked_for_runs(choice: Choice, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    """Whatever ran before; and the portable minimum is that of every other way."""
    compiled = []

    def load(source: str, optimisation: str, entry: str, *, portable: bool) -> object:
        compiled.extend([portable] if entry == ENTRY else [])
        return compile.load_library(source, optimisation, entry, portable=portable)

    monkeypatch.setattr("symcal.kernels.compiled.load_library", load)
    q, z = measured(rng)
    portable = fit_many(model_of("portable"), q, z, SIGMA)
    found = fit_many(model_of(choice), q, z, SIGMA)
    assert compiled == [True, *([False] if choice == "c" else [])]
    np.testing.assert_allclose(found.cost, portable.cost, rtol=1e-9)
    spread = np.sqrt(np.einsum("rii->ri", portable.covariance))
    assert np.abs((found.x - portable.x) / spread).max() < 1e-4
