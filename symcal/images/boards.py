"""From images of a printed board to measured image points, one pose per image; nothing is dropped silently.

What can be wrong with a folder of images is looked for before anything is believed: images of another camera, copies,
another board, and images that do not belong to the joint readings of their names (`symcal.placing.agreement`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from symcal.camera.board import Board
from symcal.camera.board_pose import BoardPose, board_pose
from symcal.camera.camera import Camera
from symcal.data.dataset import Dataset, Readings
from symcal.errors import InputError, RefusedError
from symcal.images.copies import copies, copy_reasons
from symcal.images.foreign import foreign_reasons
from symcal.images.measure import flange_poses
from symcal.images.other_cameras import other_cameras
from symcal.images.shots import Shot, Shots, conditions_of, listed_failures, with_thumbnail
from symcal.instruments import seen_by
from symcal.placing.agreement import FEWEST, MOUNTS, Agreement, Mount, agreement
from symcal.placing.pairing import foreign_views
from symcal.robot.robot import Robot
from symcal.spatial import transform
from symcal.vision.board import BoardDetection, detect_board
from symcal.vision.board_size import other_size
from symcal.vision.images import thumbnail
from symcal.words import plural

Array = NDArray[np.float64]
Progress = Callable[[str], None]

_BLAS = ThreadpoolController()

_LOOKED_AT = 3  # images in which another board is looked for
_FAR_OFF = 20.0  # mm: robots are rarely off so far at nominal
_SEED = 1  # of the draws of the consensus: the same images always give the same points


@dataclass(frozen=True, slots=True)
class MeasuredBoards:
    """Image points of all images that show the board.

    data: `pixels`. images: the image of each pose. detections: of each pose. thumbnails: of each pose, as JPEG; empty
    for some where there are very many. failures: (image, reason) of every other.
    found: what most images agree on; None where nothing could be compared. notes: what should be known about them.
    """

    data: Dataset
    images: tuple[str, ...]
    detections: tuple[BoardDetection, ...]
    thumbnails: tuple[bytes, ...]
    failures: tuple[tuple[str, str], ...]
    found: Agreement | None
    notes: tuple[str, ...]

    @property
    def where(self) -> str:
        """What the camera is on, in words; nothing where that is not known."""
        if self.found is None:
            return ""
        where = "in the robot's hand" if self.found.mount == "hand" else "beside the robot, the board on it"
        return f"the camera is {where}; by the nominal robot the views agree to {self.found.typical:.1f} mm"


@dataclass(frozen=True, slots=True)
class _View:
    """A shot in which the board was found: its place among the shots, what was found, a digest of the grey levels, a
    small copy."""

    shot: Shot
    row: int
    detection: BoardDetection
    digest: str
    thumbnail: bytes


def measure_boards(
    shots: Shots,
    robot: Robot,
    camera: Camera,
    board: Board,
    *,
    mounts: tuple[Mount, ...] = MOUNTS,
    progress: Progress = lambda _: None,
) -> MeasuredBoards:
    """Image points of the board in every image that can be believed.

    Args:
        mounts: what the camera may be on.
    Raises:
        RefusedError: no image shows the board, or what is wrong makes all of them doubtful; in one sentence.
    """
    if not shots.shots:
        raise RefusedError("none of the images is there and has joint readings: check the names in the joints file")
    with _BLAS.limit(limits=1):  # small matrices: a second thread only costs
        views, failures, notes = _detected(shots, camera, board, progress)
        progress("comparing images and joint readings")
        found = _believed(views, failures, shots, robot, camera, board, mounts)
        return replace(found, notes=(*notes, *found.notes))


def _detected(
    shots: Shots, camera: Camera, board: Board, progress: Progress
) -> tuple[list[_View], list[tuple[str, str]], list[str]]:
    """Views of the board, (image, reason) of every other image, and what is to be said."""
    views: list[_View] = []
    failures: list[tuple[str, str]] = []
    others: list[str | None] = []
    sizes: list[str] = []
    pictured = with_thumbnail(len(shots.shots))
    for number, (shot, row) in enumerate(zip(shots.shots, shots.rows, strict=True), start=1):
        progress(f"looking for the board in image {number} of {len(shots.shots)}")
        try:
            image = np.asarray(shot.load(), dtype=np.uint8)
        except InputError as error:
            failures.append((shot.name, error.message))
            continue
        if image.shape != (camera.height, camera.width):
            sizes.append(f"{image.shape[1]} x {image.shape[0]} px")
            stated = f"the camera file says {camera.width} x {camera.height} px"
            failures.append((shot.name, f"another camera: the image is {sizes[-1]}, {stated}"))
            continue
        if len(others) < _LOOKED_AT and not (views and board.kind == "chessboard"):
            others.append(other_size(image, board))
            _insist_on_board(others, board)
        found = detect_board(image, board, shot.name)
        if isinstance(found, BoardDetection):
            small = thumbnail(image) if number - 1 in pictured else b""
            views.append(_View(shot, row, found, hashlib.sha256(image.tobytes()).hexdigest(), small))
        else:
            failures.append((shot.name, found.reason))
    if len(sizes) > 0.5 * len(shots.shots):
        usual = max(dict.fromkeys(sizes), key=sizes.count)
        raise RefusedError(
            f"{len(sizes)} of {plural(len(shots.shots), 'image')} are not of this camera: they are {usual}, and the "
            f"camera file is of {camera.width} x {camera.height} px"
        )
    if not views:
        raise RefusedError(f"no image could be measured: {listed_failures(failures)}")
    odd = f"{len(sizes)} of {plural(len(shots.shots), 'image')} have another size than the camera file says"
    return views, failures, [f"{odd}: two cameras in one folder"] if sizes else []


def _insist_on_board(others: Sequence[str | None], board: Board) -> None:
    """Refuse when several images show one and the same other board."""
    for other in others:
        if other is not None and others.count(other) > 1:
            raise RefusedError(f"the images show {other}, and the board is said to be {board}")


def _believed(
    views: list[_View],
    failures: list[tuple[str, str]],
    shots: Shots,
    robot: Robot,
    camera: Camera,
    board: Board,
    mounts: tuple[Mount, ...],
) -> MeasuredBoards:
    notes: list[str] = []
    posed: list[tuple[_View, BoardPose]] = []
    for view in views:
        pose = board_pose(camera, board, view.detection.indices, view.detection.pixels)
        if pose is None:
            failures.append((view.shot.name, "its corners do not tell where the board is"))
        else:
            posed.append((view, pose))
    if not posed:
        raise RefusedError(f"no image could be measured: {listed_failures(failures)}")
    reasons, said = other_cameras([pose for _, pose in posed], [view.shot.name for view, _ in posed])
    notes += said
    failures += [(posed[i][0].shot.name, reason) for i, reason in reasons.items()]
    kept = [each for i, each in enumerate(posed) if i not in reasons]
    found, reasons, said, turned = _compared(kept, shots, robot, board, mounts)
    notes += said
    failures += [(kept[i][0].shot.name, reason) for i, reason in reasons.items()]
    used = [i for i in range(len(kept)) if i not in reasons]
    if not used:
        raise RefusedError(f"no image could be measured: {listed_failures(failures)}")
    measured = [kept[i][0] for i in used]
    detections = tuple(_turned_round(kept[i][0].detection, board) if turned[i] else kept[i][0].detection for i in used)
    return MeasuredBoards(
        data=_dataset([view.shot for view in measured], detections, camera, board),
        images=tuple(view.shot.name for view in measured),
        detections=detections,
        thumbnails=tuple(view.thumbnail for view in measured),
        failures=tuple(failures),
        found=found,
        notes=tuple(notes),
    )


def _compared(
    kept: Sequence[tuple[_View, BoardPose]], shots: Shots, robot: Robot, board: Board, mounts: tuple[Mount, ...]
) -> tuple[Agreement | None, dict[int, str], list[str], list[bool]]:
    """What views and joint readings agree on, reasons to leave views out, what is to be said, and which views show the
    board turned round."""
    names = [view.shot.name for view, _ in kept]
    own = np.array([view.row for view, _ in kept])
    twice = _looks_the_same_turned(board)
    poses = [_with_turned(pose.poses, board) if twice else pose.poses for _, pose in kept]
    stack = np.full((len(kept), max(len(each) for each in poses), 4, 4), np.nan)
    for i, each in enumerate(poses):
        stack[i, : len(each)] = each
    flange = flange_poses(robot, shots.q)
    centre = board.points.mean(axis=0)
    found = agreement(flange, own, stack, centre, np.random.default_rng(_SEED), mounts)
    groups = copies([view.detection for view, _ in kept], [view.digest for view, _ in kept])
    misfit = None if found is None else found.misfit[np.arange(len(own)), own]
    reasons, notes = copy_reasons(groups, [view.shot for view, _ in kept], misfit)
    if found is None:
        why = f"fewer than {FEWEST} of them" if len(kept) < FEWEST else "the flange turns about one axis only"
        notes.append(f"it was not checked that images and joint readings belong together: {why}")
        if twice:
            notes.append("the board looks the same from both sides: its points may be named otherwise in each image")
        return None, reasons, notes, [False] * len(kept)
    if found.scale != 1:
        raise RefusedError(
            f"by the robot's motion the board is about {found.scale:.2f} times as large as said: its squares measure "
            f"{found.scale * board.square:.3g} mm and not {board.square:g} mm, or the robot file's lengths are wrong"
        )
    if found.typical > _FAR_OFF:
        notes.append(
            f"views and joint readings agree to {found.typical:.0f} mm only: look at the robot file, the signs of the "
            "joints and the camera file"
        )
    foreign = foreign_views(found, own, np.array([pose.sigma for _, pose in kept]))
    others, more = foreign_reasons(foreign, shots, own.tolist(), names, found)
    flip = [twice and int(k) % 2 == 1 for k in found.which]
    return found, others | reasons, notes + more, flip


def _looks_the_same_turned(board: Board) -> bool:
    """Whether half a turn carries the board onto itself, so that its detector cannot tell which corner is the first."""
    return board.kind == "circles" or (board.kind == "chessboard" and (board.columns + board.rows) % 2 == 0)


def _with_turned(poses: Array, board: Board) -> Array:
    """Each pose, followed by that of the board turned round."""
    half = transform(np.diag([-1.0, -1.0, 1.0]), 2 * board.points.mean(axis=0) * [1, 1, 0])
    return np.stack([poses, poses @ half], axis=1).reshape(-1, 4, 4)


def _turned_round(detection: BoardDetection, board: Board) -> BoardDetection:
    return replace(detection, indices=len(board.points) - 1 - detection.indices)


def _dataset(shots: Sequence[Shot], detections: Sequence[BoardDetection], camera: Camera, board: Board) -> Dataset:
    """Image points without a stated noise: the residuals of an identification tell it."""
    z = np.full((len(shots), len(board.points), 2), np.nan)
    for row, detection in enumerate(detections):
        z[row, detection.indices] = detection.pixels
    names = tuple(str(i) for i in range(len(board.points)))
    return Dataset(
        of=(Readings(seen_by(camera, calibrate=False), "pixels", names),),
        q=np.array([shot.q for shot in shots]),
        z=z.reshape(len(shots), -1),
        labels=tuple(shot.label for shot in shots),
        split=tuple(shot.split for shot in shots),
        provenance="images",
        conditions=conditions_of(shots),
    )
