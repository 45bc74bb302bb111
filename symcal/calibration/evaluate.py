"""How accurate: errors of a robot's tool against measurements, and what was to be expected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Fit
from symcal.model.model import Model, State
from symcal.model.task import Task
from symcal.placing.placement import settled

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Statistics:
    """Of Euclidean norms over points, or of rotation angles; rms = sqrt(mean of squares)."""

    mean: float
    rms: float
    p95: float
    max: float
    count: int


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of predictions against measurements.

    vectors: per reading, shape (k, d), in ``unit`` (mm, deg or px); those of points are in world. pose: the pose of
    each, shape (k,). point: its feature, shape (k,). rotations: rotation vectors in the tool frame, shape (k, 3), rad,
    NaN where an instrument measured the position alone; None where all did.
    quantity: what they are errors of. words: the same, said to people.
    names: of the components of ``vectors``. axes: whose axes x, y and z of them are. counted: what one of them is.
    of_tool: whether they are errors of the robot's tool, which only an instrument tells whose reading fixes a point.
    fitted: how many parameters were fitted to these very measurements.
    """

    vectors: Array
    pose: NDArray[np.intp]
    point: NDArray[np.intp]
    rotations: Array | None
    quantity: str = "position"
    unit: str = "mm"
    words: str = "tool error"
    names: tuple[str, ...] = ("x", "y", "z")
    of_tool: bool = True
    fitted: int = 0
    axes: str = "world"
    counted: str = "observation"

    @property
    def title(self) -> str:
        """What axes of figures call it: `position error`, `error along the distance`."""
        return "position error" if self.of_tool else self.words

    @property
    def size(self) -> Array:
        """Norms, shape (k,)."""
        return np.asarray(np.linalg.norm(self.vectors, axis=1))

    @property
    def statistics(self) -> Statistics:
        """Of the norms; parameters fitted to these measurements taken off."""
        return statistics(self.size, self.fitted / self.vectors.shape[1])

    @property
    def key(self) -> str:
        """Name of the quantity with its unit, as results have it: `position_mm`."""
        return f"{self.quantity}_{self.unit}"

    @property
    def turns(self) -> Array | None:
        """Rotation angle of every reading, shape (k,), rad, NaN where there is none."""
        return None if self.rotations is None else np.asarray(np.linalg.norm(self.rotations, axis=1))

    @property
    def orientation(self) -> Array | None:
        """Rotation angles where there are any, rad."""
        return None if self.turns is None else self.turns[np.isfinite(self.turns)]


def statistics(values: Array, taken: float = 0.0) -> Statistics:
    """Statistics of error norms, shape (k,), k >= 1.

    Args:
        taken: how many of the k were taken by parameters fitted to them; the rms is over what is left.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> float(sc.statistics(np.array([0.3, 0.4, 0.5])).max)
        0.5
    """
    return Statistics(
        float(values.mean()),
        float(np.sqrt(np.sum(values**2) / max(values.size - taken, 1.0))),
        float(np.percentile(values, 95)),
        float(values.max()),
        int(values.size),
    )


def evaluate(state: State, data: Dataset) -> Errors:
    """Errors of a state on measurements of its kind: of the tool, over all instruments that give points; else of what
    the first instrument reads, over all that read the same.

    Raises:
        RefusedError: none of them has read anything at these poses.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> calibration = sc.identify(robot, data, task)
        >>> bool(sc.evaluate(calibration.states["after"], data).statistics.rms < 0.1)
        True
    """
    return judging(state.model.task, evaluate_each(state, data))


def judging(task: Task, each: Mapping[str, Errors]) -> Errors:
    """The errors that judge, of those by observation; see `evaluate`.

    Raises:
        RefusedError: none of these observations has read anything.
    """
    found = [each[o.name] for o in task.judged_by if o.name in each]
    if not found:
        names = ", ".join(o.name for o in task.judged_by)
        raise RefusedError(f"nothing was read at these poses by what judges ({names})")
    return found[0] if len(found) == 1 else pooled(found)


def evaluate_each(state: State, data: Dataset) -> dict[str, Errors]:
    """Errors of a state by observation, each in its own unit; without those that have read nothing here.

    Raises:
        RefusedError: nothing was read at all.
    """
    unplaced = state.unplaced
    state = settled(state, data)
    model = state.model
    judge = model.kernels.accuracy_for(len(data))
    (error,) = judge(data.q, state.x, state.setup.under(data.conditions), np.nan_to_num(data.z))
    out: dict[str, Errors] = {}
    for part in model.measurement.parts:
        kind = part.observation.instrument
        quantity, unit, size = kind.error
        seen = part.seen(data.z).reshape(len(data), part.features, -1).all(axis=2)
        if not seen.any():
            continue
        pose, point = np.nonzero(seen)
        vectors = error[:, part.errors].reshape(len(data), -1, size)[seen]
        turns = error[:, part.attitudes]
        out[part.observation.name] = Errors(
            np.rad2deg(vectors) if unit == "rad" else vectors,
            pose,
            point,
            turns[pose] if turns.shape[1] else None,
            quantity,
            "deg" if unit == "rad" else unit,
            kind.error_words,
            kind.error_names,
            kind.gives_point,
            sum(name in part.observation.names for name in unplaced),
            "world" if kind.judged_in_world else "its place",
            "contact" if kind.constrains else "observation",
        )
    if not out:
        raise RefusedError("no instrument has read anything at these poses")
    return out


def pooled(found: Sequence[Errors]) -> Errors:
    """Errors of one kind as one set."""
    blank = [np.full((len(each.vectors), 3), np.nan) if each.rotations is None else each.rotations for each in found]
    return replace(
        found[0],
        vectors=np.vstack([each.vectors for each in found]),
        pose=np.concatenate([each.pose for each in found]),
        point=np.concatenate([each.point for each in found]),
        rotations=None if all(each.rotations is None for each in found) else np.vstack(blank),
        fitted=sum(each.fitted for each in found),
    )


def expected_position_rms(model: Model, result: Fit, q: Array) -> Array:
    """Predicted rms position error of the tool (or of its points) at each pose, shape (N,), mm; from the covariance.

    The noise of the measurement that it would be compared with is not in it. Where only the instruments say where the
    world is, it is the error after one rigid alignment of all poses.
    """
    jacobian, own = position_slopes(model, result, q)
    rms = result.posterior.predicted_rms(jacobian)
    return np.asarray(np.sqrt(rms**2 / (jacobian.shape[1] // 3) + own))


def position_slopes(model: Model, result: Fit, q: Array) -> tuple[Array, Array]:
    """How positions of the k points of the tool depend on the free parameters, shape (N, 3 k, n), mm per unit; and what
    a smooth remainder leaves unknown beside them, shape (N,), mm^2 for three axes.

    Where only the instruments say where the world is, without what one rigid motion of all poses does.
    """
    index = model.parameters.indices(result.free)
    at, jacobian = model.points(q, result.x, result.setup.vector)
    jacobian, own = jacobian[:, :, index], np.zeros(len(q))
    if result.remainder is not None:
        base = model.moved(result.setup, result.x).base[:3, :3]
        jacobian, own = result.remainder.corrected(q, jacobian, base), 3 * result.remainder.variance(q)
    if model.measurement.adrift:  # only the instruments say where the world is
        jacobian = without_rigid_motion(at.reshape(-1, 3), jacobian)
    return jacobian, own


def without_rigid_motion(points: Array, jacobian: Array) -> Array:
    """Jacobian (N, 3 k, n) of points (N k, 3) without what one rigid motion of all of them can do."""
    arm = points - points.mean(axis=0)
    turn = np.cross(np.eye(3), arm[:, None, :])
    motion = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=2).reshape(-1, 6)
    basis, _ = np.linalg.qr(motion / np.linalg.norm(motion, axis=0))
    flat = jacobian.reshape(-1, jacobian.shape[2])
    return np.asarray((flat - basis @ (basis.T @ flat)).reshape(jacobian.shape))
