"""Pickles and msgpack as plain data: nothing in a file is ever called.

A pickle may name any function to be called with anything. Here every name becomes a `Stub` that remembers what it was
given, and the few that stand for numbers are read out of their stubs (`number`). Hostile files are refused in time and
memory of the order of their size.
"""

import io
import math
import pickle
import re
import struct
from collections.abc import Callable
from fractions import Fraction
from typing import Any, ClassVar, Self

import numpy as np

# flatland-rl patches `msgpack.unpackb` for the whole process on import: the patched one unpickles what it is asked to.
from msgpack._cmsgpack import unpackb
from numpy.typing import NDArray

MOST_BYTES = 256_000_000  # of a file
MOST_ITEMS = 10_000  # of a container in a msgpack file: one that is announced takes memory before it is there
MOST_PARTS = 3_000_000  # that a file is made of: some take a hundred times the memory of their byte in the file
MOST_NAMES = 1000  # of classes
MOST_FIELDS = 8  # of a dictionary that stands for a number or an array
DEEPEST_KEY = 4  # tuples in each other, as keys
FRACTION = re.compile(r"(-?[0-9]{1,18})(?:/([0-9]{1,18}))?")
NUMBERS = {  # numpy's types, as struct reads them
    "i1": "b",
    "i2": "h",
    "i4": "i",
    "i8": "q",
    "u1": "B",
    "u2": "H",
    "u4": "I",
    "u8": "Q",
    "f4": "f",
    "f8": "d",
    "b1": "?",
}


class NotPlainError(ValueError):
    """Something is not what it should be."""


class Stub:
    """Stands for an object of a class that is not looked up.

    Attributes:
        name: module and name of the class.
        arguments: what it was made of.
        state: what was to be put into it.
    """

    name: ClassVar[str] = ""
    arguments: tuple[Any, ...]
    state: Any = None

    def __new__(cls, *arguments: Any, **_options: Any) -> Self:
        """Pickles make objects without calling `__init__`."""
        stub = super().__new__(cls)
        stub.arguments = arguments
        return stub

    def __setstate__(self, state: Any) -> None:
        """Remember it."""
        self.state = state

    def append(self, _item: Any) -> None:
        """Nobody asks for it: what an object of a kind of list holds."""

    def __setitem__(self, _key: Any, _value: Any) -> None:
        """Nobody asks for it: what an object of a kind of dictionary holds."""

    @property
    def is_called(self) -> str:
        """The name of the class alone."""
        return self.name.rpartition(".")[2]


class _Countdown(dict[int, Callable[[Any], None]]):
    """What to do for each code of a pickle, so many times in all."""

    def __init__(self, dispatch: dict[int, Callable[[Any], None]]) -> None:
        super().__init__(dispatch)
        self._left = MOST_PARTS

    def __getitem__(self, code: int) -> Callable[[Any], None]:
        self._left -= 1
        if self._left < 0:
            raise NotPlainError("a pickle of too many parts")
        return super().__getitem__(code)


class _Reader(pickle._Unpickler):  # noqa: SLF001
    """The interpreter's own reader in Python, whose memo grows with the file, not with what the file says."""

    dispatch = {  # noqa: RUF012  (as the class that it extends has it)
        code: method
        for code, method in pickle._Unpickler.dispatch.items()  # noqa: SLF001
        if code
        not in {
            *pickle.PERSID,
            *pickle.BINPERSID,
            *pickle.EXT1,
            *pickle.EXT2,
            *pickle.EXT4,
            *pickle.INST,
            *pickle.OBJ,
            *pickle.DICT,
            *pickle.NEXT_BUFFER,
            *pickle.READONLY_BUFFER,
        }
    }

    def __init__(self, data: bytes) -> None:
        super().__init__(io.BytesIO(data))
        self.dispatch = _Countdown(self.dispatch)  # type: ignore[misc]
        self._classes: dict[str, type[Stub]] = {}

    def find_class(self, module: str, name: str) -> type[Stub]:
        called = f"{module}.{name}"
        if called not in self._classes:
            if len(self._classes) >= MOST_NAMES:
                raise NotPlainError("a pickle of too many classes")
            self._classes[called] = type("Stub", (Stub,), {"name": called})
        return self._classes[called]


def _checked(opcode: bytes, keys: Callable[[Any], Any]) -> None:
    """Have an opcode that hashes things look at them first."""
    original = pickle._Unpickler.dispatch[opcode[0]]  # noqa: SLF001

    def load(self: Any) -> None:
        for key in keys(self):
            if not _is_flat(key, DEEPEST_KEY):
                raise NotPlainError("a key that is no plain value")
        original(self)

    _Reader.dispatch[opcode[0]] = load


def _read_byte_array(self: Any) -> None:
    """As bytes of what is there: the original takes the memory that is announced."""
    (length,) = struct.unpack("<Q", self.read(8))
    if length > MOST_BYTES:
        raise NotPlainError("an array that is too long")
    self.append(self.read(length))


_Reader.dispatch[pickle.BYTEARRAY8[0]] = _read_byte_array
_checked(pickle.SETITEM, lambda self: self.stack[-2:-1])
_checked(pickle.SETITEMS, lambda self: self.stack[::2])
_checked(pickle.ADDITEMS, lambda self: self.stack)
_checked(pickle.FROZENSET, lambda self: self.stack)


def _is_flat(value: Any, depth: int) -> bool:
    if isinstance(value, tuple):
        return depth > 0 and len(value) <= DEEPEST_KEY and all(_is_flat(part, depth - 1) for part in value)
    return value is None or isinstance(value, str | bytes | int | float | Stub)


def unpickled(data: bytes) -> Any:
    """What a pickle holds, with stubs for all objects; raises anything if it is broken."""
    return _Reader(data).load()


def unpacked(data: bytes) -> Any:
    """What msgpack holds; arrays are tuples. Raises anything if it is broken."""
    left = MOST_PARTS

    def count(container: Any) -> Any:
        nonlocal left
        left -= 1 + len(container)
        if left < 0:
            raise NotPlainError("a file of too many parts")
        return container

    return unpackb(
        data,
        list_hook=count,
        object_hook=count,
        use_list=False,
        raw=False,
        unicode_errors="surrogateescape",  # of numpy's bytes, which old writers took for text
        strict_map_key=False,
        max_array_len=MOST_ITEMS,
        max_map_len=MOST_ITEMS,
    )


def number(value: Any) -> int | float | Fraction:
    """A number, however it was written.

    Raises:
        NotPlainError: it is none.
    """
    if isinstance(value, bool | int | float | Fraction):
        return int(value) if isinstance(value, bool) else value
    if isinstance(value, dict):  # numpy's, by msgpack-numpy
        fields = _fields(value)
        if not fields.get("nd", True):
            return _decoded(_text(fields.get("type")), _bytes(fields.get("data")))
    if isinstance(value, Stub):
        if value.is_called == "Fraction":
            return _fraction(value.arguments)
        if value.is_called == "scalar" and len(value.arguments) == 2:
            kind, data = value.arguments
            return _decoded(_kind(kind), _latin(data))
        if len(value.arguments) == 1 and isinstance(value.arguments[0], int):  # an enum's member
            return int(value.arguments[0])
    raise NotPlainError("something is no number")


def whole(value: Any, least: int = -(2**31), most: int = 2**63 - 1) -> int:
    """A whole number within bounds.

    Raises:
        NotPlainError: it is none.
    """
    found = number(value)
    if found != int(found) or not least <= found <= most:
        raise NotPlainError("a number is not whole or too large")
    return int(found)


def sequence(value: Any, most: int) -> list[Any]:
    """The items of a list, a tuple, or a set of a pickle, of so many at most.

    Raises:
        NotPlainError: it is none.
    """
    if isinstance(value, Stub) and value.is_called in {"set", "frozenset"} and len(value.arguments) == 1:
        value = value.arguments[0]
    if not isinstance(value, list | tuple | set | frozenset) or len(value) > most:
        raise NotPlainError("something is no list, or too long")
    return list(value)


def table(value: Any, most: int) -> NDArray[Any] | None:
    """Numpy's array of whole numbers with two dimensions, however it was written; None if it is no array of numpy's.

    Raises:
        NotPlainError: it is damaged, of another kind, or has more items.
    """
    if isinstance(value, dict):  # by msgpack-numpy
        fields = _fields(value)
        form = _text(fields.get("type")), fields.get("shape"), _bytes(fields.get("data")), False
    elif isinstance(value, Stub) and value.is_called == "_reconstruct" and isinstance(value.state, tuple):
        _version, shape, dtype, by_columns, data = value.state
        form = _kind(dtype), shape, _latin(data), by_columns
    elif isinstance(value, Stub) and value.is_called == "_frombuffer":  # of protocol 5
        data, dtype, shape, order = value.arguments
        form = _kind(dtype), shape, data, order == "F"
    else:
        return None
    kind, shape, data, by_columns = form
    height, width = (whole(side, 0, most) for side in sequence(shape, 2))
    code = kind.lstrip("<>=|")
    if code not in NUMBERS or code[0] not in "iu" or not isinstance(data, bytes) or height * width > most:
        raise NotPlainError("an array of another kind")
    dtype = np.dtype(kind)
    if len(data) != math.prod((height, width, dtype.itemsize)):
        raise NotPlainError("an array of another length than its shape")
    return np.frombuffer(data, dtype).reshape((height, width), order="F" if by_columns else "C")


def _fields(value: dict[Any, Any]) -> dict[str, Any]:
    if len(value) > MOST_FIELDS:
        raise NotPlainError("a dictionary that stands for no number")
    return {_text(key): part for key, part in value.items()}


def _latin(data: Any) -> Any:
    """Bytes that pickles of the first protocols write as text."""
    if isinstance(data, Stub) and data.is_called == "encode" and isinstance(data.arguments[0], str):
        return data.arguments[0].encode("latin-1")
    return data


def _fraction(arguments: tuple[Any, ...]) -> Fraction:
    """Of its text, or since Python 3.12 of its two numbers."""
    text = "/".join(map(str, arguments)) if all(type(part) is int for part in arguments[:2]) else arguments[0]
    match = FRACTION.fullmatch(text) if isinstance(text, str) and len(arguments) <= 2 else None
    if match is None or (match[2] is not None and int(match[2]) == 0):
        raise NotPlainError("a fraction that is none")
    return Fraction(int(match[1]), int(match[2] or 1))


def _kind(dtype: Any) -> str:
    """Numpy's name of a type with its byte order, out of the stub of a dtype."""
    if not isinstance(dtype, Stub) or dtype.is_called != "dtype" or not dtype.arguments:
        raise NotPlainError("a number of no known type")
    order = dtype.state[1] if isinstance(dtype.state, tuple) and len(dtype.state) > 1 else "<"
    return f"{order}{_text(dtype.arguments[0])}"


def _decoded(kind: str, data: Any) -> int | float:
    code = NUMBERS.get(kind.lstrip("<>=|"))
    if code is None or not isinstance(data, bytes):
        raise NotPlainError("a number of no known type")
    form = (">" if kind.startswith(">") else "<") + code
    if len(data) != struct.calcsize(form):
        raise NotPlainError("a number of another length than its type")
    found: int | float = struct.unpack(form, data)[0]
    return int(found) if isinstance(found, bool) else found


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else value if isinstance(value, str) else ""


def _bytes(value: Any) -> Any:
    return value.encode("utf-8", "surrogateescape") if isinstance(value, str) else value
