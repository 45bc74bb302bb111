"""Frames, points and instruments placed by the data with the nominal robot: first guesses, then least squares.

Instruments whose readings give points or whole frames are placed in closed form, one after the other: what one has
placed is known to the next. The others are searched for from many starts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.fit.estimation import Fit, Options, fit, minimised, variance_model
from symcal.fit.residual_rows import Rows, rows_of
from symcal.fit.variances import Variances
from symcal.model.measurement import Setup
from symcal.model.model import Model, State
from symcal.model.observation import Observation
from symcal.parameters import coordinate_names, frame_names
from symcal.placing.ends import Ends, ends_of
from symcal.placing.multistart import STARTS, search
from symcal.placing.registration import LEVER, register
from symcal.placing.scene_placement import camera_guesses, place_scene
from symcal.placing.views import disagreements
from symcal.spatial import inverse, matrix_vectors

Array = NDArray[np.float64]

_ROUGH = {"mm": 1.0, "rad": 1 / LEVER, "px": 1.0}
"""Noise with which places are found whose readings judge: only the ratio of units matters."""

_MORE = 100.0  # mm of a tool, which belongs to the robot's length too


@dataclass(frozen=True, slots=True)
class Placed:
    """Where everything is by nominal kinematics.

    searches: instruments that were searched for, and how many of how many starts came to where they are.
    odd: what is said of views that disagree. variances: with which they were placed, if by least squares.
    """

    setup: Setup
    searches: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    odd: tuple[str, ...] = ()
    variances: Variances | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        return self.odd + tuple(
            f"where '{name}' stands was found by one of {starts} starts only: there may be a better place; a rough "
            "place under 'near' would help"
            for name, (agreed, starts) in self.searches.items()
            if agreed < 2
        )


def place(model: Model, data: Dataset, options: Options, starts: int = STARTS, near: Placed | None = None) -> Setup:
    """See `placed`."""
    return placed(model, data, options, starts, near).setup


def placed(model: Model, data: Dataset, options: Options, starts: int = STARTS, near: Placed | None = None) -> Placed:
    """The model's frames and points as nominal kinematics and the data have them; always by Levenberg-Marquardt.

    A frame of which something is held starts from nominal, so that what is held stays as it was.

    Args:
        starts: of a search for an instrument that is not placed in closed form, at least.
        near: where everything roughly is: nothing is searched for then, but for a fixed camera alone.
    """
    free = placed_by(model, data)
    if not free:
        return Placed(model.setup)
    if model.task.scene is not None:
        return Placed(place_scene(model, model.task.scene, data, options))
    options = replace(options, solver="levenberg_marquardt")
    if len(model.task.observations) > 1:
        # what nominal kinematics leaves is no noise of instruments: stated ones would tell how they share it
        options = replace(options, sigma={})
    nominal = State(model, model.setup, np.zeros(len(model.parameters)))
    if near is None:
        start = _start(nominal, data, free, options, starts)
    else:
        start = Placed(_like(nominal, near.setup, tuple(_open(model, free))), variances=near.variances)
    odd, agreeing = disagreements(model, data, start.setup)
    found = _fit(replace(nominal, setup=start.setup), agreeing, free, options, variances=start.variances)
    return Placed(_found(model, found, free), start.searches, odd, found.variances)


def settled(state: State, data: Dataset, near: Setup | None = None) -> State:
    """The state with what it has unplaced fitted to these data, the robot held.

    Args:
        near: where that roughly is, as another state of the model had it; searched for when None.
    """
    names = tuple(name for name in state.unplaced if name in placed_by(state.model, data))
    if not names:
        return state
    own = _read_by(state.model, data, [o for o in state.model.task.observations if set(names) & set(o.names)])
    options = Options(sigma={group.name: _ROUGH[group.unit] for group in state.model.measurement.groups})
    start = _start(state, own, names, options).setup if near is None else _like(state, near, names)
    found = _fit(replace(state, setup=start), own, names, options, alone=True)
    return replace(state, setup=_found(state.model, found, names), unplaced=())


def _like(state: State, near: Setup, names: tuple[str, ...]) -> Setup:
    """The setup of a state with frames, points and numbers of these parameters as another one has them."""
    setup, wanted = state.setup, {name.rpartition("_")[0] for name in names}
    chosen = [name in wanted for name in state.model.measurement.points_called]
    return replace(
        setup,
        base=near.base if "base" in wanted else setup.base,
        tool=near.tool if "tool" in wanted else setup.tool,
        points=np.where(np.reshape(chosen, (-1, 1)), near.points, setup.points),
        places={name: near.places[name] if name in wanted else place for name, place in setup.places.items()},
        own={name: near.own[name] if name in names else value for name, value in setup.own.items()},
    )


def placed_by(model: Model, data: Dataset) -> tuple[str, ...]:
    """The placement as far as these data have anything of it: not that of instruments that have read nothing here."""
    read = [
        o for part, o in zip(model.measurement.parts, model.task.observations, strict=True) if part.seen(data.z).any()
    ]
    of_read = {name for o in read for name in o.names} - _untold_points(model, data)
    of_others = {name for o in model.task.observations for name in o.names} - of_read
    return tuple(name for name in model.placement if name not in of_others)


def _untold_points(model: Model, data: Dataset) -> set[str]:
    """Coordinates of unknown points of which these data have no reading."""
    known: dict[str, bool] = {}
    for part, o in zip(model.measurement.parts, model.task.observations, strict=True):
        if o.instrument.reads != "points":
            continue
        there = part.seen(data.z).reshape(len(data), part.features, -1)
        for k, point in enumerate(o.features):
            seen = bool(there[:, k].any())
            if point in o.target.unknown_points:
                for name in o.target.coordinates(point):
                    known[name] = known.get(name, False) or seen
    return {name for name, seen in known.items() if not seen}


def stated(model: Model, setup: Setup) -> Array:
    """The frames, points and numbers that the robot and the task state, as errors from a setup, shape (n,).

    That is where priors are centred: what is known of a frame is known of the stated one, wherever it is found.
    """
    errors: dict[str, float] = {}
    frames = [("base", setup.base, model.setup.base), ("tool", setup.tool, model.setup.tool)]
    frames += [(name, place, model.setup.places[name]) for name, place in setup.places.items()]
    for name, frame, nominal in frames:
        step = inverse(frame) @ nominal
        errors |= dict(zip(frame_names(name), (*step[:3, 3], *matrix_vectors(step[:3, :3])), strict=True))
    for name, shift in zip(model.measurement.points_called, model.setup.points - setup.points, strict=True):
        errors |= dict(zip(coordinate_names(name), shift, strict=True))
    errors |= {name: model.setup.own[name] - value for name, value in setup.own.items()}
    return np.array([float(errors.get(name, 0.0)) for name in model.parameters.names])


def from_other(model: Model, x: Array, other: Setup, setup: Setup) -> Array:
    """Errors from a setup that are the same robot, places and numbers as errors ``x`` from another one, shape (n,)."""
    moved = model.moved(other, x)
    errors = model.parameters.mapping(x)
    own = {name: value + errors.get(name, 0.0) for name, value in other.own.items()}
    there = stated(replace(model, setup=replace(moved, own=own)), setup)
    return np.where(np.isin(model.parameters.names, model.placement), there, x)


def _found(model: Model, found: Fit, free: tuple[str, ...]) -> Setup:
    """The setup of a placement, numbers of instruments included; those of a camera stay as they were calibrated."""
    errors = {name: value for name, value in model.parameters.mapping(found.x).items() if name in free}
    frames = set(model.frames)
    own = {name: value + errors.get(name, 0.0) * (name in frames) for name, value in found.setup.own.items()}
    return replace(found.setup.moved(errors, model.measurement.points_called), own=own)


def _start(state: State, data: Dataset, free: tuple[str, ...], options: Options, starts: int = STARTS) -> Placed:
    """Every observation that has something free placed roughly, with the robot of a state."""
    model, x = state.model, state.x
    observations = [o for o in model.task.observations if _told(o) & set(free)]
    givers = [o for o in observations if o.instrument.gives_point or o.instrument.camera is not None]
    setup, still_open, later = state.setup, _open(model, free), list(observations)
    while givers:
        ends = [ends_of(model, o, still_open) for o in givers]
        # what stands at a known place tells the base, before others are placed by it
        order = sorted(range(len(givers)), key=lambda i: _doubt(ends[i]))
        chosen, end = givers.pop(order[0]), ends[order[0]]
        own = data.read_by(chosen.name) if len(data.of) > 1 else data
        if end is None or len(own) == 0:
            continue
        setup = _by_points(replace(state, setup=setup), end, own, data, options)
        still_open -= _told(chosen)
        later.remove(chosen)
    searches: dict[str, tuple[int, int]] = {}
    rng = np.random.default_rng(0)
    for o in later:
        wanted = _told(o) & still_open & set(model.frames)
        names, alone = tuple(name for name in free if name in wanted), _read_by(model, data, [o])
        if not names or len(alone) == 0:
            continue
        found = search(model, alone, setup, x, names, model.robot.length(data.q) + _MORE, rng, starts)
        setup = found.setup
        still_open -= set(names)
        searches[o.name] = (found.agreed, found.starts)
    return Placed(setup, searches)


def _open(model: Model, free: tuple[str, ...]) -> frozenset[str]:
    """What is to be placed freely: frames of which something is held are not."""
    held = {name.rpartition("_")[0] for name in model.task.fix}
    return frozenset(name for name in free if name.rpartition("_")[0] not in held)


def _told(o: Observation) -> frozenset[str]:
    """Parameters that an observation tells: its own, and base and tool as far as it stands on them."""
    on = {o.at.on, o.target.at.on}
    robot = (*(frame_names("base") if "world" in on else ()), *(frame_names("tool") if "tool" in on else ()))
    return frozenset((*o.names, *robot))


def _doubt(end: Ends | None) -> int:
    """How much of an observation's ends is unknown beside the base."""
    if end is None:
        return 9
    return int(end.unknown(end.fixed)) * 2 + int(end.right_mode is not None)


def _by_points(state: State, end: Ends, own: Dataset, data: Dataset, options: Options) -> Setup:
    """The ends of one observation from its points or frames; among several guesses that which fits best.

    Of very many poses a few thousand are looked at: the fit of all comes after.
    """
    own = own.few()
    model, setup, chain = state.model, state.setup, end.chain(own.q, state.x)
    if end.observation.instrument.camera is not None:
        return camera_guesses(end, own, chain, setup)
    nominal = end.registration(setup)
    left, right = end.left_unknown, end.right_mode
    if not left and right is None:
        return setup
    starts = end.starts(own, nominal, chain)
    guesses = register(chain, end.measured(own), nominal, base=left, tool=right, starts=starts)
    setups = [end.placed(setup, guess) for guess in guesses]
    if len(setups) == 1:
        return setups[0]
    floor = min(group.floor for group in model.measurement.groups if group.unit == "mm")
    size = max(min(guess.rms for guess in guesses) / np.sqrt(3), floor)
    sigma = {g.name: size / (LEVER if g.unit == "rad" else 1.0) for g in model.measurement.groups}
    plain = replace(options, loss="linear", sigma=sigma)
    alone, told = _read_by(model, data, [end.observation]).few(), _told(end.observation) & end.open
    names = tuple(name for name in model.placement if name in told)
    return min(setups, key=lambda s: _left(replace(state, setup=s), alone, names, plain))


def _read_by(model: Model, data: Dataset, wanted: Iterable[Observation]) -> Dataset:
    """The data as if nothing else had measured."""
    names = {o.name for o in wanted}
    if len(names) == len(data.of):
        return data
    z = data.z.copy()
    for part in model.measurement.parts:
        if part.observation.name not in names:
            z[:, part.readings] = np.nan
    return replace(data, z=z).take(np.flatnonzero(np.isfinite(z).any(axis=1)))


def _fit(
    state: State,
    data: Dataset,
    free: Iterable[str],
    options: Options,
    *,
    alone: bool = False,
    variances: Variances | None = None,
) -> Fit:
    """Args: alone: by the readings alone, whatever else is known. variances: that are about right, if any are known."""
    names = _framed(state.model, free)
    near = None if variances is None else (state.x, variances)
    return fit(_rows(state, data, names, alone=alone), names, options, state.x, prior_mean=_stated(state), near=near)


def _framed(model: Model, free: Iterable[str]) -> tuple[str, ...]:
    frames = set(model.frames)
    return tuple(name for name in free if name in frames)


def _rows(state: State, data: Dataset, names: tuple[str, ...], *, alone: bool = False) -> Rows:
    model = state.model
    # what is known between things counts once all of them are placed
    others = set(model.placement) if alone else set(model.placement) - set(names)
    return rows_of(model.measurement, data, state.setup, model.residuals, others)


def _stated(state: State) -> Array:
    return stated(state.model, state.setup)


def _left(state: State, data: Dataset, free: Iterable[str], options: Options) -> float:
    """Squared residuals that a guess leaves after a rough fit of the free frames, all noise given; infinite where it
    gives no number. Poses are seen as points, so that guesses are compared in one unit."""
    model, names = state.model, _framed(state.model, free)
    rows = _rows(state, data, names)
    system = variance_model(rows, names, options, state.x, prior_mean=_stated(state))
    given = Variances(dict(options.sigma), dict.fromkeys(system.system.groups, 1.0), rows.seen.astype(float))
    solution = minimised(system, options, given, state.x)
    r = rows.residual(system.system.at(solution.x))
    left = float(np.sum((r * model.measurement.per_unit({"mm": 1.0, "rad": LEVER, "px": 1.0})) ** 2))
    return left if np.isfinite(left) else np.inf
