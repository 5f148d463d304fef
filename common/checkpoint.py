"""Checkpoints and snapshots: named arrays and strings in one safetensors file that is whole or refused.

A digest over everything else in the file is checked on reading, so no flipped byte goes unnoticed. Equal
content has equal bytes. Files replace their predecessors atomically: a crash leaves the old one or the new
one. No torch here, and nothing that unpickles.
"""

import hashlib
import json
import os
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

FORMAT = "1"  # 1: the first
Kind = Literal["checkpoint", "snapshot"]  # weights to act with; everything that a learner goes on from
OURS = ("kind", "format", "digest")
DTYPES = frozenset(
    ("bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
    + ("float16", "float32", "float64")
)

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
    data = to_bytes(tensors, metadata, kind)
    temporary = path.with_name(
        f".{path.name}.{os.getpid()}.tmp"
    )  # same folder: a rename must not cross disks
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)  # or the rename itself may be lost with the power
    finally:
        os.close(folder)


def load(path: Path, kind: Kind) -> tuple[Tensors, Metadata]:
    """Read a file of `kind`.

    Returns:
        The tensors, and the metadata that `save` was given, with `digest`, `kind` and `format`.

    Raises:
        CheckpointError: the file is missing, unreadable, damaged, of another kind or of another format.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise CheckpointError(f"{path}: no such file: check the path and the run's folder") from None
    except OSError as error:
        raise CheckpointError(
            f"{path}: cannot be read ({error.strerror}): check the path and its rights"
        ) from None
    return from_bytes(data, kind, source=str(path))


def to_bytes(tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str], kind: Kind) -> bytes:
    """The content of a file: equal for equal arguments.

    Raises:
        ValueError: metadata uses a name of ours, or safetensors has no room for an array's dtype.
    """
    if reserved := [name for name in OURS if name in metadata]:
        raise ValueError(f"metadata {reserved[0]} is set here: choose another name")
    arrays = {name: _portable(name, array) for name, array in tensors.items()}
    full = {**metadata, "kind": kind, "format": FORMAT}
    full["digest"] = _digest(arrays, full)
    return _sorted_header(safetensors.numpy.save(arrays, full))


def from_bytes(data: bytes, kind: Kind, source: str) -> tuple[Tensors, Metadata]:
    """Undo `to_bytes`; raises as `load`, in the name of `source`."""
    try:
        metadata = _header(data).get("__metadata__", {})
        tensors = safetensors.numpy.load(data)
    except (SafetensorError, ValueError, KeyError, struct.error):
        remedy = "it is truncated or of another program, use another one"
        raise CheckpointError(f"{source}: not a safetensors file: {remedy}") from None
    _check_metadata(metadata, kind, source)
    if metadata["digest"] != _digest(tensors, metadata):
        raise CheckpointError(f"{source}: damaged, its digest does not match its content: use another one")
    return tensors, metadata


def _check_metadata(metadata: Metadata, kind: Kind, source: str) -> None:
    for name in OURS:
        if name not in metadata:
            raise CheckpointError(
                f"{source}: metadata {name} is missing: railctl did not write this file, use another"
            )
    if metadata["format"] != FORMAT:
        want = f"this version of railctl reads format {FORMAT}, use the one that wrote it"
        raise CheckpointError(f"{source}: has format {metadata['format'][:32]}: {want}")
    if metadata["kind"] != kind:
        folders = " and ".join(f"{name}s/" for name in get_args(Kind))
        raise CheckpointError(
            f"{source}: is a {metadata['kind'][:32]}, not a {kind}: a run has both, in {folders}"
        )


def _digest(tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str]) -> str:
    """Hash of all arrays, with names, dtypes and shapes, and of all metadata but the digest itself."""
    state = hashlib.blake2b(digest_size=16)
    labels = {name: value for name, value in metadata.items() if name != "digest"}
    shapes = {name: [array.dtype.str, *array.shape] for name, array in tensors.items()}
    state.update(json.dumps([labels, shapes], sort_keys=True).encode())
    for name in sorted(tensors):
        state.update(tensors[name].data if tensors[name].size else b"")  # numpy lends out no empty buffers
    return state.hexdigest()


def _portable(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Dense and little-endian: safetensors writes the memory of an array as it lies."""
    if array.dtype.name not in DTYPES:
        raise ValueError(f"tensor {name} has dtype {array.dtype}, which safetensors does not keep")
    return np.asarray(array, dtype=array.dtype.newbyteorder("<"), order="C")


def _header(data: bytes) -> dict[str, Any]:
    (length,) = struct.unpack_from("<Q", data)
    header: dict[str, Any] = json.loads(data[8 : 8 + length])
    return header


def _sorted_header(data: bytes) -> bytes:
    """The same file with the keys of its header in order: safetensors leaves it to chance."""
    (length,) = struct.unpack_from("<Q", data)
    text = json.dumps(_header(data), sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 8)  # the arrays after it stay aligned
    return b"".join((struct.pack("<Q", len(text)), text, memoryview(data)[8 + length :]))
