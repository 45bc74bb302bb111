"""Noise in files: a number for each quantity that registered kinds of instrument measure."""

from typing import Annotated, Self

from pydantic import AfterValidator, ConfigDict, Field, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError, PydanticKnownError

from symcal.documents.document import Strict
from symcal.instruments import KINDS

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


def quantities() -> tuple[str, ...]:
    """Everything that has a noise, over all registered kinds."""
    return tuple(dict.fromkeys(q.noise for kind in KINDS.values() for q in kind().quantities))


def _measured(name: str) -> str:
    if name not in quantities():
        raise PydanticKnownError("literal_error", {"expected": ", ".join(map(repr, quantities()))})
    return name


Quantity = Annotated[str, AfterValidator(_measured), WithJsonSchema({"enum": list(quantities()), "type": "string"})]
KnownNoise = dict[Quantity, Positive]
"""Known standard deviation per axis, by quantity; what is absent is estimated from the training data."""


class ByQuantity(Strict):
    """A number for each quantity that is measured, under its name."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, NotNegative] = Field(init=False)

    @model_validator(mode="after")
    def _measured(self) -> Self:
        for name in self.__pydantic_extra__:
            if name not in quantities():
                message = "nothing measures '{name}': quantities are {known}"
                raise PydanticCustomError("quantity", message, {"name": name, "known": ", ".join(quantities())})
        return self

    @property
    def sizes(self) -> dict[str, float]:
        return dict(self.__pydantic_extra__)
