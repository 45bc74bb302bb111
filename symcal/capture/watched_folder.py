"""A folder into which a camera's program writes: an image whose name holds the pose's is the answer to its request.

`30.png`, `pose_30.png` and `cell2-30-b.tif` are all of pose 30: the name is cut where letters and digits end. An image
is used once; a pose that is asked for again needs another one.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from symcal.capture.aim import Aim
from symcal.capture.lines import Answer, Missed, Read, Request
from symcal.errors import InputError, RefusedError, SymcalError
from symcal.images.entries import measure_entry
from symcal.images.shots import Shot, Shots
from symcal.vision.images import read_image

_PAUSE = 0.2  # seconds between two looks
_SETTLED = 2  # looks at which a file is the same, before it is whole
_BROKEN = 25  # looks after which one that cannot be read never will be
_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm"})


class WatchedFolder:
    """Waits for images. used: names of those that were read before. tell: says where to drive."""

    def __init__(self, aim: Aim, folder: Path, used: Iterable[str], tell: Callable[[Request], None]) -> None:
        target, camera = aim.observation.target, aim.instrument.camera
        if camera is None or (target.board is None and target.marks is None):
            raise InputError(
                "images are measured by 'instrument: pixels' of a target with 'board' or 'file'", key="--instrument"
            )
        if not folder.is_dir():
            raise InputError("there is no such folder to watch", key="--instrument", found=folder)
        self._aim, self._folder, self._used, self._tell = aim, folder, set(used), tell

    def ask(self, request: Request) -> Answer:
        self._tell(request)
        path = self._waited_for(request.of.pose)
        self._used.add(path.name)
        try:
            return self._measured(request, path)
        except SymcalError as error:
            return Missed(f"{path.name}: {error}")

    def _measured(self, request: Request, path: Path) -> Answer:
        robot, o = self._aim.experiment.robot, self._aim.observation
        shot = Shot(path.name, request.of.pose, "train", request.q, lambda: read_image(path))
        found = measure_entry(o, Shots.of([shot]), robot, lambda _: None, examples=0).data
        if found.only.features != o.features:
            raise RefusedError("the image shows other points than the target has")
        return Read(np.asarray(found.z[0]), request.q, request.directions, path.name)

    def _waited_for(self, pose: str) -> Path:
        """The first image of a pose that was not used, when it is whole."""
        seen: dict[Path, tuple[int, int, int]] = {}
        while True:
            for path in sorted(self._folder.iterdir()):
                if path.suffix.lower() not in _SUFFIXES or path.name in self._used or not _names(path, pose):
                    continue
                state = path.stat()
                size, when, looks = seen.get(path, (-1, -1, 0))
                same = (size, when) == (state.st_size, state.st_mtime_ns)
                seen[path] = (state.st_size, state.st_mtime_ns, looks + 1 if same else 0)
                if same and looks + 1 >= _SETTLED and (_readable(path) or looks + 1 >= _BROKEN):
                    return path
            time.sleep(_PAUSE)

    def say(self, text: str) -> None:
        pass

    def end(self, text: str) -> None:
        pass


def _names(path: Path, pose: str) -> bool:
    """Whether a file is called by a pose."""
    return pose == path.stem or pose in re.split(r"[^A-Za-z0-9]+", path.stem)


def _readable(path: Path) -> bool:
    try:
        read_image(path)
    except SymcalError:
        return False
    return True
