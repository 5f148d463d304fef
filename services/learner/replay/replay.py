"""Experience replay in plain arrays, uniform or prioritised (Schaul et al. 2016, arXiv:1511.05952)."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.config import ReplayConfig


class Sample(NamedTuple):
    columns: dict[str, Tensor]
    weights: Tensor
    places: NDArray[np.int64]


class Replay:
    def __init__(self, config: ReplayConfig, columns: Mapping[str, Any], rows: Sequence[str], n_features: int) -> None:
        self._config = config
        self._arrays = {name: np.zeros(config.capacity, dtype) for name, dtype in columns.items()}
        self._arrays |= {name: np.zeros((config.capacity, n_features), np.float32) for name in rows}
        self._priorities = np.zeros(config.capacity)
        self._max = 1.0
        self._size = self._cursor = 0

    def __len__(self) -> int:
        return self._size

    def add(self, items: Mapping[str, NDArray[Any]], priorities: NDArray[np.float64] | None = None) -> None:
        count = len(next(iter(items.values())))
        kept = np.arange(max(0, count - self._config.capacity), count)
        places = (self._cursor + kept) % self._config.capacity
        for name, array in self._arrays.items():
            array[places] = items[name][kept]
        self._cursor = (self._cursor + count) % self._config.capacity
        self._size = min(self._size + count, self._config.capacity)
        self.reprioritise(places, np.full(count, self._max)[kept] if priorities is None else priorities[kept])

    def sample(self, size: int, rng: np.random.Generator, beta: float = 1.0) -> Sample:
        if self._size == 0:
            raise ValueError("cannot sample from an empty replay: add transitions first")
        weights = np.ones(size)
        if self._config.kind == "uniform":
            places = rng.integers(self._size, size=size)
        else:
            sums = np.cumsum(self._priorities[: self._size])
            places = np.minimum(np.searchsorted(sums, rng.random(size) * sums[-1], side="right"), self._size - 1)
            weights = (self._size * self._priorities[places] / sums[-1]) ** -beta
            weights /= weights.max()
        columns = {}
        for name, array in self._arrays.items():
            dtype = torch.int64 if array.dtype.kind == "i" else torch.float32
            columns[name] = torch.tensor(array[places], dtype=dtype)
        return Sample(columns, torch.tensor(weights, dtype=torch.float32), places)

    def reprioritise(self, places: NDArray[np.int64], priorities: NDArray[np.float64]) -> None:
        self._max = max(self._max, float(priorities.max(initial=0.0)))
        self._priorities[places] = (priorities + 1e-6) ** self._config.alpha

    def telling(self) -> dict[str, float]:
        told = {"replay_fill": self._size / self._config.capacity}
        if self._config.kind == "prioritized":
            told["priority_mean"] = float(self._priorities[: self._size].mean())
            told["priority_max"] = float(self._priorities[: self._size].max())
        return told

    def state(self) -> dict[str, NDArray[Any]]:
        filled = {name: array[: self._size].copy() for name, array in self._arrays.items()}
        return filled | {
            "priorities": self._priorities[: self._size].copy(),
            "max": np.array(self._max),
            "cursor": np.array(self._cursor, np.int64),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        if different := sorted(set(state) ^ {*self._arrays, "priorities", "max", "cursor"}):
            raise ValueError(f"replay: tensor {different[0]} is {'unknown' if different[0] in state else 'missing'}")
        self._size, self._cursor = len(state["priorities"]), int(state["cursor"])
        self._max = float(state["max"])
        self._priorities[: self._size] = state["priorities"]
        for name, array in self._arrays.items():
            array[: self._size] = state[name]
