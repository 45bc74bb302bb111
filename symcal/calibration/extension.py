"""What an identification beyond geometry found: groups of joint terms, and what each is at the joints."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class JointFinding:
    """A group's numbers at one joint.

    joint: from one. names: of the numbers. values, sigmas: in their units. p: probability of as much without a cause.
    named: whether that is small enough. seen: how many directions of the numbers the data see better than their
    plausible size, or the one that the group was found to have. amplitude, phase: of waves a sin(k q + phase), with
    their standard deviations; rad or mm, rad. smallest: amplitude that these data would name. summed:
    whether only its sum with the gravity moment of the own link means anything (`SharedFinding`): it is then not named.
    """

    joint: int
    name: str
    names: tuple[str, ...]
    values: tuple[float, ...]
    sigmas: tuple[float, ...]
    p: float
    named: bool
    seen: int
    unit: str
    amplitude: float | None = None
    amplitude_sigma: float | None = None
    phase: float | None = None
    phase_sigma: float | None = None
    smallest: float | None = None
    summed: bool = False

    @property
    def unseen(self) -> bool:
        return self.seen == 0


@dataclass(frozen=True, slots=True)
class SharedFinding:
    """What the first harmonic of a joint and the gravity moment of its own link are together: no pose tells them apart.

    amplitude, phase: of the sum, a sin(q + phase), with standard deviations.
    """

    joint: int
    name: str
    amplitude: float
    amplitude_sigma: float
    phase: float
    phase_sigma: float


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Residuals of poses in folds, without and with a group.

    without, with_: rms of the first noise group's readings, mm, rad or px. better: mean of the paired differences of
    the whitened squares of poses, without less with, over its standard error.
    """

    without: float
    with_: float
    better: float


@dataclass(frozen=True, slots=True)
class GroupFinding:
    """What became of a group.

    scale: factor on the plausible size of its numbers that the data ask for. rejected: whether held-out poses spoke
    against it although it gained. gain: twice the gain in log marginal likelihood. joints: what was found at each.
    """

    name: str
    kept: bool
    scale: float
    rejected: bool
    gain: float
    held_out: HeldOut
    joints: tuple[JointFinding, ...]


@dataclass(frozen=True, slots=True)
class Extension:
    """What an identification beyond geometry found.

    wanted: groups that were asked for, or `auto`. poses: that it was found by, in so many folds. geometry, chosen:
    held-out rms of the first noise group without any candidate and with those kept. quantity, unit: what that is.
    """

    wanted: tuple[str, ...]
    poses: int
    folds: int
    quantity: str
    unit: str
    geometry: float
    chosen: float
    groups: tuple[GroupFinding, ...]
    shared: tuple[SharedFinding, ...] = ()

    @property
    def kept(self) -> tuple[str, ...]:
        return tuple(group.name for group in self.groups if group.kept)
