"""Every byte on the wire: msgpack, with the schema's name and version outside the body, in Zenoh's encoding.

Arrays travel as raw little-endian bytes with dtype and shape. Decoding is strict: whatever is not exactly a valid
message of the expected schema is `Refused`, with a reason that names what is wrong; it never raises anything else.
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

from common.records import Record

R = TypeVar("R", bound=Record)

SCHEMA_VERSION = 2  # 2: episodes come in fragments; raise it when a record changes in any way
MAX_MESSAGE_BYTES = 300_000_000
ARRAY_TYPE = 1
ARRAY_DTYPES = frozenset({"|i1", "<i4", "<i8", "<f4", "<f8"})


class Refused(ValueError):  # noqa: N818  (a verdict, not a failure of ours)
    """A message that is not taken; the text says why."""


def encoding_of(record_type: type[Record]) -> str:
    """The Zenoh encoding that announces a message.

    >>> from common.records import Lease
    >>> encoding_of(Lease)
    'application/msgpack;railctl.Lease.2'
    """
    return f"application/msgpack;railctl.{record_type.__name__}.{SCHEMA_VERSION}"


def encode(record: Record) -> bytes:
    """The body of a message.

    Raises:
        ValueError: the message is larger than any receiver would take.
    """
    body = Packer(default=_pack_array).pack(record.model_dump(by_alias=True))
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
        plain = unpackb(body, ext_hook=_unpack_array, strict_map_key=True)
        return record_type.model_validate(plain)
    except Refused:
        raise
    except ValidationError as error:
        problem = error.errors()[0]
        field = ".".join(str(part) for part in problem["loc"]) or "message"
        raise Refused(f"{record_type.__name__}: {field:.100}: {problem['msg']:.300}") from None
    except Exception as error:  # noqa: BLE001
        # msgpack's C parser raises a family of unrelated exceptions on hostile bytes.
        raise Refused(f"{record_type.__name__}: not a message: {type(error).__name__}: {error!s:.300}") from None


def _pack_array(value: Any) -> ExtType:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"cannot send a {type(value).__name__}")
    little = np.ascontiguousarray(value).astype(value.dtype.newbyteorder("<"), copy=False).reshape(value.shape)
    if little.dtype.str not in ARRAY_DTYPES:
        raise TypeError(f"cannot send an array of {value.dtype}")
    return ExtType(ARRAY_TYPE, Packer().pack([little.dtype.str, list(value.shape), little.tobytes()]))


def _unpack_array(code: int, data: bytes) -> NDArray[Any]:
    if code != ARRAY_TYPE:
        raise Refused(f"unknown extension type {code}")
    dtype, shape, raw = unpackb(data)
    if dtype not in ARRAY_DTYPES:
        raise Refused(f"array dtype {dtype!r:.40} is not taken")
    if not all(type(size) is int and 0 <= size < 2**31 for size in shape) or len(shape) > 8:
        raise Refused(f"array shape {shape!r:.80} is not taken")
    if len(raw) != math.prod(shape) * np.dtype(dtype).itemsize:
        raise Refused(f"array of shape {tuple(shape)} and dtype {dtype} has {len(raw)} bytes")
    return np.frombuffer(raw, dtype).reshape(shape).copy()
