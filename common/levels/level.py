"""A level as plain data: rails, where trains start, where they go, and how long they have."""

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


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
        state = hashlib.blake2b(digest_size=16)
        state.update(f"{self.grid.shape}{self.n_trains}/{self.max_steps}".encode())
        for array, dtype in ((self.grid, "<u2"), (self.starts, "<i4"), (self.targets, "<i4")):
            state.update(np.ascontiguousarray(array, dtype=dtype).tobytes())
        return state.hexdigest()

    @cached_property
    def grid_hash(self) -> int:
        """64-bit hash of the rails alone."""
        state = hashlib.blake2b(f"{self.grid.shape}".encode(), digest_size=8)
        state.update(np.ascontiguousarray(self.grid, dtype="<u2").tobytes())
        return int.from_bytes(state.digest(), "little")
