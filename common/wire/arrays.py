"""Arrays on the wire: dtype, shape and raw little-endian bytes, or, where most numbers are zero, those that are not."""

import math
from reprlib import Repr
from typing import Any

import numpy as np
from msgpack import ExtType

# flatland-rl patches `msgpack.packb` and `unpackb` for the whole process on import; the patched ones unpickle
# what a message asks them to. The compiled module stays as it was made.
from msgpack._cmsgpack import Packer, unpackb
from numpy.typing import NDArray

MAX_ARRAY_BYTES = 4_000_000_000  # of one array in memory: a message of zeros is a thirtieth of what it unpacks to
ARRAY_TYPE, SPARSE_TYPE = 1, 2
SPARSE_FROM = 1 << 13  # numbers; to look for the zeros in what is smaller costs more than to send them
ARRAY_DTYPES = {name: np.dtype(name) for name in ("|i1", "|u1", "<i4", "<i8", "<f4", "<f8")}
ROOM = 1 << 14  # bytes that packing begins with; msgpack's own 256 KB come from the system, and go back, each time


repr_of = Repr()  # looks at a few elements only
repr_of.maxlist = repr_of.maxdict = 9


class Refused(ValueError):  # noqa: N818  (a verdict, not a failure of ours)
    """A message that is not taken; the text says why."""


def shown(value: Any) -> str:
    """The beginning of what somebody sent, however large it is."""
    return f"{repr_of.repr(value):.80}"


def pack_array(value: Any) -> ExtType:
    """An array as msgpack takes it.

    Raises:
        TypeError: this is no array, or one of numbers that are not sent.
    """
    if not isinstance(value, np.ndarray):
        raise TypeError(f"cannot send a {type(value).__name__}")
    dtype = value.dtype.str
    if dtype not in ARRAY_DTYPES:
        value = value.astype(value.dtype.newbyteorder("<"))
        dtype = value.dtype.str
        if dtype not in ARRAY_DTYPES:
            raise TypeError(f"cannot send an array of {value.dtype}")
    if dtype == "<f4" and value.size >= SPARSE_FROM and (sparse := pack_sparse(value)) is not None:
        return sparse
    return _extension(ARRAY_TYPE, dtype, value.shape, value.tobytes())


def pack_sparse(value: NDArray[np.float32]) -> ExtType | None:
    """An array that is mostly zeros, as a map of bits and the other numbers; None for any other array.

    Minus zero counts as a number, so that it too comes back to the bit.
    """
    numbers = value.reshape(-1).view(np.uint32)
    used = numbers.astype(np.bool_)
    others = numbers[used]
    if 2 * len(others) >= len(numbers):
        return None
    return _extension(SPARSE_TYPE, value.shape, np.packbits(used).tobytes(), others.tobytes())


def _extension(code: int, *parts: Any) -> ExtType:
    return ExtType(code, Packer(buf_size=ROOM).pack(parts))


def unpack_array(code: int, data: bytes) -> NDArray[Any]:
    """Undo `pack_array`.

    Raises:
        Refused: this is no array of ours.
        Exception: a whole family of them on hostile bytes.
    """
    if code == SPARSE_TYPE:
        return _unpack_sparse(data)
    if code != ARRAY_TYPE:
        raise Refused(f"unknown extension type {code}")
    dtype, shape, raw = unpackb(data)
    if dtype not in ARRAY_DTYPES:
        raise Refused(f"array dtype {shown(dtype)} is not taken")
    known = ARRAY_DTYPES[dtype]
    _check_shape(shape)
    if type(raw) is not bytes or len(raw) != math.prod(shape) * known.itemsize:
        raise Refused(f"array of shape {tuple(shape)} and dtype {dtype} has {len(raw)} bytes")
    return np.ndarray(shape, known, bytearray(raw))


def _unpack_sparse(data: bytes) -> NDArray[np.float32]:
    shape, bits, raw = unpackb(data)
    _check_shape(shape)
    size = math.prod(shape)
    if len(bits) != -(-size // 8):
        raise Refused(f"sparse array of shape {tuple(shape)} has a map of {len(bits)} bytes")
    if 4 * size > MAX_ARRAY_BYTES:
        raise Refused(f"sparse array of shape {tuple(shape)} exceeds the limit of {MAX_ARRAY_BYTES} bytes")
    used = np.unpackbits(np.frombuffer(bits, np.uint8))
    numbers = np.frombuffer(raw, np.uint32)
    if used[size:].any() or np.count_nonzero(used) != len(numbers) or not numbers.all():
        raise Refused(f"sparse array of shape {tuple(shape)} has {len(numbers)} numbers that do not fit its map")
    dense = np.zeros(size, np.uint32)
    dense[used[:size].view(np.bool_)] = numbers
    return dense.view("<f4").reshape(shape)


def _check_shape(shape: Any) -> None:
    if type(shape) is not list or len(shape) > 8:
        raise Refused(f"array shape {shown(shape)} is not taken")
    for size in shape:
        if type(size) is not int or not 0 <= size < 2**31:
            raise Refused(f"array shape {shown(shape)} is not taken")
