"""What every record is made of: strict fields, and arrays of declared dtype and shape."""

from collections.abc import Iterator
from dataclasses import dataclass
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

    def check(self, value: Any) -> NDArray[Any]:
        if not isinstance(value, np.ndarray):
            raise ValueError(f"wants an array, got {type(value).__name__}")  # noqa: TRY004  (pydantic wants ValueError)
        if value.dtype != np.dtype(self.dtype):
            raise ValueError(f"wants dtype {self.dtype}, got {value.dtype}")
        if self.dims is not None and value.ndim != len(self.dims):
            raise ValueError(f"wants {len(self.dims)} dimensions, got shape {value.shape}")
        for size, want in zip(value.shape, self.dims or (), strict=self.dims is not None):
            if isinstance(want, int) and size != want:
                raise ValueError(f"wants shape {self.dims}, got {value.shape}")
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            raise ValueError("has non-finite numbers")
        return value


class Record(BaseModel):
    """A strict message: no unknown field, no coercion, no non-finite number.

    A shape letter stands for one length, also in the records that this one is made of.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )

    @classmethod
    def arrays(cls) -> dict[str, Array]:
        """The declared array fields, by name."""
        specs = {name: info.metadata for name, info in cls.model_fields.items()}
        return {name: spec for name, metadata in specs.items() for spec in metadata if isinstance(spec, Array)}

    @model_validator(mode="after")
    def _letters_agree(self) -> Self:
        seen: dict[str, int] = {}
        for field, letter, size in self.lengths():
            if seen.setdefault(letter, size) != size:
                raise ValueError(f"{field}: dimension {letter} is {size} here and {seen[letter]} before")
        return self

    def lengths(self) -> Iterator[tuple[str, str, int]]:
        """Field, shape letter and length of all arrays, also of those in nested records."""
        specs = type(self).arrays()
        for field in type(self).model_fields:
            value = getattr(self, field)
            if isinstance(value, Record):
                yield from ((f"{field}.{name}", letter, size) for name, letter, size in value.lengths())
            elif field in specs and (dims := specs[field].dims) is not None:
                for letter, size in zip(dims, value.shape, strict=True):
                    if isinstance(letter, str):
                        yield field, letter, size
