"""What every record is made of: strict fields, and arrays of declared dtype and shape."""

from dataclasses import dataclass
from functools import cache, cached_property
from types import UnionType
from typing import Annotated, Any, Literal, Self, Union, get_args, get_origin

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

    A shape letter stands for one length, also in the records that this one is made of: `lengths`.
    """

    __slots__ = ("lengths",)

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
        # What is below has checked itself, and is not walked through again but for the text of an error.
        lengths: dict[str, int] = {}
        own, below = _letters(type(self))
        values = self.__dict__
        for field, lettered in own:
            shape = values[field].shape
            for at, letter in lettered:
                if lengths.setdefault(letter, shape[at]) != shape[at]:
                    _say_where(self, "", {})
        for field in below:
            record = values[field]
            for letter, length in () if record is None else record.lengths.items():
                if lengths.setdefault(letter, length) != length:
                    _say_where(self, "", {})
        object.__setattr__(self, "lengths", lengths)
        return self


@cache
def _letters(record_type: type[Record]) -> tuple[list[tuple[str, list[tuple[int, str]]]], list[str]]:
    """The array fields with those of their dimensions that have a letter, and the fields that are records or None."""
    own = [
        (name, [(at, letter) for at, letter in enumerate(spec.dims or ()) if isinstance(letter, str)])
        for name, spec in record_type.arrays().items()
    ]
    below = [name for name, info in record_type.model_fields.items() if _is_record(info.annotation)]
    return [(name, lettered) for name, lettered in own if lettered], below


def _is_record(annotation: Any) -> bool:
    choices = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    return any(isinstance(choice, type) and issubclass(choice, Record) for choice in choices)


def _say_where(record: Record, path: str, seen: dict[str, int]) -> None:
    """Raises ValueError for the first dimension, in the order of the fields, that is not what its letter was before."""
    for field in type(record).model_fields:
        value = getattr(record, field)
        if isinstance(value, Record):
            _say_where(value, f"{path}{field}.", seen)
            continue
        spec = record.arrays().get(field)
        for at, letter in enumerate(spec.dims or () if spec else ()):
            if isinstance(letter, str) and seen.setdefault(letter, value.shape[at]) != value.shape[at]:
                size, before = value.shape[at], seen[letter]
                raise ValueError(f"{path}{field}: dimension {letter} is {size} here and {before} before")
