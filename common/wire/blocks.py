"""Records with arrays on the wire: plain fields, what the letters of shapes stand for, and a block of each dtype.

A block is the numbers of all arrays of its dtype, one array after the other. So no message can hold arrays of a wrong
dtype or of shapes that disagree, and of a dozen arrays none is packed or looked at by itself. What counts here is that
little code runs: training empties the processor's caches between two messages, and what is not in them is slow.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from railctl.common.records.base import Layout, Record, has_infinities, layout_of
from railctl.common.wire.arrays import SPARSE_FROM, Refused, pack_sparse, shown

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
    whole = record.__dict__.copy()
    records = [(whole, layout_of(type(record)))]
    for fields, layout in records:  # which grows: first the record, then what is below
        for name, dtype, *_ in layout.arrays:
            parts[dtype].append(fields.pop(name).tobytes())
        for name, below in layout.below:
            if fields[name] is not None:
                fields[name] = fields[name].__dict__.copy()
                records.append((fields[name], below))
    return [whole, record.measured(), *[_block(dtype, b"".join(arrays)) for dtype, arrays in parts.items()]]


def _block(dtype: DType, raw: bytes) -> Any:
    if len(raw) < 4 * SPARSE_FROM or dtype != np.float32:
        return raw
    return pack_sparse(np.frombuffer(raw, np.float32)) or raw


class Whole(NamedTuple):
    """A record put together again.

    Attributes:
        fields: with arrays, and with mappings in the place of records. Only the arrays are certain to be as declared.
        finite: so are all numbers in the arrays.
        left: what no array wants of lengths and blocks, if there is something; for who finds the fields complete.
    """

    fields: Any
    finite: bool
    left: str | None


def put_together(record_type: type[Record], plain: Any) -> Whole:
    """Undo `take_apart`.

    Raises:
        Refused: these are no fields, lengths and blocks, or they do not fit each other.
    """
    dtypes = dtypes_of(record_type)
    if type(plain) is not list or len(plain) != 2 + len(dtypes) or type(plain[1]) is not dict:
        raise Refused(f"{record_type.__name__}: wants fields, lengths and {len(dtypes)} blocks")
    whole, lengths, *blocks = plain
    for letter, length in lengths.items():
        if type(length) is not int or not 0 <= length < 2**31:
            raise Refused(f"{record_type.__name__}: length {letter:.40} is {shown(length)}")
    numbers = {dtype: _numbers(dtype, block) for dtype, block in zip(dtypes, blocks, strict=True)}
    letters: set[str] = set()
    at = dict.fromkeys(dtypes, 0)  # bytes
    records = [(whole, layout_of(record_type))]
    for fields, layout in records:  # in the order of `take_apart`
        if type(fields) is not dict:
            continue  # None, or what nobody will take for a record
        letters |= layout.letters
        for name, dtype, dims, _ in layout.arrays:
            try:
                array: NDArray[Any] = np.ndarray([*map(lengths.get, dims, dims)], dtype, numbers[dtype], at[dtype])
            except (TypeError, ValueError) as problem:
                raise Refused(
                    f"{record_type.__name__}: {name} of {dims} in {shown(lengths)}: {problem!s:.80}"
                ) from None
            at[dtype] += array.nbytes
            if fields.setdefault(name, array) is not array:
                raise Refused(f"{record_type.__name__}: {name} is not in a block")
        for name, below in layout.below:
            records.append((fields.get(name), below))
    finite = True not in map(has_infinities, numbers.values())
    return Whole(whole, finite, _left(lengths, letters, numbers, at))


def _numbers(dtype: DType, block: Any) -> NDArray[Any]:
    if type(block) is bytes:
        return np.frombuffer(bytearray(block), dtype)
    if type(block) is np.ndarray and block.dtype == dtype and block.ndim == 1:  # was sparse
        return block
    raise Refused(f"{shown(block)} is no block of {dtype}")


def _left(
    lengths: dict[str, int], letters: set[str], numbers: dict[DType, NDArray[Any]], at: dict[DType, int]
) -> str | None:
    if letters != lengths.keys():
        return f"lengths of {shown(sorted(lengths))} for shapes of {sorted(letters)}"
    for dtype, block in numbers.items():
        if at[dtype] != block.nbytes:
            return f"more numbers of {dtype} than in arrays"
    return None
