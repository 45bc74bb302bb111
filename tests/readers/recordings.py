"""A robot that moves from pose to pose and stands still at each, recorded, and bags of it, written with `rosbags`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import symcal as sc

Array = NDArray[np.float64]
STORE = get_typestore(Stores.ROS2_HUMBLE)
BEGIN = 1_760_000_000  # s since 1970
NAMES = [f"{joint}_joint" for joint in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]


@dataclass(frozen=True)
class Recording:
    """t, q: times and readings of the joints; seen_t, seen: times and poses (m) of the tool; still: begin and end of
    every standstill."""

    t: Array
    q: Array
    seen_t: Array
    seen: Array
    still: Array


def record(
    model: sc.Model, count: int = 14, *, seed: int = 3, shift: float = 0.0, noise: float = 2e-5, stop: float = 1.0
) -> Recording:
    """Moves of about a second with smooth speeds, and stops; joints at 100 Hz, poses at 60 Hz, ``shift`` s late."""
    rng = np.random.default_rng(seed)
    stops = rng.uniform(-1.2, 1.2, (count, model.robot.dof))
    moves = rng.uniform(0.6, 1.5, count)
    begins = np.concatenate([[0.0], np.cumsum(moves[:-1] + stop)])
    end = begins[-1] + stop

    def readings(t: Array) -> Array:
        out = np.empty((len(t), stops.shape[1]))
        for i, now in enumerate(t):
            k = int(np.clip(np.searchsorted(begins, now, side="right") - 1, 0, count - 1))
            part = np.clip((now - begins[k] - stop) / moves[k], 0.0, 1.0)
            goal = stops[min(k + 1, count - 1)]
            out[i] = stops[k] + (goal - stops[k]) * (3 * part**2 - 2 * part**3)
        return out

    t = np.arange(0.0, end, 0.01)
    seen_t = np.arange(0.003, end, 1 / 60)
    truth = {"theta_2": 0.004, "a_3": 0.6, "alpha_4": -0.003, "base_x": 40.0}
    seen = sc.simulate(model, truth, readings(seen_t), sc.Noise(position=0.02, orientation=1e-5), rng).z
    seen[:, :3] /= 1000
    read = readings(t) + rng.normal(0, noise, (len(t), stops.shape[1]))
    still = np.column_stack([begins, begins + stop])
    return Recording(t, read, seen_t + shift, seen, still)


def _header(t: float, frame: str = "") -> Any:
    sec, part = divmod(round((BEGIN + t) * 1e9), 1_000_000_000)
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=part)
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _make(kind: str, **parts: Any) -> Any:
    return STORE.types[kind](**parts)


def _xyz(kind: str, values: Array) -> Any:
    return _make(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", map(float, values), strict=True)))


def _quaternion(values: Array) -> Any:
    return _make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, values), strict=True)))


def _pose(seen: Array) -> Any:
    return _make("geometry_msgs/msg/Pose", position=_xyz("Point", seen[:3]), orientation=_quaternion(seen[3:]))


def _transform(t: float, seen: Array, parent: str = "world", child: str = "tool") -> Any:
    moved = _make("geometry_msgs/msg/Transform", translation=_xyz("Vector3", seen[:3]), rotation=_quaternion(seen[3:]))
    kind = "geometry_msgs/msg/TransformStamped"
    return _make(kind, header=_header(t, parent), child_frame_id=child, transform=moved)


def _odometry(t: float, seen: Array) -> Any:
    zero = _xyz("Vector3", np.zeros(3))
    twist = _make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
    return _make(
        "nav_msgs/msg/Odometry",
        header=_header(t),
        child_frame_id="tool",
        pose=_make("geometry_msgs/msg/PoseWithCovariance", pose=_pose(seen), covariance=np.zeros(36)),
        twist=_make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


MEASURED: dict[str, Callable[[float, Array], Any]] = {
    "geometry_msgs/msg/PoseStamped": lambda t, seen: _make(
        "geometry_msgs/msg/PoseStamped", header=_header(t), pose=_pose(seen)
    ),
    "geometry_msgs/msg/PointStamped": lambda t, seen: _make(
        "geometry_msgs/msg/PointStamped", header=_header(t), point=_xyz("Point", seen[:3])
    ),
    "geometry_msgs/msg/TransformStamped": _transform,
    "nav_msgs/msg/Odometry": _odometry,
    "tf2_msgs/msg/TFMessage": lambda t, seen: _make(
        "tf2_msgs/msg/TFMessage",
        transforms=[_transform(t, np.array([0, 0, 1.0, 0, 0, 0, 1.0]), "map", "world"), _transform(t, seen)],
    ),
}


def _state(t: float, q: Array, names: Sequence[str]) -> Any:
    none = np.zeros(0)
    return _make(
        "sensor_msgs/msg/JointState",
        header=_header(t),
        name=list(names),
        position=np.ascontiguousarray(q, dtype=np.float64),
        velocity=none,
        effort=none,
    )


def write_bag(
    path: Path,
    recording: Recording,
    kind: str = "geometry_msgs/msg/PoseStamped",
    storage: StoragePlugin = StoragePlugin.MCAP,
    names: Sequence[str] = NAMES,
) -> Path:
    """A bag with the topics /joint_states, in which a gripper speaks too, and /tracker/pose."""
    with Writer(path, version=9, storage_plugin=storage) as bag:
        states = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=STORE)
        tracked = bag.add_connection("/tracker/pose", kind, typestore=STORE)
        messages = [(t, states, _state(t, q[::-1], names[::-1])) for t, q in zip(recording.t, recording.q, strict=True)]
        messages += [(t + 0.002, states, _state(t, np.zeros(1), ["gripper"])) for t in recording.t[::50]]
        messages += [
            (t, tracked, MEASURED[kind](t, seen)) for t, seen in zip(recording.seen_t, recording.seen, strict=True)
        ]
        for t, connection, message in sorted(messages, key=lambda each: each[0]):
            raw = STORE.serialize_cdr(message, connection.msgtype)
            bag.write(connection, round((BEGIN + t + 0.0004) * 1e9), raw)
    return path
