"""The search from many starts against SciPy, sent from the same starts one after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import anywhere, handling
from scipy.optimize import least_squares

import symcal as sc
from symcal import Distance, Noise, Observation, Place, Target, Task, build_model, simulate
from symcal.data.dataset import Dataset
from symcal.fit.residual_rows import rows_of
from symcal.model.model import Model
from symcal.placing import multistart
from symcal.placing.multistart import Found, search

FREE = ("wire_x", "wire_y", "wire_z")
PLACE = np.array([900.0, 1200.0, 300.0])


def wire(noise: float) -> tuple[Model, Dataset]:
    """A wire whose place is searched for, and some readings that are missing."""
    rng = np.random.default_rng(3)
    smr = Target("smr", Place("flange"), {"P": (40.0, 0.0, 60.0)})
    model = build_model(
        handling(), Task((Observation(Distance(), "wire", at=Place("world", unknown=True), target=smr),))
    )
    data = simulate(
        model, dict(zip(FREE, PLACE, strict=True)), anywhere(handling(), 30, rng), Noise(distance=noise), rng
    )
    z = data.z.copy()
    z[::7] = np.nan
    return model, replace(data, z=z)


def searched(model: Model, data: Dataset, rng: np.random.Generator, fewest: int = 16) -> Found:
    return search(model, data, model.setup, np.zeros(len(model.parameters)), FREE, 2000.0, rng, fewest)


@pytest.mark.parametrize("noise", [0.05, 1e-9])
def test_the_best_of_many_starts_is_scipys(noise: float) -> None:
    model, data = wire(noise)
    index = model.parameters.indices(FREE)
    found = searched(model, data, np.random.default_rng(1))

    def residual(start, shift):
        x = np.zeros(len(model.parameters))
        x[index] = shift
        return rows_of(model.measurement, data, start, model.residuals)(x)[0].ravel()

    rng, ends = np.random.default_rng(1), []
    for i in range(found.starts):
        start = model.setup if i == 0 else multistart._somewhere(model, model.setup, FREE, 2000.0, rng)
        end = least_squares(lambda shift, start=start: residual(start, shift), np.zeros(3), method="lm", xtol=1e-14)
        ends.append((end.cost, start.places["wire"][:3, :3] @ end.x + start.places["wire"][:3, 3]))
    cost, place = min(ends, key=lambda each: each[0])
    assert found.agreed == sum(each <= 1.05**2 * cost + 1e-9 for each, _ in ends)
    assert np.allclose(found.setup.places["wire"][:3, 3], place, atol=1e-3)
    assert np.allclose(place, PLACE, atol=1.0)


def test_a_search_goes_on_until_enough_starts_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """By no more of them than must agree in any case, as if they were tried one after the other."""
    model, data = wire(0.05)
    calls: list[int] = []
    ends = multistart._Descents.ends

    def odd(self, begin):  # no two of the first starts agree
        calls.append(len(begin))
        out = ends(self, begin)
        if len(calls) == 1:
            out[:, 0] = 1e3 * 2.0 ** np.arange(len(begin))
        return out

    monkeypatch.setattr(multistart._Descents, "ends", odd)
    found = searched(model, data, np.random.default_rng(1))
    assert calls == [16, 3, 1]
    assert (found.starts, found.agreed) == (20, 4)


def test_what_readings_do_not_tell_stays_where_it_started() -> None:
    """A wire from an arm of upright axes to a box: nothing tells their heights apart, and they ran off to 6e14 mm."""
    links = [sc.Link(sc.Joint("revolute", name, -2.0, 2.0), {"theta": 0.0, "a": 300.0}) for name in ("upper", "lower")]
    hook = Target("hook", Place("flange"), {"P": None})
    model = build_model(
        sc.Robot("flat", "standard", tuple(links)),
        Task((Observation(Distance(offset=None), "wire", at=Place("base", unknown=True), target=hook),)),
    )
    rng = np.random.default_rng(1)
    free = ("wire_x", "wire_y", "wire_z", "wire_offset", "hook_P_x", "hook_P_y", "hook_P_z")
    truth = {"wire_x": 700.0, "wire_y": 500.0, "wire_offset": 20.0, "hook_P_x": 60.0, "hook_P_z": 40.0}
    data = simulate(model, truth, rng.uniform(-2.0, 2.0, (40, 2)), Noise(distance=0.1), rng)
    found = search(model, data, model.setup, np.zeros(len(model.parameters)), free, 600.0, rng)
    assert abs(found.setup.places["wire"][2, 3]) < 2000.0
    assert np.abs(found.setup.points).max() < 2000.0
