"""Numbers of trials against other means: SciPy, `simulate`, laws of statistics, the identification of one set."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares
from studies import write_study

from symcal.calibration.calibrate import calibrate
from symcal.calibration.simulate import simulate
from symcal.config.trials import MOST_TRIALS
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.model.model import build_model
from symcal.trials.description import Description, packed, shared_generator
from symcal.trials.draw import draw
from symcal.trials.identify import one_by_one
from symcal.trials.load import load_study
from symcal.trials.need import answers
from symcal.trials.setting import Setting, description_of, setting_of
from symcal.trials.statistics import Share, quantile
from symcal.trials.study import Execution, run_study
from symcal.trials.worker import run_trials

FIXED = "{poses: 25, errors: fixed}"


def loaded(path: Path) -> tuple[Description, Setting]:
    digest, data = packed(load_study(path).description)
    description = description_of(digest, data)
    return description, setting_of(description, 0)


def content(path: Path, out: Path) -> dict:
    run_study(path, out, execution=Execution(2))
    return json.loads((out / "results.json").read_text())


def test_each_trial_draws_from_its_own_stream(tmp_path):
    """Errors, poses, noise in this order from SeedSequence(seed, spawn_key=(trial,)), as NumPy draws them."""
    description, setting = loaded(write_study(tmp_path, vary="{poses: 9, errors: drawn}"))
    drawn = draw(description, setting, description.cells[0], [3, 17])
    model = build_model(description.robot, description.tasks[0])
    for i, trial in enumerate((3, 17)):
        rng = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(trial,)))
        errors = rng.standard_normal(len(model.kinematic)) * model.parameters.scales[: len(model.kinematic)]
        q = description.lower + (description.upper - description.lower) * rng.random((9, 5))
        data = simulate(model, dict(zip(model.kinematic, errors, strict=True)), q, description.cells[0].noise, rng)
        np.testing.assert_array_equal(drawn.truth[i, : len(errors)], errors)
        np.testing.assert_array_equal(drawn.poses(i), q)
        np.testing.assert_allclose(drawn.z[i], data.z, rtol=0, atol=1e-10)


def test_plans_test_poses_and_trials_share_no_stream(tmp_path, monkeypatch):
    """What a plan draws comes from a stream that neither a trial has, nor the test poses, nor a child of these."""
    streams = []

    class Planned(Exception):
        pass

    def find_plan(_problem, _wanted, rng, _progress):
        streams.append(rng.bit_generator.seed_seq)
        raise Planned

    monkeypatch.setattr("symcal.planning.drive_plan.find_plan", find_plan)
    with pytest.raises(Planned):
        load_study(write_study(tmp_path, vary="{plan: certified, poses: 20}"))
    description, _ = loaded(write_study(tmp_path, vary=FIXED))
    others = [description.generator(trial) for trial in range(40)]
    others += [shared_generator(5, purpose) for purpose in ("truth", "test")]
    assert description.trials < MOST_TRIALS < 2**31
    first = {int(np.random.default_rng(child).integers(2**63)) for child in [*streams, *streams[0].spawn(20)]}
    assert len(first) == 21
    for rng in others:
        drawn = {int(own.integers(2**63)) for own in [*rng.spawn(20), rng]}
        assert not first & drawn


def test_trials_are_what_scipy_finds(tmp_path):
    """Same data, same priors: SciPy's minimum gives the same errors at the test poses."""
    description, setting = loaded(write_study(tmp_path, vary=FIXED))
    cell, trials = description.cells[0], [0, 1, 2]
    results = run_trials(description, trials)
    drawn = draw(description, setting, cell, trials)
    model, sigma = setting.model, setting.sigma(cell)["position"]
    width = model.parameters.scales * np.where([p.unknown for p in model.parameters.items], 1e3, 1.0)
    predict = model.measurement.predict

    def positions(q, x):
        return np.array([np.asarray(predict(each, x, model.setup.vector)).ravel() for each in q])

    for i, result in enumerate(results):

        def whitened(y, i=i):
            off = (positions(drawn.poses(i), y * width) - drawn.z[i]) / sigma
            return np.concatenate([off.ravel(), y])

        found = least_squares(whitened, np.zeros(len(width)), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
        off = positions(description.test, found.x * width) - positions(description.test, drawn.truth[i])
        lengths = np.linalg.norm(off, axis=1)
        wanted = lengths.mean(), np.sqrt(np.mean(lengths**2)), np.percentile(lengths, 95), lengths.max()
        np.testing.assert_allclose((result.mean, result.rms, result.p95, result.max), wanted, rtol=2e-3)
        np.testing.assert_allclose(result.cost, found.cost, rtol=1e-6)


def test_one_by_one_is_the_identification_of_one_set(tmp_path):
    study = write_study(tmp_path, 3, FIXED, identification="{noise: estimated, sizes: estimated}")
    description, setting = loaded(study)
    assert one_by_one(description, setting) == "the noise is estimated, the sizes of the errors are estimated"
    drawn = draw(description, setting, description.cells[0], [1])
    (result,) = run_trials(description, [1])
    model = setting.model
    truth = dict(zip(model.parameters.names, drawn.truth[0], strict=True))
    rng = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(1,)))
    q = description.lower + (description.upper - description.lower) * rng.random((25, 5))
    data = simulate(model, truth, q, description.cells[0].noise, rng)
    after = calibrate(model, None, data, Options(), ()).after
    held = np.asarray([model.measurement.predict(each, after.x, after.setup.vector) for each in description.test])
    true = np.asarray(
        [model.measurement.predict(each, drawn.truth[0], model.setup.vector) for each in description.test]
    )
    lengths = np.linalg.norm((held - true).reshape(-1, 3), axis=1)
    np.testing.assert_allclose(result.rms, np.sqrt(np.mean(lengths**2)), rtol=1e-6)
    assert result.rank == after.identifiability.rank
    out = content(study, tmp_path / "run")
    assert out["identification"]["path"] == "one by one"
    assert out["cells"][0]["trials"] == {"ok": 3, "failed": 0, "refused": 0}


def test_stated_uncertainties_hold_where_errors_have_their_sizes(tmp_path):
    """Errors drawn with the plausible sizes: 95 % intervals hold in 95 %, and foretold errors are those found."""
    study = write_study(tmp_path, 800, "{poses: 20, errors: drawn}", "{test_poses: 250}")
    (cell,) = content(study, tmp_path / "run")["cells"]
    assert cell["trials"]["ok"] == 800
    assert abs(cell["expected"]["ratio"] - 1) < 4 * cell["expected"]["ratio_error"]
    assert cell["expected"]["ratio_error"] < 0.02
    held = [cell["coverage"]["position"]]
    for each in cell["coverage"]["parameters"].values():
        held += [own for own in (each["held"], each["held_untold"]) if own["of"] > 100]
    assert len(held) >= 16
    for own in held:  # 17 of them: a false alarm in one of a thousand draws of the seed
        assert stats.binomtest(own["count"], own["of"], 0.95).pvalue > 1e-3 / 17


def test_errors_fall_as_cramer_and_rao_say(tmp_path):
    """Without priors that matter, known links but for what is seen: the squared error is that of the linear law.

    rms^2 over trials = mean over test poses of tr(J C J^T), C from the plan alone, by NumPy at the truth.
    """
    study = write_study(tmp_path, 600, "{poses: 30, plan: random, noise: {position: 0.01}}", "{test_poses: 100}")
    out = content(study, tmp_path / "run")
    description, setting = loaded(study)
    drawn = draw(description, setting, description.cells[0], range(600))
    model, sigma = setting.model, setting.sigma(description.cells[0])["position"]
    assert sigma == pytest.approx(0.01 / np.sqrt(3))  # the experiment's noise is uniform
    index = np.arange(len(model.parameters))
    width = model.parameters.scales * np.where([p.unknown for p in model.parameters.items], 1e3, 1.0)
    truth = drawn.truth[0]
    asked = model.jacobian(description.test, truth, model.setup.vector)[0].reshape(-1, len(index)) * width
    bounds = []
    for i in range(0, 600, 10):
        rows = model.jacobian(drawn.poses(i), truth, model.setup.vector)[0].reshape(-1, len(index)) * width / sigma
        values, vectors = np.linalg.svd(rows)[1:]
        seen = vectors[: (values > 1e-9 * values[0]).sum()]
        noise = np.sum((asked @ (seen.T / values[: len(seen)])) ** 2) / len(description.test)
        bounds.append(noise)
    ratio = out["cells"][0]["expected"]["found_rms_mm"] ** 2 / np.mean(bounds)
    assert 0.9 < ratio < 1.1


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_bounds_of_quantiles_hold_whatever_the_law(rng, share):
    draws = [np.sort(rng.lognormal(size=150)) for _ in range(2000)]
    true = stats.lognorm.ppf(share, 1)
    held = sum(q.low <= true <= q.high for q in (quantile(d, share) for d in draws))
    assert stats.binomtest(held, 2000, 0.95, alternative="less").pvalue > 1e-3
    sorted_ = draws[0]
    assert quantile(sorted_, share).value == pytest.approx(np.quantile(sorted_, share))


def test_few_trials_bound_no_outer_quantile(rng):
    found = quantile(np.sort(rng.normal(size=20)), 0.95)
    assert found.high == np.inf
    assert found.facts()["high"] is None
    assert quantile(np.array([1.0, 2.0, np.inf]), 0.9).facts()["value"] is None


@pytest.mark.parametrize(("count", "of"), [(0, 10), (3, 10), (10, 10), (950, 1000)])
def test_bounds_of_shares_are_clopper_and_pearsons(count, of):
    wanted = stats.binomtest(count, of).proportion_ci(0.95, "exact")
    assert (Share(count, of).low, Share(count, of).high) == pytest.approx((wanted.low, wanted.high))


def _cell(poses: int, value: float | None, **shown: object) -> dict:
    bounds = {
        "value": value,
        "low": None if value is None else 0.9 * value,
        "high": None if value is None else 1.1 * value,
    }
    return {"shown": {"poses": poses, **shown}, "judged_mm": {"at_share": bounds}}


QUESTION = {"of": "p95", "against": "truth", "share": 0.95, "tolerance_mm": 0.05}


def test_the_answer_is_the_fewest_poses_from_which_on_all_will_do():
    cells = [_cell(10, 0.08), _cell(15, 0.049), _cell(20, 0.052), _cell(30, 0.04), _cell(40, 0.03)]
    (answer,) = answers(cells, ("poses",), QUESTION)
    assert (answer["poses"], answer["sure"]) == (30, True)
    assert answer["text"].startswith("30 poses are enough for 0.05 mm: in 95")
    assert "with 20 it is 0.0520 mm" in answer["text"]


def test_a_close_answer_says_so_and_none_is_told():
    (close,) = answers([_cell(10, 0.08), _cell(20, 0.049)], ("poses",), QUESTION)
    assert (close["poses"], close["sure"]) == (20, False)
    assert "so few trials do not settle" in close["text"]
    none, failing = answers(
        [_cell(10, 0.08, plan="a"), _cell(20, 0.07, plan="a"), _cell(20, None, plan="b")], ("plan", "poses"), QUESTION
    )
    assert none["poses"] is None
    assert none["text"].startswith("plan a: 0.05 mm cannot be met: 20 poses leave 0.0700 mm")
    assert "too many trials fail" in failing["text"]


def test_refused_trials_count_and_say_why(tmp_path):
    """Five poses are too few to tell the noise from: every trial is there, refused, with its reason; 20 are not."""
    judge, told = "{test_poses: 20, tolerance: 0.3, share: 0.5}", "{noise: estimated}"
    study = write_study(tmp_path, 4, "{poses: [5, 20]}", judge, told)
    out = content(study, tmp_path / "run")
    few, enough = out["cells"]
    assert few["trials"] == {"ok": 0, "failed": 0, "refused": 4}
    assert "5 poses give 15 equations" in few["reasons"][0]["reason"]
    assert few["within"]["share"] == 0.0
    assert few["judged_mm"]["median"]["value"] is None
    assert enough["trials"]["ok"] == 4
    assert any("4 of 4 trials count as errors larger than any" in warning for warning in out["warnings"])
    assert out["answers"][0]["poses"] == 20
    rows = (tmp_path / "run/trials.csv").read_text().splitlines()
    assert sum(",refused," in row for row in rows) == 4


def test_against_measurement_the_test_noise_is_in_the_error(tmp_path):
    study = write_study(tmp_path, 50, FIXED, "{test_poses: 300, against: measurement, of: rms}")
    out = content(study, tmp_path / "run")
    true, seen = out["cells"][0]["error_mm"]["rms"]["median"], out["cells"][0]["judged_mm"]["median"]["value"]
    assert seen == pytest.approx(np.sqrt(true**2 + 3 * (0.1 / np.sqrt(3)) ** 2), rel=0.03)  # uniform, three axes


def test_several_instruments(tmp_path, configs):
    """A tracker alone and with a wire, from one experiment: as many cells, each with its own model."""
    experiment = (configs / "tracker_and_wire.yaml").read_text()
    folder = tmp_path / "experiments"
    folder.mkdir()
    (folder / "both.yaml").write_text(experiment.replace("robots/", f"{configs}/robots/"))
    study = write_study(
        tmp_path, 12, "{instruments: [[tracker], [tracker, wire]], poses: 40}", experiment=folder / "both.yaml"
    )
    try:
        out = content(study, tmp_path / "run")
    except RefusedError as error:
        pytest.fail(str(error))
    alone, both = out["cells"]
    assert (alone["shown"]["instruments"], both["shown"]["instruments"]) == ("tracker", "tracker + wire")
    assert alone["trials"]["ok"] == both["trials"]["ok"] == 12
    assert set(alone["noise"]["sigma"]) == {"position"}
    assert set(both["noise"]["sigma"]) == {"tracker position", "wire distance"}
