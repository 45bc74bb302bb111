"""What all identifications with one model and the same free parameters share: expressions, priors, compiled code."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.fit.whitened import beforehand
from symcal.kernels import BatchFunction, batch_function
from symcal.kernels.fit import FitKernel, fit_kernel
from symcal.kernels.fit_source import Layout
from symcal.kernels.instructions import read_program
from symcal.model.measurement import Measurement
from symcal.model.model import Model
from symcal.model.staged_kernel import StagedKernel

Array = NDArray[np.float64]

_KEPT = 32  # systems of models that were used last


@dataclass(frozen=True, slots=True)
class System:
    """The identification of the free parameters of a model.

    free, index: their names and places. scales: S, plausible sizes, shape (k,). prior: P, upper triangular rows of what
    is known before, |P x|^2, shape (k, k). equal: T with T^T T = P^T P + S^-2, shape (k, k): along it data tell as much
    as a plausible size.
    setup: the model's own, shape (s,). nowhere: x = 0, shape (n,). sizes: joints, n, s, and readings
        and components of a pose. places: index as a tuple.
    rows: (q, x, setup, z) -> r, shape (N, m), and J by the free parameters, shape (N, m, k); None where points come in
    stages. known: (x, setup) -> the same, whitened, of what is known between things, if anything is.
    """

    model: Model
    free: tuple[str, ...]
    index: NDArray[np.intp]
    scales: Array
    prior: Array
    equal: Array
    setup: Array
    nowhere: Array
    sizes: tuple[int, int, int, int, int]
    places: tuple[int, ...]
    rows: BatchFunction | None
    known: ca.Function | None
    # Compiled for a form of the arrays; filled on first use, never changed after.
    _kernels: dict[Layout, FitKernel | None] = field(default_factory=dict, compare=False, repr=False)

    def kernel(self, layout: Layout) -> FitKernel | None:
        """The compiled identification of arrays in this form; None where numpy has to do it, or is asked for."""
        if self.rows is None or self.rows.program is None or self.rows.kind.backend != "c":
            return None
        if layout not in self._kernels:
            known = None if self.known is None else read_program(self.known)
            self._kernels[layout] = fit_kernel(
                self.rows.program, layout, known, self.prior, self.scales, portable=self.rows.kind.portable
            )
        return self._kernels[layout]

    def at(self, q: Array, x: Array, setup: Array, z: Array) -> tuple[Array, Array]:
        """Residuals of N rows, shape (N, m), and their slopes by the free parameters, shape (N, m, k)."""
        if self.rows is not None:
            r, jacobian = self.rows(q, x, setup, z)
            return r, jacobian
        measurement = self.model.measurement
        found = [
            kernel(q, x, setup, z[:, part.readings])
            for part, kernel in zip(measurement.parts, self.model.residuals, strict=True)
        ]
        return np.hstack([r for r, _ in found]), np.concatenate([j[:, :, self.index] for _, j in found], axis=1)


class _Same:
    """A model as a key: this very one. Comparing its contents would take longer than the identification."""

    def __init__(self, model: Model) -> None:
        self.model = model

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.model is self.model

    def __hash__(self) -> int:
        return id(self.model)


_systems: OrderedDict[tuple[_Same, tuple[str, ...] | None, bool], System] = OrderedDict()


def system_of(model: Model, free: tuple[str, ...] | None, *, moved: bool) -> System:
    """The system of a model, made once for each set of free parameters and kept for the models used last.

    Args:
        free: names; all that are not held when None. moved: whether the others may be anywhere; zero if not, and the
            expressions are shorter then.
    """
    key = (_Same(model), free, moved)
    found = _systems.get(key)
    if found is None:
        names = free if free is not None else _not_held(model)
        found = _systems[key] = _made(model, names, moved)
        if len(_systems) > _KEPT:
            _systems.popitem(last=False)
    else:
        _systems.move_to_end(key)
    return found


def _not_held(model: Model) -> tuple[str, ...]:
    return tuple(name for name in model.parameters.names if name not in model.task.fix)


def _made(model: Model, free: tuple[str, ...], moved: bool) -> System:
    measurement = model.measurement
    parameters = measurement.parameters
    index = parameters.indices(free)
    scales = parameters.scales[index]
    prior = _triangle(beforehand(parameters, free).rows(scales) / scales)
    setup = model.setup.vector
    staged = any(isinstance(part.residual, StagedKernel) for part in measurement.parts)
    whole = len(free) == len(parameters) and np.array_equal(index, np.arange(len(index)))
    rows: BatchFunction | None = None
    if whole and len(measurement.parts) == 1 and isinstance(model.residual, BatchFunction):
        rows = model.residual
    elif not staged:
        rows = batch_function(_rows(measurement, index, moved), backend=model.kernels.choice)
    return System(
        model=model,
        free=free,
        index=index,
        scales=scales,
        prior=prior,
        equal=_triangle(np.vstack([prior, np.diag(1 / scales)])),
        setup=setup,
        nowhere=np.zeros(len(parameters)),
        sizes=(model.robot.dof, len(parameters), setup.size, measurement.parts[-1].readings.stop, measurement.rows),
        places=tuple(index.tolist()),
        rows=rows,
        known=_known(measurement, index, moved) if measurement.values else None,
    )


def _triangle(rows: Array) -> Array:
    """Upper triangular rows of the same squares, shape (k, k)."""
    n = rows.shape[1]
    if len(rows) == n and not np.tril(rows, -1).any():
        return rows
    found = np.zeros((n, n))
    r = np.linalg.qr(rows, mode="r")
    found[: len(r)] = r
    return found


def _rows(measurement: Measurement, index: NDArray[np.intp], moved: bool) -> ca.Function:
    """All parts one after the other, by the free parameters; the others are zero unless they may have moved."""
    whole = measurement.predict
    q, x, setup = (ca.SX.sym(name, *whole.size_in(i)) for i, name in enumerate(("q", "x", "setup")))
    z = ca.SX.sym("z", measurement.parts[-1].readings.stop)
    at = x if moved else _free_only(x, index)
    found = []
    for part in measurement.parts:
        assert isinstance(part.residual, ca.Function)
        found.append(part.residual(q, at, setup, z[part.readings]))
    r, jacobian = ca.vertcat(*(r for r, _ in found)), ca.vertcat(*(j for _, j in found))
    outputs = [r, jacobian[:, index.tolist()]]
    return ca.Function("rows", [q, x, setup, z], outputs, ["q", "x", "setup", "z"], ["r", "J"])


def _known(measurement: Measurement, index: NDArray[np.intp], moved: bool) -> ca.Function:
    """Residuals of all that is known between things, by the free parameters."""
    whole = measurement.predict
    x, setup = (ca.SX.sym(name, *whole.size_in(i)) for i, name in ((1, "x"), (2, "setup")))
    at, still = x if moved else _free_only(x, index), ca.SX.zeros(*whole.size_in(0))
    found = [value(still, at, setup) for value in measurement.values]
    r, jacobian = ca.vertcat(*(r for r, _ in found)), ca.vertcat(*(j for _, j in found))
    return ca.Function("known", [x, setup], [r, jacobian[:, index.tolist()]], ["x", "setup"], ["r", "J"])


def _free_only(x: ca.SX, index: NDArray[np.intp]) -> ca.SX:
    at = ca.SX.zeros(x.numel())
    for i in index.tolist():
        at[i] = x[i]
    return at
