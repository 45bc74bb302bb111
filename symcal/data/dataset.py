"""Measurements as frozen arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.picture import data_sketch
from symcal.errors import InputError
from symcal.instruments import Instrument, kind_named
from symcal.notebook import html_table
from symcal.words import in_short, plural

Array = NDArray[np.float64]

SOME = 4096
"""Poses that stand for all where there are more and only their mean, or a first guess, is asked for."""
_ONE_POSTURE = 2e-5  # rad and mm: joint readings that files round differently


@dataclass(frozen=True, slots=True)
class Readings:
    """What columns of z hold: the readings of one observation, by feature.

    name: of the observation. features: names of the points or axes that are read; empty where it is the frame.
    """

    instrument: Instrument
    name: str
    features: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """The kind of instrument, by its name."""
        return self.instrument.name

    @property
    def width(self) -> int:
        """Columns of z."""
        return len(self.instrument.columns) * max(len(self.features), 1)

    @property
    def components(self) -> int:
        """Components of the residual."""
        return sum(q.size for q in self.instrument.quantities) * max(len(self.features), 1)

    def said(self) -> str:
        """In words, such as 'position of A, B'."""
        return f"{self.kind} of {in_short(self.features)}" if self.features else self.kind


def readings(kind: str, features: Sequence[str] = ()) -> tuple[Readings, ...]:
    """What the data of one instrument alone hold.

    Raises:
        InputError: there is no such kind.
    """
    return (Readings(kind_named(kind)(), kind, tuple(features)),)


@dataclass(frozen=True, slots=True)
class Dataset:
    """N measured poses of one robot.

    of: what was read, one observation after the other. q: joint readings, shape (N, dof), rad and mm.
    z: what the instruments gave, shape (N, nz); NaN where something was not seen, or by another instrument only.
    sigma: standard deviation of every residual component, shape (N, m), mm, rad and px; NaN where the file gives none.
    covariance: of the residual components of every pose, shape (N, m, m), where they are correlated: it then stands for
        the noise instead of ``sigma``. Directions without variance are exact by construction and say nothing.
    conditions: what else the file says of every pose, by name, shape (N,): the direction in which a joint came to its
        reading (`q2_direction`: -1, 1; 0 not known), `payload` in kg beyond that of the robot file.
    labels: the pose's name in its source, after its session where there are several. split: `train`, `test` or
        `unused` per pose.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> len(data), data.q.shape, data.z.shape
        (40, (40, 5), (40, 3))
        >>> len(data.take(range(10)))
        10
    """

    of: tuple[Readings, ...]
    q: Array
    z: Array
    labels: tuple[str, ...]
    split: tuple[str, ...]
    sigma: Array | None = None
    provenance: str = ""
    notes: tuple[str, ...] = field(default=())
    covariance: Array | None = None
    conditions: Mapping[str, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.q)

    def _repr_html_(self) -> str:
        """What was read how often, in which units, and where."""
        rows, at = [], 0
        for each in self.of:
            read = int(np.isfinite(self.z[:, at : at + each.width]).any(axis=1).sum())
            columns = ", ".join(f"{name} {unit}" if unit else name for name, unit in each.instrument.file_columns)
            rows.append([each.name or each.kind, each.said(), columns or "joint readings alone", str(read)])
            at += each.width
        splits = ", ".join(f"{self.split.count(name)} {name}" for name in dict.fromkeys(self.split))
        title = f"{plural(len(self), 'pose')}" + (f" ({splits})" if splits else "")
        drawing = data_sketch(self.of, self.z, self.split)
        return html_table(title, ["observation", "reads", "columns", "poses"], rows, self.notes, drawing)

    @property
    def only(self) -> Readings:
        """What was read where one instrument measured."""
        (only,) = self.of
        return only

    def read_by(self, name: str) -> Dataset:
        """The poses that one observation has read, with its readings alone."""
        at = at_sigma = 0
        for each in self.of:
            if each.name == name:
                break
            at, at_sigma = at + each.width, at_sigma + each.components
        else:
            raise KeyError(name)
        z = self.z[:, at : at + each.width]
        sigma = None if self.sigma is None else self.sigma[:, at_sigma : at_sigma + each.components]
        kept = np.flatnonzero(np.isfinite(z).any(axis=1))
        return replace(self, of=(each,), z=z, sigma=sigma).take(kept)

    def take(self, index: NDArray[np.intp] | Sequence[int] | NDArray[np.bool_]) -> Dataset:
        """The poses of an index or mask, in its order."""
        index = np.flatnonzero(index) if np.asarray(index).dtype == bool else np.asarray(index, dtype=np.intp)
        return replace(
            self,
            q=self.q[index],
            z=self.z[index],
            labels=tuple(self.labels[i] for i in index),
            split=tuple(self.split[i] for i in index),
            sigma=None if self.sigma is None else self.sigma[index],
            covariance=None if self.covariance is None else self.covariance[index],
            conditions={name: values[index] for name, values in self.conditions.items()},
        )

    def between(self, own: slice) -> Dataset:
        """Consecutive poses without their names and splits; arrays are views of these."""
        return replace(
            self,
            q=self.q[own],
            z=self.z[own],
            labels=(),
            split=(),
            sigma=None if self.sigma is None else self.sigma[own],
            covariance=None if self.covariance is None else self.covariance[own],
            conditions={name: values[own] for name, values in self.conditions.items()},
        )

    def few(self) -> Dataset:
        """At most `SOME` poses, evenly spread in their order; the data themselves where there are no more."""
        return self if len(self) <= SOME else self.take(evenly(len(self)))

    @property
    def used(self) -> Dataset:
        """The poses that train or test."""
        return self.take(np.array([split != "unused" for split in self.split], dtype=bool))

    def part(self, split: str) -> Dataset:
        """The poses of one split; the data themselves where that is all of them."""
        wanted = np.array([s == split for s in self.split], dtype=bool)
        return self if wanted.all() else self.take(wanted)


def evenly(count: int, most: int | None = None) -> NDArray[np.intp]:
    """Numbers of at most so many (`SOME`) of ``count`` poses, evenly spread in their order."""
    most = SOME if most is None else most
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.intp)


def unseen(count: int) -> tuple[str, ...]:
    """Names of poses that no file and no measurement has."""
    return tuple(f"unseen {i + 1}" for i in range(count))


def with_random_test(data: Dataset, fraction: float, rng: np.random.Generator) -> Dataset:
    """The data with a random share of the poses, but at least one, held out as `test`; at least one stays to train."""
    used = np.flatnonzero([s != "unused" for s in data.split])
    count = max(1, min(round(fraction * len(used)), len(used) - 1))
    split = np.array(data.split, dtype=object)
    split[used] = "train"
    split[rng.permutation(used)[:count]] = "test"
    return replace(data, split=tuple(split))


def merged(sets: Sequence[Dataset], sessions: Sequence[str]) -> Dataset:
    """The data of several observations as one: poses of one session and name are one posture.

    Raises:
        InputError: a pose whose joint readings or splits differ between two observations.
    """
    if len(sets) == 1:
        return sets[0]
    rows: dict[str, int] = {}
    first: list[tuple[Dataset, int]] = []
    for data, session in zip(sets, sessions, strict=True):
        for i, label in enumerate(data.labels):
            key = f"{session}/{label}" if session else label
            if key not in rows:
                rows[key] = len(first)
                first.append((data, i))
                continue
            other, k = first[rows[key]]
            for what, same in (
                ("joint readings", np.allclose(other.q[k], data.q[i], rtol=0, atol=_ONE_POSTURE)),
                ("split", other.split[k] == data.split[i]),
            ):
                if not same:
                    raise InputError(
                        f"pose '{label}' has another {what} with '{data.only.name}' than with '{other.only.name}': it "
                        "is one posture; give poses of other sessions a 'session' of their own",
                        file=data.provenance or None,
                    )
    z = np.full((len(first), sum(d.only.width for d in sets)), np.nan)
    sigma = np.full((len(first), sum(d.only.components for d in sets)), np.nan)
    at = at_sigma = 0
    for data, session in zip(sets, sessions, strict=True):
        index = [rows[f"{session}/{label}" if session else label] for label in data.labels]
        z[index, at : at + data.only.width] = data.z
        if data.sigma is not None:
            sigma[index, at_sigma : at_sigma + data.only.components] = data.sigma
        at, at_sigma = at + data.only.width, at_sigma + data.only.components
    return Dataset(
        of=tuple(data.only for data in sets),
        q=np.array([data.q[i] for data, i in first]),
        z=z,
        labels=tuple(rows),
        split=tuple(data.split[i] for data, i in first),
        sigma=sigma if any(data.sigma is not None for data in sets) else None,
        conditions=_conditions(sets, sessions, rows),
        provenance=", ".join(dict.fromkeys(data.provenance for data in sets)),
        notes=tuple(f"{data.only.name}: {note}" for data in sets for note in data.notes),
    )


def _conditions(sets: Sequence[Dataset], sessions: Sequence[str], rows: Mapping[str, int]) -> dict[str, Array]:
    """Conditions of the poses of several sets; nominal where no set says anything.

    Raises:
        InputError: two sets say different things of one pose.
    """
    names = dict.fromkeys(name for data in sets for name in data.conditions)
    out = {name: np.full(len(rows), np.nan) for name in names}
    for data, session in zip(sets, sessions, strict=True):
        index = np.array([rows[f"{session}/{label}" if session else label] for label in data.labels], dtype=np.intp)
        for name, values in data.conditions.items():
            other = out[name][index]
            for k in np.flatnonzero(np.isfinite(other) & (np.abs(other - values) > _ONE_POSTURE)):
                raise InputError(
                    f"pose '{data.labels[k]}' has another {name.replace('_', ' ')} with '{data.only.name}' than with "
                    "another observation: it is one posture; give poses of other sessions a 'session' of their own",
                    file=data.provenance or None,
                )
            out[name][index] = np.where(np.isfinite(other), other, values)
    return {name: np.nan_to_num(values) for name, values in out.items()}
