"""What a worker must know of a study: small, in mm and rad, and the same wherever it is unpacked."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.joints import Term
from symcal.model.task import Task
from symcal.planning.visibility import View
from symcal.robot.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Cell:
    """One combination of what differs.

    plan: as the file names it; poses_of: which of the description's plans, None for a new random one in every trial.
    instruments: by name; task: which of the description's tasks. drawn: whether every trial draws its true errors;
    size: factor on them. noise: of the readings. shown: what varies, by key, as the file has it.
    """

    number: int
    poses: int
    plan: str
    poses_of: int | None
    instruments: tuple[str, ...]
    task: int
    drawn: bool
    size: float
    noise: Noise
    shown: Mapping[str, object]

    @property
    def position_noise(self) -> float:
        """Of the first instrument that has any, mm; 0 without."""
        return next((size for name in self.instruments if (size := self.noise.size(name, "position"))), 0.0)


@dataclass(frozen=True, slots=True)
class Description:
    """A study without its files.

    terms: joint terms of the true robot that the identified one lacks. truth: its errors by name, mm and rad;
    spread: standard deviations of those that are drawn in every trial, where they are. lower, upper: of the working
    area, shape (dof,). view: what plans ask of cameras. plans: poses, shape (N, dof) each. test: test poses, (T, dof).
    told: whether identifications are told the noise. measured: whether they are judged by readings with noise too.
    portable: whether all machines must run the one level of kernels that all have.
    """

    name: str
    seed: int
    repetitions: int
    robot: Robot
    tasks: tuple[Task, ...]
    terms: tuple[Term, ...]
    truth: Mapping[str, float]
    spread: Mapping[str, float]
    lower: Array
    upper: Array
    view: View
    plans: tuple[Array, ...]
    test: Array
    cells: tuple[Cell, ...]
    options: Options
    told: bool
    measured: bool
    portable: bool = False
    digest: str = field(default="", compare=False)

    @property
    def trials(self) -> int:
        return len(self.cells) * self.repetitions

    def cell_of(self, trial: int) -> Cell:
        return self.cells[trial // self.repetitions]

    def generator(self, trial: int) -> np.random.Generator:
        """Everything random in a trial, and in no other one."""
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(self.seed, spawn_key=(trial,))))


Shared = Literal["truth", "test", "plans"]
_SHARED: dict[Shared, int] = {"truth": 2**31, "test": 2**31 + 1, "plans": 2**31 + 2}


def shared_generator(seed: int, purpose: Shared) -> np.random.Generator:
    """Randomness that all trials share; its keys are beyond the number of any trial, so that none has the same stream,
    nor have streams that are spawned from these."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_SHARED[purpose],)))


def packed(description: Description) -> tuple[str, bytes]:
    """A description as bytes for other processes, and their hash, by which a worker knows what it has built."""
    data = pickle.dumps(description, protocol=5)
    return hashlib.sha256(data).hexdigest(), data
