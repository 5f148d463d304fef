"""Every byte on the wire: msgpack, with the schema's name and version outside the body, in Zenoh's encoding.

A record travels as the mapping of its fields; with arrays of declared shapes, as `common.wire.blocks` says. Decoding is
strict: whatever is not exactly a valid message of the expected schema is `Refused`, with a reason that names what is
wrong; it never raises anything else.
"""

from functools import cache
from typing import Any, TypeVar

# flatland-rl patches `msgpack.packb` and `unpackb` for the whole process on import; the patched ones unpickle
# what a message asks them to. The compiled module stays as it was made.
from msgpack._cmsgpack import Packer, unpackb
from pydantic import ValidationError

from railctl.common.records.base import ARRAYS_FIT, Record
from railctl.common.wire.arrays import ROOM, Refused, pack_array, unpack_array
from railctl.common.wire.blocks import dtypes_of, put_together, take_apart

__all__ = ["Refused", "decode", "encode", "encoding_of", "unpack"]

R = TypeVar("R", bound=Record)

SCHEMA_VERSION = 7  # 7: episodes say how stale their weights were; raise it when a record changes in any way
MAX_MESSAGE_BYTES = 300_000_000
MOST_PROBLEMS = 100


@cache
def encoding_of(record_type: type[Record]) -> str:
    """The Zenoh encoding that announces a message.

    >>> from railctl.common.records.acting import Lease
    >>> encoding_of(Lease)
    'application/msgpack;railctl.Lease.7'
    """
    return f"application/msgpack;railctl.{record_type.__name__}.{SCHEMA_VERSION}"


def encode(record: Record) -> bytes:
    """The body of a message.

    Raises:
        ValueError: the message is larger than any receiver would take.
    """
    plain = take_apart(record) if dtypes_of(type(record)) else record
    body: bytes = Packer(default=_plain, buf_size=ROOM).pack(plain)
    if len(body) > MAX_MESSAGE_BYTES:
        raise ValueError(f"a {type(record).__name__} of {len(body)} bytes exceeds the limit of {MAX_MESSAGE_BYTES}")
    return body


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
        return _record(record_type, unpack(body))
    except Refused:
        raise
    except ValidationError as error:
        if error.error_count() > MOST_PROBLEMS:  # to list them all would take long
            raise Refused(f"{record_type.__name__}: {error.error_count()} fields are not as declared") from None
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
    return unpackb(body, ext_hook=unpack_array, strict_map_key=True)


def _record(record_type: type[R], plain: Any) -> R:
    if not dtypes_of(record_type):
        return record_type.model_validate(plain)
    fields, finite, left = put_together(record_type, plain)
    validator = record_type.__pydantic_validator__  # `model_validate` asks first how it is to call this
    record: R = validator.validate_python(fields, context=ARRAYS_FIT if finite else None)
    if left is not None:
        raise Refused(f"{record_type.__name__}: {left}")
    return record


def _plain(value: Any) -> Any:
    """What msgpack does not know, as what it does."""
    if isinstance(value, Record):
        values = value.__dict__
        return {alias: values[name] for name, alias in value.names().items()}
    return pack_array(value)
