"""Random subsets of a measured set train, its other poses judge: `python tests/remainder_subsets.py CONFIG N [DRAWS]`.

Physics: geometry with the joint terms that `symcal.calibration.candidates` names (gravity, harmonics 1 and 2).
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from symcal.calibration.calibrate import calibrate
from symcal.calibration.candidates import candidates
from symcal.calibration.evaluate import evaluate
from symcal.calibration.remainder import with_remainder
from symcal.model.model import build_model
from symcal.runs.data import measurements
from symcal.runs.load import load

if __name__ == "__main__":
    experiment = load(sys.argv[1])
    rng = np.random.default_rng(experiment.seed)
    own = (experiment.file, experiment.document, experiment.model, rng)
    data = measurements(*own, data=None, planned=None, progress=lambda _: None).data
    robot = experiment.model.robot
    terms = candidates(robot, ("gravity", "harmonics 1", "harmonics 2"), data.conditions)
    models = {
        "geometry": experiment.model,
        "with terms": build_model(replace(robot, terms=terms), experiment.model.task),
    }
    every = np.flatnonzero([split == "train" for split in data.split])
    for draw in range(int(sys.argv[3]) if len(sys.argv) > 3 else 1):
        chosen = np.random.default_rng(draw).permutation(every)[: int(sys.argv[2])]
        used = replace(
            data, split=tuple("train" if i in set(chosen.tolist()) else "test" for i in range(len(data)))
        ).take(every)
        for name, model in models.items():
            plain = calibrate(model, None, used, experiment.options)
            found = with_remainder(plain, used, experiment.options, np.random.default_rng(draw))
            rms = [evaluate(c.states["after"], used.part("test")).statistics.rms for c in (plain, found)]
            assert found.trial is not None
            print(
                f"{len(chosen)} poses, draw {draw}, {name}: unseen rms {rms[0]:.4f} without, {rms[1]:.4f} with; "
                f"kept {found.trial.kept}, gain {found.trial.candidate.gain:.1f}, "
                f"lengths {found.trial.candidate.kernel.lengths.round(2).tolist()}",
                flush=True,
            )
