"""Any number of instruments against an independent model in NumPy: rank at the truth, errors against Cramer-Rao.

    python tests/known_truth.py [draws [scenarios]]        long form of test_known_truth.py: 100 draws of each scenario

The witness knows no screws and no CasADi: homogeneous matrices, and derivatives by complex steps.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from cases import ARM
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.transform import Rotation

from symcal.calibration.calibrate import calibrate
from symcal.calibration.simulate import simulate
from symcal.camera.board import parse_board
from symcal.camera.camera import INTRINSIC_NAMES, Camera
from symcal.fit.estimation import Options
from symcal.instruments import Instrument, kind_named
from symcal.instruments.noise import Noise
from symcal.model.contact import constraints, contact_postures
from symcal.model.growth import growth
from symcal.model.measurement import Setup
from symcal.model.model import Model, build_model, nominal_setup
from symcal.model.observation import Observation, Place, Target
from symcal.model.task import Task
from symcal.placing.placement import stated
from symcal.spatial import look_at, transform

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
POSES = 60
SIZE = 0.2  # of the default plausible sizes: so small that the model is linear from gauge to gauge at the noise
_STEP = 1e-30


def kind(name: str, **settings: object) -> Instrument:
    return kind_named(name)(**settings)


# ------------------------------------------------------------------------------------------------------ the scenarios


@dataclass(frozen=True)
class Scenario:
    """What is measured, and where everything truly stands; noise by observation and quantity.

    priors: of the cameras' numbers, by parameter. seen: whether postures are those at which a camera sees its board.
    """

    task: Task
    setup: Setup
    noise: Mapping[str, Mapping[str, float]]
    priors: Mapping[str, float] = field(default_factory=dict)
    seen: bool = False


def frame(rng: np.random.Generator, size: float, turn: float = np.pi) -> Array:
    direction = rng.normal(size=3)
    rotation = Rotation.from_rotvec(turn * rng.uniform(0.3, 1) * direction / np.linalg.norm(direction)).as_matrix()
    return transform(rotation, rng.uniform(0.4, 1.0, 3) * size * rng.choice([-1.0, 1.0], 3))


def near(place: Array, rng: np.random.Generator, mm: float = 30.0, rad: float = 0.05) -> Array:
    return np.asarray(
        place @ transform(Rotation.from_rotvec(rad * rng.normal(size=3)).as_matrix(), mm * rng.normal(size=3))
    )


def unknown(on: str = "world", guess: Array | None = None) -> Place:
    return Place(on, guess, unknown=True)


def three_wires(rng: np.random.Generator) -> Scenario:
    target = Target("smr", Place("flange"), {"P": None})
    wires = [Observation(kind("distance", offset=None), f"wire_{c}", at=unknown("base"), target=target) for c in "abc"]
    places = {o.name: transform(np.eye(3), rng.uniform(600, 1500, 3) * rng.choice([-1, 1], 3)) for o in wires}
    own = {f"{o.name}_offset": float(rng.uniform(-50, 50)) for o in wires}
    setup = Setup(np.eye(4), np.eye(4), rng.uniform(30, 90, (1, 3)), places, own)
    return Scenario(Task(tuple(wires)), setup, {o.name: {"distance": 0.05} for o in wires})


def two_dial_gauges(rng: np.random.Generator) -> Scenario:
    target = Target("ball", Place("flange"), {"P": (20.0, -10.0, 60.0)})
    places = {name: frame(rng, 800.0) for name in ("gauge_1", "gauge_2")}
    gauges = [
        Observation(kind("component"), name, at=unknown("base", near(place, rng)), target=target)
        for name, place in places.items()
    ]
    setup = Setup(np.eye(4), np.eye(4), np.array([[20.0, -10.0, 60.0]]), places)
    return Scenario(Task(tuple(gauges)), setup, {name: {"component": 0.02} for name in places})


def tracker_and_wire(rng: np.random.Generator) -> Scenario:
    target = Target("smr", Place("flange"), {"P": None})
    tracker = Observation(kind("position"), "tracker", target=target)
    wire = Observation(kind("distance", offset=None), "wire", at=unknown(), target=target)
    base = frame(rng, 1500.0)
    anchor = np.asarray(base @ transform(np.eye(3), rng.uniform(600, 1200, 3)))
    setup = Setup(base, np.eye(4), rng.uniform(30, 90, (1, 3)), {"wire": anchor}, {"wire_offset": 12.0})
    return Scenario(
        Task((tracker, wire), base=True), setup, {"tracker": {"position": 0.05}, "wire": {"distance": 0.03}}
    )


def two_trackers(rng: np.random.Generator) -> Scenario:
    target = Target("smr", Place("flange"), {"P": None, "Q": None})
    first = Observation(kind("position"), "tracker_1", target=target)
    second = Observation(kind("position"), "tracker_2", at=unknown(), target=target)
    setup = Setup(frame(rng, 1500.0), np.eye(4), rng.uniform(30, 120, (2, 3)), {"tracker_2": frame(rng, 2000.0)})
    noise = {"tracker_1": {"position": 0.05}, "tracker_2": {"position": 0.1}}
    return Scenario(Task((first, second), base=True), setup, noise)


def two_sessions(rng: np.random.Generator) -> Scenario:
    monday = Observation(kind("position"), "monday", target=Target("first", Place("flange"), {"P": None}))
    second = Target("second", Place("flange"), {"Q": None})
    tuesday = Observation(kind("position"), "tuesday", at=unknown(), target=second, session="tuesday")
    setup = Setup(frame(rng, 1500.0), np.eye(4), rng.uniform(30, 120, (2, 3)), {"tuesday": frame(rng, 2000.0)})
    return Scenario(Task((monday, tuesday), base=True), setup, {n: {"position": 0.05} for n in ("monday", "tuesday")})


def eye_in_hand(rng: np.random.Generator) -> Scenario:
    camera = Observation(kind("pose"), "camera", at=Place("tool"), target=Target("board", Place("world")))
    setup = Setup(frame(rng, 900.0), frame(rng, 80.0))
    return Scenario(Task((camera,), base=True, tool=True), setup, {"camera": {"position": 0.1, "orientation": 2e-4}})


def directions_only(rng: np.random.Generator) -> Scenario:
    beams = Target("beams", Place("tool"), {}, {"along": (0.0, 0.0, 1.0), "across": (1.0, 0.2, 0.0)})
    seen = Observation(kind("direction"), "directions", target=beams)
    setup = Setup(frame(rng, 500.0), frame(rng, 50.0))
    return Scenario(Task((seen,), base=True, tool=True), setup, {"directions": {"direction": 1e-4}})


def one_pin(rng: np.random.Generator) -> Scenario:
    target = Target("ball", Place("flange"), {"P": None})
    pin = Observation(kind("fixed_point"), "pin", at=unknown("base"), target=target)
    setup = Setup(np.eye(4), np.eye(4), rng.uniform(30, 90, (1, 3)), {"pin": within_reach(rng)})
    return Scenario(Task((pin,)), setup, {"pin": {"position": 0.05}})


def two_sockets(rng: np.random.Generator) -> Scenario:
    """The known distance is itself a measurement: the true one is off by its noise."""
    target = Target("ball", Place("flange"), {"P": None})
    pins = [Observation(kind("fixed_point"), name, at=unknown("base"), target=target) for name in ("left", "right")]
    on_right = Target("right", unknown("base"), {"O": (0.0, 0.0, 0.0)})
    gap = Observation(
        kind("distance"),
        "gap",
        at=unknown("base"),
        target=on_right,
        noise={"distance": 0.1},
        place_name="left",
        value=(150.0,),
    )
    left = within_reach(rng)
    way = rng.normal(size=3)
    right = transform(np.eye(3), left[:3, 3] + (150 + 0.1 * rng.normal()) * way / np.linalg.norm(way))
    setup = Setup(
        np.eye(4),
        np.eye(4),
        np.vstack([rng.uniform(30, 90, (1, 3)), np.zeros((1, 3))]),
        {"left": left, "right": right},
        {"gap_offset": 0.0},
    )
    return Scenario(Task((*pins, gap)), setup, {o.name: {"position": 0.05} for o in pins})


def three_planes(rng: np.random.Generator) -> Scenario:
    target = Target("ball", Place("flange"), {"P": (20.0, -10.0, 60.0)})
    turns = [np.eye(3), *(Rotation.from_euler(axis, 60, degrees=True).as_matrix() for axis in "xy")]
    planes, places = [], {}
    for name, turn in zip(("floor", "wall", "slope"), turns, strict=True):
        places[name] = transform(
            turn @ Rotation.from_rotvec(0.2 * rng.normal(size=3)).as_matrix(), within_reach(rng)[:3, 3]
        )
        at = unknown("base", near(places[name], rng, 5.0, 0.02))
        planes.append(Observation(kind("plane", radius=5.0), name, at=at, target=target))
    setup = Setup(np.eye(4), np.eye(4), np.array([[20.0, -10.0, 60.0]]), places)
    return Scenario(Task(tuple(planes)), setup, {name: {"height": 0.03} for name in places})


def pin_and_camera(rng: np.random.Generator) -> Scenario:
    """A ball in a socket, and beside it on the flange a board that a camera sees: half of the postures touch."""
    ball = Target("ball", Place("flange"), {"P": None})
    board = Target("board", unknown("flange"), board=parse_board("charuco:6x5:40mm:30mm:DICT_4X4_100"))
    camera, true = lens(rng)
    pin = Observation(kind("fixed_point"), "pin", at=unknown("base"), target=ball)
    eye = Observation(kind("pixels", camera=camera), "eye", at=unknown("world"), target=board)
    places = {  # in the order of the observations, as a setup's vector has it
        "pin": within_reach(rng),
        "eye": near(look_at(np.array([1500.0, -700.0, 500.0]), np.array([200.0, 0.0, 300.0])), rng, 60.0, 0.1),
        "board": near(transform(np.diag([1.0, -1.0, -1.0]), np.array([-100.0, 80.0, 20.0])), rng, 15.0, 0.2),
    }
    points, own = rng.uniform(30, 90, (1, 3)), _numbers("eye", true)
    setup = Setup(np.eye(4), np.eye(4), points, places, own)
    noise = {"pin": {"position": 0.05}, "eye": {"image": 0.2}}
    return Scenario(Task((pin, eye)), setup, noise, _priors("eye"), seen=True)


def within_reach(rng: np.random.Generator) -> Array:
    """A place in front of the arm."""
    shift = rng.uniform(-100, 100, 3)
    return transform(np.eye(3), np.array([450.0, 0.0, 250.0]) + shift)


LENS = (5.0, 5.0, 5.0, 5.0, 0.01, 0.01, 0.001, 0.001, 0.01)  # standard deviations of a calibration
NUMBERS = np.array([620.0, 622.0, 639.5, 511.5, -0.06, 0.02, 0.0005, -0.0004, 0.0])


def lens(rng: np.random.Generator) -> tuple[Camera, Array]:
    """A wide lens as its calibration has it, and the numbers that it truly has."""
    numbers = NUMBERS * rng.uniform(0.98, 1.02)
    camera = Camera(1280, 1024, *numbers[:4].tolist(), tuple(numbers[4:].tolist()), np.diag(np.square(LENS)))
    return camera, numbers + np.array(LENS) * rng.normal(size=9)


def _numbers(name: str, true: Array) -> dict[str, float]:
    return {f"{name}_{n}": float(v) for n, v in zip(INTRINSIC_NAMES, true, strict=True)}


def _priors(*names: str) -> dict[str, float]:
    return {f"{name}_{n}": s for name in names for n, s in zip(INTRINSIC_NAMES, LENS, strict=True)}


def eye_in_hand_board(rng: np.random.Generator) -> Scenario:
    board = Target("board", unknown("world"), board=parse_board("charuco:8x6:60mm:44mm:DICT_4X4_100"))
    camera, true = lens(rng)
    eye = Observation(kind("pixels", camera=camera), "eye", at=unknown("flange"), target=board)
    lying = transform(np.diag([1.0, -1.0, -1.0]), np.array([300.0, 250.0, -300.0]))  # its printed side up
    places = {"eye": frame(rng, 60.0, 0.6), "board": near(lying, rng, 60.0, 0.2)}
    setup = Setup(np.eye(4), np.eye(4), places=places, own=_numbers("eye", true))
    return Scenario(Task((eye,)), setup, {"eye": {"image": 0.3}}, _priors("eye"), seen=True)


def two_cameras_board(rng: np.random.Generator) -> Scenario:
    board = Target("board", unknown("flange"), board=parse_board("charuco:6x5:40mm:30mm:DICT_4X4_100"))
    first, true_first = lens(rng)
    second, true_second = lens(rng)
    cameras = (
        Observation(kind("pixels", camera=first), "left", at=Place("world", np.eye(4)), target=board),
        Observation(kind("pixels", camera=second), "right", at=unknown("world"), target=board),
    )
    left, right = (look_at(np.array([1300.0, y, 500.0]), np.array([0.0, 0.0, 400.0])) for y in (-600.0, 600.0))
    outward = transform(np.diag([1.0, -1.0, -1.0]), np.array([-100.0, 80.0, 20.0]))  # printed side out
    base = near(np.linalg.inv(left), rng, 60.0, 0.1)
    places = {  # in the order of the observations, as a setup's vector has it
        "left": np.eye(4),
        "board": near(outward, rng, 15.0, 0.2),
        "right": np.asarray(base @ near(right, rng, 60.0, 0.1)),
    }
    own = _numbers("left", true_first) | _numbers("right", true_second)
    noise = {"left": {"image": 0.1}, "right": {"image": 0.2}}
    priors = _priors("left", "right")
    setup = Setup(base, np.eye(4), places=places, own=own)
    return Scenario(Task(cameras, base=True), setup, noise, priors, seen=True)


SCENARIOS: dict[str, Callable[[np.random.Generator], Scenario]] = {
    f.__name__: f
    for f in (
        three_wires,
        two_dial_gauges,
        tracker_and_wire,
        two_trackers,
        two_sessions,
        eye_in_hand,
        directions_only,
        one_pin,
        two_sockets,
        three_planes,
        eye_in_hand_board,
        two_cameras_board,
        pin_and_camera,
    )
}


# -------------------------------------------------------------------------------------------------------- the witness


def about(axis: int, angle: Complex) -> Complex:
    """Turns about an axis, shape (N, 4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    t = np.tile(np.eye(4, dtype=complex), (len(angle), 1, 1))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    t[:, i, i], t[:, i, j], t[:, j, i], t[:, j, j] = c, -s, s, c
    return t


def along(axis: int, length: complex) -> Complex:
    t = np.eye(4, dtype=complex)
    t[axis, 3] = length
    return t


def increment(values: Complex) -> Complex:
    """A frame's increment: translation, then a rotation vector; by the series of the exponential."""
    x, y, z = values[3:]
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    t, term = np.eye(4, dtype=complex), np.eye(3, dtype=complex)
    for n in range(1, 20):
        term = term @ k / n
        t[:3, :3] += term
    t[:3, 3] = values[:3]
    return t


@dataclass(frozen=True)
class Witness:
    """Readings of a scenario at joint readings (N, dof) and errors by parameter name."""

    scenario: Scenario

    def moved(self, nominal: Array, name: str, e: Mapping[str, complex]) -> Complex:
        axes = ("x", "y", "z", "rx", "ry", "rz")
        return nominal @ increment(np.array([e.get(f"{name}_{axis}", 0.0) for axis in axes], dtype=complex))

    def stations(self, q: Array, e: Mapping[str, complex]) -> dict[str, Complex]:
        setup, still = self.scenario.setup, np.tile(np.eye(4, dtype=complex), (len(q), 1, 1))
        t = still @ self.moved(setup.base, "base", e)
        found, nothing = {"world": still, "base": t}, np.zeros(len(q), dtype=complex)
        for i, (link, reading) in enumerate(zip(ARM.links, q.T, strict=True), start=1):
            own = {k: link.parameters[k] + e.get(f"{k}_{i}", 0.0) for k in link.parameters}
            t = t @ about(0, own.get("alpha", 0.0) + nothing) @ along(0, own.get("a", 0.0))
            t = t @ about(1, own.get("beta", 0.0) + nothing)
            t = t @ about(2, own["theta"] + reading + nothing) @ along(2, own.get("d", 0.0))
        return found | {"flange": t, "tool": t @ self.moved(setup.tool, "tool", e)}

    def place(self, stations: dict[str, Complex], name: str, place: Place, e: Mapping[str, complex]) -> Complex:
        there = self.scenario.setup.places.get(name)
        return stations[place.on] if there is None else stations[place.on] @ self.moved(there, name, e)

    def residual(self, q: Array, e: Mapping[str, complex], exact: list[Complex] | None = None) -> list[Complex]:
        """What every observation reads of every feature, shape (N, d) each; whole frames and directions by how far they
        are from exact ones, where those are given."""
        task, setup = self.scenario.task, self.scenario.setup
        stations, out, known = self.stations(q, e), [], iter(exact or [])
        loose = [o.target for o in task.observations if o.target.board is None]
        order = list(dict.fromkeys(target.qualified(p) for target in loose for p in target.points))
        for o in task.observations:
            t = np.linalg.inv(self.place(stations, o.place, o.at, e)) @ self.place(
                stations, o.target.name, o.target.at, e
            )
            for feature in o.features or ("",):
                before = next(known, None)
                if o.instrument.reads == "points":
                    called = o.target.qualified(feature)
                    shift = [e.get(f"{called}_{axis}", 0.0) for axis in "xyz"]
                    board = o.target.board
                    at = setup.points[order.index(called)] if board is None else board.points[int(feature)]
                    out.append(self.of_point((t @ np.append(at + shift, 1.0))[:, :3], o, e))
                elif o.instrument.reads == "frame":
                    out.append(t if before is None else from_frame(t, before))
                else:
                    axis = np.array(o.target.axes[feature]) / np.linalg.norm(o.target.axes[feature])
                    u = t[:, :3, :3] @ axis
                    out.append(u if before is None else np.einsum("nij,nj->ni", across(before), u))
        return out

    def of_point(self, p: Complex, o: Observation, e: Mapping[str, complex]) -> Complex:
        if o.instrument.name == "distance":
            offset = self.scenario.setup.own[f"{o.name}_offset"] + e.get(f"{o.name}_offset", 0.0)
            return np.sqrt(np.sum(p * p, axis=1, keepdims=True)) + offset
        if o.instrument.name == "plane":
            return p[:, 2:] - o.instrument.radius
        if o.instrument.name == "pixels":
            own = [self.scenario.setup.own[f"{o.name}_{n}"] + e.get(f"{o.name}_{n}", 0.0) for n in INTRINSIC_NAMES]
            return image(p, own)
        return p[:, 2:] if o.instrument.name == "component" else p

    def values(self, names: tuple[str, ...], errors: Mapping[str, float]) -> Array:
        """Slopes of known distances over their noise, by complex steps, shape (k, n)."""
        rows = []
        for o in self.scenario.task.values:
            row = []
            for name in names:
                e: dict[str, complex] = dict(errors)
                e[name] = e.get(name, 0.0) + 1j * _STEP
                ends = [self.moved(self.scenario.setup.places[n], n, e)[:3, 3] for n in (o.place, o.target.name)]
                row.append(np.sqrt(np.sum((ends[1] - ends[0]) ** 2)).imag / _STEP)
            rows.append(np.array(row) / o.noise["distance"])
        return np.array(rows).reshape(-1, len(names))

    def views(self, q: Array) -> NDArray[np.bool_]:
        """Whether a camera sees enough of its board: in the image, in front of it and from its printed side."""
        seen = np.zeros(len(q), dtype=bool)
        clear = np.ones(len(q), dtype=bool)
        stations = self.stations(q, {})
        for o in self.scenario.task.observations:
            if not o.instrument.is_camera:
                continue
            t = np.linalg.inv(self.place(stations, o.place, o.at, {})) @ self.place(
                stations, o.target.name, o.target.at, {}
            )
            p = (t.real @ np.c_[o.target.nominal, np.ones(len(o.target.points))].T).swapaxes(1, 2)[:, :, :3]
            own = [self.scenario.setup.own[f"{o.name}_{n}"] for n in INTRINSIC_NAMES]
            uv = image(p.reshape(-1, 3), own).real.reshape(*p.shape[:2], 2)
            inside = ((uv > 0) & (uv < [1279, 1023])).all(axis=2) & (p[:, :, 2] > 100)
            facing = np.einsum("ni,nki->nk", t[:, :3, 2].real, p) > 0.3 * np.linalg.norm(p, axis=2)
            seen |= (inside & facing).sum(axis=1) >= o.target.needed
            clear &= (np.abs(p[:, :, 2]) > 50).all(axis=1)  # none of its corners near the plane of the lens
        return seen & clear

    def jacobian(self, q: Array, names: tuple[str, ...], errors: Mapping[str, float]) -> Array:
        """By complex steps, shape (N, m, n)."""
        exact = self.residual(q, errors)
        columns = []
        for name in names:
            e: dict[str, complex] = dict(errors)
            e[name] = e.get(name, 0.0) + 1j * _STEP
            columns.append(np.hstack([v.imag for v in self.residual(q, e, exact)]) / _STEP)
        return np.stack(columns, axis=2)


def image(p: Complex, own: Sequence[complex]) -> Complex:
    """Image points of p in a camera's frame, shape (N, 3) -> (N, 2); [Brown1966] as OpenCV writes it."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = own
    x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    yd = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.stack([fx * xd + cx, fy * yd + cy], axis=1)


def from_frame(t: Complex, exact: Complex) -> Complex:
    """Position, and the rotation vector from exact frames to first order, shape (N, 6)."""
    turn = np.linalg.inv(exact)[:, :3, :3] @ t[:, :3, :3]
    w = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], axis=1)
    return np.hstack([t[:, :3, 3], w / 2])


def across(u: Complex) -> Array:
    """Two unit vectors across each direction, shape (N, 2, 3)."""
    return np.linalg.svd(u.real[:, None, :])[2][:, 1:]


# ------------------------------------------------------------------------------------------------------- the comparison


@cache
def _built(name: str) -> Model:
    task = SCENARIOS[name](np.random.default_rng(0)).task
    scales = {n: SIZE * p.scale for n, p in ((p.name, p) for p in task.parameters(ARM).items) if n in ARM.parameters}
    return build_model(ARM, replace(task, scales=scales))


def told(name: str, scenario: Scenario) -> Model:
    """The model of a scenario with its first guesses."""
    return replace(_built(name), setup=nominal_setup(ARM, scenario.task))


def postures(scenario: Scenario, rng: np.random.Generator) -> Array:
    if not scenario.seen:
        return rng.uniform(-2.2, 2.2, (POSES, ARM.dof))
    found = np.zeros((0, ARM.dof))
    while len(found) < POSES:
        tried = rng.uniform(-2.2, 2.2, (2000, ARM.dof))
        found = np.vstack([found, tried[Witness(scenario).views(tried)]])
    return found[:POSES]


def measured(model: Model, scenario: Scenario, rng: np.random.Generator) -> Array:
    """Postures; such as touch where something must be touched."""
    if not constraints(model.measurement):
        return postures(scenario, rng)
    limit = np.full(ARM.dof, 2.8)
    seen = Witness(scenario).views if scenario.seen else None
    return contact_postures(model, POSES, lambda n: rng.uniform(-2.2, 2.2, (n, ARM.dof)), (-limit, limit), seen)


def sessions(model: Model, z: Array) -> Array:
    """Readings of a scenario with sessions: every observation reads its half of the poses."""
    if not any(o.session for o in model.task.observations):
        return z
    half = len(z) // 2
    z = z.copy()
    for part in model.measurement.parts:
        z[half:, part.readings] = z[half:, part.readings] if part.observation.session else np.nan
        if part.observation.session:
            z[:half, part.readings] = np.nan
    return z


def slopes(name: str, seed: int) -> tuple[Array, Array]:
    """Jacobians at the truth by scaled parameters, shape (N, m, n), mm and 200 rad: ours, and the witness's."""
    rng = np.random.default_rng(seed)
    scenario = SCENARIOS[name](rng)
    model = told(name, scenario)
    q, p = postures(scenario, rng), model.parameters
    errors = {n: float(rng.normal() * s) for n, s in zip(p.names, p.scales, strict=True) if n in ARM.parameters}
    (ours,) = model.jacobian(q, p.vector(errors), scenario.setup.vector)
    for part in constraints(model.measurement):  # their residuals are taken per growth, a factor without consequence
        ours[:, part.components] *= growth(model.measurement.growth, p.vector(errors))
    weights = model.measurement.per_unit({"mm": 1.0, "rad": 200.0, "px": 1.0})[None, :, None] * p.scales
    return ours * weights, Witness(scenario).jacobian(q, p.names, errors) * weights


def ranks(name: str, seed: int = 0) -> tuple[int, int]:
    """Numerical rank at the truth of noise-free rows in the same scales: ours, and the witness's."""
    model = told(name, SCENARIOS[name](np.random.default_rng(seed)))
    readings = sessions(model, np.zeros((POSES, model.measurement.parts[-1].readings.stop)))
    rows = np.hstack([part.seen(readings) for part in model.measurement.parts])
    out = []
    for jacobian in slopes(name, seed):
        s = np.linalg.svd(jacobian[rows], compute_uv=False)
        out.append(int(np.sum(s > 1e-9 * s[0])))
    return out[0], out[1]


def plane(found: Array, true: Array) -> tuple[float, float, float]:
    """z, rx, ry that carry the found frame's xy plane into the true one, all that a gauge along z can tell of them."""
    n = found[:3, :3].T @ true[:3, 2]
    axis = np.cross([0.0, 0.0, 1.0], n)
    turn = axis / np.linalg.norm(axis) * np.arctan2(np.linalg.norm(axis), n[2])
    shift = found[:3, :3].T @ (true[:3, 3] - found[:3, 3])
    return float(n @ shift / n[2]), float(turn[0]), float(turn[1])


@dataclass(frozen=True)
class Draw:
    """Whitened errors on the seen subspace, shape (k,), and whether the fit converged."""

    whitened: Array
    converged: bool


def draw(name: str, seed: int) -> Draw:
    """An identification at stated noise, the truth of plausible size; whitened at the truth by the witness's rows."""
    rng = np.random.default_rng(seed)
    scenario = SCENARIOS[name](rng)
    model = told(name, scenario)
    p = model.parameters
    errors = {n: float(rng.normal() * s) for n, s in zip(p.names, p.scales, strict=True) if n in ARM.parameters}
    true = replace(model, setup=scenario.setup)
    data = simulate(true, errors, measured(true, scenario, rng), Noise(by_instrument=scenario.noise), rng)
    data = replace(data, z=sessions(model, data.z))
    noise = {g.name: scenario.noise[g.observation][g.quantity] for g in model.measurement.groups}
    found = calibrate(model, None, data, Options(sigma=noise, scales="stated")).after
    truth = p.vector(errors) + stated(true, found.setup)
    for o in model.task.observations:
        if o.place_axes and "x" not in o.place_axes:
            truth[p.indices([f"{o.place}_{axis}" for axis in ("z", "rx", "ry")])] = plane(
                found.setup.places[o.place], scenario.setup.places[o.place]
            )
    witness = Witness(replace(scenario, setup=found.setup))  # the same truth, as the estimate's frames have it
    rows = np.hstack([part.seen(data.z) for part in model.measurement.parts])
    jacobian = witness.jacobian(data.q, p.names, p.mapping(truth))
    sigma = model.measurement.per_component(noise)
    w = (jacobian / sigma[None, :, None])[rows] * p.scales
    w = np.vstack([w, witness.values(p.names, p.mapping(truth)) * p.scales])
    _, s, vt = np.linalg.svd(w, full_matrices=False)
    seen = vt[s > 1].T
    told_size = np.array([1.0 if n in ARM.parameters else 1e-3 for n in p.names])
    prior = [s / scenario.priors.get(n, s / t) for n, s, t in zip(p.names, p.scales, told_size, strict=True)]
    root = np.linalg.inv(np.linalg.qr(np.vstack([w, np.diag(prior)]), mode="r"))
    error = seen.T @ ((found.x - truth) / p.scales)
    covariance = seen.T @ root @ root.T @ seen
    return Draw(np.linalg.solve(np.linalg.cholesky(covariance), error), found.converged)


@dataclass(frozen=True)
class Law:
    """Of many draws: mean squared whitened error (its expectation is one), its standard error, and a KS test."""

    ratio: float
    error: float
    p_value: float
    converged: bool
    directions: int


def law(name: str, draws: int) -> Law:
    found = [draw(name, 1000 + seed) for seed in range(draws)]
    pooled = np.concatenate([each.whitened for each in found])
    squares = [float(each.whitened @ each.whitened) for each in found]
    sizes = [len(each.whitened) for each in found]
    uniform = stats.chi2.cdf(squares, sizes)
    return Law(
        float(np.mean(pooled**2)),
        float(np.sqrt(2 / len(pooled))),
        float(stats.kstest(uniform, "uniform").pvalue),
        all(each.converged for each in found),
        int(np.median(sizes)),
    )


def said(name: str, draws: int) -> str:
    """The law of a scenario in a line."""
    (ours, theirs), found = ranks(name), law(name, draws)
    return (
        f"{name:17s} rank {ours}, witness {theirs}; (error / Cramer-Rao)^2 {found.ratio:.3f} +- {found.error:.3f}; "
        f"KS p {found.p_value:.3f}; {found.directions} directions; converged {found.converged}"
    )


if __name__ == "__main__":
    for scenario_name in sys.argv[2:] or SCENARIOS:
        sys.stdout.write(said(scenario_name, int(sys.argv[1]) if len(sys.argv) > 1 else 100) + "\n")
        sys.stdout.flush()
