"""The parameter vector: names, order, units, nominal values, scales and priors in one place.

The vector x holds *errors*: identified minus nominal, so x = 0 is the nominal robot. Link parameters come first, by
kind and link as in [Ding2017] eq. 3; then base, tool, tool points, camera and its intrinsics.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError

Array = NDArray[np.float64]
Unit = Literal["mm", "rad", "px", "1", "rad/mm", "mm/rad", "rad/Nmm", "mm/N"]

SCALE: dict[str, float] = {"mm": 1.0, "rad": 0.010}
"""Plausible size of an error that nothing else is said about: 1 mm and 10 mrad."""

SMALLEST_SIZE, LARGEST_SIZE = 1e-9, 1e6
"""Sizes and priors beyond these are slips, and rounding would spoil what is computed with them."""

FRAME_AXES = ("x", "y", "z", "rx", "ry", "rz")


def check_size(name: str, value: float) -> None:
    """Refuse a size or prior (mm, rad) that cannot be meant.

    Raises:
        InputError: with the parameter's name as its key.
    """
    if not SMALLEST_SIZE <= value <= LARGEST_SIZE:
        limits = f"must be positive, from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} mm or rad"
        raise InputError(limits, key=name, found=value)


def link_name(kind: str, link: int) -> str:
    """Name of a link parameter, such as `theta_1`; links count from one."""
    return f"{kind}_{link}"


def zero_name(revolute: bool, joint: int) -> str:
    """Name of a joint's zero offset."""
    return link_name("theta" if revolute else "d", joint)


def frame_names(frame: str) -> tuple[str, ...]:
    """Names of the six increments of a frame, such as `base_x` to `base_rz`."""
    return tuple(f"{frame}_{axis}" for axis in FRAME_AXES)


def coordinate_names(point: str) -> tuple[str, ...]:
    """Names of the coordinates of a target's point, such as `tool_P1_x` to `tool_P1_z` of `tool_P1`."""
    return tuple(f"{point}_{axis}" for axis in "xyz")


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of the model that may be identified.

    nominal: its nominal value (mm, rad); increments of frames have nominal 0.
    scale: plausible size of its error; prior_sigma: standard deviation of a prior on the error, or None.
    unknown: nothing is known of it before it is measured (frames, points, a camera that was not calibrated): its scale
        then says what counts as seen, not what is plausible.
    group: of joint terms, those that share one common factor on their sizes; empty: links, which share another.
    """

    name: str
    unit: Unit
    nominal: float
    scale: float
    prior_sigma: float | None = None
    unknown: bool = False
    group: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class JointPrior:
    """A prior of mean zero on several errors together: their covariance, shape (k, k), positive definite."""

    names: tuple[str, ...]
    covariance: Array

    @property
    def rows(self) -> Array:
        """R with R^T R = covariance^-1, shape (k, k): |R e|^2 is the squared whitened error."""
        sigma = np.sqrt(np.diag(self.covariance))
        root = np.linalg.cholesky(self.covariance / np.outer(sigma, sigma))
        return np.asarray(np.linalg.solve(root, np.diag(1 / sigma)))


@dataclass(frozen=True)
class ParameterSet:
    """The parameters of a model in the order of its vector, and priors that tie several of them together."""

    items: tuple[Parameter, ...]
    joint_priors: tuple[JointPrior, ...] = ()

    def __post_init__(self) -> None:
        names = self.names
        if len(set(names)) < len(names):
            raise InputError("two parameters have this name", found=next(n for n in names if names.count(n) > 1))

    def __len__(self) -> int:
        return len(self.items)

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.items)

    @cached_property
    def units(self) -> tuple[Unit, ...]:
        return tuple(p.unit for p in self.items)

    @cached_property
    def nominal(self) -> Array:
        """Shape (n,), read-only."""
        return _kept([p.nominal for p in self.items])

    @cached_property
    def scales(self) -> Array:
        """Shape (n,), read-only."""
        return _kept([p.scale for p in self.items])

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def index(self, name: str) -> int:
        """Place of a parameter in the vector; KeyError if it has none."""
        return self._places[name]

    def indices(self, names: Iterable[str]) -> NDArray[np.intp]:
        return np.array([self._places[name] for name in names], dtype=np.intp)

    def vector(self, values: Mapping[str, float]) -> Array:
        """The vector with these errors and zero elsewhere; KeyError for a name that is not in the set."""
        x = np.zeros(len(self))
        for name, value in values.items():
            x[self.index(name)] = value
        return x

    def mapping(self, x: Array) -> dict[str, float]:
        return {p.name: float(v) for p, v in zip(self.items, x, strict=True)}

    def with_scales(self, scales: Mapping[str, float]) -> ParameterSet:
        """The same set where the plausible errors of these parameters are these; mm, rad."""
        self._check(scales)
        return replace(self, items=tuple(replace(p, scale=scales.get(p.name, p.scale)) for p in self.items))

    def with_priors(self, sigmas: Mapping[str, float]) -> ParameterSet:
        """The same set where these errors have a prior of mean zero and this standard deviation; mm, rad."""
        self._check(sigmas)
        items = tuple(replace(p, prior_sigma=sigmas.get(p.name, p.prior_sigma)) for p in self.items)
        return replace(self, items=items)

    def prior_rows(self, names: Sequence[str]) -> Array:
        """Whitened rows of all priors, shape (k, len(names)): |R e|^2 is what they add to the squared residuals.

        Parameters that are not named are held at nominal. There are as many rows as named parameters with a prior.
        """
        place = {name: i for i, name in enumerate(names)}
        single = [(p.name, p.prior_sigma) for p in self.items if p.name in place and p.prior_sigma is not None]
        rows = np.zeros((len(single), len(names)))
        for k, (name, sigma) in enumerate(single):
            rows[k, place[name]] = 1 / sigma
        for prior in self.joint_priors:
            kept = [i for i, name in enumerate(prior.names) if name in place]
            block = np.zeros((len(kept), len(names)))
            block[:, [place[prior.names[i]] for i in kept]] = np.linalg.qr(prior.rows[:, kept], mode="r")
            rows = np.vstack([rows, block])
        return rows

    def _check(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            if name not in self.names:
                raise InputError("no such parameter", found=name, allowed=self.names)
            check_size(name, value)


def _kept(values: list[float]) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
