"""Views that the stated camera did not take: their corners say another focal length, or fit no board."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symcal.camera.board_pose import BoardPose
from symcal.errors import RefusedError
from symcal.words import plural

_FOCAL, _SIGMAS = 0.03, 5.0  # least difference that is told, as a share and in standard deviations
_TOLD = 0.02  # standard deviation of the focal length from which a view tells it
_EXPLAINED = 0.5  # of the residuals: the most that another focal length may leave
_BAD, _BAD_PX = 5.0, 1.0  # of the median rms, and px: corners that are not a board's
_POOR_PX = 1.0  # median rms from which the camera file is doubted


def other_cameras(poses: Sequence[BoardPose], names: Sequence[str]) -> tuple[dict[int, str], list[str]]:
    """The reason of each view that the camera did not take, by its number, and sentences on them.

    Raises:
        RefusedError: most views are of another camera.
    """
    ratio = np.array([pose.focal for pose in poses])
    sigma = np.array([pose.focal_sigma for pose in poses])
    rms = np.array([pose.rms_px for pose in poses])
    left = np.array([pose.focal_rms_px for pose in poses])
    told = sigma < _TOLD
    odd = told & (np.abs(ratio - 1) > np.maximum(_FOCAL, _SIGMAS * sigma)) & (left < _EXPLAINED * rms)
    reasons: dict[int, str] = {}
    notes: list[str] = []
    if odd.any():
        times = float(np.median(ratio[odd]))
        if odd.sum() > 0.5 * told.sum():
            raise RefusedError(
                f"{odd.sum()} of {plural(int(told.sum()), 'image')} that tell it were taken with about {times:.2f} "
                "times the focal length of the camera file: it belongs to another camera, or to another zoom"
            )
        group = plural(int(odd.sum()), "image")
        notes.append(f"images of two cameras: {group} of {len(names)} tell {times:.2f} times the file's focal length")
        for i in np.flatnonzero(odd):
            reasons[int(i)] = f"it was taken with {ratio[i]:.2f} times the focal length of the camera file"
    others = rms[~odd]
    median = float(np.median(others)) if len(others) else 0.0
    for i in np.flatnonzero(~odd & (rms > max(_BAD * median, _BAD_PX))):
        reasons[int(i)] = f"its corners are not a flat board's: {rms[i]:.1f} px rms, others about {median:.2f} px"
    if median > _POOR_PX:
        notes.append(
            f"the corners fit camera file and board to {median:.1f} px rms only: calibrate the camera (symcal camera), "
            "or look at the board"
        )
    return reasons, notes
