"""How to fit, by itself: a file's checks need it, and not the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from symcal.fit.robust import Loss
from symcal.solvers import SolverName
from symcal.solvers.least_squares import Tolerances

Scales = Literal["estimated", "stated"]


@dataclass(frozen=True, slots=True)
class Options:
    """How to fit.

    loss: `auto` is for an identification to choose (`symcal.calibration.loss_choice`); a single fit needs one.
    sigma: known noise per group (mm, rad, px), estimated where absent. scales: whether a common factor on the plausible
        sizes of the link parameters (and one on those of each group of joint terms) is estimated, or they hold as
        stated. shrinking: groups of joint terms that may not be there at all: their factor is found whatever was
        stated.

    Example:
        >>> import symcal as sc
        >>> options = sc.Options(loss="huber", sigma={"position": 0.05})
        >>> options.solver
        'levenberg_marquardt'
    """

    solver: SolverName = "levenberg_marquardt"
    tolerances: Tolerances = field(default_factory=Tolerances)
    loss: Loss | Literal["auto"] = "linear"
    sigma: Mapping[str, float] = field(default_factory=dict)
    scales: Scales = "estimated"
    shrinking: tuple[str, ...] = ()
