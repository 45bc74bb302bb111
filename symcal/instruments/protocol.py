"""What a kind of instrument is: how a reading comes from where a target's feature stands in the instrument's own frame.

A feature is a point of the target with the target's axes, one of its axes, or its frame: (R, p), mm. A kind is one
short file: a subclass of `Instrument` that says what is read of it, registered by name. Everything else asks the
instrument what it can do, and never for its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.camera.camera import Camera
from symcal.documents.document import Strict
from symcal.parameters import FRAME_AXES, JointPrior, Parameter, Unit

SX = ca.SX
Array = NDArray[np.float64]
Draw = Callable[[tuple[int, ...]], Array]
"""Noise of one sigma in a shape."""
Column = tuple[str, Unit | None]
"""A number of a reading in tables: its name, and its unit if it has one."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """Residual components of one feature that share a noise sigma.

    noise: name of the sigma. size: how many components. floor: noise of data that have none (rounding), in the unit.
    alike: noise of this quantity that goes with 1 mm, 1 rad or 1 px of the first one of the kind, roughly.
    sigma_columns: names of their sigmas in tables. sigma_column: that of one sigma for all of them.

    Example:
        >>> import symcal as sc
        >>> (quantity,) = sc.Plane().quantities
        >>> quantity.noise, quantity.unit, quantity.size
        ('height', 'mm', 1)
    """

    noise: str
    unit: Unit
    size: int
    floor: float
    sigma_columns: tuple[str, ...]
    sigma_column: str
    alike: float = 1.0


@dataclass(frozen=True, slots=True)
class Edge:
    """What the keys of a kind need to become numbers: mm and rad per unit of the file, and the files that they name.

    path: of a file named under a key, absolute; InputError if it is not there.
    """

    length: float
    angle: float
    path: Callable[[str, str], Path]


@dataclass(frozen=True, slots=True)
class Margin:
    """By how much a feature can be read, positive while it can: what it is, its unit, and what counts as much."""

    name: str
    unit: Literal["mm", "rad", "px"]
    scale: float


class Keys(Strict):
    """The keys of a kind in YAML, beside those that every observation has."""


class Instrument:
    """A kind of instrument with its settings; subclasses are frozen dataclasses.

    name: as files call it. label: said to people. reads: which features of the target it reads one by one, some of
    which may be missing: its points, its axes (z of R then), or its frame as a whole.
    quantities: what the residual of one feature consists of. columns: the numbers of one reading.
    gives_point: a reading fixes the point; its residual is then an error of the tool in mm.
    makes_world: its own frame is world where nobody says where it stands; of others that must be said.
    error: name, unit and number of components of what is judged of a feature. error_words: said to people.
    sees: which increments of its own frame it can tell. own: names of its own numbers, such as a wire's offset.
    limits: what a feature must keep to be read, see `margins`.
    constrains: it reads nothing: the feature must lie on it. Its reading is zero then, and files have no columns of it.
    sees_length: whether its readings change when all lengths, its own place included, grow by the same share.
    is_camera, camera: whether it is one, and its optics.

    Example:
        >>> import symcal as sc
        >>> isinstance(sc.Distance(), sc.Instrument), sc.Distance().columns
        (True, (('distance', 'mm'),))
    """

    name: ClassVar[str]
    label: ClassVar[str]
    reads: ClassVar[Literal["points", "axes", "frame"]] = "points"
    gives_point: ClassVar[bool] = False
    makes_world: ClassVar[bool] = False
    error_words: ClassVar[str]
    own: ClassVar[tuple[str, ...]] = ()
    constrains: ClassVar[bool] = False
    sees_length: ClassVar[bool] = True
    is_camera: ClassVar[bool] = False
    camera: Camera | None = None
    Config: ClassVar[type[Keys]] = Keys

    @classmethod
    def configured(cls, _keys: Any, _edge: Edge) -> Self:
        """The instrument that keys of a file describe."""
        return cls()

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        raise NotImplementedError

    @property
    def columns(self) -> tuple[Column, ...]:
        raise NotImplementedError

    @property
    def file_columns(self) -> tuple[Column, ...]:
        """The numbers of one reading that files hold."""
        return () if self.constrains else self.columns

    @property
    def limits(self) -> tuple[Margin, ...]:
        return ()

    @property
    def error(self) -> tuple[str, Unit, int]:
        first = self.quantities[0]
        return first.noise, first.unit, first.size

    @property
    def judged_in_world(self) -> bool:
        """Whether what is judged is a vector that has axes x, y, z of world."""
        return self.gives_point or self.is_camera

    @property
    def error_names(self) -> tuple[str, ...]:
        """Names of the components of what is judged."""
        own = tuple(name.removeprefix("sigma_") for name in self.quantities[0].sigma_columns)
        return ("x", "y", "z") if self.judged_in_world else own

    @property
    def sees(self) -> tuple[str, ...]:
        return FRAME_AXES

    @property
    def numbers(self) -> Array:
        """Nominal values of ``own``, shape (len(own),)."""
        return np.zeros(len(self.own))

    def unknowns(self, prefix: str) -> tuple[Sequence[Parameter], Sequence[JointPrior]]:
        """Those of its own numbers that are to be found, their names with this prefix, and what is known of them."""
        return (), ()

    @property
    def has_unknowns(self) -> bool:
        """Whether any of its own numbers is to be found."""
        return bool(self.unknowns("")[0])

    def by_axis(self, *, observed: bool) -> Self:
        """The instrument with all components of its residual in its own axes, for a noise by axis.

        Args:
            observed: data hold its pose in the target's frame, not the target's in its own.
        """
        return self

    @property
    def componentwise(self) -> bool:
        """Whether each number of a reading makes one component of the residual, so that it may be missing alone."""
        return len(self.columns) == sum(quantity.size for quantity in self.quantities)

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        """The reading of a feature, shape (len(columns),)."""
        raise NotImplementedError

    def residual(self, rotation: SX, point: SX, reading: SX, own: SX) -> SX:
        """Model minus measured, shape (sum of sizes,)."""
        return self.predict(rotation, point, own) - reading

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        """Derivatives of the residual by the feature's twist (omega, v) in the instrument's frame, and by ``own``; by
        automatic differentiation where a kind does not know better.

        Args:
            reading: None at a residual of zero: of a reading that is yet to be taken.
        """
        r, p = SX.sym("R", 3, 3), SX.sym("p", 3)
        z, numbers, twist = SX.sym("z", len(self.columns)), SX.sym("own", len(self.own)), SX.sym("twist", 6)
        moved = self.residual(r + spatial.skew(twist[:3]) @ r, p + twist[3:], z, numbers)
        still = ca.substitute([ca.jacobian(moved, twist), ca.jacobian(moved, numbers)], [twist], [SX.zeros(6)])
        at = ca.Function("slopes", [r, p, z, numbers], [ca.densify(each) for each in still])
        given = self.predict(rotation, point, own) if reading is None else reading
        by_twist, by_own = at(rotation, point, given, own)
        return by_twist, by_own

    def margins(self, rotation: SX, point: SX, own: SX) -> SX:
        """Signed amounts, one per limit: the feature can be read where all are positive, shape (len(limits),)."""
        return SX(0, 1)

    def miss(self, rotation: SX, point: SX, reading: SX, own: SX, *, riding: bool) -> tuple[SX, SX]:
        """What is judged of a reading: ``error`` (in the instrument's frame if it is a point), and the tool's attitude
        error (3,) or nothing.

        Args:
            riding: the instrument is on the robot and the target is not.
        """
        return self.residual(rotation, point, reading, own)[: self.error[2]], SX(0, 1)

    def retract(self, reading: Array, noise: Mapping[str, Draw]) -> Array:
        """Readings (N, k, len(columns)) with noise, by name of the sigma."""
        (quantity,) = self.quantities
        return reading + noise[quantity.noise](reading.shape)

    def record(self) -> dict[str, Any]:
        """Its settings as plain data, for `recalled`."""
        return asdict(self) if hasattr(self, "__dataclass_fields__") else {}  # type: ignore[call-overload]

    @classmethod
    def recalled(cls, settings: Mapping[str, Any], _file: Path) -> Self:
        """The instrument of `record`."""
        return cls(**settings)

    def corrected(self, errors: Mapping[str, float]) -> Self:
        """The instrument with errors of its own numbers carried out, by name: fields that are called like them."""
        if not self.own:
            return self
        own = {name: float(n) + errors.get(name, 0.0) for name, n in zip(self.own, self.numbers, strict=True)}
        return replace(self, **own)  # type: ignore[type-var]


def sigmas(*components: str) -> tuple[str, ...]:
    """Names of the columns of sigmas of these components."""
    return tuple(f"sigma_{component}" for component in components)
