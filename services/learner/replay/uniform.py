"""Uniform experience replay: a ring of the newest transitions (Lin 1992; Mnih et al. 2015).

Batches are drawn with replacement: every draw is uniform over what the ring holds, at a cost that does not
depend on how much that is.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from services.learner.replay.transitions import Transitions

FIELDS = ("observation_tm1", "action_tm1", "reward_t", "discount_t", "observation_t")


class Batch(NamedTuple):
    """B transitions in memory that torch allocated; fields as in `Transitions`."""

    observation_tm1: Tensor  # [B, F] float32
    action_tm1: Tensor  # [B] int64
    reward_t: Tensor  # [B] float32
    discount_t: Tensor  # [B] float32
    observation_t: Tensor  # [B, F] float32


class UniformReplay:
    """A ring of at most `capacity` transitions; the oldest give way."""

    def __init__(self, capacity: int, n_features: int) -> None:
        # Not zeros: the kernel gives pages to this memory only as the ring fills.
        self._arrays: dict[str, NDArray[Any]] = {
            "observation_tm1": np.empty((capacity, n_features), np.float32),
            "action_tm1": np.empty(capacity, np.int8),
            "reward_t": np.empty(capacity, np.float32),
            "discount_t": np.empty(capacity, np.float32),
            "observation_t": np.empty((capacity, n_features), np.float32),
        }
        self._capacity = capacity
        self._size = 0
        self._cursor = 0  # where the next transition goes
        self._batch = _empty_batch(0, n_features)

    def __len__(self) -> int:
        return self._size

    def add(self, new: Transitions) -> None:
        """Append transitions, oldest first."""
        skipped = max(0, len(new) - self._capacity)  # they would be overwritten at once
        kept = np.arange(skipped, len(new))
        places = (self._cursor + kept) % self._capacity
        for name, array in self._arrays.items():
            array[places] = getattr(new, name)[kept]
        self._cursor = (self._cursor + len(new)) % self._capacity
        self._size = min(self._size + len(new), self._capacity)

    def sample(self, size: int, rng: np.random.Generator) -> Batch:
        """`size` transitions drawn uniformly, with replacement.

        The batch is valid until the next call, which writes into the same memory.

        Raises:
            ValueError: the ring is empty.
        """
        if self._size == 0:
            raise ValueError("cannot sample from an empty replay: add transitions first")
        if len(self._batch.action_tm1) != size:
            self._batch = _empty_batch(size, self._arrays["observation_t"].shape[1])
        chosen = rng.integers(self._size, size=size)
        batch = self._batch
        for name in FIELDS:
            out = getattr(batch, name).numpy()  # the tensor's own memory
            if name == "action_tm1":
                out[:] = self._arrays[name][chosen]
            else:  # all are in range: "clip" only spares numpy the buffer that "raise" needs
                np.take(self._arrays[name], chosen, axis=0, out=out, mode="clip")
        return batch

    def state(self) -> dict[str, NDArray[Any]]:
        """A copy of what the ring holds, in the order of its places, and its cursor."""
        filled = {name: array[: self._size].copy() for name, array in self._arrays.items()}
        return {**filled, "cursor": np.array(self._cursor, np.int64)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take on a `state`: what is sampled and overwritten from here on is as in the ring that gave it.

        Raises:
            ValueError: naming the tensor that is missing, unknown, of another dtype or shape, or out of
                range.
        """
        if different := sorted(set(state) ^ {*FIELDS, "cursor"}):
            raise ValueError(f"replay: tensor {different[0]} is {'unknown' if different[0] in state else 'missing'}")
        size, cursor = len(state["action_tm1"]), int(state["cursor"])
        if size > self._capacity:
            raise ValueError(f"replay: action_tm1 holds {size} transitions, the capacity is {self._capacity}")
        if not (cursor == size % self._capacity if size < self._capacity else 0 <= cursor < size):
            raise ValueError(f"replay: cursor {cursor} does not fit {size} transitions")
        for name, array in self._arrays.items():
            want, got = (size, *array.shape[1:]), state[name]
            if got.dtype != array.dtype or got.shape != want:
                raise ValueError(f"replay: {name} is {got.dtype}{got.shape}, not {array.dtype}{want}")
        for name, array in self._arrays.items():
            array[:size] = state[name]
        self._size, self._cursor = size, cursor


def _empty_batch(size: int, n_features: int) -> Batch:
    return Batch(
        observation_tm1=torch.zeros(size, n_features),
        action_tm1=torch.zeros(size, dtype=torch.int64),
        reward_t=torch.zeros(size),
        discount_t=torch.zeros(size),
        observation_t=torch.zeros(size, n_features),
    )
