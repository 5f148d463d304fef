"""Records with arrays on the wire: plain fields, what the letters of shapes stand for, and a block of each dtype.

A block is the numbers of all arrays of its dtype, one array after the other. So no message can hold arrays of a wrong
dtype or of shapes that disagree, and of a dozen arrays none is packed or looked at by itself. What counts here is that
little code runs: training empties the processor's caches between two messages, and what is not in them is slow.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.records.base import Layout, Record, has_infinities, layout_of
from common.wire.arrays import SPARSE_FROM, Refused, pack_sparse

DType = np.dtype[Any]


@cache
def dtypes_of(record_type: type[Record]) -> list[DType]:
    """Those of a record's arrays, here and below, in the order of their blocks; none without arrays."""
    return sorted(_dtypes(layout_of(record_type)), key=str)


def _dtypes(layout: Layout) -> set[DType]:
    return {dtype for _, dtype, *_ in layout.arrays}.union(*(_dtypes(below) for _, below in layout.below))


def take_apart(record: Record) -> list[Any]:
    """Fields, lengths and blocks of a record, all of which msgpack knows."""
    parts: dict[DType, list[bytes]] = {dtype: [] for dtype in dtypes_of(type(record))}
    fields = _fields(record, layout_of(type(record)), parts)
    return [fields, record.measured(), *[_block(dtype, b"".join(arrays)) for dtype, arrays in parts.items()]]


def _fields(record: Record, layout: Layout, parts: dict[DType, list[bytes]]) -> dict[str, Any]:
    fields = record.__dict__.copy()
    for name, dtype, *_ in layout.arrays:
        parts[dtype].append(fields.pop(name).tobytes())
    for name, below in layout.below:
        if (part := fields[name]) is not None:
            fields[name] = _fields(part, below, parts)
    return fields


def _block(dtype: DType, raw: bytes) -> Any:
    if len(raw) < 4 * SPARSE_FROM or dtype != np.float32:
        return raw
    return pack_sparse(np.frombuffer(raw, np.float32)) or raw


class Whole:
    """A record put together again from what `take_apart` made of it.

    Attributes:
        fields: with arrays, and with mappings in the place of records. Only the arrays are certain to be as declared.
        finite: so are all numbers in the arrays.
    """

    __slots__ = ("_at", "_lengths", "_letters", "_numbers", "fields", "finite")

    def __init__(self, record_type: type[Record], plain: Any) -> None:
        """`plain` is what msgpack has unpacked.

        Raises:
            Refused: these are no fields, lengths and blocks, or they do not fit each other.
        """
        dtypes = dtypes_of(record_type)
        if type(plain) is not list or len(plain) != 2 + len(dtypes) or type(plain[1]) is not dict:
            raise Refused(f"{record_type.__name__}: wants fields, lengths and {len(dtypes)} blocks")
        self.fields, self._lengths, *blocks = plain
        for letter, length in self._lengths.items():
            if type(length) is not int or not 0 <= length < 2**31:
                raise Refused(f"{record_type.__name__}: length {letter:.40} is {length!r:.40}")
        self.finite = True
        self._at = dict.fromkeys(dtypes, 0)
        self._numbers = {}
        for dtype, block in zip(dtypes, blocks, strict=True):
            numbers = self._numbers[dtype] = _numbers(dtype, block)
            if dtype.kind == "f" and has_infinities(numbers):
                self.finite = False
        self._letters: set[str] = set()
        self._fill(f"{record_type.__name__}: ", self.fields, layout_of(record_type))

    def check_all_is_used(self) -> None:
        """Raises Refused for lengths or numbers that no array wants; only then, to name the field if one is missing."""
        if self._letters != self._lengths.keys():
            raise Refused(f"lengths of {sorted(self._lengths)!s:.80} for shapes of {sorted(self._letters)}")
        for dtype, numbers in self._numbers.items():
            if self._at[dtype] != numbers.nbytes:
                raise Refused(f"has more numbers of {dtype} than its arrays")

    def _fill(self, path: str, fields: Any, layout: Layout) -> None:
        if type(fields) is not dict:
            return  # nothing, or what nobody will take for a record
        self._letters |= layout.letters
        for name, dtype, dims, _ in layout.arrays:
            shape = [self._lengths.get(dim, dim) for dim in dims]
            at = self._at[dtype]
            try:
                array: NDArray[Any] = np.ndarray(shape, dtype, self._numbers[dtype], at)
            except (TypeError, ValueError) as problem:
                raise Refused(f"{path}{name}: no shape is {shape}: {problem!s:.100}") from None
            self._at[dtype] = at + array.nbytes
            if fields.setdefault(name, array) is not array:
                raise Refused(f"{path}{name}: is not in a block")
        for name, below in layout.below:
            self._fill(f"{path}{name}.", fields.get(name), below)


def _numbers(dtype: DType, block: Any) -> NDArray[Any]:
    if type(block) is bytes:
        return np.frombuffer(bytearray(block), dtype)
    if type(block) is np.ndarray and block.dtype == dtype and block.ndim == 1:  # was sparse
        return block
    raise Refused(f"{block!r:.40} is no block of {dtype}")
