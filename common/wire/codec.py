"""Every byte on the wire: msgpack, with the schema's name and version outside the body, in Zenoh's encoding.

Arrays travel as raw little-endian bytes with dtype and shape. Those of float32 that are mostly zeros, as observations
are, travel as a map of bits, one a number, and the numbers that are not zero; minus zero counts as a number, so they
too come back to the bit. Decoding is strict: whatever is not exactly a valid message of the expected schema is
`Refused`, with a reason that names what is wrong; it never raises anything else.
"""

import math
from typing import Any, TypeVar

import numpy as np
from msgpack import ExtType

# flatland-rl patches `msgpack.packb` and `unpackb` for the whole process on import; the patched ones unpickle
# what a message asks them to. The compiled module stays as it was made.
from msgpack._cmsgpack import Packer, unpackb
from numpy.typing import NDArray
from pydantic import ValidationError

from common.records.base import Record

R = TypeVar("R", bound=Record)

SCHEMA_VERSION = 3  # 3: fragments hold their lease and their course; raise it when a record changes in any way
MAX_MESSAGE_BYTES = 300_000_000
MAX_ARRAY_BYTES = 4_000_000_000  # of one array in memory: a message of zeros is a thirtieth of what it unpacks to
ARRAY_TYPE, SPARSE_TYPE = 1, 2
SPARSE_FROM = 64  # numbers; what is smaller is not worth a second look
ARRAY_DTYPES = {name: np.dtype(name) for name in ("|i1", "<i4", "<i8", "<f4", "<f8")}


class Refused(ValueError):  # noqa: N818  (a verdict, not a failure of ours)
    """A message that is not taken; the text says why."""


def encoding_of(record_type: type[Record]) -> str:
    """The Zenoh encoding that announces a message.

    >>> from common.records.acting import Lease
    >>> encoding_of(Lease)
    'application/msgpack;railctl.Lease.3'
    """
    return f"application/msgpack;railctl.{record_type.__name__}.{SCHEMA_VERSION}"


def encode(record: Record) -> bytes:
    """The body of a message.

    Raises:
        ValueError: the message is larger than any receiver would take.
    """
    body = Packer(default=_plain).pack(record)
    if len(body) > MAX_MESSAGE_BYTES:
        raise ValueError(f"a {type(record).__name__} of {len(body)} bytes exceeds the limit of {MAX_MESSAGE_BYTES}")
    return bytes(body)


def decode(record_type: type[R], encoding: str, body: bytes) -> R:
    """The message in `body`.

    Raises:
        Refused: wrong schema or version, oversize, not msgpack, unknown or missing field, wrong type, wrong shape,
            non-finite number.
    """
    expected = encoding_of(record_type)
    if encoding != expected:
        raise Refused(f"schema is {encoding[:100]!r}, this process speaks {expected!r}")
    if len(body) > MAX_MESSAGE_BYTES:
        raise Refused(f"{len(body)} bytes exceed the limit of {MAX_MESSAGE_BYTES}")
    try:
        return record_type.model_validate(unpack(body))
    except Refused:
        raise
    except ValidationError as error:
        problem = error.errors()[0]
        field = ".".join(str(part) for part in problem["loc"]) or "message"
        raise Refused(f"{record_type.__name__}: {field:.100}: {problem['msg']:.300}") from None
    except Exception as error:  # noqa: BLE001
        # msgpack's C parser raises a family of unrelated exceptions on hostile bytes.
        raise Refused(f"{record_type.__name__}: not a message: {type(error).__name__}: {error!s:.300}") from None


def unpack(body: bytes) -> Any:
    """What is in a message, of whatever record: plain values and arrays.

    Raises:
        Exception: a whole family of them on hostile bytes; use `decode` for what comes from elsewhere.
    """
    return unpackb(body, ext_hook=_unpack_array, strict_map_key=True)


def _plain(value: Any) -> Any:
    """What msgpack does not know, as what it does: a record is the mapping of its fields."""
    if isinstance(value, Record):
        values = value.__dict__
        return {alias: values[name] for name, alias in value.names().items()}
    return _pack_array(value)


def _pack_array(value: Any) -> ExtType:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"cannot send a {type(value).__name__}")
    dtype = value.dtype.str
    if dtype not in ARRAY_DTYPES:
        value = value.astype(value.dtype.newbyteorder("<"))
        dtype = value.dtype.str
        if dtype not in ARRAY_DTYPES:
            raise TypeError(f"cannot send an array of {value.dtype}")
    if dtype == "<f4" and value.size >= SPARSE_FROM:
        numbers = np.ascontiguousarray(value).reshape(-1).view(np.uint32)
        used = numbers != 0
        if 2 * np.count_nonzero(used) < value.size:
            parts = [value.shape, np.packbits(used).tobytes(), numbers[used].tobytes()]
            return ExtType(SPARSE_TYPE, Packer().pack(parts))
    return ExtType(ARRAY_TYPE, Packer().pack([dtype, value.shape, value.tobytes()]))


def _unpack_array(code: int, data: bytes) -> NDArray[Any]:
    if code == SPARSE_TYPE:
        return _unpack_sparse(data)
    if code != ARRAY_TYPE:
        raise Refused(f"unknown extension type {code}")
    dtype, shape, raw = unpackb(data)
    if dtype not in ARRAY_DTYPES:
        raise Refused(f"array dtype {dtype!r:.40} is not taken")
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
    for size in shape:
        if type(size) is not int or not 0 <= size < 2**31:
            raise Refused(f"array shape {shape!r:.80} is not taken")
    if type(shape) is not list or len(shape) > 8:
        raise Refused(f"array shape {shape!r:.80} is not taken")
