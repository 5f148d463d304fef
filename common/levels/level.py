"""A level as plain data: rails, where trains start, where they go, how long they have, and how they run."""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

U2, I4 = np.dtype("<u2"), np.dtype("<i4")  # as all machines hash them


MOST_STEPS = 100_000  # of an episode


class InfeasibleLevelError(RuntimeError):
    """The generator's draws gave a train no way to its target."""


class Malfunctions(NamedTuple):
    """How trains break down: flatland's `MalfunctionParameters`.

    Attributes:
        rate: flatland's `malfunction_rate`: a train breaks down in a step with the probability 1 - exp(-rate).
        min_steps: flatland's `min_duration`; a malfunction takes one step more than what is drawn.
        max_steps: flatland's `max_duration`.
    """

    rate: float
    min_steps: int
    max_steps: int


@dataclass(frozen=True)
class Schedule:
    """What the trains of flatland-rl 4.3.0 know beyond starts and targets; only the stock rules know of it.

    Attributes:
        speeds: [N, 2] int32, cells a step as numerator and denominator, above 0 and at most 1.
        earliest_departures: [N] int32, the step from which a train may depart.
        latest_arrivals: [N] int32, the step after which an arrival is late.
        target_headings: [N] int32, a bit for each heading that counts at the target (bit 0 north); 0: all that the
            rails allow.
        malfunctions: what breaks trains down; None: nothing does.
    """

    speeds: NDArray[np.int32]
    earliest_departures: NDArray[np.int32]
    latest_arrivals: NDArray[np.int32]
    target_headings: NDArray[np.int32]
    malfunctions: Malfunctions | None = None

    def content(self) -> bytes:
        """All of it as bytes, for hashes."""
        columns = self.speeds, self.earliest_departures, self.latest_arrivals, self.target_headings
        return b"".join(np.asarray(column, I4).tobytes() for column in columns) + repr(self.malfunctions).encode()


@dataclass(frozen=True)
class Level:
    """One railway world at step 0.

    Attributes:
        grid: [H, W] uint16, flatland's transition maps.
        starts: [N, 3] int32, row, column, heading (0 north, 1 east, 2 south, 3 west).
        targets: [N, 2] int32, row, column.
        max_steps: the step limit of an episode.
        schedule: how trains run; None: as in the study, at speed 1, departing at any time, never broken down.
    """

    grid: NDArray[np.uint16]
    starts: NDArray[np.int32]
    targets: NDArray[np.int32]
    max_steps: int
    schedule: Schedule | None = None

    @property
    def n_trains(self) -> int:
        return len(self.starts)

    @cached_property
    def content_hash(self) -> str:
        """128-bit hash of the content: equal levels have equal hashes, wherever they came from."""
        head = f"{self.grid.shape}{self.n_trains}/{self.max_steps}".encode()
        arrays = np.asarray(self.grid, U2), np.asarray(self.starts, I4), np.asarray(self.targets, I4)
        content = b"".join((head, *(array.tobytes() for array in arrays)))
        if self.schedule is not None:
            content += self.schedule.content()
        return hashlib.blake2b(content, digest_size=16).hexdigest()

    @cached_property
    def grid_hash(self) -> int:
        """64-bit hash of the rails alone."""
        content = f"{self.grid.shape}".encode() + np.asarray(self.grid, U2).tobytes()
        return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "little")
