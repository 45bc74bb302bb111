"""Many identifications at once: against SciPy for every kind of measurement, and bits that no neighbour changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import boards
import numpy as np
import pytest
from cases import ARM, anywhere, front_half, handling, handling_model, prismatic, random_errors, revolute
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import least_squares
from strategies import random_robot
from test_contacts import LIMIT, PIN, pin, random, truth_of

import symcal as sc
from symcal.data.dataset import Dataset, readings
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Options, fit
from symcal.fit.identifiability import analyse
from symcal.fit.many import ManyFits, fit_many
from symcal.fit.residual_rows import rows_of
from symcal.fit.whitened import beforehand
from symcal.kernels.compiler import find_compiler
from symcal.model.contact import contact_postures
from symcal.model.model import Kernels, Model, build_model
from symcal.model.task import Task
from symcal.parameters import JointPrior
from symcal.robot.robot import Robot
from symcal.solvers.least_squares import Tolerances
from symcal.spatial import transform

Array = NDArray[np.float64]

SMR = sc.Target("smr", sc.Place("flange"), {"P": (40.0, 0.0, 60.0)})
START = transform(np.eye(3), np.array([900.0, -700.0, 300.0]))
BACKENDS = ("c", "vm") if find_compiler() is not None else ("vm",)
backends = pytest.mark.parametrize("backend", BACKENDS)


@dataclass(frozen=True)
class Case:
    """A model, how its poses are drawn, and noise of the components of its residual."""

    model: Model
    draw: Callable[[int, np.random.Generator], Array]
    sigma: Array


def wire() -> sc.Observation:
    return sc.Observation(sc.Distance(), "wire", sc.Place("world", START, unknown=True), SMR)


def positions() -> Case:
    model = build_model(handling(), Task.of("position", {"base", "tool"}, {"P": (40.0, 0.0, 60.0)}))
    return Case(model, front_half, np.array([0.05, 0.02, 0.08]))


def poses() -> Case:
    model = build_model(ARM, Task.of("pose", {"base", "tool"}))
    return Case(model, lambda n, rng: anywhere(ARM, n, rng), np.array([0.05] * 3 + [2e-4] * 3))


def points() -> Case:
    named = {"a": (50.0, 0.0, 100.0), "b": (0.0, 50.0, 100.0), "c": (-30.0, 0.0, 150.0)}
    model = build_model(ARM, Task.of("position", {"base", "points"}, named))
    return Case(model, lambda n, rng: anywhere(ARM, n, rng), np.full(9, 0.05))


def wire_and_tracker() -> Case:
    tracker = sc.Observation(sc.Position(), "tracker", target=SMR)
    model = build_model(handling(), Task((wire(), tracker), base=True))
    return Case(model, front_half, np.array([0.03, 0.05, 0.05, 0.05]))


def stated() -> Case:
    """Held parameters, stated priors, one that ties two together, and other sizes."""
    task = Task.of(
        "position", {"base"}, fix=("theta_5", "beta_3"), scales={"d_2": 0.2}, priors={"alpha_1": 0.003, "base_x": 2.0}
    )
    model = build_model(handling(), task)
    tie = JointPrior(("a_5", "d_5"), np.array([[0.04, 0.03], [0.03, 0.09]]))
    tied = replace(model.parameters, joint_priors=(tie,))
    symbolic = replace(model.measurement.chain, parameters=tied)
    kernels = Kernels(replace(model.measurement, chain=symbolic))
    return Case(replace(model, kernels=kernels), front_half, np.full(3, 0.05))


def contacts() -> Case:
    """Two balls in sockets, and what is known of the distance between these: rows of errors alone."""
    aside = PIN + np.array([0.0, 120.0, 0.0])
    target = sc.Target("right", sc.Place("base", transform(np.eye(3), aside), unknown=True), {"O": (0.0, 0.0, 0.0)})
    gap = sc.Observation(
        sc.Distance(),
        "gap",
        sc.Place("base", unknown=True),
        target,
        noise={"distance": 0.02},
        place_name="left",
        value=(120.1,),
    )
    model = build_model(ARM, Task((pin("left"), pin("right", aside), gap)))
    sigma = np.full(model.measurement.rows, 0.05)
    return Case(model, lambda n, rng: contact_postures(model, n, random(rng), (-LIMIT, LIMIT)), sigma)


CASES = {f.__name__: f for f in (positions, poses, points, wire_and_tracker, stated, contacts)}
made = cache(lambda name: CASES[name]())


def measured(case: Case, count: int, n: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """q (R, N, dof), z (R, N, nz) with noise, and sigma (R, N, m); a tenth of the readings are missing."""
    model = case.model
    q, z = [], []
    noise = sc.Noise(position=0.05, orientation=2e-4, distance=0.03)
    for _ in range(count):
        truth = truth_of(model, rng, 0.5) if "left_x" in model.parameters.names else random_errors(model, rng)
        data = sc.simulate(model, truth, case.draw(n, rng), noise, rng)
        q.append(data.q)
        z.append(data.z)
    readings_ = np.stack(z)
    seen = np.concatenate([part.seen(readings_.reshape(-1, readings_.shape[2])) for part in model.measurement.parts], 1)
    sigma = np.where(seen & (rng.random(seen.shape) < 0.9), case.sigma, np.inf)
    return np.stack(q), readings_, sigma.reshape(count, n, -1)


def witness(case: Case, free: tuple[str, ...], q: Array, z: Array, sigma: Array) -> tuple[float, Array, Array]:
    """Cost, errors of all parameters and Jacobian of SciPy's minimum, from CasADi's functions one pose at a time."""
    model = case.model
    parameters = model.parameters
    index, vector = parameters.indices(free), model.setup.vector
    scales = parameters.scales[index]
    prior = beforehand(parameters, free).rows(scales)
    keep = np.isfinite(sigma).ravel()

    def rows(y: Array) -> tuple[Array, Array]:
        x = np.zeros(len(parameters))
        x[index] = scales * y
        r, jacobian = [], []
        for joints, reading in zip(q, np.nan_to_num(z), strict=True):
            for part in model.measurement.parts:
                own, slopes = part.residual(joints, x, vector, reading[part.readings])
                r.append(np.array(own).ravel())
                jacobian.append(np.array(slopes)[:, index])
        whole = np.concatenate(r)[keep] / sigma.ravel()[keep]
        slopes = np.concatenate(jacobian)[keep] / sigma.ravel()[keep, None]
        known = [(r, j[:, index]) for _, r, j in model.measurement.known_rows(x, model.setup)]
        whole = np.concatenate([whole, *(r for r, _ in known), prior @ y])
        return whole, np.vstack([slopes * scales, *(j * scales for _, j in known), prior])

    found = least_squares(lambda y: rows(y)[0], np.zeros(len(free)), lambda y: rows(y)[1], method="lm", ftol=1e-12,
                          xtol=1e-12)  # fmt: skip
    x = np.zeros(len(parameters))
    x[index] = scales * found.x
    return float(found.cost), x, rows(found.x)[1] / scales


def same(one: ManyFits, other: ManyFits, which: object = slice(None)) -> bool:
    """To the last bit."""
    names = ("x", "cost", "factor", "iterations", "evaluations", "converged", "equations", "rank", "covariance", "dof")
    return all(np.array_equal(getattr(one, name)[which], getattr(other, name)) for name in names)


@backends
@pytest.mark.parametrize("name", CASES)
def test_the_minimum_is_scipys(name: str, backend: str, monkeypatch: pytest.MonkeyPatch, rng) -> None:
    monkeypatch.setenv("SYMCAL_KERNELS", backend)
    case = CASES[name]()
    q, z, sigma = measured(case, 2, 26, rng)
    many = fit_many(case.model, q, z, sigma)
    assert many.converged.all()
    assert not set(many.free) & set(case.model.task.fix)
    index = case.model.parameters.indices(many.free)
    for i in range(2):
        cost, x, jacobian = witness(case, many.free, q[i], z[i], sigma[i])
        assert many.cost[i] == pytest.approx(cost, rel=1e-10)
        covariance = np.linalg.inv(jacobian.T @ jacobian)
        spread = np.sqrt(np.diag(covariance))
        assert np.abs((many.x[i] - x)[index] / spread).max() < 1e-4
        np.testing.assert_allclose(
            many.covariance[i] / np.outer(spread, spread), covariance / np.outer(spread, spread), atol=1e-4
        )
        prior = beforehand(case.model.parameters, many.free).rows(case.model.parameters.scales[index])
        unlearnt = prior / case.model.parameters.scales[index]
        learnt = len(index) - np.trace(unlearnt.T @ unlearnt @ covariance)
        assert many.dof[i] == pytest.approx(np.isfinite(sigma[i]).sum() - learnt, abs=1e-3)
        told = jacobian[: -len(prior)] * case.model.parameters.scales[index]
        assert many.rank[i] == analyse_rank(told)
    held = np.setdiff1d(np.arange(len(case.model.parameters)), index)
    assert not many.x[:, held].any()


def analyse_rank(whitened: Array) -> int:
    return int((np.linalg.svd(whitened, compute_uv=False) > 1.0).sum())


@backends
@pytest.mark.parametrize("name", ["positions", "poses", "stated"])
def test_no_neighbour_changes_a_bit(name: str, backend: str, monkeypatch: pytest.MonkeyPatch, rng) -> None:
    """Alone, among others, in another order, twice, with neighbours that do not converge or are not finite."""
    monkeypatch.setenv("SYMCAL_KERNELS", backend)
    case = CASES[name]()
    q, z, sigma = measured(case, 13, 24, rng)
    z[5] += 400.0 * rng.normal(size=z[5].shape)
    few = Tolerances(cost=1e-10, iterations=25)  # after which most of the wild ones are still on their way

    def fits(q: Array, z: Array, sigma: Array) -> ManyFits:
        return fit_many(case.model, q, z, sigma, strict=False, tolerances=few)

    whole = fits(q, z, sigma)
    assert np.flatnonzero(~whole.converged).tolist() == [5]
    for which in ([0], [12], [7, 3, 3, 9], rng.permutation(13), np.arange(5), np.arange(5, 13)):
        assert same(whole, fits(q[which], z[which], sigma[which]), which)
    at_once = fits(q[0], z, case.sigma)
    assert 0 < at_once.converged.sum() < 13
    for cut in (1, 4, 11):
        for some in (slice(None, cut), slice(cut, None)):
            assert same(at_once, fits(q[0], z[some], case.sigma), some)


@backends
def test_many_problems_are_cut_where_nobody_sees_it(backend: str, monkeypatch: pytest.MonkeyPatch, rng) -> None:
    """More than numpy holds at once."""
    monkeypatch.setenv("SYMCAL_KERNELS", backend)
    model = build_model(handling(), Task.of("position"))
    q = front_half(400, rng)
    exact = sc.simulate(model, {"theta_1": 0.003, "d_2": 0.4}, q, sc.Noise(), rng).z
    z = exact + 0.05 * rng.normal(size=(103, 400, 3))
    whole = fit_many(model, q, z, 0.05)
    assert same(whole, fit_many(model, q, z[50:53], 0.05), slice(50, 53))
    assert np.abs(whole.x[:, model.parameters.index("theta_1")].mean() - 0.003) < 1e-4


@pytest.mark.skipif(find_compiler() is None, reason="no compiler")
@pytest.mark.parametrize("name", CASES)
def test_both_ways_agree(name: str, monkeypatch: pytest.MonkeyPatch, rng) -> None:
    case = CASES[name]()
    q, z, sigma = measured(case, 4, 25, rng)
    start = 0.1 * rng.normal(size=(4, len(case.model.parameters))) * case.model.parameters.scales
    found = []
    for backend in ("c", "vm"):
        monkeypatch.setenv("SYMCAL_KERNELS", backend)
        found.append(fit_many(CASES[name]().model, q, z, sigma, start=start))
    one, other = found
    np.testing.assert_allclose(one.cost, other.cost, rtol=1e-10)
    np.testing.assert_array_equal(one.rank, other.rank)
    spread = np.sqrt(np.einsum("rii->ri", other.covariance))
    index = case.model.parameters.indices(one.free)
    assert np.abs((one.x - other.x)[:, index] / spread).max() < 1e-5
    held = np.setdiff1d(np.arange(start.shape[1]), index)
    np.testing.assert_array_equal(one.x[:, held], start[:, held])


def test_the_fit_of_the_estimator_is_the_same(rng) -> None:
    case = made("positions")
    q, z, _ = measured(case, 4, 40, rng)
    many = fit_many(case.model, q, z, 0.05)
    for i in range(4):
        data = Dataset(readings("position", ("P",)), q[i], z[i], tuple(map(str, range(40))), ("train",) * 40)
        rows = rows_of(case.model.measurement, data, case.model.setup, case.model.residuals)
        one = fit(rows, many.free, Options(sigma={"position": 0.05}, scales="stated"))
        assert many.cost[i] == pytest.approx(one.solution.cost, rel=1e-9)
        assert np.abs((many.x[i] - one.x) / np.sqrt(np.diag(many.covariance[i]))).max() < 1e-4
        assert many.rank[i] == one.identifiability.rank
        assert many.dof[i] == pytest.approx(one.dof, rel=1e-6)


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6))
def test_any_arm(seed: int) -> None:
    """Random conventions, joints, signs and ratios; numpy, so that no robot needs a compiler."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SYMCAL_KERNELS", "vm")
        model = build_model(robot, Task.of("position", {"base"}))
    case = Case(model, lambda n, r: r.uniform(-1.0, 1.0, (n, robot.dof)), np.full(3, 0.05))
    q, z, sigma = measured(case, 1, 20, rng)
    many = fit_many(model, q, z, sigma)
    cost, _, _ = witness(case, many.free, q[0], z[0], sigma[0])
    assert many.cost[0] == pytest.approx(cost, rel=1e-9)


@pytest.mark.skipif(find_compiler() is None, reason="no compiler")
@pytest.mark.parametrize("seed", range(4))
def test_any_arm_compiled(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, dof=3 + seed)
    model = build_model(robot, Task.of("position", {"base"}))
    case = Case(model, lambda n, r: r.uniform(-1.0, 1.0, (n, robot.dof)), np.full(3, 0.05))
    q, z, sigma = measured(case, 2, 20, rng)
    many = fit_many(model, q, z, sigma)
    for i in range(2):
        cost, _, _ = witness(case, many.free, q[i], z[i], sigma[i])
        assert many.cost[i] == pytest.approx(cost, rel=1e-9)


def test_folds_are_problems_with_other_sigmas(rng) -> None:
    """What does not count may be anything; leaving readings out is leaving poses out."""
    case = made("positions")
    q, z, _ = measured(case, 1, 30, rng)
    sigma = np.full((3, 30, 3), 0.05)
    for fold in range(3):
        sigma[fold, fold::3] = np.inf
    folds = fit_many(case.model, q[0], np.repeat(z, 3, axis=0), sigma)
    for fold in range(3):
        kept = np.isfinite(sigma[fold, :, 0])
        alone = fit_many(case.model, q[0][kept], z[:, kept], 0.05)
        assert folds.cost[fold] == pytest.approx(alone.cost[0], rel=1e-10)
        np.testing.assert_allclose(folds.x[fold], alone.x[0], atol=1e-6)
        assert folds.equations[fold] == alone.equations[0] == 60
    wild = np.where(np.isfinite(sigma), np.repeat(z, 3, axis=0), np.nan)
    assert same(folds, fit_many(case.model, q[0], wild, sigma))


def test_a_part_of_the_parameters_and_a_start(rng) -> None:
    case = made("positions")
    q, z, _ = measured(case, 2, 30, rng)
    free = ("d_3", "theta_1", "alpha_2")
    start = np.zeros(len(case.model.parameters))
    start[case.model.parameters.index("d_2")] = 0.7
    found = fit_many(case.model, q, z, 0.05, free=free, start=start)
    assert found.free == free
    assert (found.x[:, case.model.parameters.index("d_2")] == 0.7).all()
    other = fit_many(case.model, q, z, 0.05, free=free, start=found.x)
    assert (other.evaluations < found.evaluations).all()
    spread = np.sqrt(np.einsum("rii->ri", found.covariance))
    index = case.model.parameters.indices(free)
    assert np.abs((found.x - other.x)[:, index] / spread).max() < 1e-4


def test_a_far_start_is_brought_back_by_damping(rng) -> None:
    """Half a radian off: undamped steps do not do."""
    case = made("poses")
    q, z, sigma = measured(case, 2, 30, rng)
    near = fit_many(case.model, q, z, sigma)
    names = case.model.parameters.names
    start = np.where([name.startswith(("theta", "alpha")) for name in names], 0.5, 0.0)
    for backend in BACKENDS:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("SYMCAL_KERNELS", backend)
            model = CASES["poses"]().model
        far = fit_many(model, q, z, sigma, start=start)
        assert (far.evaluations > near.evaluations).all()
        np.testing.assert_allclose(far.cost, near.cost, rtol=1e-9)


@backends
def test_a_curved_valley_is_followed_to_its_end(backend: str, monkeypatch: pytest.MonkeyPatch, rng) -> None:
    """Of parallel axes with base and tool point unknown, the heights of both are told by curvature alone.

    The end: another hundred looks from there find nothing better.
    """
    monkeypatch.setenv("SYMCAL_KERNELS", backend)
    links = (
        revolute(theta=0.0, d=340.0, a=325.0, alpha=0.0, beta=0.0),
        revolute(theta=0.0, a=275.0, alpha=np.pi, beta=0.0),
        prismatic(d=0.0, theta=0.0, a=0.0, alpha=0.0, beta=0.0),
        revolute(theta=0.0, d=30.0, a=0.0, alpha=0.0),
    )
    model = build_model(Robot("scara", "standard", links), Task.of("position", {"base", "points"}, {"P": (0.0,) * 3}))
    case = Case(model, lambda n, generator: anywhere(model.robot, n, generator), np.full(3, 0.02))
    q, z, sigma = measured(case, 16, 20, rng)
    found = fit_many(model, q, z, sigma)
    assert found.evaluations.max() > 100
    again = fit_many(model, q, z, sigma, start=found.x)
    np.testing.assert_allclose(again.cost, found.cost, rtol=1e-9)


def test_a_board_of_many_points(rng) -> None:
    """Targets in stages go through numpy: the same minimum as the estimator's."""
    model = boards.built(boards.SMALL)
    truth = boards.errors(rng, 0.3)
    data = boards.measured(boards.SMALL, boards.postures(boards.SMALL, 12, rng), truth, 0.1, rng)
    rows = rows_of(model.measurement, data, model.setup, model.residuals)
    seen = np.hstack([part.seen(data.z) for part in model.measurement.parts])
    many = fit_many(model, data.q, data.z[None], np.where(seen, 0.1, np.inf))
    one = fit(rows, many.free, Options(sigma={"image": 0.1}, scales="stated"))
    assert many.cost[0] == pytest.approx(one.solution.cost, rel=1e-8)


# ------------------------------------------------------------------------------------------------- arrays of `identify`


def test_identify_takes_arrays(rng) -> None:
    case = made("positions")
    q, z, _ = measured(case, 2, 30, rng)
    many = sc.identify(case.model, q, z, sigma=0.05)
    one = sc.identify(case.model, q[0], z[0], sigma=0.05)
    assert isinstance(many, ManyFits)
    np.testing.assert_allclose(one.x, many.x[0], rtol=1e-9, atol=1e-12)
    assert list(one.errors.values()) == one.x.tolist()
    assert tuple(one.errors) == case.model.parameters.names
    assert one.free == many.free
    assert (one.converged, one.iterations, one.rank) == (True, many.iterations[0], many.rank[0])
    assert one.cost == pytest.approx(many.cost[0], rel=1e-12)
    assert one.dof == pytest.approx(many.dof[0], rel=1e-9)
    assert one.covariance.shape == (len(one.free),) * 2
    whitened = one.fits.triangle[0] @ one.covariance @ one.fits.triangle[0].T
    np.testing.assert_allclose(whitened, np.eye(len(one.free)), atol=1e-6)
    seen = analyse(np.vstack([one.fits.triangle[0]]), case.model.parameters)
    assert seen.rank >= one.rank


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q": np.zeros((30, 4))}, "key 'q': must have the shape"),
        ({"q": np.full((30, 5), np.nan)}, r"key 'q': must be finite numbers .found: \[0, 0\] is not"),
        ({"z": np.zeros((30, 3))}, "key 'z': readings must have the shape"),
        ({"z": np.zeros((2, 0, 3))}, "key 'z': readings must have the shape"),
        ({"z": np.where(np.arange(180).reshape(2, 30, 3) == 95, np.nan, 0.0)}, r"key 'z'.*\[1, 1, 2\] is not"),
        ({"sigma": 0.0}, "key 'sigma': must be positive"),
        ({"sigma": np.nan}, "key 'sigma': must be positive"),
        ({"sigma": np.inf}, "key 'sigma': nothing would count"),
        ({"sigma": np.ones(4)}, "key 'sigma': must have the shape"),
        ({"free": ("theta_1", "nobody")}, r"key 'free'.*nobody"),
        ({"free": ("theta_1", "theta_1")}, "key 'free'"),
        ({"free": ()}, "key 'free'"),
        ({"start": np.zeros(3)}, "key 'start': must have the shape"),
        ({"setup": np.zeros(3)}, "key 'setup': must have the shape"),
    ],
)
def test_bad_arrays_are_refused(change: dict[str, object], message: str) -> None:
    arguments = {"q": np.zeros((30, 5)), "z": np.zeros((2, 30, 3)), "sigma": 0.1} | change
    with pytest.raises(InputError, match=message):
        fit_many(handling_model(), **arguments)


def test_identify_refuses_halves_of_either_form() -> None:
    with pytest.raises(InputError, match="key 'sigma'"):
        sc.identify(handling_model(), np.zeros((30, 5)), np.zeros((30, 3)))
    with pytest.raises(InputError, match="key 'z'"):
        sc.identify(handling_model(), np.zeros((30, 5)), sigma=0.1)
    with pytest.raises(InputError, match="key 'z'"):
        sc.identify(handling_model(), np.zeros((30, 5)), np.zeros(3), sigma=0.1)


@backends
def test_what_does_not_converge_is_named(backend: str, monkeypatch: pytest.MonkeyPatch, rng) -> None:
    monkeypatch.setenv("SYMCAL_KERNELS", backend)
    case = positions()
    q, z, _ = measured(case, 6, 30, rng)
    found = fit_many(case.model, q, z, 0.05)
    easy = fit_many(case.model, q, z, 0.05, start=np.where(np.arange(6)[:, None] == 4, 0.0, found.x), strict=False)
    limit = Tolerances(cost=1e-10, iterations=int(easy.evaluations[[0, 1, 2, 3, 5]].max()) - 1)
    start = np.where(np.arange(6)[:, None] == 4, 0.0, found.x)
    with pytest.raises(RefusedError, match="problem 4: the search had not converged"):
        fit_many(case.model, q, z, 0.05, start=start, tolerances=limit)
    told = fit_many(case.model, q, z, 0.05, start=start, tolerances=limit, strict=False)
    assert told.converged.tolist() == [True] * 4 + [False, True]
    far = z.copy()
    far[2, 3] = 1e300
    with pytest.raises(RefusedError, match="problem 2: the model gives no finite number"):
        fit_many(case.model, q, far, 0.05)
    kept = fit_many(case.model, q, far, 0.05, strict=False)
    assert kept.converged.tolist() == [True] * 2 + [False] + [True] * 3
    np.testing.assert_array_equal(kept.x[[0, 1, 3]], found.x[[0, 1, 3]])
