"""What may have gone wrong between robot file and measurements: one mistake each, as the change that undoes it.

The set is small and finite on purpose: signs, right-angle zeros, units, order of columns and rows on the side of the
joints; units, handedness, order and inverse of what was read on the side of the instrument. The list is ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.robot.robot import Robot
from symcal.spatial import signed_permutations

Array = NDArray[np.float64]
Change = Callable[[Array], Array]

_QUARTERS = ((np.pi / 2, "90"), (-np.pi / 2, "-90"), (np.pi, "180"))
_FACTORS = (
    (1000.0, "metres, labelled as millimetres"),
    (1e-3, "millimetres, labelled as metres"),
    (10.0, "centimetres, labelled as millimetres"),
    (0.1, "millimetres, labelled as centimetres"),
    (100.0, "metres, labelled as centimetres"),
    (0.01, "centimetres, labelled as metres"),
    (25.4, "inches, labelled as millimetres"),
    (1 / 25.4, "millimetres, labelled as inches"),
)
_AXES = "xyz"


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One thing that may be wrong, as what undoes it.

    kind: of mistake, such as `joint sign`. text: what would be wrong, said to people. readings: joint readings as the
    file has them, shape (N, dof), to those that are meant; measured: readings of an instrument, shape (N, w), likewise.
    rows: by how many rows the joint readings are shifted against what was measured; readings of row i belong to row
    i + rows.
    """

    kind: str
    text: str
    readings: Change | None = None
    measured: Change | None = None
    rows: int = 0


def joint_hypotheses(robot: Robot) -> tuple[Hypothesis, ...]:
    """What may be wrong with the joint columns and the robot file."""
    turning = [joint.revolute for joint in robot.joints]
    names = [f"joint {i}" for i in range(1, robot.dof + 1)]
    return (
        *_signs(names),
        *_zeros(names, turning),
        *_joint_units(names, turning),
        *_orders(names, turning),
        *(Hypothesis("row shift", _shifted(k), rows=k) for k in (1, -1)),
    )


def _shifted(k: int) -> str:
    many = "a row" if abs(k) == 1 else f"{abs(k)} rows"
    return f"the joint readings stand {many} {'above' if k > 0 else 'below'} the measurement that they belong to"


def _signs(names: Sequence[str]) -> Iterator[Hypothesis]:
    for i, name in enumerate(names):
        yield Hypothesis("joint sign", f"{name} counts the other way round (its sign)", _scaled([i], -1.0))
    yield Hypothesis("joint sign", "all joints count the other way round", _scaled(range(len(names)), -1.0))


def _zeros(names: Sequence[str], turning: Sequence[bool]) -> Iterator[Hypothesis]:
    for i, name in enumerate(names):
        if turning[i]:
            for angle, said in _QUARTERS:
                yield Hypothesis("joint zero", f"the zero of {name} is off by {said} deg", _offset(i, angle))


def _joint_units(names: Sequence[str], turning: Sequence[bool]) -> Iterator[Hypothesis]:
    angles = ((180 / np.pi, "in radians, labelled as degrees"), (np.pi / 180, "in degrees, labelled as radians"))
    lengths = tuple((factor, f"in {said}") for factor, said in _FACTORS)
    for revolute, factors in ((True, angles), (False, lengths)):
        own = [i for i, each in enumerate(turning) if each == revolute]
        for factor, said in factors:
            for i in own:
                yield Hypothesis("joint unit", f"{names[i]} is {said}", _scaled([i], factor))
            if len(own) > 1:
                what = "revolute joints" if revolute else "prismatic joints"
                yield Hypothesis("joint unit", f"all {what} are {said}", _scaled(own, factor))


def _orders(names: Sequence[str], turning: Sequence[bool]) -> Iterator[Hypothesis]:
    for i, j in combinations(range(len(names)), 2):
        if turning[i] == turning[j]:
            order = list(range(len(names)))
            order[i], order[j] = j, i
            text = f"the columns of {names[i]} and {names[j]} are swapped"
            yield Hypothesis("joint order", text, _ordered(order))
    if len(names) > 2 and list(turning) == list(turning)[::-1]:
        yield Hypothesis("joint order", "the joint columns are in reversed order", _ordered(range(len(names))[::-1]))
    if len(names) > 2 and len(set(turning)) == 1:
        first = [*range(1, len(names)), 0]
        yield Hypothesis("joint order", "the first joint column is the last joint's", _ordered(np.argsort(first)))
        yield Hypothesis("joint order", "the last joint column is the first joint's", _ordered(first))


def _scaled(joints: Sequence[int] | range, factor: float) -> Change:
    def change(q: Array) -> Array:
        out = q.copy()
        out[:, list(joints)] *= factor
        return out

    return change


def _offset(joint: int, angle: float) -> Change:
    def change(q: Array) -> Array:
        out = q.copy()
        out[:, joint] += angle
        return out

    return change


def _ordered(order: Sequence[int] | range | NDArray[np.intp]) -> Change:
    def change(q: Array) -> Array:
        return np.asarray(q[:, list(order)])

    return change


# ------------------------------------------------------------------------------------------------------ what was read


def point_hypotheses() -> tuple[Hypothesis, ...]:
    """What may be wrong with measured points, shape (N, 3 k), mm."""
    mirrored = "the measured axes are left-handed: one of x, y, z is negated, or two are swapped"
    return (
        *(Hypothesis("unit", f"the measurements are {said}", measured=_times(factor)) for factor, said in _FACTORS),
        Hypothesis("left-handed", mirrored, measured=_signed(np.diag([1.0, 1.0, -1.0]))),
    )


def frame_hypotheses() -> tuple[Hypothesis, ...]:
    """What may be wrong with measured poses (x, y, z, qx, qy, qz, qw), shape (N, 7), mm."""
    found = [
        Hypothesis("unit", f"the measured positions are {said}", measured=_times(factor, 3))
        for factor, said in _FACTORS
    ]
    for matrix, said in _signed_permutations():
        found.append(Hypothesis("axes", f"{said}, against the orientations", measured=_signed(matrix, 3)))
    mirror = np.diag([1.0, 1.0, -1.0])

    def left_handed(z: Array) -> Array:
        t = spatial.pose_matrix(z)
        return _posed(mirror @ t[:, :3, :3] @ mirror, z[:, :3] @ mirror)

    def inverted(z: Array) -> Array:
        return spatial.matrix_pose(spatial.inverse(spatial.pose_matrix(z)))

    found += [
        Hypothesis("left-handed", "positions and orientations are those of left-handed axes", measured=left_handed),
        Hypothesis("quaternion", "the quaternions are w, x, y, z, not x, y, z, w", measured=_quaternion([1, 2, 3, 0])),
        Hypothesis(
            "quaternion",
            "the quaternion's parts are shifted by one: w stands first",
            measured=_quaternion([3, 0, 1, 2]),
        ),
        Hypothesis(
            "orientation",
            "the orientations are inverse (conjugate quaternions)",
            measured=_quaternion([0, 1, 2, 3], -1.0),
        ),
        Hypothesis(
            "orientation", "the quaternions are w, x, y, z and conjugate", measured=_quaternion([1, 2, 3, 0], -1.0)
        ),
        Hypothesis("inverse pose", "the poses are inverse: 'reports' says whose pose the data hold", measured=inverted),
        *_angles(),
    ]
    return tuple(found)


def axis_hypotheses() -> tuple[Hypothesis, ...]:
    """What may be wrong with measured directions, shape (N, 3 k)."""
    mirrored = "the measured axes are left-handed: one of x, y, z is negated, or two are swapped"
    return (Hypothesis("left-handed", mirrored, measured=_signed(np.diag([1.0, 1.0, -1.0]))),)


def _angles() -> Iterator[Hypothesis]:
    """Roll, pitch and yaw that are meant in another way: about other axes in turn, as a vector, or in another unit."""

    def again(read: Change) -> Change:
        return lambda z: _posed(read(_rpy(z)), z[:, :3])

    def ordered(order: str) -> Change:
        turns = [np.eye(3)["xyz".index(axis)] for axis in order]

        def read(angles: Array) -> Array:
            first, second, third = (spatial.rpy_matrix(angles * axis) for axis in turns)
            return np.asarray(third @ second @ first)

        return read

    for order in ("xzy", "yxz", "yzx", "zxy", "zyx"):
        text = f"roll, pitch and yaw are turns about {', '.join(order)} in turn, not about x, y, z"
        yield Hypothesis("angles", text, measured=again(ordered(order)))
    yield Hypothesis("angles", "roll and yaw are swapped", measured=again(lambda a: spatial.rpy_matrix(a[:, ::-1])))
    yield Hypothesis("angles", "roll, pitch, yaw are a rotation vector", measured=_of_vectors)
    yield Hypothesis(
        "angles",
        "roll, pitch, yaw are in radians, labelled as degrees",
        measured=again(lambda a: spatial.rpy_matrix(a * 180 / np.pi)),
    )


def _rpy(z: Array) -> Array:
    """Roll, pitch and yaw of poses, shape (N, 3), rad."""
    return spatial.matrix_rpy(spatial.quaternion_matrices(z[:, 3:]))


def _of_vectors(z: Array) -> Array:
    """Poses whose roll, pitch and yaw are a rotation vector.

    Two sets of angles are one rotation, roll + 180, 180 - pitch, yaw + 180 deg being the other: where both are as short
    as a rotation vector may be, nothing is said of the pose.
    """
    angles = _rpy(z)
    other = (angles * [1.0, -1.0, 1.0] + 2 * np.pi) % (2 * np.pi) - np.pi
    short, too = (np.linalg.norm(each, axis=1) <= np.pi for each in (angles, other))
    out = _posed(spatial.vector_matrix(np.where(short[:, None], angles, other)), z[:, :3])
    out[short & too] = np.nan
    return out


def _posed(rotation: Array, position: Array) -> Array:
    return np.hstack([position, spatial.matrix_quaternions(rotation)])


def _times(factor: float, columns: int | None = None) -> Change:
    def change(z: Array) -> Array:
        out = z.copy()
        out[:, :columns] *= factor
        return out

    return change


def _signed(matrix: Array, columns: int | None = None) -> Change:
    """Points turned or mirrored by a signed permutation; all of them, or those of the first columns."""

    def change(z: Array) -> Array:
        out = z.copy()
        own = out[:, :columns]
        out[:, :columns] = (own.reshape(len(z), -1, 3) @ matrix.T).reshape(own.shape)
        return out

    return change


def _quaternion(order: Sequence[int], sign: float = 1.0) -> Change:
    def change(z: Array) -> Array:
        out = z.copy()
        out[:, 3:] = z[:, [3 + i for i in order]]
        out[:, 3:6] *= sign
        return out

    return change


def _signed_permutations() -> Iterator[tuple[Array, str]]:
    """All but the identity, each with what it says of the measured x, y, z."""
    for order, signs, matrix in signed_permutations():
        if np.array_equal(matrix, np.eye(3)):
            continue
        said = ", ".join(("-" if s < 0 else "") + _AXES[i] for i, s in zip(order, signs, strict=True))
        yield matrix, f"the measured positions have other axes: x, y, z are the file's {said}"
