"""Rank, spectrum and unseen directions: of matrices made for the purpose, and of the paper's robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import ARM, TRIANGLE, anywhere, front_half, handling
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import null_space, subspace_angles
from scipy.optimize import linprog

from symcal.fit.identifiability import Identifiability, analyse, decompose, numerical_rank, sparse_basis
from symcal.model.model import build_model
from symcal.model.task import Task
from symcal.parameters import Parameter, ParameterSet
from symcal.robot.robot import Robot
from symcal.solvers.sparsest import least_one_norms

RNG = np.random.default_rng(8)


def plain(names: str, scales: tuple[float, ...] | None = None) -> ParameterSet:
    listed = names.split()
    return ParameterSet(
        tuple(
            Parameter(name, "rad" if name[0] in "tb" else "mm", 0.0, scale)
            for name, scale in zip(listed, scales or (1.0,) * len(listed), strict=True)
        )
    )


def at_nominal(robot: Robot, task: Task, poses: np.ndarray) -> tuple[Identifiability, np.ndarray]:
    """What many poses see without noise; orientations count like points at 200 mm. Also the scaled rows."""
    model = build_model(robot, task)
    (jacobian,) = model.jacobian(poses, np.zeros(len(model.parameters)), model.setup.vector)
    weight = model.measurement.per_component({"position": 1.0, "orientation": 200.0})
    rows = (jacobian * weight[:, None]).reshape(-1, len(model.parameters))
    return analyse(rows, model.parameters, noise_known=False), rows * model.parameters.scales


def of_handling(kind: str, estimate: tuple[str, ...] = (), points: int = 1) -> tuple[Identifiability, np.ndarray]:
    places = {"P": (0.0, 0.0, 0.0)} if points == 1 else dict(zip("abc", TRIANGLE, strict=True))
    task = Task.of(kind, frozenset(estimate), places)  # type: ignore[arg-type]
    return at_nominal(handling(), task, front_half(60, np.random.default_rng(5)))


@given(st.integers(1, 40), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_the_spectrum_is_numpys(rows: int, columns: int, seed: int) -> None:
    matrix = np.random.default_rng(seed).normal(size=(rows, columns))
    values, v, rank, numerical = decompose(matrix, 1.0)
    witness = np.linalg.svd(matrix, compute_uv=False)
    assert np.allclose(values[: witness.size], witness, atol=1e-12)
    assert (values[witness.size :] == 0).all()
    assert numerical == np.linalg.matrix_rank(matrix)
    assert rank == (witness > 1).sum()
    assert np.allclose(v.T @ v, np.eye(columns), atol=1e-12)
    assert np.allclose(np.linalg.norm(matrix @ v, axis=0), values, atol=1e-12)


def test_no_parameters_have_rank_zero() -> None:
    seen = analyse(np.zeros((5, 2)), plain("a b"), ())
    assert (seen.rank, seen.numerical_rank, seen.unseen()) == (0, 0, ())
    assert seen.condition_number == np.inf


def test_a_direction_counts_when_the_noise_leaves_less_than_its_scale() -> None:
    """One measurement of each of four parameters, sigma 0.1: known to 0.1, against the scales."""
    parameters = plain("a b c d", (1.0, 0.11, 0.09, 0.01))
    seen = analyse(np.eye(4) / 0.1, parameters)
    assert (seen.rank, seen.numerical_rank) == (2, 4)
    assert seen.singular_values == pytest.approx([10, 1.1, 0.9, 0.1])
    assert seen.condition_number == pytest.approx(10 / 1.1)
    assert sorted(d.text for d in seen.unseen()) == ["c cannot be seen", "d cannot be seen"]
    assert analyse(np.eye(4) / 0.1, parameters, noise_known=False).rank == 4


def test_names_choose_the_columns() -> None:
    seen = analyse(np.diag([5.0, 4.0, 3.0]), plain("a b c"), ("c", "a"))
    assert seen.names == ("c", "a")
    assert seen.singular_values.tolist() == [5.0, 3.0]


@given(st.integers(1, 30), st.integers(1, 10), st.integers(0, 10), st.integers(0, 2**32 - 1))
def test_the_numerical_rank_does_not_see_the_noise(rows: int, columns: int, rank: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, columns))
    assert numerical_rank(matrix) == numerical_rank(1e-9 * matrix) == min(rows, columns, rank)


def test_the_papers_robot_shows_eleven_of_fifteen_in_position() -> None:
    seen, rows = of_handling("position")
    assert (seen.rank, len(seen.names)) == (11, 15)
    expected = np.zeros((4, 15))
    for row, entries in zip(
        expected,
        (
            {"theta_5": 1},  # about its own axis, a_5 = 0
            {"theta_4": 40, "a_4": 1},  # 40 mrad of theta_4 turn d_5 = 25 mm by 1 mm
            {"alpha_4": 40, "d_3": -1},
            {"d_3": 1, "d_4": -1},
        ),
        strict=True,
    ):
        for name, value in entries.items():
            row[seen.names.index(name)] = value * (1e-3 if name[0] in "ta" and not name.startswith("a_") else 1.0)
    scaled = (expected / seen.scales).T
    assert np.abs(rows @ scaled / np.linalg.norm(scaled, axis=0)).max() < 1e-9
    assert np.max(subspace_angles(seen.hidden, scaled)) < 1e-9
    texts = {d.text for d in seen.unseen()}
    assert "theta_5 cannot be seen" in texts
    assert "d_3 and d_4 cannot be told apart: +1 mm of d_3 with -1 mm of d_4 changes nothing that was measured" in texts
    assert any(t.startswith("theta_4 and a_4 cannot be told apart: +10 mrad of theta_4 with +0.25 mm") for t in texts)


@pytest.mark.parametrize(
    ("kind", "estimate", "points", "rank", "unknowns"),
    [
        ("position", (), 1, 11, 15),
        ("position", (), 3, 14, 15),
        ("position", ("base", "tool"), 3, 21, 27),
        ("position", ("base", "points"), 3, 24, 30),
        ("pose", (), 1, 14, 15),
        ("pose", ("base", "tool"), 1, 21, 27),
    ],
)
def test_what_the_papers_robot_shows(
    kind: str, estimate: tuple[str, ...], points: int, rank: int, unknowns: int
) -> None:
    seen, rows = of_handling(kind, estimate, points)
    assert (seen.rank, len(seen.names)) == (rank, unknowns)
    assert seen.rank == np.linalg.matrix_rank(rows, tol=1e-9 * np.linalg.norm(rows, 2))


def test_a_complete_model_shows_four_per_revolute_joint_two_per_prismatic_and_six() -> None:
    """[Everett1987]. The paper's model is one short: nothing in it moves the elbow sideways from the waist's axis."""
    everything = Task.of("pose", frozenset(["base", "tool"]))
    arm, _ = at_nominal(ARM, everything, anywhere(ARM, 60, np.random.default_rng(1)))
    assert arm.rank == 4 * 6 + 6
    links = list(handling().links)
    links[2] = replace(links[2], parameters={**links[2].parameters, "a": 0.0})
    whole, _ = at_nominal(replace(handling(), links=tuple(links)), everything, front_half(60, RNG))
    assert whole.rank == 4 * 3 + 2 * 2 + 6
    assert of_handling("pose", ("base", "tool"))[0].rank == whole.rank - 1


@pytest.mark.parametrize(
    "case", [("position", (), 1), ("position", ("base", "tool"), 3), ("pose", ("base", "tool"), 1)]
)
def test_sparse_directions_span_the_null_space(case: tuple[str, tuple[str, ...], int]) -> None:
    seen, rows = of_handling(*case)
    basis = np.array(sparse_basis(seen.hidden)).T
    assert basis.shape == seen.hidden.shape
    assert np.max(subspace_angles(basis, null_space(rows, rcond=1e-9))) < 1e-7
    assert np.linalg.cond(basis) < 30
    assert (np.abs(basis) > 1e-6).sum(axis=0).max() <= 2
    texts = [d.text for d in seen.unseen()]
    assert len(set(texts)) == len(texts) == basis.shape[1]


@settings(max_examples=10)
@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_any_subspace_gets_a_whole_basis(dimension: int, seed: int) -> None:
    subspace, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(8, dimension)))
    basis = np.array(sparse_basis(subspace)).T
    assert basis.shape == (8, dimension)
    assert np.allclose(np.linalg.norm(basis, axis=0), 1)
    assert np.max(subspace_angles(basis, subspace)) < 1e-6
    assert (np.abs(basis) > 1e-6).sum(axis=0).max() <= 9 - dimension  # a generic vector needs no more


def test_three_parameters_make_a_sentence_of_three() -> None:
    hidden = np.array([1.0, -2.0, 2.0]) / 3
    rows = null_space(hidden[None]).T * 100
    (direction,) = analyse(rows, plain("theta_1 d_2 d_3")).unseen()
    assert direction.direction == pytest.approx({"theta_1": 1 / 3, "d_2": -2 / 3, "d_3": 2 / 3})
    assert direction.text == (
        "theta_1, d_2 and d_3 can be changed together unseen: +500 mrad of theta_1 with -1 mm of d_2 with +1 mm of d_3 "
        "changes nothing that was measured"
    )


@pytest.mark.parametrize("seed", range(8))
def test_vectors_of_least_one_norm_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, k = 14, int(rng.integers(1, 5))
    few = np.zeros((n, k))
    for column in few.T:
        column[rng.choice(n, 3, replace=False)] = rng.normal(size=3)
    subspace = np.linalg.qr(few @ rng.normal(size=(k, k)))[0]
    places = np.flatnonzero(np.linalg.norm(subspace, axis=1) > 1e-3)
    bound = np.block([[subspace, -np.eye(n)], [-subspace, -np.eye(n)]])
    for j, found in zip(places, least_one_norms(subspace, places), strict=True):
        witness = linprog(
            np.append(np.zeros(k), np.ones(n)),
            A_ub=bound,
            b_ub=np.zeros(2 * n),
            A_eq=np.append(subspace[j], np.zeros(n))[None],
            b_eq=[1.0],
            bounds=[(None, None)] * k + [(0, None)] * n,
        )
        assert found[j] == pytest.approx(1.0)
        assert np.abs(found).sum() == pytest.approx(witness.fun, abs=1e-9)
        np.testing.assert_allclose(subspace @ (subspace.T @ found), found, atol=1e-12)
