"""Kinds of instrument: each behind the protocol, and nobody outside asks for one by its name."""

from __future__ import annotations

import ast
import json
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import symcal
from symcal.camera.camera import Camera
from symcal.errors import InputError
from symcal.instruments import KINDS, Instrument, kind_named, seen_by

PACKAGE = Path(symcal.__file__).parent
SX = ca.SX
Array = NDArray[np.float64]


def named(node: ast.AST) -> bool:
    """Does an expression hold the name of a kind?"""
    return any(isinstance(part, ast.Constant) and part.value in KINDS for part in ast.walk(node))


def asks_for_a_kind(node: ast.AST) -> bool:
    """A comparison of something called kind, type or task with a kind's name; an import of a kind's own file."""
    if isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        subject = " ".join(ast.unparse(side) for side in sides)
        words = ("instrument", ".kind", "type", "entry")
        return any(map(named, sides)) and any(word in subject for word in words)
    if isinstance(node, ast.Match):
        return any(named(case.pattern) for case in node.cases)
    if isinstance(node, ast.Subscript):
        return ast.unparse(node.value).endswith("KINDS") and named(node.slice)
    if isinstance(node, ast.ImportFrom):
        return (node.module or "") in {f"symcal.instruments.{name}" for name in KINDS}
    return False


def test_nobody_outside_asks_for_a_kind_by_its_name() -> None:
    found = [
        f"{path.relative_to(PACKAGE)}:{getattr(node, 'lineno', '?')}"
        for path in PACKAGE.rglob("*.py")
        if "instruments" not in path.parts
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if asks_for_a_kind(node)
    ]
    assert found == []


def test_the_look_finds_what_it_looks_for() -> None:
    for text in (
        'x = task.kind == "pose"',
        'x = o.instrument.name in ("wire", "distance")',
        'KINDS["pixels"]',
        "from symcal.instruments.pose import Pose",
    ):
        assert any(map(asks_for_a_kind, ast.walk(ast.parse(text))))
    assert not any(map(asks_for_a_kind, ast.walk(ast.parse('sigmas["position"]'))))


def instruments() -> dict[str, Instrument]:
    """Every registered kind with settings that leave nothing at its default."""
    lens = Camera(2400, 2000, 4600.0, 4610.0, 1200.0, 1000.0, (-0.1, 0.1, 1e-3, -2e-3, 0.02))
    skewed = {"a": (0.6, 0.0, 0.8), "b": (0.0, -1.0, 0.0)}
    special = {
        "pixels": seen_by(lens, calibrate=True),
        "distance": kind_named("distance")(offset=35.0),  # type: ignore[call-arg]
        "component": kind_named("component")(directions=skewed),  # type: ignore[call-arg]
    }
    pose = kind_named("pose")
    return {name: special.get(name, kind()) for name, kind in KINDS.items()} | {
        f"pose, {axes}": pose(axes=axes)  # type: ignore[call-arg]
        for axes in ("observer", "observed")
    }


every_kind = pytest.mark.parametrize("kind", instruments().values(), ids=list(instruments()))


def predicted(kind: Instrument) -> ca.Function:
    """The reading as a function of (R, p, own)."""
    r, p, own = SX.sym("R", 3, 3), SX.sym("p", 3), SX.sym("own", len(kind.own))
    return ca.Function("h", [r, p, own], [kind.predict(r, p, own)])


def a_reading(kind: Instrument, rng: np.random.Generator) -> tuple[ca.Function, tuple[Array, ...], Array]:
    """The residual as a function of (R, p, z, own), where a feature is, and a reading of it with noise."""
    r, p, z, own = SX.sym("R", 3, 3), SX.sym("p", 3), SX.sym("z", len(kind.columns)), SX.sym("own", len(kind.own))
    residual = ca.Function("r", [r, p, z, own], [kind.residual(r, p, z, own)])
    predict = predicted(kind)
    at = (Rotation.random(rng=rng).as_matrix(), np.array([100.0, -80.0, 1500.0]), kind.numbers)
    noise = {q.noise: lambda shape: 0.01 * rng.normal(size=shape) for q in kind.quantities}
    return residual, at, kind.retract(predict(*at).full().reshape(1, 1, -1), noise)[0, 0]


@every_kind
def test_slopes_are_central_differences(kind: Instrument, rng: np.random.Generator) -> None:
    """Away from the measured pose, and at a reading that is yet to be taken."""
    residual, (turn, at, own), measured = a_reading(kind, rng)
    predict = predicted(kind)
    for z in (measured, None):
        symbols = [SX.sym("R", 3, 3), SX.sym("p", 3), SX.sym("own", len(kind.own))]
        reading = None if z is None else SX(z)
        slopes_of = kind.slopes(symbols[0], symbols[1], reading, symbols[2])
        both = ca.Function("J", symbols, [ca.densify(e) for e in slopes_of])
        by_twist, by_own = (np.array(v) for v in both(turn, at, own))
        given = predict(turn, at, own).full().ravel() if z is None else z

        def moved(step: Array, given: Array = given) -> Array:
            rotation = Rotation.from_rotvec(step[:3]).as_matrix() @ turn
            return residual(rotation, at + step[3:6], given, own + step[6:]).full().ravel()

        count = 6 + len(kind.own)
        sizes = np.array([1e-5] * 3 + [1e-3] * 3 + [1e-3] * 4 + [1e-6] * 5)[:count]
        slopes = np.array(
            [(moved(h * e) - moved(-h * e)) / (2 * h) for h, e in zip(sizes, np.eye(count), strict=True)]
        ).T
        np.testing.assert_allclose(np.hstack([by_twist, by_own]), slopes, atol=2e-6 * max(np.abs(slopes).max(), 1))


@every_kind
def test_slopes_are_those_of_automatic_differentiation(kind: Instrument, rng: np.random.Generator) -> None:
    _, (turn, at, own), measured = a_reading(kind, rng)
    symbols = [SX.sym("R", 3, 3), SX.sym("p", 3), SX.sym("own", len(kind.own)), SX.sym("z", len(kind.columns))]
    r, p, o, z = symbols
    for reading in (z, None):
        mine = kind.slopes(r, p, reading, o)
        theirs = Instrument.slopes(kind, r, p, reading, o)
        both = ca.Function("J", symbols, [ca.densify(e) for e in (*mine, *theirs)])
        a, a_own, b, b_own = (np.array(v) for v in both(turn, at, own, measured))
        np.testing.assert_allclose(a, b, atol=1e-9 * max(np.abs(b).max(), 1))
        np.testing.assert_allclose(a_own, b_own, atol=1e-9 * max(np.abs(b_own).max(initial=0), 1))


@every_kind
def test_a_reading_without_noise_has_no_residual(kind: Instrument, rng: np.random.Generator) -> None:
    residual, (turn, at, own), _ = a_reading(kind, rng)
    predict = predicted(kind)
    left = residual(turn, at, predict(turn, at, own), own).full()
    assert np.abs(left).max() < 1e-9
    assert len(left) == sum(quantity.size for quantity in kind.quantities)


@every_kind
def test_noise_is_that_of_the_residual(kind: Instrument, rng: np.random.Generator) -> None:
    """Readings with noise of a sigma leave residuals of that sigma, component by component."""
    residual, (turn, at, own), _ = a_reading(kind, rng)
    predict = predicted(kind)
    exact = predict(turn, at, own).full().ravel()
    sizes = {q.noise: 0.3 if q.unit != "rad" else 1e-3 for q in kind.quantities}
    noise = {name: partial(lambda s, shape: s * rng.normal(size=shape), s) for name, s in sizes.items()}
    readings = kind.retract(np.tile(exact, (3000, 1, 1)), noise)[:, 0]
    left = np.array([residual(turn, at, z, own).full().ravel() for z in readings])
    wanted = np.concatenate([np.full(q.size, sizes[q.noise]) for q in kind.quantities])
    np.testing.assert_allclose(left.std(axis=0), wanted, rtol=0.06)


@every_kind
def test_settings_survive_the_file(kind: Instrument, tmp_path: Path) -> None:
    again = type(kind).recalled(json.loads(json.dumps(kind.record())), tmp_path)
    assert again.columns == kind.columns
    assert again.sees == kind.sees
    np.testing.assert_array_equal(again.numbers, kind.numbers)


def test_a_kind_that_is_not_registered_is_refused() -> None:
    with pytest.raises(InputError, match="did you mean 'position'"):
        kind_named("positon")
