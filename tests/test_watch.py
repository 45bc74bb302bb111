"""Checks of a robot in service: statistics against plain GLS and SciPy, verdicts against what was changed, bad input.

Rates of false alarms and powers of many simulated robots: `watch_draws.py`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import watch_draws as draws
from cases import ARM, anywhere, random_errors
from scipy import stats
from watch_draws import OFFSETS

from symcal.calibration.calibrate import calibrate
from symcal.calibration.simulate import simulate
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import build_model
from symcal.model.task import Task
from symcal.watch.check import check
from symcal.watch.choose import offsets_criterion
from symcal.watch.directed import Law
from symcal.watch.plan import plan_check
from symcal.watch.reference import linear_at
from symcal.watch.results import check_facts
from symcal.watch.sensitivity import fewest, poses_needed, sensitivity, undisturbed
from symcal.watch.shares import shares
from symcal.watch.words import verdict


@pytest.fixture(scope="module")
def service() -> draws.Service:
    return draws.in_service(draws.cell(), 3, pool=200)


@pytest.fixture
def today(service, rng):
    def made(changed=None, *, moved=False):
        return draws.today(service, moved, changed or {}, rng)

    return made


def slopes(predict, size: int, step: float = 1e-5) -> np.ndarray:
    """Central differences of predictions, shape (k, size)."""
    unit = np.eye(size) * step
    return np.column_stack([(predict(d) - predict(-d)) / (2 * step) for d in unit])


def predictions(model, q):
    names = model.parameters.names

    def predict(x):
        truth = dict(zip(names, x, strict=True))
        return simulate(model, truth, q, Noise("normal"), np.random.default_rng(0)).z.ravel()

    return predict


def test_a_directed_test_is_that_of_generalised_least_squares(service, today) -> None:
    reference, data = service.reference, today({"theta_2": 3e-4})
    found = draws.checked(service, data)
    before = predictions(reference.before, data.q)
    known = slopes(lambda d: before(reference.x + d), len(reference.x))
    covariance = reference.robot.record.covariance
    v = reference.noise["position"] ** 2 * np.eye(data.z.size) + known @ covariance @ known.T
    changed = predictions(reference.changed, data.q)
    own = slopes(changed, len(reference.changed.parameters))
    r = data.z.ravel() - changed(np.zeros(own.shape[1]))
    for h in reference.hypotheses:
        d = own[:, reference.index(h)]
        inner = d.T @ np.linalg.solve(v, d)
        score = d.T @ np.linalg.solve(v, r)
        assert found.tests[h.name].squares == pytest.approx(score @ np.linalg.solve(inner, score), rel=1e-4)
        if h.joint is not None:
            offset, sigma = found.alone[h.name]
            assert offset == pytest.approx(score[0] / inner[0, 0], rel=1e-4, abs=1e-9)
            assert sigma == pytest.approx(inner[0, 0] ** -0.5, rel=1e-4)
    assert found.rest.squares == pytest.approx(r @ np.linalg.solve(v, r), rel=1e-4)
    assert found.rest.directions == data.z.size


@pytest.mark.parametrize("dof", [25.0, np.inf])
def test_the_smallest_change_is_found_so_often(dof: float) -> None:
    law = Law(dof, 0.01 / 9)
    for d in (1, 3, 6):
        size, limit = law.needed(d), law.limit(d)
        if np.isinf(dof):
            power = stats.ncx2.sf(stats.chi2.isf(law.level, d), d, size)
        else:
            power = stats.ncf.sf(stats.f.isf(law.level, d, dof), d, dof, size)
            assert limit == pytest.approx(d * stats.f.isf(law.level, d, dof))
        assert power == pytest.approx(0.95, abs=1e-6)
    assert law.tested(law.limit(3), 3).p == pytest.approx(law.level)
    assert law.tested(0.0, 0).p == 1.0


@pytest.mark.parametrize("dof", [25.0, np.inf])
def test_the_rate_of_false_alarms_is_shared_for_equal_power(dof: float) -> None:
    wanted = {"strong": 400.0, "weak": 20.0, "weaker": 16.0, "hopeless": 1.0}
    found, other = shares(0.01, 8, wanted, dof)
    assert found["hopeless"] == other == 0.5 * 0.01 / 8
    assert sum(found.values()) + 4 * other == pytest.approx(0.01)
    assert found["strong"] == pytest.approx(0.1 * 0.01 / 8, rel=1e-3)

    def power(name: str, level: float) -> float:
        if np.isinf(dof):
            return float(stats.ncx2.sf(stats.chi2.isf(level, 1), 1, wanted[name]))
        return float(stats.ncf.sf(stats.f.isf(level, 1, dof), 1, dof, wanted[name]))

    assert power("weak", found["weak"]) == pytest.approx(power("weaker", found["weaker"]), abs=2e-4)
    assert power("weaker", found["weaker"]) > power("weaker", 0.01 / 8)
    sure, other = shares(0.01, 8, {"a": 1e9, "b": 1e9}, dof)
    assert sure["a"] == sure["b"] == pytest.approx((0.01 - 6 * other) / 2)
    assert shares(0.01, 8, {"a": 1.0}, dof) == ({"a": 0.01 / 8}, 0.01 / 8)


def test_the_offset_that_is_promised_is_found_so_often(service, rng) -> None:
    """Truth drawn by what the calibration knows, the noise too."""
    reference = service.reference
    linear = linear_at(reference, undisturbed(reference, service.q), np.zeros(len(reference.changed.parameters)))
    found = sensitivity(reference, linear, 0.01, OFFSETS, moved=False)
    (sigma,) = reference.noise.values()
    for h in (reference.joints[2], reference.joints[4]):
        d = linear.slopes[:, reference.index(h)][:, 0]
        v = sigma**2 * np.eye(len(d)) + linear.reference @ reference.root @ (linear.reference @ reference.root).T
        weight = np.linalg.solve(v, d) / np.sqrt(d @ np.linalg.solve(v, d))
        runs = 20000
        scale = np.sqrt(rng.chisquare(reference.dof, runs) / reference.dof)  # the noise, as it was estimated
        score = (found.offset(h) * weight @ d + rng.normal(size=runs)) / scale
        assert np.mean(score**2 > found.laws[h.name].limit(1)) == pytest.approx(0.95, abs=0.006)


def test_a_plan_knows_how_many_poses_an_offset_needs(service) -> None:
    reference = service.reference
    linear = linear_at(reference, undisturbed(reference, service.q), np.zeros(len(reference.changed.parameters)))
    wrist, wanted = reference.joints[3], dict.fromkeys((h.name for h in reference.joints), 6e-4)
    needed = poses_needed(reference, linear, wanted, 0.01, moved=False)
    count = needed[wrist.name]
    assert count is not None
    for poses, enough in ((count, True), (count - 1, False)):
        found = sensitivity(reference, linear, 0.01, wanted, moved=False, poses=poses / len(service.q)).offset(wrist)
        assert (found <= 6e-4) is enough
    assert needed["wrist_3"] is None


def test_the_choice_of_poses_maximises_the_information_on_offsets(rng) -> None:
    rows = rng.normal(size=(12, 9))
    m, criterion = rows.T @ rows, offsets_criterion(3)
    v = np.eye(12) + rows[:, :6] @ rows[:, :6].T  # of readings whose other six numbers are known to one sigma
    own = np.array([d @ np.linalg.solve(v, d) for d in rows[:, 6:].T])
    assert float(criterion.value(m)) == pytest.approx(float(np.sum(own**-4.0) ** -0.25))
    slope, step = criterion.slope(m), 1e-6
    for _ in range(5):
        d = rng.normal(size=(9, 9))
        d = d + d.T
        ahead, behind = (float(criterion.score(m + side * step * d)) for side in (1, -1))
        assert np.sum(slope * d) == pytest.approx((ahead - behind) / (2 * step), rel=1e-5, abs=1e-8)


def test_good_days_raise_few_alarms_and_changes_are_named(service, rng) -> None:
    """Over what the calibration leaves unknown of one robot; of many robots see `watch_draws.py`."""
    reference, names = service.reference, service.reference.before.parameters.names
    alarms, named = 0, 0
    runs = 60
    for run in range(runs):
        x = reference.x + reference.root @ rng.normal(size=reference.root.shape[1])
        truth, noise = dict(zip(names, x, strict=True)), Noise("normal", reference.noise["position"])
        good = simulate(reference.before, truth, service.q, noise, rng)
        alarms += not draws.checked(service, good, 0.05).holds
        if run < 20:
            bad = simulate(reference.before, truth | {"theta_3": truth["theta_3"] + 5e-4}, service.q, noise, rng)
            found = draws.checked(service, bad)
            named += bool(found.group) and found.group[0].hypothesis.name == "elbow"
    assert alarms <= stats.binom.ppf(0.999, runs, 0.05)
    assert named >= 18


def test_a_joint_and_what_cannot_be_told_from_it_are_named_together(service, today) -> None:
    found = draws.checked(service, today({"theta_1": 1e-3}))
    assert [change.hypothesis.name for change in found.group] == ["shoulder_pan", "base"]
    said = verdict(check_facts(service.reference, found))
    assert "joint 1 'shoulder_pan' by" in said
    assert "do not tell apart" in said
    base = draws.checked(service, today({"base": 0.5}))
    assert base.group[0].hypothesis.name == "base"


def test_an_instrument_that_was_set_up_anew_does_not_see_joint_1(service, today) -> None:
    found = draws.checked(service, today({"theta_1": 5e-3}, moved=True), moved=True)
    assert found.holds
    assert found.unseen == ("shoulder_pan",)
    assert "base" not in found.tests
    elbow = draws.checked(service, today({"theta_3": 2e-3}, moved=True), moved=True)
    assert elbow.group[0].hypothesis.name == "elbow"
    far = draws.checked(service, today(moved=True))  # nobody said that it was moved
    assert far.group[0].hypothesis.name == "base"


def test_a_joint_whose_axis_the_point_is_on_is_not_seen(rng) -> None:
    service = draws.in_service(draws.cell(0.0), 1, pool=150)
    found = draws.checked(service, draws.today(service, False, {}, rng))
    assert found.unseen == ("wrist_3",)
    turned = draws.checked(service, draws.today(service, False, {"theta_6": 0.01}, rng))
    assert "wrist_3" not in turned.tests


def test_one_slip_is_named_and_changes_no_verdict(service, today) -> None:
    for size in (0.5, 5.0, 500.0):
        good = draws.checked(service, today({"slip": size}))
        assert good.holds, size
        assert good.gross is not None
        assert good.gross not in good.labels
    both = draws.checked(service, today({"slip": 5.0, "theta_3": 1e-3}))
    assert both.group[0].hypothesis.name == "elbow"
    assert both.gross is not None


def test_an_instrument_in_the_hand_reads_a_check_too(rng) -> None:
    """Whole poses, and joints that share a name."""
    model = build_model(ARM, Task.of("pose", {"base", "tool"}, invert=True))
    errors = {k: v for k, v in random_errors(model, rng).items() if k in ARM.parameters}
    noise = Noise("normal", 0.05, 1e-4)
    data = simulate(model, errors, anywhere(ARM, 30, rng), noise, rng)
    reference = draws.referred(calibrate(model, None, data, Options()).robot)
    offsets = dict.fromkeys((h.name for h in reference.joints), 5e-4)
    bad = simulate(model, errors | {"theta_4": errors["theta_4"] + 2e-3}, anywhere(ARM, 8, rng), noise, rng)
    for moved in (False, True):
        found = check(reference, bad, alpha=0.01, offsets=offsets, moved=moved)
        assert [change.hypothesis.name for change in found.group] == ["joint_4"]
        assert found.group[0].values[0] == pytest.approx(2e-3, abs=4e-4)


def test_two_changes_are_no_one_change(service, today) -> None:
    found = draws.checked(service, today({"theta_2": 1e-3, "theta_4": 3e-3}))
    assert not found.holds
    assert found.group == ()
    assert "no one change" in verdict(check_facts(service.reference, found))


def test_too_few_poses_are_refused_with_the_number_that_is_needed(service, today) -> None:
    reference = service.reference
    for moved in (False, True):
        least = fewest(reference, moved=moved)
        few = today(moved=moved).take(range(least - 1))
        with pytest.raises(RefusedError, match=f"{least - 1} poses are too few.*: {least} are needed"):
            draws.checked(service, few, moved=moved)
        draws.checked(service, today(moved=moved).take(range(least)), moved=moved)
    data = today({"slip": 50.0})
    slipped = int(draws.checked(service, data).gross)
    with pytest.raises(RefusedError, match="looks like a slip, and the others are too few"):
        draws.checked(service, data.take([slipped, *(i for i in range(10) if i != slipped)][:4]))
    with pytest.raises(RefusedError, match="3 poses are too few to judge by"):
        plan_check(reference, service.cell.pool[:50], service.cell.area, 3, offsets=OFFSETS, alpha=0.01, moved=False)


def test_a_pose_beyond_the_limits_is_refused(service, today) -> None:
    data = today()
    q = data.q.copy()
    q[4, 2] = 4.0
    with pytest.raises(InputError, match=r"pose '4' is beyond the limits of joint 'elbow'"):
        draws.checked(service, replace(data, q=q))
