"""What every record is made of: strict fields, and arrays of declared dtype and shape."""

from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, Self, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_.-]+$")]
Text = Annotated[str, Field(max_length=4096)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
Role = Literal["router", "learner", "actor", "evaluator"]
Count = Annotated[int, Field(ge=0, lt=2**53)]

ARRAYS_FIT = object()  # as the context of a validation: who made the arrays has seen to it that they are as declared


@dataclass(frozen=True)
class Array:
    """Declares an array field: its dtype and one letter (or number) a dimension; equal letters are equal lengths."""

    dtype: str
    dims: tuple[str | int, ...] | None = None  # None: any shape

    def __get_pydantic_core_schema__(self, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        if self.dims is None:
            return core_schema.no_info_plain_validator_function(self.check)
        return core_schema.any_schema()  # its record looks at all of them at once

    def check(self, value: Any, where: str = "") -> NDArray[Any]:
        """The array, if all but the lengths of its dimensions is as declared.

        Raises:
            ValueError: it is not; the text begins with `where`.
        """
        if not isinstance(value, np.ndarray):
            raise ValueError(f"{where}wants an array, got {type(value).__name__}")  # noqa: TRY004  (pydantic's wish)
        if value.dtype != self.dtype:
            raise ValueError(f"{where}wants dtype {self.dtype}, got {value.dtype}")
        if self.dims is not None and value.ndim != len(self.dims):
            raise ValueError(f"{where}wants {len(self.dims)} dimensions, got shape {value.shape}")
        if has_infinities(value):
            raise ValueError(f"{where}has non-finite numbers")
        return value


def has_infinities(numbers: NDArray[Any]) -> bool:
    """Some of these are infinite, or no numbers at all."""
    if numbers.dtype.kind != "f" or not numbers.size:
        return False
    return b"\0" in np.isfinite(numbers).tobytes()  # a third of the time of `all`


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

    @classmethod
    def made(cls, **values: Any) -> Self:
        """A record of what this process itself made, for a part of the time: only its arrays are looked at.

        Args:
            values: all fields, in their order.

        Raises:
            ValueError: an array is not as declared.
        """
        record = cls.__new__(cls)
        assign = object.__setattr__  # the class is frozen
        assign(record, "__dict__", values)
        assign(record, "__pydantic_fields_set__", set(values))
        assign(record, "__pydantic_extra__", None)
        assign(record, "__pydantic_private__", None)
        record.check_arrays()
        return record

    def model_post_init(self, context: Any, /) -> None:
        """Check what no field shows by itself; a validator would be called anew for each record around this one."""
        if context is not ARRAYS_FIT:
            self.check_arrays()
        self.check()

    def check(self) -> None:
        """Raises ValueError for fields that do not fit each other, whose arrays are as declared."""

    def check_arrays(self) -> dict[str, int]:
        """What the letters of its shapes stand for.

        Raises:
            ValueError: an array is not as declared, or two differ in what a letter stands for.
        """
        values, layout = self.__dict__, layout_of(type(self))
        lengths: dict[str, int] = {}
        for name, dtype, dims, spec in layout.arrays:
            array = values[name]
            usual = type(array) is np.ndarray and array.dtype is dtype and array.ndim == len(dims)
            if not usual or has_infinities(array):
                spec.check(array, f"{name}: ")
            for dim, length in zip(dims, array.shape, strict=True):
                if length != (lengths.setdefault(dim, length) if type(dim) is str else dim):
                    _say_where(self, "", {})
        for name, _ in layout.below:
            # It has checked itself, and is not walked through again but for the text of an error.
            if (record := values[name]) is not None:
                for letter, length in record.measured().items():
                    if lengths.setdefault(letter, length) != length:
                        _say_where(self, "", {})
        object.__setattr__(self, "lengths", lengths)
        return lengths

    def measured(self) -> dict[str, int]:
        """As `check_arrays`, unless that was called before, as it is not for what comes over the wire."""
        found: dict[str, int] | None = getattr(self, "lengths", None)
        return self.check_arrays() if found is None else found


class Layout(NamedTuple):
    """How a record is made.

    Attributes:
        arrays: the array fields: name, dtype, dimensions, and what declares them.
        below: fields that are records or None, and how these are made.
        letters: of the dimensions of its own arrays.
    """

    arrays: list[tuple[str, np.dtype[Any], tuple[str | int, ...], Array]]
    below: list[tuple[str, "Layout"]]
    letters: frozenset[str]


@cache
def layout_of(record_type: type[Record]) -> Layout:
    """How a record is made."""
    specs = record_type.arrays().items()
    arrays = [(name, np.dtype(spec.dtype), spec.dims, spec) for name, spec in specs if spec.dims is not None]
    records = {name: _record_in(info.annotation) for name, info in record_type.model_fields.items()}
    below = [(name, layout_of(found)) for name, found in records.items() if found is not None]
    letters = frozenset(dim for _, _, dims, _ in arrays for dim in dims if isinstance(dim, str))
    return Layout(arrays, below, letters)


def _record_in(annotation: Any) -> type[Record] | None:
    """The only record that a field may be, if it may be nothing else but None."""
    choices = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    found = [choice for choice in choices if isinstance(choice, type) and issubclass(choice, Record)]
    return found[0] if len(found) == 1 else None


def _say_where(record: Record, path: str, seen: dict[str, int]) -> None:
    """Raises ValueError for the first dimension, in the order of the fields, that is not what its letter was before."""
    for field in type(record).model_fields:
        value = getattr(record, field)
        if isinstance(value, Record):
            _say_where(value, f"{path}{field}.", seen)
            continue
        spec = record.arrays().get(field)
        for at, letter in enumerate(spec.dims or () if spec else ()):
            size = value.shape[at]
            if isinstance(letter, int) and size != letter:
                raise ValueError(f"{path}{field}: wants shape {spec and spec.dims}, got {value.shape}")
            if isinstance(letter, str) and seen.setdefault(letter, size) != size:
                raise ValueError(f"{path}{field}: dimension {letter} is {size} here and {seen[letter]} before")
