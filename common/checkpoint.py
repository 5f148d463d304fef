"""Checkpoints and snapshots: named arrays and strings in one safetensors file that is whole or refused.

A digest over everything else in the file is checked on reading, so no flipped byte goes unnoticed. Equal
content has equal bytes. Files replace their predecessors atomically: a crash leaves the old one or the new
one. No torch here, and nothing that unpickles.

The library safetensors reads the files. They are written here: it would put the metadata in an order of chance,
and copy a snapshot's hundred megabytes several times.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from railctl.common.bounded import open_at_once, read_bounded
from railctl.common.whole import write_whole

FORMAT = "1"  # 1: the first
Kind = Literal["checkpoint", "snapshot"]  # weights to act with; everything that a learner goes on from
OURS = ("kind", "format", "digest")  # metadata that this module sets and checks
MOST_BYTES: dict[Kind, int] = {"checkpoint": 2_000_000_000, "snapshot": 64_000_000_000}
NO_SAFETENSORS = "not a safetensors file: it is truncated or of another program, use another one"
DTYPES = {"b": "BOOL", "i": "I", "u": "U", "f": "F"}  # numpy's kind to safetensors' name, but for the bits

Tensors = dict[str, NDArray[Any]]
Metadata = dict[str, str]


class CheckpointError(ValueError):
    """A file that cannot be used: one line that names it, what is wrong and what to do."""


def save(path: Path, tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str], kind: Kind) -> None:
    """Write a file that is on the disk, whole, when this returns; one that was there is replaced.

    Raises:
        ValueError: as `to_bytes`.
        OSError: the disk refused; a file that was there is as it was.
    """
    write_whole(path, *_parts(tensors, metadata, kind))


def load(path: Path, kind: Kind) -> tuple[Tensors, Metadata]:
    """Read a file of `kind`.

    Returns:
        The tensors, and the metadata that `save` was given, with `digest`, `kind` and `format`.

    Raises:
        CheckpointError: the file is missing, unreadable, damaged, of another kind or of another format; or it is a
            checkpoint with other numbers than finite ones of float32.
    """
    try:
        if path.exists() and not path.is_file():
            raise CheckpointError(f"{path}: is no file: check the path")  # a pipe would wait
        with open_at_once(path), safetensors.safe_open(path, "np"):
            pass  # it is one as far as its header says, so that reading all of it is worth while
        data = read_bounded(path, MOST_BYTES[kind])
    except SafetensorError:
        raise CheckpointError(f"{path}: {NO_SAFETENSORS}") from None
    except FileNotFoundError:
        raise CheckpointError(f"{path}: no such file: check the path and the run's folder") from None
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read ({error.strerror}): check the path and its rights") from None
    return from_bytes(data, kind, source=str(path))


def to_bytes(tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str], kind: Kind) -> bytes:
    """The content of a file: equal for equal arguments.

    Args:
        tensors: of any shape and layout; bool, or whole or floating numbers of at most 64 bits.
        metadata: whatever else shall come back with the tensors.
        kind: what `load` must ask for.

    Raises:
        ValueError: the metadata uses a name of ours, or safetensors has no room for a tensor's dtype.
    """
    return b"".join(_parts(tensors, metadata, kind))


def from_bytes(data: bytes, kind: Kind, source: str) -> tuple[Tensors, Metadata]:
    """Undo `to_bytes`; raises as `load`, in the name of `source`."""
    try:
        tensors = safetensors.numpy.load(data)
        metadata = _header(data).get("__metadata__", {})
    except (SafetensorError, ValueError, KeyError):  # KeyError: a dtype that numpy lacks
        raise CheckpointError(f"{source}: {NO_SAFETENSORS}") from None
    _check_metadata(metadata, kind, source)
    if metadata["digest"] != _digest(tensors, metadata):
        raise CheckpointError(f"{source}: damaged, its digest does not match its content: use another one")
    if kind == "checkpoint":
        _check_weights(tensors, source)
    return tensors, metadata


def _check_weights(tensors: Tensors, source: str) -> None:
    """Networks take float32 alone: what is wider may be finite here, and not there."""
    for name, array in tensors.items():
        if array.dtype != np.float32:
            raise CheckpointError(f"{source}: tensor {name} has dtype {array.dtype}, not float32: use another one")
        if not np.isfinite(array).all():
            raise CheckpointError(f"{source}: tensor {name} has numbers that are not finite: use another checkpoint")


def _check_metadata(metadata: Metadata, kind: Kind, source: str) -> None:
    for name in OURS:
        if name not in metadata:
            raise CheckpointError(f"{source}: metadata {name} is missing: railctl did not write it, use another")
    if metadata["format"] != FORMAT:
        want = f"this version of railctl reads format {FORMAT}, use the one that wrote it"
        raise CheckpointError(f"{source}: has format {metadata['format'][:32]!r}: {want}")
    if metadata["kind"] != kind:
        folders = " and ".join(f"{name}s/" for name in get_args(Kind))
        raise CheckpointError(f"{source}: is a {metadata['kind'][:32]!r}, not a {kind}: a run has {folders}")


def _digest(tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str]) -> str:
    """Hash of all arrays, with names, dtypes and shapes, and of all metadata but the digest itself."""
    state = hashlib.blake2b(digest_size=16)
    labels = {name: value for name, value in metadata.items() if name != "digest"}
    shapes = {name: [array.dtype.str, *array.shape] for name, array in tensors.items()}
    state.update(json.dumps([labels, shapes], sort_keys=True).encode())
    for name in sorted(tensors):
        state.update(tensors[name].reshape(-1).data)
    return state.hexdigest()


def _parts(
    tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str], kind: Kind
) -> Iterator[bytes | memoryview]:
    """The bytes of a file, one after another: header, then arrays, the widest first, so that all are aligned."""
    if reserved := [name for name in OURS if name in metadata]:
        raise ValueError(f"metadata {reserved[0]} is set here: choose another name")
    arrays = {name: _portable(name, array) for name, array in tensors.items()}
    full = {**metadata, "kind": kind, "format": FORMAT}
    header: dict[str, Any] = {"__metadata__": {**full, "digest": _digest(arrays, full)}}
    order = sorted(arrays, key=lambda name: (-arrays[name].itemsize, name))
    offset = 0
    for name in order:
        array = arrays[name]
        bits = "" if array.dtype.kind == "b" else 8 * array.itemsize
        header[name] = {
            "dtype": f"{DTYPES[array.dtype.kind]}{bits}",
            "shape": array.shape,
            "data_offsets": (offset, offset + array.nbytes),
        }
        offset += array.nbytes
    text = json.dumps(header, sort_keys=True, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    yield len(text).to_bytes(8, "little") + text
    for name in order:
        yield arrays[name].reshape(-1).view(np.uint8).data


def _portable(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Dense and little-endian, as safetensors wants it."""
    if array.dtype.kind not in DTYPES or array.itemsize > 8:
        raise ValueError(f"tensor {name} has dtype {array.dtype}, which safetensors does not keep")
    if name == "__metadata__":
        raise ValueError("no tensor can have the name __metadata__: safetensors keeps it for itself")
    return np.asarray(array, dtype=array.dtype.newbyteorder("<"), order="C")


def _header(data: bytes) -> dict[str, Any]:
    length = int.from_bytes(data[:8], "little")
    header: dict[str, Any] = json.loads(data[8 : 8 + length])
    return header
