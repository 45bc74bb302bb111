"""Kinds of instrument: each behind the protocol, and nobody outside asks for one by its name."""

from __future__ import annotations

import ast
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import symcal
from symcal import spatial
from symcal.errors import InputError
from symcal.instruments import KINDS, Kind, kind_named

PACKAGE = Path(symcal.__file__).parent
SX = ca.SX


def slopes_of(kind: Kind, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
    """`Kind.slopes` by automatic differentiation, at a twist of zero."""
    reading = kind.predict(rotation, point, own) if reading is None else reading
    twist, numbers = SX.sym("twist", 6), SX.sym("own", len(kind.own))
    moved = kind.residual(rotation + spatial.skew(twist[:3]) @ rotation, point + twist[3:], reading, numbers)
    by_twist, by_own = ca.jacobian(moved, twist), ca.jacobian(moved, numbers)
    both = ca.substitute([by_twist, by_own], [twist, numbers], [SX.zeros(6), own])
    return both[0], both[1]


def named(node: ast.AST) -> bool:
    """Does an expression hold the name of a kind?"""
    return any(isinstance(part, ast.Constant) and part.value in KINDS for part in ast.walk(node))


def asks_for_a_kind(node: ast.AST) -> bool:
    """A comparison of something called kind, type or task with a kind's name; an import of a kind's own file."""
    if isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        subject = " ".join(ast.unparse(side) for side in sides)
        words = ("measurement.kind", "task.kind", "data.kind", "type")
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
    for text in ('x = task.kind == "pose"', 'KINDS["pixels"]', "from symcal.instruments.pose import Pose"):
        assert any(map(asks_for_a_kind, ast.walk(ast.parse(text))))
    assert not any(map(asks_for_a_kind, ast.walk(ast.parse('sigmas["position"]'))))


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_slopes_are_those_of_automatic_differentiation(kind: Kind, rng: np.random.Generator) -> None:
    """Away from the measured pose, and at a reading that is yet to be taken."""
    rotation, point = SX.sym("R", 3, 3), SX.sym("p", 3)
    own, reading = SX.sym("own", len(kind.own)), SX.sym("z", len(kind.columns))
    numbers = np.array([4600.0, 4610, 1200, 1000, -0.1, 0.1, 1e-3, -2e-3, 0.02])[: len(kind.own)]
    turn, at = Rotation.random(rng=rng), np.array([100.0, -80.0, 1500.0])
    symbols = [rotation, point, own]
    exact = ca.Function("h", symbols, [kind.predict(*symbols)])(turn.as_matrix(), at, numbers).full().ravel()
    noise = {q.noise: lambda shape: 0.01 * rng.normal(size=shape) for q in kind.quantities}
    measured = kind.retract(exact[None, None], noise)[0, 0]
    for z in (reading, None):
        mine, theirs = kind.slopes(rotation, point, z, own), slopes_of(kind, rotation, point, z, own)
        both = ca.Function("J", [*symbols, reading], [ca.densify(e) for e in (*mine, *theirs)])
        a, a_own, b, b_own = (np.array(v) for v in both(turn.as_matrix(), at, numbers, measured))
        np.testing.assert_allclose(a, b, atol=1e-9 * max(np.abs(b).max(), 1))
        np.testing.assert_allclose(a_own, b_own, atol=1e-9 * max(np.abs(b_own).max(initial=0), 1))


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_a_reading_without_noise_has_no_residual(kind: Kind, rng: np.random.Generator) -> None:
    rotation, point, own = SX.sym("R", 3, 3), SX.sym("p", 3), SX.sym("own", len(kind.own))
    numbers = np.array([4600.0, 4610, 1200, 1000, -0.1, 0.1, 1e-3, -2e-3, 0.02])[: len(kind.own)]
    h = kind.predict(rotation, point, own)
    left = ca.Function("r", [rotation, point, own], [kind.residual(rotation, point, h, own)])
    at = np.array([50.0, 20.0, 900.0])
    assert np.abs(left(Rotation.random(rng=rng).as_matrix(), at, numbers).full()).max() < 1e-9
    assert left.size1_out(0) == sum(quantity.size for quantity in kind.quantities)


def test_a_kind_that_is_not_registered_is_refused() -> None:
    with pytest.raises(InputError, match="did you mean 'position'"):
        kind_named("positon")
