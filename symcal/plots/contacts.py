"""Postures that touch: the arm with what it touches, and where its point comes to lie about each place, magnified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors, evaluate_each, pooled
from symcal.calibration.held_out_places import HeldOutPlaces, held_out_places
from symcal.data.dataset import Dataset
from symcal.model.measurement import Setup
from symcal.planning.skeleton import Skeleton, skeleton
from symcal.plots.space import draw_arm, draw_face, draw_label, draw_points, space_axes
from symcal.plots.style import FAINT, INK, WIDE, Illustration, escaped, grid, print_settings, settle, sheet
from symcal.plots.touched import Thing, labels, patch, sign, things
from symcal.words import listed, number, plural

Array = NDArray[np.float64]

ROWS = 6
"""Places whose residuals are drawn."""

_FEW = 3  # rows that leave room for large panels
_LARGE, _SMALL = 26.0, 19.5  # height of a row, mm
_ARMS = 4  # postures in which the arm is drawn
_TRIED = 3  # postures of a place among which they are chosen
_LONGEST = 36  # letters of a name
_BELOW = 0.11  # of the scene's size: labels stand so far under their places
_ROOM = 1.1  # of the largest residual that axes show
_NOISE = 2.0  # standard deviations: the circle


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """A thing with its errors before and after, the postures that touch it, shape (k, dof), and whether no training
    pose told where it is."""

    thing: Thing
    before: Errors
    after: Errors
    q: Array
    held_out: bool

    @property
    def moved(self) -> str:
        """Rms before and after, in words."""
        return " → ".join(number(errors.statistics.rms) for errors in (self.before, self.after)) + " mm"


def contacts(
    calibration: Calibration, data: Dataset, found: HeldOutPlaces | None = None, most: int = ROWS
) -> Illustration:
    """Left: the arm in a few of its postures, on what it touches. Right: where the touching point comes to lie about
    its place before (hollow) and after (filled), along the place's axes; of planes the heights.

    Args:
        found: what the held-out poses told of the identified state; found here when None. most: places whose
            residuals are drawn.
    Raises:
        ValueError: nothing is touched.
    """
    places = _places(calibration, data, found or held_out_places(calibration.states["after"], data.part("test")))
    if not places:
        raise ValueError("nothing here is touched")
    shown = _chosen(places, most)
    with print_settings():
        figure = sheet(WIDE, 18 + max((_LARGE if len(shown) <= _FEW else _SMALL) * len(shown), 2 * _LARGE))
        figure.suptitle(" ", fontsize=6.5)  # room for the heads of the columns
        cells = figure.add_gridspec(len(shown), 5, width_ratios=[4.0, 1, 1, 1, 1])
        _space(figure, cells[:, 0], calibration, places, shown)
        before, after = ([_limit(shown, i, flat=flat) for flat in (False, True)] for i in (0, 1))
        rows = [_row(figure, cells, i, place, before, after, calibration) for i, place in enumerate(shown)]
    circles = any(not place.thing.flat and _noise(calibration, place.thing) is not None for place in shown)
    caption = _caption(places, shown, circles=circles)
    return Illustration(_headed(settle(figure), rows), "contacts", "Contacts", caption)


def _places(calibration: Calibration, data: Dataset, found: HeldOutPlaces) -> list[_Place]:
    """Everything that is touched, those that training poses tell first."""
    model, states = calibration.model, calibration.states
    setup = model.moved(found.state.setup, found.state.x)
    errors: dict[str, list[tuple[Errors, Errors, Array]]] = {}
    for part in (data.part("train"), data.part("test")):
        if len(part):
            before, after = (evaluate_each(states[name], part) for name in ("before", "after"))
            for name in after:
                errors.setdefault(name, []).append((before[name], after[name], part.q[after[name].pose]))
    out = []
    for thing in things(model.measurement, setup):
        if thing.name in errors:
            first, last, q = zip(*errors[thing.name], strict=True)
            held_out = any(name in thing.part.observation.names for name in found.settled)
            out.append(_Place(thing, pooled(first), pooled(last), np.concatenate(q), held_out))
    return sorted(out, key=lambda place: place.held_out)


def _chosen(places: list[_Place], most: int) -> list[_Place]:
    """Those whose residuals are drawn: the training ones, then held-out ones with the largest residuals, in order."""
    if len(places) <= most:
        return places
    by_size = sorted(places, key=lambda place: (place.held_out, -place.after.statistics.rms))[:most]
    return [place for place in places if any(place is chosen for chosen in by_size)]


# -------------------------------------------------------------------------------------------------------- left: the arm


def _space(figure: Figure, cell: Any, calibration: Calibration, places: list[_Place], shown: list[_Place]) -> None:
    """The arm on what it touches: one posture for each of the first few places that are shown."""
    model, x = calibration.model, calibration.after.x
    setup = calibration.setup
    arm = skeleton(model.measurement.chain, setup, x)
    bodies = _bodies(shown, arm, x, setup)
    spots = np.array([place.thing.place for place in places if not place.thing.flat]).reshape(-1, 3)
    faces = {
        id(place): patch(place.thing.frame, place.thing.touched_by(place.q, x, setup), 20.0)
        for place in places
        if place.thing.flat
    }
    corners = np.vstack([*bodies, spots, *faces.values()])
    axes = space_axes(figure, cell, corners, zoom=1.12 if len(shown) > _FEW else 0.88)
    for face in faces.values():
        draw_face(axes, face, "#e8e8e8")
    for i, body in enumerate(reversed(bodies)):
        draw_arm(axes, body, color=INK if i == len(bodies) - 1 else FAINT, width=2.0 if i == len(bodies) - 1 else 1.1)
    draw_points(axes, bodies[0][:1], marker="s", markersize=5, color=INK, zorder=8)
    size = float(np.ptp(corners, axis=0).max())
    names, at = [], []
    for place in places:
        index = next((i for i, each in enumerate(shown) if each is place), None)
        where = faces[id(place)].mean(axis=0) if place.thing.flat else place.thing.place
        if index is None:
            draw_points(axes, where[None], marker=".", markersize=3, color=FAINT, zorder=9)
            continue
        draw_points(axes, where[None], markersize=4.5, markeredgecolor="white", zorder=10, **_filled(index))
        names.append(str(index + 1))
        at.append(where)
    for where, words in labels(names, np.array(at), size):
        draw_label(axes, where - np.array([0, 0, _BELOW * size]), words)


def _bodies(shown: list[_Place], arm: Skeleton, x: Array, setup: Setup) -> list[Array]:
    """Polylines of the arm down to what it touches, shape (k, 3) each, mm: the postures that differ most."""
    found = []
    for place in shown:
        q = place.q[np.linspace(0, len(place.q) - 1, min(_TRIED, len(place.q))).astype(int)]
        tips = place.thing.touched_by(q, x, setup)
        found += [np.vstack([nodes, tip]) for nodes, tip in zip(arm.nodes(q), tips, strict=True)]
    chosen = [0]
    while len(chosen) < min(_ARMS, len(found)):
        apart = [min(float(np.linalg.norm(body - found[i])) for i in chosen) for body in found]
        chosen.append(int(np.argmax(apart)))
    return [found[i] for i in chosen]


def _filled(index: int) -> dict[str, Any]:
    return {key: value for key, value in sign(index).items() if key != "linestyle"}


# ------------------------------------------------------------------------------------------------- right: the residuals


def _limit(shown: list[_Place], state: int, *, flat: bool) -> float:
    """Half width of the axes of a state (0 before, 1 after), mm."""
    found = [(place.before, place.after)[state] for place in shown if place.thing.flat == flat]
    return _ROOM * max((float(np.abs(errors.vectors).max()) for errors in found), default=1.0) or 1.0


def _row(
    figure: Figure,
    cells: Any,
    i: int,
    place: _Place,
    before: list[float],
    after: list[float],
    calibration: Calibration,
) -> list[Axes]:
    """The panels of a place, from left to right: before, then after."""
    last = i == cells.nrows - 1
    panels = []
    for state, (errors, limits) in enumerate(((place.before, before), (place.after, after))):
        vectors = errors.vectors
        style = sign(i, hollow=state == 0) | {"markersize": 2.2, "markeredgewidth": 0.5}
        if place.thing.flat:
            axes = figure.add_subplot(cells[i, 1 + 2 * state : 3 + 2 * state])
            axes.plot(np.arange(1, len(vectors) + 1), vectors[:, 0], zorder=3, **style)
            axes.axhline(0, color=INK, linewidth=0.5, zorder=1)
            axes.set_ylim(-limits[1], limits[1])
            axes.set_ylabel("height / mm", fontsize=6)
            axes.set_xlabel("contact", fontsize=6)
            axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
            axes.yaxis.set_major_locator(MaxNLocator(4))
            axes.tick_params(labelsize=5.5)
            grid(axes)
            panels.append(axes)
            continue
        for k, (u, v) in enumerate(((0, 1), (0, 2))):
            axes = figure.add_subplot(cells[i, 1 + 2 * state + k])
            axes.plot(vectors[:, u], vectors[:, v], zorder=3, **style)
            sigma = _noise(calibration, place.thing)
            if state == 1 and sigma is not None:
                axes.add_patch(
                    Circle((0, 0), _NOISE * sigma, fill=False, color=INK, linewidth=0.5, linestyle="--", zorder=2)
                )
            _cross(axes, limits[0])
            axes.set_ylabel("xyz"[v], fontsize=6, labelpad=1)
            axes.set_yticklabels([])
            axes.tick_params(labelsize=5.5)
            if last:
                axes.set_xlabel("xyz"[u] + " / mm", fontsize=6, labelpad=1)
            else:
                axes.set_xticklabels([])
            panels.append(axes)
    _name(panels[0], i, place)
    return panels


def _name(axes: Axes, i: int, place: _Place) -> None:
    """Mark, number and name of a place above its first panel."""
    axes.set_title(" ", fontsize=6.5, pad=2)  # room
    words = axes.annotate(
        f"{i + 1}  {escaped(_short(place.thing.name))}{' (held-out)' * place.held_out}: {place.moved}",
        (0, 1),
        xycoords="axes fraction",
        xytext=(8, 3),
        textcoords="offset points",
        fontsize=6.5,
    )
    figure: Any = axes.get_figure()
    shift = ScaledTranslation(3 / 72, 5.2 / 72, figure.dpi_scale_trans)
    (mark,) = axes.plot(0, 1, transform=axes.transAxes + shift, clip_on=False, markersize=4, **sign(i))
    for drawn in (words, mark):
        drawn.set_in_layout(False)


def _short(name: str) -> str:
    """A name that has room above its panels."""
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"


def _cross(axes: Axes, limit: float) -> None:
    """Equal axes about the place, with ticks at a round distance on each side."""
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    for line in (axes.axhline, axes.axvline):
        line(0, color=INK, linewidth=0.4, zorder=1)
    step = 10 ** np.floor(np.log10(limit))
    step *= max(d for d in (1, 2, 5) if d * step <= 0.95 * limit or d == 1)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_ticks([-step, 0, step], labels=[f"{v:g}".replace("-", "\N{MINUS SIGN}") for v in (-step, 0, step)])
    axes.spines[["top", "right"]].set_visible(True)


def _noise(calibration: Calibration, thing: Thing) -> float | None:
    """Standard deviation per axis of a contact, mm; None where it is by axis or by reading."""
    after, o = calibration.after, thing.part.observation
    groups = [group.name for group in calibration.model.measurement.groups if group.observation == o.of]
    return after.sigmas.get(groups[0]) if len(groups) == 1 else None


def _headed(figure: Figure, rows: list[list[Axes]]) -> Figure:
    """The settled figure with what its columns show written above them."""
    first = rows[0]
    half = len(first) // 2
    top = max(axes.get_position().y1 for axes in first)
    for panels, words in ((first[:half], "before: nominal, frames fitted"), (first[half:], "after: all parameters")):
        left, right = panels[0].get_position().x0, panels[-1].get_position().x1
        figure.text((left + right) / 2, top + 0.19 / figure.get_figheight(), words, fontsize=7, ha="center")
    return figure


def _caption(places: list[_Place], shown: list[_Place], *, circles: bool) -> str:
    count = sum(len(place.q) for place in shown)
    flat = [place for place in shown if place.thing.flat]
    text = (
        f"Left: the calibrated arm in a few of its postures, its base (square) and what it touches. Right: where the "
        f"point that touches comes to lie about its place by the model in {plural(count, 'contact')}, along the "
        "place's axes, before (hollow) and after (filled) the identification, each with a scale of its own"
        + ("; of a plane the heights" if flat else "")
        + ". Rms before → after: "
        + listed([f"{place.thing.name} {place.moved}" for place in shown])
        + "."
    )
    if circles:
        text += f" Dashed circles: {_NOISE:g} standard deviations of the contacts' noise."
    if any(place.held_out for place in shown):
        text += " Held-out places were fitted to their own contacts, the robot held."
    if len(shown) < len(places):
        text += (
            f" Of {len(places)} places those of the training and the held-out ones with the largest residuals are "
            "shown; dots mark the others."
        )
    return text


def has_contacts(calibration: Calibration, data: Dataset) -> bool:
    """Whether there is anything to draw."""
    judged = data.take([split in ("train", "test") for split in data.split])
    found = things(calibration.model.measurement, calibration.setup)
    return any(bool(thing.part.seen(judged.z).any()) for thing in found)
