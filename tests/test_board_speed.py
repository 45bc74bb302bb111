"""A board of 88 corners in 60 views is no burden: the numbers of its system. Times are those of `board_speed.py`."""

from __future__ import annotations

import numpy as np
import pytest
from boards import LARGE, ROBOT, board, built, errors, eye_in_hand, measured, postures

from symcal.calibration.calibrate import calibrate
from symcal.fit.estimation import Options
from symcal.fit.residual_rows import rows_of
from symcal.model.model import build_model


@pytest.mark.parametrize(("backend", "views"), [("auto", 60), ("vm", 20)])
def test_many_views_of_a_board_are_identified_with_a_compiler_and_without(
    backend: str, views: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SYMCAL_KERNELS", backend)
    rng = np.random.default_rng(1)
    data = measured(LARGE, postures(LARGE, views, rng), errors(rng), 0.1, rng)
    model = build_model(ROBOT, eye_in_hand(board(), guess=False))
    found = calibrate(model, None, data, Options()).after
    assert found.converged
    assert found.equations == int(np.isfinite(data.z).sum())
    assert found.sigmas["image"] == pytest.approx(0.1, rel=0.05)


def test_a_system_has_sixteen_rows_for_each_view() -> None:
    """And is not written out: no expression has more instructions than one corner asks for."""
    rng = np.random.default_rng(2)
    model = built(LARGE)
    data = measured(LARGE, postures(LARGE, 10, rng), {}, 0.1, rng)
    rows = rows_of(model.measurement, data, model.setup, model.residuals)
    spread = np.where(rows.seen, 0.1, np.inf)
    n, views = len(model.parameters), int(rows.seen.any(axis=1).sum())
    assert views > 7
    assert rows.at(np.zeros(n)).weighted(spread, np.arange(n), model.parameters.scales).shape == (views * 16, n + 1)
    kernel = model.measurement.parts[0].staged
    assert kernel is not None
    assert kernel.residual.function.n_instructions() < 600
    assert kernel.pose.function.n_instructions() < 4000
    assert model.measurement.predict.n_instructions() < 200
