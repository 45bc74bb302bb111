"""Figures: drawn from the data, labelled with units, captions that say what is drawn; nothing global is touched."""

from __future__ import annotations

import re
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
import scipy.stats
from identifications import Case, simulated, wired
from matplotlib.colors import to_rgb
from PIL import Image

from symcal import plots
from symcal.calibration.evaluate import Errors, evaluate, statistics
from symcal.model.model import State
from symcal.plots import panels, style
from symcal.plots.cells import in_cells
from symcal.plots.pixels import PIXELS_PER_INCH, pixels
from symcal.plots.save import save_figure, save_figures
from symcal.words import number, symbol

Figures = dict[str, plots.Illustration]


@pytest.fixture(scope="module")
def position(configs: Path) -> Case:
    return simulated(configs, "position")


@pytest.fixture(scope="module")
def pose(configs: Path) -> Case:
    return simulated(configs, "pose")


@pytest.fixture(scope="module")
def position_figures(position: Case) -> Figures:
    return {i.name: i for i in plots.identification_figures(*position)}


@pytest.fixture(scope="module")
def pose_figures(pose: Case) -> Figures:
    return {i.name: i for i in plots.identification_figures(*pose)}


@pytest.fixture(scope="module")
def wire_figures(configs: Path) -> Figures:
    return {i.name: i for i in plots.identification_figures(*wired(configs))}


@pytest.mark.parametrize("kind", ["position_figures", "pose_figures", "wire_figures"])
def test_every_quantity_on_an_axis_has_its_unit(kind: str, request: pytest.FixtureRequest) -> None:
    for illustration in request.getfixturevalue(kind).values():
        for axes in illustration.figure.axes:
            labels = [axes.get_xlabel(), axes.get_ylabel()]
            assert any(labels) or not axes.get_visible() or axes.get_shared_x_axes().get_siblings(axes), (
                illustration.name
            )
            for label in labels:
                quantity = re.search(r"error|correction|value|learnt", label)
                assert not quantity or re.search(r"/\s?(mm|mrad|deg|%|1)$", label), f"{illustration.name}: {label!r}"


def test_a_wire_does_not_tell_a_position_error(wire_figures: Figures) -> None:
    assert "predicted_error" not in wire_figures
    for name in ("errors_per_pose", "error_distribution", "residuals_per_axis", "convergence"):
        illustration = wire_figures[name]
        labels = " ".join(axes.get_xlabel() + axes.get_ylabel() for axes in illustration.figure.axes)
        assert "error along the distance" in illustration.caption.lower(), name
        assert "position" not in labels + illustration.caption, name
        assert "tool" not in labels + illustration.caption, name
        assert "error along the distance / mm" in labels or name == "residuals_per_axis"


def _errors(size: int, unit: str, words: str, *, of_tool: bool = False) -> dict[str, dict[str, Errors]]:
    vectors = np.random.default_rng(3).normal(size=(12, size))
    names = ("x", "y", "z") if size == 3 else ("across_1", "across_2")[:size]
    pose, point = np.repeat(np.arange(6), 2), np.zeros(12, int)
    found = Errors(vectors, pose, point, None, "any", unit, words, names, of_tool)
    return {"train": {"before": found, "after": found}}


@pytest.mark.parametrize(
    ("errors", "labels", "words"),
    [
        (_errors(1, "mm", "error along the distance"), ["error / mm"], "Error along the distance, model minus"),
        (
            _errors(2, "deg", "angle between the directions"),
            ["across 1 / deg", "across 2 / deg"],
            "Components of the angle between the directions, model minus",
        ),
        (
            _errors(3, "mm", "error across the lines of sight"),
            [f"error in {c} / mm" for c in "xyz"],
            "Components of the error across the lines of sight in world, model minus",
        ),
        (
            _errors(3, "mm", "tool error", of_tool=True),
            [f"error in {c} / mm" for c in "xyz"],
            "Components of the position error in world, model minus",
        ),
    ],
    ids=["distance", "direction", "pixels", "position"],
)
def test_residuals_have_a_panel_for_every_component(
    errors: dict[str, dict[str, Errors]], labels: list[str], words: str
) -> None:
    illustration = plots.residuals_per_axis(errors)
    series = illustration.figure.axes[::2]
    assert [axes.get_ylabel() for axes in series] == labels
    vectors = errors["train"]["after"].vectors
    for axes, values in zip(series, vectors.T, strict=True):
        lines: Any = axes.get_lines()
        np.testing.assert_array_equal(lines[-2].get_ydata(), values)  # the last one is the line at zero
    assert illustration.caption.startswith(words)
    assert f"{number(float(vectors[:, 0].std()), 2)} {errors['train']['after'].unit}" in illustration.caption


def test_errors_of_a_pose_that_several_instruments_read_are_put_together() -> None:
    errors = _errors(3, "mm", "tool error", of_tool=True)
    axes = plots.errors_per_pose(errors).figure.axes[0]
    assert axes.get_ylabel() == "position error,\nrms over instruments / mm"
    drawn: Any = [line.get_ydata() for line in axes.get_lines()][-1]
    np.testing.assert_allclose(drawn, np.sqrt((errors["train"]["after"].size ** 2).reshape(6, 2).mean(axis=1)))


def test_nothing_global_is_touched(position: Case, tmp_path: Path) -> None:
    before = dict(matplotlib.rcParams)
    for illustration in plots.identification_figures(*position)[-2:]:
        save_figure(illustration, tmp_path)
    assert dict(matplotlib.rcParams) == before
    if "matplotlib.pyplot" in sys.modules:  # others may have imported it; no figure is registered there
        assert sys.modules["matplotlib.pyplot"].get_fignums() == []


def test_files_are_vector_and_reproducible(position: Case, tmp_path: Path) -> None:
    illustration = plots.singular_values(position[0].after.identifiability)
    assert b"/Type3" not in save_figure(illustration, tmp_path, truetype=True).file.read_bytes()
    picture = save_figure(illustration, tmp_path)
    first = picture.file.read_bytes()
    assert first.startswith(b"%PDF")
    assert picture.file.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert save_figure(illustration, tmp_path).file.read_bytes() == first
    assert picture.width_mm == pytest.approx(style.NARROW)


def test_captions_tell_the_errors_that_are_drawn(pose: Case, pose_figures: Figures) -> None:
    _, _, errors = pose
    figures = pose_figures
    after = statistics(errors["test"]["after"].size)
    caption = figures["errors_per_pose"].caption
    angle = errors["test"]["after"].orientation
    assert angle is not None
    for value in (after.rms, after.max, float(np.sqrt(np.mean(np.rad2deg(angle) ** 2)))):
        assert number(value) in caption
    assert number(after.p95) in figures["error_distribution"].caption
    assert number(statistics(errors["truth"]["after"].size).p95) in figures["true_error_distribution"].caption
    assert "simulated truth" in figures["true_error_distribution"].caption


def test_every_pose_is_drawn_once_per_state(position: Case, position_figures: Figures) -> None:
    _, data, errors = position
    axes = position_figures["errors_per_pose"].figure.axes[0]
    drawn: Any = [line.get_ydata() for line in axes.get_lines() if len(np.asarray(line.get_xdata())) > 2]
    assert sum(len(y) for y in drawn) == 3 * len(data)
    last = np.asarray(drawn[-1])
    np.testing.assert_allclose(last, errors["test"]["after"].size)


def test_corrections_have_95_percent_bars_and_are_hollow_where_assumed(position: Case) -> None:
    calibration = position[0]
    fit, model = calibration.after, calibration.model
    known = fit.posterior
    illustration = plots.parameter_corrections(calibration)
    errors = model.parameters.mapping(fit.x)
    half = dict(zip(known.names, known.half_widths(), strict=True))
    share = dict(zip(known.names, known.learnt, strict=True))
    angles = [n for n in model.robot.parameters if n in half and n.split("_")[0] in ("theta", "alpha", "beta")]
    groups = [[n for n in angles if share[n] < 0.5], [n for n in angles if share[n] >= 0.5]]
    assert all(groups)
    for bars, names, hollow in zip(illustration.figure.axes[0].containers, groups, (True, False), strict=True):
        found: Any = bars
        np.testing.assert_allclose(np.asarray(found[0].get_ydata()), [1e3 * errors[n] for n in names])
        assert (found[0].get_markerfacecolor() == "white") == hollow
        drawn = [0.5 * (s[1, 1] - s[0, 1]) for s in found[2][0].get_segments()]
        np.testing.assert_allclose(drawn, [1e3 * half[n] for n in names])
    links = [n for n in known.names if n in model.robot.parameters]
    assert f"Filled: {sum(share[n] >= 0.5 for n in links)} that were mostly learnt" in illustration.caption


def test_what_was_learnt_is_drawn_once_for_every_link_parameter(position: Case) -> None:
    calibration = position[0]
    known = calibration.after.posterior
    share = {
        n: 100 * s for n, s in zip(known.names, known.learnt, strict=True) if n in calibration.model.robot.parameters
    }
    illustration = plots.what_was_learnt(calibration)
    whole, learnt = illustration.figure.axes[0].containers
    assert [bar.get_height() for bar in whole] == [100.0] * len(share)
    np.testing.assert_allclose([bar.get_height() for bar in learnt], list(share.values()))
    assert [text.get_text() for text in illustration.figure.axes[0].get_xticklabels()] == [symbol(n) for n in share]
    at = np.array([bar.get_x() for bar in learnt])
    assert np.all(np.diff(at) >= 1)
    assert f"{sum(s >= 50 for s in share.values())} of {len(share)} were mostly learnt" in illustration.caption


def test_spectrum_counts_what_the_rank_says(position: Case) -> None:
    seen = position[0].after.identifiability
    illustration = plots.singular_values(seen)
    legend = illustration.figure.axes[0].get_legend()
    assert legend is not None
    counts = [int(text.get_text().rpartition(":")[2]) for text in legend.get_texts()]
    assert sum(counts) == len(seen.names)
    assert f"{seen.rank} of {len(seen.names)} directions" in illustration.caption


def test_correlation_shows_the_strongest_pair(position: Case) -> None:
    fit = position[0].after
    keep = np.flatnonzero(fit.posterior.learnt >= 0.5)
    matrix = fit.posterior.correlation()[np.ix_(keep, keep)]
    image = np.ma.filled(plots.correlation_matrix(fit).figure.axes[0].images[0].get_array(), 0.0)
    assert np.abs(image).max() == pytest.approx(np.abs(np.tril(matrix, -1)).max())
    assert number(float(np.tril(matrix, -1).flat[np.abs(np.tril(matrix, -1)).argmax()]), 2) in (
        plots.correlation_matrix(fit).caption
    )


def test_convergence_ends_at_the_error_after(position: Case) -> None:
    calibration, data, errors = position
    illustration = plots.convergence(calibration, {"train": data.part("train")})
    curve = np.asarray(illustration.figure.axes[0].get_lines()[0].get_ydata())
    assert len(curve) == len(calibration.after.path)
    assert curve[-1] == pytest.approx(statistics(errors["train"]["after"].size).rms)


def test_predicted_error_is_right_in_simulation(configs: Path) -> None:
    """With normal noise and a right model about 95 % of new errors are below the 95 % limit."""
    calibration, data, errors = simulated(configs, "position", train=40, test=400)
    caption = plots.predicted_error(calibration, data.part("test"), errors["test"]["after"]).caption
    share = re.search(r"([\d.]+) % are below", caption)
    assert share is not None
    # noise and covariance come from 40 poses: five binomial standard deviations and 15 % of sigma
    assert 85 <= float(share.group(1)) <= 99.9


def test_predicted_error_is_that_of_the_instruments_that_give_points(configs: Path) -> None:
    """A wire reads every pose and a tracker every other one: 95 % of the tracker's errors are below the limit."""
    calibration, data, _ = wired(configs, tracked=True, test=400)
    test = data.part("test")
    z = test.z.copy()
    z[::2, 1:] = np.nan
    test = replace(test, z=z)
    after = evaluate(State(calibration.model, calibration.setup, calibration.after.x), test)
    assert after.of_tool
    caption = plots.predicted_error(calibration, test, after).caption
    assert "200 held-out poses" in caption
    share = re.search(r"([\d.]+) % are below", caption)
    assert share is not None
    assert 85 <= float(share.group(1)) <= 99.9


@pytest.mark.parametrize("counts", [(40,), (40, 1000), (57, 57)])
def test_places_do_not_overlap(counts: tuple[int, ...]) -> None:
    at = panels.places(counts)
    joined = np.concatenate(at)
    assert [len(x) for x in at] == list(counts)
    assert np.all(np.diff(joined) > 0)
    assert 0 <= joined[0] < joined[-1] <= 1


def test_states_differ_in_lightness_alone() -> None:
    """Relative luminance (ITU-R BT.709, linear) turned into CIE L*: at least 15 apart in a grey copy."""

    def lightness(color: str) -> float:
        rgb = np.array(to_rgb(color))
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        return float(116 * np.cbrt(linear @ [0.2126, 0.7152, 0.0722]) - 16)

    values = sorted(lightness(style.LOOKS[s].color) for s in ("before", "offsets_only", "after"))
    assert min(np.diff(values)) > 15


def test_without_test_poses_and_without_noise(configs: Path) -> None:
    calibration, data, errors = simulated(configs, "position", test=0)
    names = [i.name for i in plots.identification_figures(calibration, data, errors)]
    assert "predicted_error" not in names
    exact = {"train": {s: replace(e, vectors=0 * e.vectors) for s, e in errors["train"].items()}}
    assert "0 mm" in plots.errors_per_pose(exact).caption
    assert plots.residuals_per_axis(exact).figure.axes
    assert plots.error_distribution(exact["train"], "train").figure.axes


def test_dollars_in_names_are_text() -> None:
    assert style.escaped("P$1$") == r"P\$1\$"


def test_the_tolerance_is_drawn_where_it_is(position: Case) -> None:
    """Within both panels, beyond the largest error too, and told in the caption."""
    _, _, errors = position
    for limit in (0.3, 50.0):
        drawn = plots.error_distribution(errors["test"], limit=limit)
        assert f"the tolerance, {number(limit)} mm" in drawn.caption
        for axes in drawn.figure.axes[:2]:
            assert [limit, limit] in [list(line.get_xdata()) for line in axes.lines]
            assert axes.get_xlim()[0] <= limit <= axes.get_xlim()[1]
        drawn.figure.canvas.draw()
        (named,) = [text for text in drawn.figure.axes[0].texts if text.get_text() == "tolerance"]
        box, frame = named.get_window_extent(), drawn.figure.axes[0].get_window_extent()
        assert frame.x0 <= box.x0
        assert box.x1 <= frame.x1
    assert "tolerance" not in plots.error_distribution(errors["test"]).caption


@pytest.mark.parametrize("statistic", ["max", "mean"])
def test_cells_hold_what_scipy_finds_in_them(statistic: Any) -> None:
    rng = np.random.default_rng(0)
    flat, values = np.round(rng.normal(size=(400, 2)), 1), rng.normal(size=400)  # many points on edges
    for where in (None, rng.random(400) < 0.3):
        found, *edges = in_cells(flat, values, 0.5, statistic, where)
        own = slice(None) if where is None else where
        wanted = scipy.stats.binned_statistic_2d(*flat[own].T, values[own], statistic=statistic, bins=edges)
        np.testing.assert_array_equal(found, wanted.statistic)


def test_figures_are_laid_out_as_matplotlib_alone_does_it(position: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Margins that are remembered while ticks stay move no axes by more than a pixel of the layout."""
    remembered = plots.identification_figures(*position)
    monkeypatch.setattr(style, "_margins_remembered", lambda _: nullcontext())
    for own, plain in zip(remembered, plots.identification_figures(*position), strict=True):
        for axes, wanted in zip(own.figure.axes, plain.figure.axes, strict=True):
            assert "get_tightbbox" not in vars(axes)
            found = [a.get_window_extent().get_points() for a in (axes, wanted)]
            np.testing.assert_allclose(*found, atol=1.0, err_msg=own.name)


def test_pixels_are_those_of_the_pdf(position: Case, tmp_path: Path) -> None:
    """Against another program that draws PDF files: the same size, and a picture that differs by edges alone."""
    pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2, which draws PDF files, is not installed")
    shown = save_figures(plots.identification_figures(*position)[:3], tmp_path)
    for picture in shown:
        page = pdfium.PdfDocument(picture.file)[0].render(scale=PIXELS_PER_INCH / 72)
        wanted = page.to_pil().convert("L")
        found = Image.open(picture.file.with_suffix(".png")).convert("L")
        assert np.abs(np.subtract(found.size, wanted.size)).max() <= 1
        smaller = [np.asarray(image.resize((200, 100), Image.Resampling.BOX), dtype=float) for image in (found, wanted)]
        assert np.abs(np.subtract(*smaller)).mean() < 1.0  # of 255
        assert np.corrcoef(smaller[0].ravel(), smaller[1].ravel())[0, 1] > 0.98
    assert pixels([picture.file.read_bytes() for picture in shown[:1]]) == (
        shown[0].file.with_suffix(".png").read_bytes(),
    )
    assert pixels([]) == ()
