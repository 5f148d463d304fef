"""Pickles and msgpack as plain data: nothing in a file is ever called.

A pickle may name any function to be called with anything. Here every name becomes a `Stub` that remembers what it was
given, and the few that stand for numbers are read out of their stubs (`number`). Hostile files are refused in time and
memory of the order of their size.
"""

import io
import pickle
import re
import struct
from collections.abc import Callable
from fractions import Fraction
from typing import Any, ClassVar, Self

# flatland-rl patches `msgpack.unpackb` for the whole process on import: the patched one unpickles what it is asked to.
from msgpack._cmsgpack import unpackb

MOST_ITEMS = 20_000  # of a container in a msgpack file: one that is announced takes memory before it is there
DEEPEST_KEY = 4  # tuples in each other, as keys
FRACTION = re.compile(r"^(-?\d{1,18})(?:/(\d{1,18}))?$")
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

    @property
    def is_called(self) -> str:
        """The name of the class alone."""
        return self.name.rpartition(".")[2]


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
            *pickle.BYTEARRAY8,
            *pickle.NEXT_BUFFER,
            *pickle.READONLY_BUFFER,
        }
    }

    def find_class(self, module: str, name: str) -> type[Stub]:
        return type("Stub", (Stub,), {"name": f"{module}.{name}"})


def _checked(opcode: bytes, keys: Callable[[Any], Any]) -> None:
    """Have an opcode that hashes things look at them first."""
    original = pickle._Unpickler.dispatch[opcode[0]]  # noqa: SLF001

    def load(self: Any) -> None:
        for key in keys(self):
            if not _is_flat(key, DEEPEST_KEY):
                raise NotPlainError("a key that is no plain value")
        original(self)

    _Reader.dispatch[opcode[0]] = load


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
    return _Reader(io.BytesIO(data)).load()


def unpacked(data: bytes) -> Any:
    """What msgpack holds; arrays are tuples. Raises anything if it is broken."""
    return unpackb(
        data,
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
        fields = {_text(key): part for key, part in value.items()}
        if not fields.get("nd", True):
            return _decoded(_text(fields.get("type")), _bytes(fields.get("data")))
    if isinstance(value, Stub):
        if value.is_called == "Fraction" and len(value.arguments) == 1:
            return _fraction(value.arguments[0])
        if value.is_called == "scalar" and len(value.arguments) == 2:
            kind, data = value.arguments
            return _decoded(_kind(kind), data)
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


def _fraction(text: Any) -> Fraction:
    match = FRACTION.match(text) if isinstance(text, str) else None
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
