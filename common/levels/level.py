"""A level as plain data: rails, where trains start, where they go, and how long they have."""

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

U2, I4 = np.dtype("<u2"), np.dtype("<i4")  # as all machines hash them


@dataclass(frozen=True)
class Level:
    """One railway world at step 0.

    Attributes:
        grid: [H, W] uint16, flatland's transition maps.
        starts: [N, 3] int32, row, column, heading (0 north, 1 east, 2 south, 3 west).
        targets: [N, 2] int32, row, column.
        max_steps: the step limit of an episode.
    """

    grid: NDArray[np.uint16]
    starts: NDArray[np.int32]
    targets: NDArray[np.int32]
    max_steps: int

    @property
    def n_trains(self) -> int:
        return len(self.starts)

    @cached_property
    def content_hash(self) -> str:
        """128-bit hash of the content: equal levels have equal hashes, wherever they came from."""
        head = f"{self.grid.shape}{self.n_trains}/{self.max_steps}".encode()
        arrays = np.asarray(self.grid, U2), np.asarray(self.starts, I4), np.asarray(self.targets, I4)
        content = b"".join((head, *(array.tobytes() for array in arrays)))
        return hashlib.blake2b(content, digest_size=16).hexdigest()

    @cached_property
    def grid_hash(self) -> int:
        """64-bit hash of the rails alone."""
        content = f"{self.grid.shape}".encode() + np.asarray(self.grid, U2).tobytes()
        return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "little")
