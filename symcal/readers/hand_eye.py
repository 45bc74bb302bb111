"""Pairs of poses for hand-eye calibration: `.samples` of easy_handeye2, and samples that MoveIt's calibration saved.

easy_handeye2 (marcoesposito1988/easy_handeye2 at b42cae6, easy_handeye2/handeye_sampler.py and easy_handeye2_msgs):
YAML of a SampleList; `robot` is the effector in the base for an eye in the hand, its inverse for one on the base, and
`tracking` the marker in the camera. Its sampler leaves `parameters`, which have the type, as they were made.

MoveIt (moveit/moveit_calibration at a883ec2, moveit_calibration_gui/handeye_calibration_rviz_plugin/src/
handeye_control_widget.cpp): YAML list of `effector_wrt_world` and `object_wrt_sensor`, matrices row by row, neither
inverted; joint states it saves by themselves, as `joint_names` and `joint_values`. Lengths are m.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symcal import spatial
from symcal.documents.csv_file import read_table
from symcal.documents.document import Document, Key, Loose, Strict, read_document, validate
from symcal.documents.table import Table, joint_readings
from symcal.errors import InputError
from symcal.readers.streams import Joints

Array = NDArray[np.float64]
Eye = Literal["hand", "base"]

_TYPES: dict[str, Eye] = {"eye_in_hand": "hand", "eye_on_base": "base"}
_Matrix = Annotated[list[float], Field(min_length=16, max_length=16)]


class _Vector(Strict):
    x: float
    y: float
    z: float


class _Quaternion(_Vector):
    w: float


class _Transform(Strict):
    translation: _Vector
    rotation: _Quaternion

    def matrix(self, document: Document, key: Key) -> Array:
        r, t = self.rotation, self.translation
        quaternion = np.array([r.x, r.y, r.z, r.w])
        norm = float(np.linalg.norm(quaternion))
        if abs(norm - 1) > 1e-3:
            raise document.error("the quaternion is not of unit length", (*key, "rotation"), found=f"{norm:.6g}")
        return spatial.transform(spatial.quaternion_matrices(quaternion), np.array([t.x, t.y, t.z]))


class _Sample(Strict):
    robot: _Transform
    tracking: _Transform


class _Parameters(Loose):
    calibration_type: str = ""


class _SampleList(Strict):
    parameters: _Parameters = _Parameters.model_construct()
    samples: Annotated[list[_Sample], Field(min_length=1)]


class _Pair(Strict):
    effector_wrt_world: _Matrix
    object_wrt_sensor: _Matrix


class _Pairs(Strict):
    pairs: Annotated[list[_Pair], Field(min_length=1)]


class _JointStates(Strict):
    joint_names: list[str]
    joint_values: list[list[float]]


def read_pairs(path: Path, eye: Eye | None = None) -> Table:
    """The pairs of a file as a table: the pose of the flange (`flange_x_m`.., `flange_qx`..) and the measured one.

    Args:
        eye: where the camera is; needed where the file does not say it and means the flange's inverse for one.
    Raises:
        InputError: not such a file, or a camera elsewhere than said.
    """
    document = read_document(path, listed="pairs")
    if "pairs" in document.data:
        flange, seen = _moveit(document)
    else:
        flange, seen = _easy(document, eye)
    columns = [np.column_stack([t[:, :3, 3], spatial.matrix_quaternions(t[:, :3, :3])]) for t in (flange, seen)]
    names = [f"{of}{c}" for of in ("flange_", "") for c in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")]
    cells = [[str(i) for i in range(len(flange))], *(list(map(repr, c)) for c in np.hstack(columns).T.tolist())]
    lines = range(1, len(flange) + 1)
    return Table(path, ("pose", *names), tuple(("\n".join(column),) for column in cells), lines, None)


def with_joints(pairs: Table, path: Path, of: Joints) -> Table:
    """The measured poses of a table of pairs with joint readings beside them, row by row.

    Args:
        path: CSV file with the columns of the joints, or joint states as MoveIt saves them (.yaml).
    Raises:
        InputError: the file cannot be read, lacks a joint, or has another number of rows.
    """
    if path.suffix.lower() in (".yaml", ".yml"):
        q = _joint_states(path, of)
    else:
        q = joint_readings(read_table(path, decimal=None), of)
    if len(q) != len(pairs):
        message = f"{len(q)} rows of joint readings for {len(pairs)} pairs of poses: they go together row by row"
        raise InputError(message, file=path)
    for name in pairs.columns:
        pairs = pairs.without(name) if name.startswith("flange_") else pairs
    for i, ((_, revolute), column) in enumerate(zip(of, q.T.tolist(), strict=True), start=1):
        pairs = pairs.with_column(f"q{i}_{'rad' if revolute else 'mm'}", "\n".join(map(repr, column)))
    return pairs


def _easy(document: Document, eye: Eye | None) -> tuple[Array, Array]:
    found = validate(document, _SampleList)
    kind = found.parameters.calibration_type
    if kind and kind not in _TYPES:
        raise document.error("no such type", ("parameters", "calibration_type"), found=kind, allowed=_TYPES)
    said = _TYPES.get(kind)
    if eye is None and said is None:
        message = (
            "the file does not say where the camera is, and means the flange's inverse for a camera on the base: say "
            "'eye: hand' or 'eye: base' where the experiment names it"
        )
        raise InputError(message, file=document.path, allowed=("hand", "base"))
    if eye is not None and said is not None and eye != said:
        message = f"the experiment says 'eye: {eye}', and the file this"
        raise document.error(message, ("parameters", "calibration_type"), found=kind)
    flange = np.array([s.robot.matrix(document, ("samples", i, "robot")) for i, s in enumerate(found.samples)])
    seen = np.array([s.tracking.matrix(document, ("samples", i, "tracking")) for i, s in enumerate(found.samples)])
    return (spatial.inverse(flange) if (eye or said) == "base" else flange), seen


def _moveit(document: Document) -> tuple[Array, Array]:
    found = validate(document, _Pairs).pairs
    out = []
    for name in ("effector_wrt_world", "object_wrt_sensor"):
        poses = np.array([getattr(pair, name) for pair in found]).reshape(-1, 4, 4)
        for i, pose in enumerate(poses):
            r = pose[:3, :3]
            rigid = np.allclose(r @ r.T, np.eye(3), atol=1e-3) and np.linalg.det(r) > 0
            if not rigid or not np.allclose(pose[3], [0, 0, 0, 1], atol=1e-9):
                message = "not the matrix of a pose: four rows, of which the last is 0, 0, 0, 1, and a rotation"
                raise document.error(message, ("pairs", i, name))
        out.append(poses)
    return out[0], out[1]


def _joint_states(path: Path, of: Joints) -> Array:
    document = read_document(path)
    found = validate(document, _JointStates)
    order: list[Any] = []
    for name, _ in of:
        own = [each for each in (name, f"{name}_joint") if each in found.joint_names]
        if not own:
            message = "the file has no joint of this name"
            raise document.error(message, ("joint_names",), found=name, allowed=found.joint_names)
        order.append(found.joint_names.index(own[0]))
    for i, row in enumerate(found.joint_values):
        if len(row) != len(found.joint_names):
            message = f"{len(row)} values for {len(found.joint_names)} joints"
            raise document.error(message, ("joint_values", i))
    scale = np.array([1.0 if revolute else 1000.0 for _, revolute in of])
    values = np.array(found.joint_values, dtype=np.float64).reshape(-1, len(found.joint_names))
    return np.asarray(values[:, order] * scale)
