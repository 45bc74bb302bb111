"""What a calibration says of itself in a robot file, as far as later commands read it: keys, kinds of their values.

Whatever else a run puts there is kept as it is. A key that is missing is of an earlier version; whoever needs it says
so. One that is there is what it should be, whoever edited the file.
"""

from typing import Annotated, Any

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from symcal.documents.document import Loose, Strict


class Named(Loose):
    place: str
    prefix: str


class Unknown(Loose):
    place: bool
    target: bool
    points: list[str]


class TargetRecord(Loose):
    name: str
    on: str


class ObservationRecord(Loose):
    """See `symcal.calibration.record`, which reads the rest of it."""

    instrument: str
    on: str
    entry: str
    names: Named
    target: TargetRecord
    unknown: Unknown | None = None
    unplaced: list[str] = Field(default_factory=list)


class LayoutRecord(Strict):
    columns: dict[str, str | list[str]] = Field(default_factory=dict)
    delimiter: str | None = None
    decimal: str | None = "."
    sheet: str | None = None
    session: str | None = None
    where: dict[str, Any] = Field(default_factory=dict)


def _layouts(found: dict[str, Any]) -> dict[str, Any]:
    """A layout by the name of each instrument, or a single one of an earlier version.

    Raises:
        PydanticCustomError: it is neither.
    """
    own = found.values() if all(isinstance(each, dict) and each for each in found.values()) else [found]
    for candidates in (own, [found]):
        try:
            for each in candidates:
                LayoutRecord.model_validate(each)
        except ValueError:
            continue
        return found
    raise PydanticCustomError("layout", "not what says how a file is laid out, by instrument")


class Provenance(Loose):
    """Everything in mm and rad. Of an identification (`symcal.calibration.calibrate`) and of its run."""

    measurements: dict[str, ObservationRecord] | None = None
    layout: Annotated[dict[str, Any], AfterValidator(_layouts)] = Field(default_factory=dict)
    noise_sigma: dict[str, float | None] = Field(default_factory=dict)
    noise_estimated: list[str] = Field(default_factory=list)
    rank: int | None = None
    dof: float | None = None
    size_factor: Annotated[float, Field(gt=0)] | None = None
    size_factors: dict[str, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)
    loss: str = "linear"
    priors: dict[str, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)
    learnt: dict[str, float] = Field(default_factory=dict)
    trouble: str = ""
    accuracy: dict[str, dict[str, Any]] = Field(default_factory=dict)
    inputs: dict[str, str] = Field(default_factory=dict)

    @property
    def facts(self) -> dict[str, Any]:
        """As the file has them."""
        return self.model_dump(exclude_unset=True)
