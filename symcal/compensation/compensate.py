r"""Joint commands with which the calibrated robot reaches what was wanted of the nominal one.

Damped Newton on the symbolic Jacobian. One step minimises the weighted motion of the joints,

    dq = W J^T (J W J^T + lambda^2 I)^-1 e,      q_next = min(max(q + dq, lower), upper)

with W = diag(1 for mm, (1/300 mm)^2 for rad), so that the turn of a joint costs what it moves at 300 mm. The damping
keeps every step finite at a singularity. Only the numbers of the robot in the base frame matter; where an instrument
saw the base does not.

Source: damped least squares after [Nakamura1986]; weights, damping, caps and what is done at limits are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.compensation.caps import CAPS as CAPS
from symcal.compensation.caps import joint_caps as joint_caps
from symcal.compensation.targets import POSE_JOINTS, Targets, base_chain, base_frames, joint_columns
from symcal.errors import RefusedError
from symcal.kernels.batch import BatchFunction, batch_function
from symcal.kinematics import chain, function, omegas, stack
from symcal.model.parameter_set import parameter_set
from symcal.outputs.whole_file import write_whole
from symcal.robot.robot import Robot

if TYPE_CHECKING:
    import pandas as pd

SX = ca.SX
Array = NDArray[np.float64]
Status = Literal["reached", "joint limit", "cap", "closest", "out of reach"]

LEVER = 300.0
"""mm at which turning counts as much as moving."""
DAMPING = 1e-3
"""lambda^2 in mm^2."""
REACHED = 1e-6
"""mm: residuals below are none."""

_ITERATIONS = 60  # three do where nothing binds; the rest is for limits and singularities
_STARTS = 100
_SEARCH_DAMPING = 1.0  # mm^2: the first one from afar
_DAMPINGS = (1e-9, 1e9)  # mm^2
_DONE = 1e-3 * REACHED


@dataclass(frozen=True, slots=True, eq=False)
class Compensation:
    """Corrected commands for N targets.

    joints: readings to command, shape (N, dof), rad and mm. nominal: what the nominal robot would be commanded, same
        shape.
    residual_mm, residual_rad: how far the calibrated model stays from the target with ``joints``, shape (N,); rad is
        None when the targets have no orientation. uncompensated_mm, uncompensated_rad: the same with ``nominal``.
    limiting: which joints keep a target from being reached, at a limit or cap; shape (N, dof).
    status: per target, `reached` (within 1e-6 mm); else what keeps it away: a `joint limit`, the `cap` on corrections,
        nothing but the arm itself (`closest`), or the nominal robot cannot get there either (`out of reach`).
    pose: whether orientations were compensated, or positions alone.
    """

    robot: Robot
    joints: Array
    nominal: Array
    residual_mm: Array
    residual_rad: Array | None
    uncompensated_mm: Array
    uncompensated_rad: Array | None
    limiting: NDArray[np.bool_]
    status: tuple[Status, ...]
    pose: bool

    def table(self) -> pd.DataFrame:
        """One row per target: the readings in deg and mm, residuals, status in words."""
        import pandas as pd  # half a second of start-up

        table = pd.DataFrame(joint_columns(self.robot, self.joints))
        table["residual_mm"] = self.residual_mm
        table["uncompensated_mm"] = self.uncompensated_mm
        if self.residual_rad is not None and self.uncompensated_rad is not None:
            table["rotation_residual_deg"] = np.degrees(self.residual_rad)
            table["rotation_uncompensated_deg"] = np.degrees(self.uncompensated_rad)
        names = [joint.name for joint in self.robot.joints]
        which = [" ".join(n for n, at in zip(names, row, strict=True) if at) for row in self.limiting]
        table["status"] = [f"{s}: {w}" if w else s for s, w in zip(self.status, which, strict=True)]
        return table

    def facts(self) -> list[dict[str, Any]]:
        """The rows of `table` as plain data; None where a number is none."""
        rows = self.table().to_dict("records")
        return [{str(k): None if v != v else v for k, v in row.items()} for row in rows]


def write_joints(result: Compensation, path: Path | str) -> None:
    """Write `Compensation.table` as CSV; `symcal.compensation.targets.read_targets` reads its joints back.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, result.table().to_csv(index=False))


def compensation_step(
    robot: Robot, *, pose: bool = False, adaptive: bool = False, adjustable: bool = False
) -> ca.Function:
    """One damped Newton step towards a target in the base frame, free of branches.

    (q, target, lower, upper) -> (q_next, error)

    Args:
        robot: its present numbers are built in as constants.
        pose: whether the target is [R | p], shape (3, 4), or a position, shape (3,); mm.
        adaptive: adds the inputs ``free``, shape (dof,), 1 for joints that may move and 0 for those that may not, and
            ``damping``, lambda^2 in mm^2; without, all are free and lambda^2 is `DAMPING`.
        adjustable: adds the inputs ``x``, errors of the robot's parameters on top of the robot's numbers, and ``tool``,
            T_flange_tool without its last row, shape (3, 4), in place of the robot's.
    Returns:
        function with q, lower, upper, q_next of shape (dof,), readings; error, shape (3,) or (6,): target minus present
        position in mm, and the rotation vector from present to target orientation in rad, both in the base frame and
        before the step.
    """
    model = chain(robot, parameter_set(robot)) if adjustable else base_chain(robot)
    n, flange_tool = robot.dof, SX.sym("tool", 3, 4)
    frames = ca.vertcat(base_frames(robot)[:12], ca.vec(flange_tool)) if adjustable else base_frames(robot)
    lower, upper = SX.sym("lower", n), SX.sym("upper", n)
    free, damping = SX.sym("free", n), SX.sym("damping")
    target = SX.sym("target", 3, 4) if pose else SX.sym("target", 3)
    tool = ca.substitute(model.tool, model.frames, frames)
    jacobian = stack(model.joint_screws, model.tool[:3, 3])
    error = target[:, 3] - tool[:3, 3] if pose else target - tool[:3, 3]
    weighted = error
    if pose:
        turn = spatial.log_rotation(target[:, :3] @ tool[:3, :3].T)
        error, weighted = ca.vertcat(error, turn), ca.vertcat(error, LEVER * turn)
        jacobian = ca.vertcat(jacobian, LEVER * omegas(model.joint_screws))
    jacobian = ca.substitute(jacobian, model.frames, frames)
    mobility = ca.DM([(1 / LEVER if j.revolute else 1.0) ** 2 / j.ratio**2 for j in robot.joints])
    spread = jacobian * ca.repmat((mobility * free if adaptive else mobility).T, jacobian.shape[0], 1)
    normal = spread @ jacobian.T + (damping if adaptive else DAMPING) * SX.eye(jacobian.shape[0])
    moved = model.q + spread.T @ solve_definite(normal, weighted)
    inputs = {"q": model.q, "target": target, "lower": lower, "upper": upper}
    if adaptive:
        inputs |= {"free": free, "damping": damping}
    if adjustable:
        inputs |= {"x": model.x, "tool": flange_tool}
    outputs = {"q_next": ca.fmin(ca.fmax(moved, lower), upper), "error": error}
    return function("compensation_step", inputs, outputs)


def solve_definite(matrix: SX, right: SX) -> SX:
    """x with A x = b, A (k, k) symmetric positive definite, by L D L^T written out: no branch, no square root."""
    k = matrix.shape[0]
    lower: list[list[SX]] = [[SX(0)] * k for _ in range(k)]
    pivots: list[SX] = []
    for j in range(k):
        pivots.append(matrix[j, j] - sum((lower[j][m] ** 2 * pivots[m] for m in range(j)), SX(0)))
        for i in range(j + 1, k):
            rest = matrix[i, j] - sum((lower[i][m] * lower[j][m] * pivots[m] for m in range(j)), SX(0))
            lower[i][j] = rest / pivots[j]
    y: list[SX] = []
    for i in range(k):
        y.append(right[i] - sum((lower[i][m] * y[m] for m in range(i)), SX(0)))
    x = [value / pivot for value, pivot in zip(y, pivots, strict=True)]
    for i in reversed(range(k)):
        x[i] = x[i] - sum((lower[m][i] * x[m] for m in range(i + 1, k)), SX(0))
    return ca.vertcat(*x)


def compensate(
    robot: Robot,
    targets: Targets,
    rng: np.random.Generator,
    *,
    pose: bool | None = None,
    caps: tuple[float, float] = CAPS,
) -> Compensation:
    """Readings with which the calibrated robot's tool is as near to the targets as limits and caps allow.

    The nominal robot's readings come first: from the targets' own joints or, where there are none, from starts over
    the whole range of the joints. The correction then stays within ``caps`` of them, and is never worse than none.

    Args:
        robot: calibrated. targets: see `symcal.compensation.targets`. rng: for the starts.
        pose: whether to compensate orientations too; by default where the targets have them and the arm has six joints
            or more. In a pose 1 rad counts as 300 mm, so that where a limit binds one of the two may be given up for
            the other.
        caps: largest correction of a joint, rad and mm.
    Raises:
        RefusedError: ``pose`` for targets without orientation or an arm with fewer than six joints.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> calibrated = sc.identify(robot, data, task).robot
        >>> corrected = sc.compensate(calibrated, sc.commanded(calibrated, q[:3]), rng)
        >>> corrected.joints.shape
        (3, 5)
    """
    if pose and not targets.oriented:
        raise RefusedError("these targets are positions: without an orientation there is no pose to compensate")
    if pose and robot.dof < POSE_JOINTS:
        raise RefusedError(f"{robot.name} has {robot.dof} joints: a full pose takes six; positions can be compensated")
    pose = targets.oriented and robot.dof >= POSE_JOINTS if pose is None else pose
    goals = targets.poses[:, :3] if pose else np.ascontiguousarray(targets.poses[:, :3, 3])
    nominal, found = _nominal_joints(robot.nominal(), goals, targets.joints, pose, rng)
    cap = joint_caps(robot, caps)
    lower, upper = np.maximum(robot.lower, nominal - cap), np.minimum(robot.upper, nominal + cap)
    step = _Step(robot, pose, 5 * len(goals))
    joints, size = step.descend(nominal, goals, lower, upper, DAMPING)
    limiting = step.limiting(joints, goals, lower, upper) & (size > REACHED)[:, None]
    at_limit = limiting & ((joints <= robot.lower) | (joints >= robot.upper))
    reasons: list[tuple[NDArray[np.bool_], Status]] = [
        (size <= REACHED, "reached"),
        (~found, "out of reach"),
        (np.any(at_limit, axis=1), "joint limit"),
        (np.any(limiting, axis=1), "cap"),
    ]
    status = np.select([where for where, _ in reasons], [word for _, word in reasons], "closest")
    before, after = (_residuals(robot, targets, q) for q in (nominal, joints))
    return Compensation(
        robot=robot,
        joints=joints,
        nominal=nominal,
        residual_mm=after[0],
        residual_rad=after[1],
        uncompensated_mm=before[0],
        uncompensated_rad=before[1],
        limiting=limiting,
        status=tuple(status.tolist()),
        pose=pose,
    )


class _Step:
    """The step over many targets at once; lives only inside one compensation."""

    def __init__(self, robot: Robot, pose: bool, evaluations: int) -> None:
        self._call: BatchFunction = batch_function(
            compensation_step(robot, pose=pose, adaptive=True), evaluations=evaluations
        )
        self._free = np.ones(robot.dof)

    def __call__(
        self, q: Array, box: tuple[Array, Array, Array], damping: Array, free: Array | None = None
    ) -> tuple[Array, Array]:
        """The next joints, shape (N, dof), and the size of the error before the step in mm, shape (N,)."""
        following, error = self._call(q, *box, self._free if free is None else free, damping[:, None])
        weight = np.array([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])[: error.shape[1]]
        return following, np.linalg.norm(weight * error, axis=1)

    def descend(self, q: Array, goals: Array, lower: Array, upper: Array, damping: float) -> tuple[Array, Array]:
        """The joints at which the error cannot be made smaller inside the bounds, and its size.

        Steps that make it larger are damped more and tried again. A joint that is held by its bound takes part in a
        step as if it could move, and its share is lost; so such a step is also taken without the held joints, and the
        better of the two counts.
        """
        best, lam = q.copy(), np.full(len(q), damping)
        _, size = self(best, (goals, lower, upper), lam)
        rows = np.flatnonzero(size > _DONE)
        for _ in range(_ITERATIONS):
            if not len(rows):
                break
            here, box = best[rows], (goals[rows], lower[rows], upper[rows])
            ahead, _ = self(here, box, lam[rows])
            _, reached = self(ahead, box, lam[rows])
            held = (ahead == here) & ((here == box[1]) | (here == box[2]))
            some = np.flatnonzero(held.any(axis=1))
            if len(some):
                inner = (box[0][some], box[1][some], box[2][some])
                other, _ = self(here[some], inner, lam[rows[some]], np.where(held[some], 0.0, 1.0))
                _, other_reached = self(other, inner, lam[rows[some]])
                wins = other_reached < reached[some]
                ahead[some[wins]], reached[some[wins]] = other[wins], other_reached[wins]
            better = reached < size[rows]
            stalled = better & (reached > (1 - 1e-9) * size[rows])
            best[rows[better]], size[rows[better]] = ahead[better], reached[better]
            lam[rows] = np.clip(np.where(better, lam[rows] / 10, lam[rows] * 10), *_DAMPINGS)
            rows = rows[(size[rows] > _DONE) & (lam[rows] < _DAMPINGS[1]) & ~stalled]
        return best, size

    def limiting(self, q: Array, goals: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
        """Joints at a bound from which the step would take them further; shape (N, dof)."""
        anywhere = np.full_like(q, np.inf)
        ahead, _ = self(q, (goals, -anywhere, anywhere), np.full(len(q), DAMPING))
        return ((q <= lower) & (ahead < q)) | ((q >= upper) & (ahead > q))


def _nominal_joints(
    robot: Robot, goals: Array, joints: Array | None, pose: bool, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Readings with which the nominal robot is at the goals or nearest to them, and whether it gets there."""
    count = len(goals)
    lower, upper = np.tile(robot.lower, (count, 1)), np.tile(robot.upper, (count, 1))
    step = _Step(robot, pose, count * (1 if joints is not None else _ITERATIONS))
    if joints is not None:
        best, size = step.descend(joints, goals, lower, upper, DAMPING)
        return best, size <= REACHED
    span = np.array([np.pi if joint.revolute else robot.reach for joint in robot.joints])
    low, high = (
        np.where(np.isfinite(limit), limit, side * span) for limit, side in ((robot.lower, -1), (robot.upper, 1))
    )
    # the middle of the joints' ranges first: neighbouring targets then get neighbouring joints
    best, size = step.descend(np.tile((low + high) / 2, (count, 1)), goals, lower, upper, _SEARCH_DAMPING)
    for _ in range(_STARTS):
        rows = np.flatnonzero(size > REACHED)
        if not len(rows):
            break
        start = rng.uniform(low, high, (len(rows), robot.dof))
        q, found = step.descend(start, goals[rows], lower[rows], upper[rows], _SEARCH_DAMPING)
        better = found < size[rows]
        best[rows[better]], size[rows[better]] = q[better], found[better]
    return best, size <= REACHED


def _residuals(robot: Robot, targets: Targets, q: Array) -> tuple[Array, Array | None]:
    """Distance (mm) and angle (rad, None without orientation) of the tool from the targets, shape (N,)."""
    pose = targets.oriented
    goals = targets.poses[:, :3] if pose else np.ascontiguousarray(targets.poses[:, :3, 3])
    step = batch_function(compensation_step(robot, pose=pose), evaluations=len(q))
    far = np.full(robot.dof, np.inf)
    _, error = step(q, goals, -far, far)
    return np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1) if pose else None
