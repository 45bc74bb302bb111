"""ROS 2 bags, read with `rosbags` (`pip install 'symcal[ros]'`): joint readings of one topic, measurements of another.

Times are those of the messages' headers, and where those are zero, as they were recorded. Lengths are m and angles rad,
as REP 103 has them. Storage may be sqlite3 or mcap, a folder or a file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symcal.documents.table import Table
from symcal.errors import InputError
from symcal.readers.streams import Joints, Matching, Stream, matched, stream
from symcal.words import plural

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

Array = NDArray[np.float64]

JOINTS = "sensor_msgs/msg/JointState"
_TF = "tf2_msgs/msg/TFMessage"
_MOST = 5_000_000  # messages of a topic


def _point(p: Any) -> list[float]:
    return [p.x, p.y, p.z]


def _pose(pose: Any) -> list[float]:
    q = pose.orientation
    return [*_point(pose.position), q.x, q.y, q.z, q.w]


def _moved(transform: Any) -> list[float]:
    q = transform.rotation
    return [*_point(transform.translation), q.x, q.y, q.z, q.w]


_MEASURED: dict[str, Callable[[Any], list[float]]] = {
    "geometry_msgs/msg/PoseStamped": lambda m: _pose(m.pose),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: _pose(m.pose.pose),
    "geometry_msgs/msg/PointStamped": lambda m: _point(m.point),
    "geometry_msgs/msg/TransformStamped": lambda m: _moved(m.transform),
    "nav_msgs/msg/Odometry": lambda m: _pose(m.pose.pose),
}
MEASURED = (*_MEASURED, _TF)
"""Types of messages that hold a measurement."""


@dataclass(frozen=True, slots=True)
class Bag:
    """What is read of a bag.

    joints, measured: topics; None: the only one of a type that fits. frames: parent and child, of transforms. names: of
    the joints in the messages, in the order of the robot's; None: those of the robot, or these with `_joint` behind.
    """

    joints: str | None = None
    measured: str | None = None
    frames: tuple[str, str] | None = None
    names: tuple[str, ...] | None = None


def read_bag(path: Path, of: Joints, bag: Bag, how: Matching) -> Table:
    """The measurements in a bag as a table, see `symcal.readers.streams.matched`.

    Raises:
        InputError: `rosbags` is not there, no bag, no such topic, joint or frame, a message that cannot be read, or
        recordings that do not go together.
    """
    with _opened(path) as reader:
        topics = {name: info.msgtype or "" for name, info in reader.topics.items()}
        joints = _topic(path, topics, bag.joints, (JOINTS,), "joint_topic")
        measured = _topic(path, topics, bag.measured, MEASURED, "topic")
        read = _joints(path, reader, joints, of, bag.names)
        seen = _seen(path, reader, measured, topics[measured], bag.frames)
    return matched(read, seen, of, how)


@contextmanager
def _opened(path: Path) -> Iterator[AnyReader]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        message = "reading a ROS bag needs the package 'rosbags': pip install 'symcal[ros]'"
        raise InputError(message, file=path) from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            yield reader
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - storage, metadata and messages each have errors of their own
        what = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"the bag cannot be read: {what}", file=path) from None


def _topic(path: Path, topics: dict[str, str], given: str | None, types: Sequence[str], key: str) -> str:
    fitting = [name for name, kind in topics.items() if kind in types]
    shown = [f"{name} ({topics[name]})" for name in fitting]
    if given is None:
        if len(fitting) != 1:
            what = "several topics" if fitting else "no topic"
            message = f"the bag has {what} that '{key}' may be: say which"
            raise InputError(message, file=path, key=key, allowed=shown or [f"of type {kind}" for kind in types])
        return fitting[0]
    if given not in topics:
        message = "the bag has no such topic"
        raise InputError(message, file=path, key=key, found=given, allowed=shown or topics)
    if given not in fitting:
        message = f"'{key}' cannot be read from messages of this type"
        raise InputError(message, file=path, part=f"topic '{given}'", key=key, found=topics[given], allowed=types)
    return given


def _messages(path: Path, reader: AnyReader, topic: str) -> Iterator[tuple[int, Any]]:
    """Messages of a topic, with the time in ns at which each was recorded."""
    chosen = [each for each in reader.connections if each.topic == topic]
    for count, (connection, recorded, raw) in enumerate(reader.messages(connections=chosen)):
        if count == _MOST:
            raise InputError(f"more than {_MOST} messages", file=path, part=f"topic '{topic}'")
        yield recorded, reader.deserialize(raw, connection.msgtype)


def _stamp(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _joints(path: Path, reader: AnyReader, topic: str, of: Joints, names: Sequence[str] | None) -> Stream:
    """Joint readings in rad and mm; messages that lack a joint are of something else, and counted."""
    part, rows, times, other = f"topic '{topic}'", [], [], 0
    wanted = [(name,) for name in names] if names else [(name, f"{name}_joint") for name, _ in of]
    if len(wanted) != len(of):
        message = f"'joint_names' names {len(wanted)} joints, the robot has {len(of)}"
        raise InputError(message, file=path, key="joint_names", allowed=[name for name, _ in of])
    scale = np.array([1.0 if revolute else 1000.0 for _, revolute in of])
    known: set[str] = set()
    for recorded, message in _messages(path, reader, topic):
        place = {name: i for i, name in enumerate(message.name)}
        known |= place.keys()
        at = [next((place[name] for name in own if name in place), None) for own in wanted]
        found = [k for k in at if k is not None]
        if len(found) < len(at) or len(message.position) < len(place):
            other += 1
            continue
        rows.append(np.asarray(message.position, dtype=np.float64)[found])
        times.append((_stamp(message.header), recorded))
    if not rows:
        missing = next((own[0] for own in wanted if not known & set(own)), wanted[0][0])
        text = "no message has a position of every joint of the robot: say 'joint_names' in the order of its joints"
        raise InputError(text, file=path, part=part, key="joint_names", found=missing, allowed=sorted(known))
    notes = (f"{plural(other, 'message')} of {topic} without a position of every joint left out",) if other else ()
    t, said = _seconds(times, topic)
    return stream(path, part, t, np.array(rows) * scale, (*notes, *said))


def _seen(path: Path, reader: AnyReader, topic: str, kind: str, frames: tuple[str, str] | None) -> Stream:
    part, rows, times = f"topic '{topic}'", [], []
    pairs: set[tuple[str, str]] = set()
    for recorded, message in _messages(path, reader, topic):
        if kind != _TF and frames is None:
            rows.append(_MEASURED[kind](message))
            times.append((_stamp(message.header), recorded))
            continue
        for each in message.transforms if kind == _TF else (message,):
            pair = (each.header.frame_id, getattr(each, "child_frame_id", ""))
            pairs.add(pair)
            if pair == frames:
                rows.append(_moved(each.transform) if kind == _TF else _MEASURED[kind](each))
                times.append((_stamp(each.header), recorded))
    if not rows and pairs:
        found = None if frames is None else " to ".join(frames)
        text = "say with 'frames: [parent, child]' which transform was measured" if found is None else "no such frames"
        allowed = [" to ".join(pair) for pair in sorted(pairs)]
        raise InputError(text, file=path, part=part, key="frames", found=found, allowed=allowed)
    t, said = _seconds(times, topic)
    return stream(path, part, t, np.array(rows, dtype=np.float64).reshape(len(t), -1), said, measured=True)


def _seconds(times: Sequence[tuple[int, int]], topic: str) -> tuple[Array, tuple[str, ...]]:
    """Times in s; those recorded where no header has one."""
    both = np.array(times, dtype=np.int64).reshape(-1, 2)
    stamped = bool(np.all(both[:, 0] > 0))
    said = f"headers of {topic} have no times: taken as recorded"
    return both[:, 0 if stamped else 1].astype(np.float64) * 1e-9, () if stamped or not len(both) else (said,)
