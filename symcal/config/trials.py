"""What a study file may say: an experiment again and again, over a grid of what may differ and repetitions of each.

Numbers here are in the units of the experiment that the file names.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

from symcal.config.counts import Count
from symcal.config.noise import Positive, Quantity
from symcal.documents.document import Strict

SCHEMA: Literal["symcal/study/1"] = "symcal/study/1"

MOST_TRIALS = 10_000_000
"""Of one study: its numbers take 2 GB."""
MOST_CELLS = 10_000

RANDOM = "random"
"""The plan that is drawn again in every trial."""

Item = TypeVar("Item")


def _listed(value: Any) -> Any:
    """One value for a list of one."""
    return value if isinstance(value, list) else [value]


def _listed_twice(value: Any) -> Any:
    """`[tracker, wire]` for `[[tracker, wire]]`."""
    one = isinstance(value, list) and value and all(isinstance(item, str) for item in value)
    return [value] if one else value


def _no_value_twice(values: list[Item]) -> list[Item]:
    for i, value in enumerate(values):
        if value in values[:i]:
            raise PydanticCustomError("twice", "{value} stands here twice", {"value": repr(value)})
    return values


Errors = Literal["fixed", "drawn"]
Several = Annotated[list[Item], BeforeValidator(_listed), Field(min_length=1), AfterValidator(_no_value_twice)]


class VaryConfig(Strict):
    """The grid: every combination of the values of every key is a cell; one value may stand without brackets.

    poses: numbers of poses; of a plan file its first ones. plan: `random` (poses of the area drawn again in every
    trial), a CSV file, or a method of planning, whose plan is made once for the cell. noise: by quantity, of all
    instruments, as the experiment's distribution has it (standard deviation or half width). errors: those of the
    experiment's `data.truth` (`fixed`), or drawn again in every trial (`drawn`): normal, with `sigma_length` and
    `sigma_angle` of `data.truth`, else with each parameter's plausible size. size: factors on the errors of links and
    joint terms. instruments: sets of the experiment's instruments, by their names.
    What is not said is as in the experiment.
    """

    poses: Several[Count] | None = None
    plan: Several[str] | None = None
    noise: dict[Quantity, Several[Positive]] = {}
    errors: Several[Errors] | None = None
    size: Several[Positive] | None = None
    instruments: (
        Annotated[
            list[Annotated[list[str], Field(min_length=1)]],
            BeforeValidator(_listed_twice),
            Field(min_length=1),
            AfterValidator(_no_value_twice),
            WithJsonSchema({"type": "array", "items": {"type": "array", "items": {"type": "string"}}}),
        ]
        | None
    ) = None


class TrialIdentification(Strict):
    """What an identification is told: the noise that the data have, or to estimate it; and whether the plausible sizes
    hold as stated. With both known, thousands are identified at once; otherwise each is as `symcal identify` does it.
    """

    noise: Literal["known", "estimated"] = "known"
    sizes: Literal["stated", "estimated"] = "stated"


class JudgeConfig(Strict):
    """How a trial is judged: by the position errors of the measured points at random poses of the working area.

    against: the truth, or readings of it with noise. tolerance: what such errors should be within. of: their mean, rms,
    95th percentile or maximum in a trial. share: of the trials that should be within the tolerance.
    """

    test_poses: Annotated[int, Field(ge=1, le=100_000)] = 1000
    against: Literal["truth", "measurement"] = "truth"
    tolerance: Positive | None = None
    of: Literal["mean", "rms", "p95", "max"] = "p95"
    share: Annotated[float, Field(gt=0, lt=1)] = 0.95


class StudyOutputs(Strict):
    """What a study leaves beside its numbers."""

    report: bool = True
    figures: bool = True


class StudyFile(Strict):
    """A study: an experiment on simulated data, `repetitions` of it in every cell of the grid `vary`.

    experiment: its file; robot, measurement, working area, noise and true errors are from there. A trial is one
    repetition; they are numbered from 0, one cell after the other, and trial t of seed s draws from
    SeedSequence(s, spawn_key=(t,)) alone.
    """

    schema_: Literal["symcal/study/1"] = Field(default=SCHEMA, alias="schema")
    kind: Literal["study"]
    name: Annotated[str, Field(min_length=1, pattern=r"^[\w][\w .+-]*$")]
    title: str | None = None
    seed: Annotated[int, Field(ge=0)] = 1
    experiment: str
    repetitions: Annotated[int, Field(ge=1, le=MOST_TRIALS)] = 1000
    vary: VaryConfig = VaryConfig.model_construct()
    identification: TrialIdentification = TrialIdentification.model_construct()
    judge: JudgeConfig = JudgeConfig.model_construct()
    outputs: StudyOutputs = StudyOutputs.model_construct()
