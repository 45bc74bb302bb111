"""How long a board of 88 corners in 60 views takes: process time of building and of identifying, warm.

python tests/board_speed.py [repeats]        once with SYMCAL_KERNELS=auto, once with =vm
"""

from __future__ import annotations

import sys
import time

import numpy as np
from boards import LARGE, ROBOT, board, errors, eye_in_hand, measured, postures

from symcal.calibration.calibrate import calibrate
from symcal.fit.estimation import Options
from symcal.model.model import build_model


def seconds() -> tuple[float, float]:
    """Of building the model, and of placing and fitting it."""
    rng = np.random.default_rng(1)
    data = measured(LARGE, postures(LARGE, 60, rng), errors(rng), 0.1, rng)
    began = time.process_time()
    model = build_model(ROBOT, eye_in_hand(board(), guess=False))
    built = time.process_time()
    calibrate(model, None, data, Options())
    warm = time.process_time()
    calibrate(model, None, data, Options())
    return built - began, time.process_time() - warm


if __name__ == "__main__":
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    found = np.array([seconds() for _ in range(repeats)])
    for name, column in zip(("building", "identifying"), found.T, strict=True):
        sys.stdout.write(f"{name:11s} {np.min(column):.3f} s at best, {np.median(column):.3f} s in the middle\n")
