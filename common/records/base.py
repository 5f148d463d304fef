"""What every record is made of: strict fields, and arrays of declared dtype and shape."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema, core_schema

Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_.-]+$")]
Text = Annotated[str, Field(max_length=4096)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
Role = Literal["router", "learner", "actor", "evaluator"]
Count = Annotated[int, Field(ge=0, lt=2**53)]


@dataclass(frozen=True)
class Array:
    """Declares an array field: its dtype and one letter (or number) a dimension; equal letters are equal lengths."""

    dtype: str
    dims: tuple[str | int, ...] | None = None  # None: any shape

    def __get_pydantic_core_schema__(self, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check)

    @cached_property
    def _wanted(self) -> tuple[np.dtype[Any], bool, list[tuple[int, int]]]:
        """The dtype, whether it has numbers that are not finite, and the dimensions that have a number."""
        dtype = np.dtype(self.dtype)
        return dtype, dtype.kind == "f", [(at, want) for at, want in enumerate(self.dims or ()) if type(want) is int]

    def check(self, value: Any) -> NDArray[Any]:
        if not isinstance(value, np.ndarray):
            raise ValueError(f"wants an array, got {type(value).__name__}")  # noqa: TRY004  (pydantic wants ValueError)
        dtype, has_infinities, numbers = self._wanted
        if value.dtype != dtype:
            raise ValueError(f"wants dtype {self.dtype}, got {value.dtype}")
        if self.dims is not None and value.ndim != len(self.dims):
            raise ValueError(f"wants {len(self.dims)} dimensions, got shape {value.shape}")
        for at, want in numbers:
            if value.shape[at] != want:
                raise ValueError(f"wants shape {self.dims}, got {value.shape}")
        if has_infinities and b"\0" in np.isfinite(value).tobytes():  # a third of the time of `all`
            raise ValueError("has non-finite numbers")
        return value


class Record(BaseModel):
    """A strict message: no unknown field, no coercion, no non-finite number.

    A shape letter stands for one length, also in the records that this one is made of.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True, defer_build=True
    )

    @classmethod
    @cache
    def arrays(cls) -> dict[str, Array]:
        """The declared array fields, by name."""
        specs = {name: info.metadata for name, info in cls.model_fields.items()}
        return {name: spec for name, metadata in specs.items() for spec in metadata if isinstance(spec, Array)}

    @classmethod
    @cache
    def names(cls) -> dict[str, str]:
        """The names of all fields here, and on the wire and in files."""
        return {name: info.alias or name for name, info in cls.model_fields.items()}

    @model_validator(mode="after")
    def _letters_agree(self) -> Self:
        _agree(self, "", {})
        return self


@cache
def _letters(record_type: type[Record]) -> list[tuple[str, list[tuple[int, str]] | None]]:
    """Of each field the dimensions that have a letter; None: it is no array. Those without letters are left out."""
    plan: list[tuple[str, list[tuple[int, str]] | None]] = []
    for name in record_type.model_fields:
        spec = record_type.arrays().get(name)
        dims = () if spec is None else spec.dims or ()
        if spec is None or dims:
            lettered = [(at, letter) for at, letter in enumerate(dims) if isinstance(letter, str)]
            plan.append((name, None if spec is None else lettered))
    return plan


def _agree(record: Record, path: str, seen: dict[str, int]) -> None:
    values = record.__dict__
    for field, lettered in _letters(type(record)):
        value = values[field]
        if lettered is None:
            if isinstance(value, Record):
                _agree(value, f"{path}{field}.", seen)
            continue
        for at, letter in lettered:
            size = value.shape[at]
            if seen.setdefault(letter, size) != size:
                raise ValueError(f"{path}{field}: dimension {letter} is {size} here and {seen[letter]} before")
