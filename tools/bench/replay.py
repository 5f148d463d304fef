"""How our replay compares with cpprb's and with plain numpy: `railctl bench replay`.

All hold the same transitions, whose observations are of the study's levels: two rows of 252 float32, an action, a
reward and a discount. "sample" gives a batch of 150 with all its data; "sample+update" then gives them new priorities.
"add" appends 300 transitions, about an episode, to a full ring.

cpprb's buffers are the library's own, with its defaults but for the summand of the priorities, which is ours. The plain
ring is numpy float32 arrays; by priority it draws with `cumsum` and `searchsorted` over the whole ring, as scripts do.
Ours ends in tensors, and in observations without their zeros, as its learner takes them; theirs in numpy's arrays.
Before anything is timed, all must give back what was put in, with the importance weights that the paper's formula
gives.
"""

import itertools
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.distributions import shipped
from railctl.common.levels.shipped import generate
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import build_network, export_parameters
from railctl.common.policy.player import Acting, network_layout, play
from railctl.common.rail.normalise import N_FEATURES
from railctl.common.rail.world import N_ACTIONS
from railctl.common.rules.replay import PrioritizedReplay, UniformReplay
from railctl.common.rules.settings import NetworkConfig
from railctl.services.learner.replay.priorities import ADDED_TO_PRIORITY
from railctl.services.learner.replay.replay import Replay
from railctl.services.learner.sparse import SparseRows, dense_rows
from railctl.tools.bench.conditions import study_rollouts
from railctl.tools.bench.measuring import Comparison, DisagreementError, Sample, run, timed

BATCH, EPISODE, CHUNK = 150, 300, 5_000  # transitions
LEVELS, EPSILON = 10, 0.5
ALPHA, BETA = 0.6, 0.4
CALLS = 300  # in a repeat
MILLION = 1_000_000
COLUMNS = {"action_tm1": np.int8, "reward_t": np.float32, "discount_t": np.float32}
ROWS = ("observation_tm1", "observation_t")

Items = dict[str, NDArray[Any]]
Drawn = tuple[NDArray[Any], Mapping[str, Any], Any]  # arrays, tensors, or sparse rows


class Contender(Protocol):
    """A replay, uniform or prioritised."""

    def add(self, items: Items) -> None: ...

    def sample(self) -> Drawn:
        """Places, data and importance weights."""

    def update(self, places: NDArray[Any], priorities: NDArray[np.float64]) -> None: ...


class Ours:
    def __init__(self, capacity: int, *, prioritized: bool) -> None:
        by_priority = PrioritizedReplay(capacity=capacity, alpha=ALPHA, beta=BETA)
        config = by_priority if prioritized else UniformReplay(capacity=capacity)
        self.replay = Replay(config, COLUMNS, ROWS, N_FEATURES)
        self._keys = itertools.count()

    def add(self, items: Items) -> None:
        self.replay.add(items)

    def sample(self) -> Drawn:
        columns, rows, weights, places = self.replay.sample(BATCH, next(self._keys), BETA)
        return places, {**columns, **rows}, weights

    def update(self, places: NDArray[Any], priorities: NDArray[np.float64]) -> None:
        self.replay.reprioritise(places, priorities)


class Cpprb:
    def __init__(self, capacity: int, *, prioritized: bool) -> None:
        from cpprb import PrioritizedReplayBuffer, ReplayBuffer  # noqa: PLC0415  (only the benchmark needs it)

        fields: dict[str, Any] = {name: {"dtype": dtype} for name, dtype in COLUMNS.items()}
        fields |= {name: {"dtype": np.float32, "shape": N_FEATURES} for name in ROWS}
        self._buffer: Any
        if prioritized:
            self._buffer = PrioritizedReplayBuffer(capacity, fields, alpha=ALPHA, eps=ADDED_TO_PRIORITY)
            self._arguments = {"beta": BETA}
        else:
            self._buffer = ReplayBuffer(capacity, fields)
            self._arguments = {}

    def add(self, items: Items) -> None:
        self._buffer.add(**items)

    def sample(self) -> Drawn:
        data = self._buffer.sample(BATCH, **self._arguments)
        return data.pop("indexes", None), data, data.pop("weights", None)

    def update(self, places: NDArray[Any], priorities: NDArray[np.float64]) -> None:
        self._buffer.update_priorities(places, priorities)


class Plain:
    def __init__(self, capacity: int, *, prioritized: bool) -> None:
        self.arrays: Items = {name: np.zeros(capacity, dtype) for name, dtype in COLUMNS.items()}
        self.arrays |= {name: np.zeros((capacity, N_FEATURES), np.float32) for name in ROWS}
        self._capacity, self._added = capacity, 0
        self._leaves = np.zeros(capacity) if prioritized else None
        self._rng = np.random.default_rng(0)

    def add(self, items: Items) -> None:
        count = len(items[ROWS[0]])
        places = np.arange(self._added, self._added + count) % self._capacity
        for name, array in self.arrays.items():
            array[places] = items[name]
        if self._leaves is not None:
            self._leaves[places] = self._leaves.max() or 1
        self._added += count

    def sample(self) -> Drawn:
        if self._leaves is None:
            places, weights = self._rng.integers(self._capacity, size=BATCH), np.ones(BATCH, np.float32)
        else:
            sums = self._leaves.cumsum()
            points = (np.arange(BATCH) + self._rng.random(BATCH)) / BATCH * sums[-1]
            places = np.minimum(sums.searchsorted(points, side="right"), self._capacity - 1)
            chances = self._leaves[places]
            weights = ((chances.min() / chances) ** BETA).astype(np.float32)
        return places, {name: array[places] for name, array in self.arrays.items()}, weights

    def update(self, places: NDArray[Any], priorities: NDArray[np.float64]) -> None:
        if self._leaves is not None:
            self._leaves[places] = (priorities + ADDED_TO_PRIORITY) ** ALPHA


RIVALS: dict[str, Callable[..., Contender]] = {"cpprb": Cpprb, "numpy": Plain}


def real_transitions(levels: int) -> Items:
    """Transitions of an untrained network on so many levels of each difficulty."""
    config = NetworkConfig(kind="dueling")
    twin, rollouts = Twin(network_layout(config, N_FEATURES)), study_rollouts()
    twin.load(export_parameters(build_network(config, N_FEATURES, N_ACTIONS, seed=0)))
    seen = []
    for difficulty in shipped():
        for seed in range(levels):
            decisions = play(rollouts, generate(difficulty, seed), Acting(twin, EPSILON, key=seed)).decisions
            by_train = np.lexsort((decisions.times, decisions.trains))
            seen.append(np.array(decisions.observations, np.float32)[by_train])
    rows, rng = np.concatenate(seen), np.random.default_rng(0)
    count = len(rows) - 1
    return {
        "observation_tm1": rows[:-1],
        "observation_t": rows[1:],
        "action_tm1": rng.integers(0, N_ACTIONS, count).astype(np.int8),
        "reward_t": -rng.random(count).astype(np.float32),
        "discount_t": rng.random(count).astype(np.float32),
    }


def drawn(items: Items, count: int, rng: np.random.Generator) -> Items:
    """So many of them, in any order, some of them often."""
    chosen = rng.integers(len(items[ROWS[0]]), size=count)
    return {name: array[chosen] for name, array in items.items()}


def plain(column: Any) -> NDArray[Any]:
    """A column of what was drawn as an array."""
    return np.asarray(dense_rows(column) if isinstance(column, SparseRows) else column)


def fill(contender: Contender, items: Items, capacity: int, *, prioritized: bool) -> None:
    """Fill a ring with the same transitions and priorities every time.

    Raises:
        DisagreementError: it gives something else back, or with other importance weights than the paper's.
    """
    rng, kept = np.random.default_rng(1), []
    for begin in range(0, capacity, CHUNK):
        some = drawn(items, min(CHUNK, capacity - begin), rng)
        kept.append(some["reward_t"])
        contender.add(some)
    rewards, priorities = np.concatenate(kept), rng.random(capacity)
    if prioritized:
        contender.update(np.arange(capacity), priorities)
    places, columns, importance = contender.sample()
    data, weights = {name: plain(column) for name, column in columns.items()}, np.asarray(importance)
    by_reward = {float(reward): row for reward, row in zip(items["reward_t"], items["observation_t"], strict=True)}
    expected = np.array([by_reward[reward] for reward in data["reward_t"].reshape(-1).tolist()])
    if not np.array_equal(data["observation_t"], expected):
        raise DisagreementError("a replay gives back other transitions than it got")
    if prioritized:
        chances = (priorities[places] + ADDED_TO_PRIORITY) ** ALPHA
        by_formula = (chances.min() / chances) ** BETA
        if not np.array_equal(data["reward_t"].reshape(-1), rewards[places]):
            raise DisagreementError("a replay does not say where its transitions lie")
        if not np.allclose(weights / weights.max(), by_formula, rtol=1e-3):
            raise DisagreementError("a replay gives other importance weights than the paper")


def drawing(items: Items, capacity: int, *, prioritized: bool) -> Comparison:
    """Batches from full rings."""
    priorities = np.random.default_rng(2).random((CALLS, BATCH))

    def work(contender: Contender) -> None:
        for some in priorities:
            places, _, _ = contender.sample()
            if prioritized:
                contender.update(places, some)

    name = f"{'prioritised sample+update' if prioritized else 'uniform sample'}, {capacity:,}"
    return beside_rivals(name, "us/batch", items, capacity, work, prioritized=prioritized)


def adding(items: Items, capacity: int) -> Comparison:
    """Episodes into full rings without priorities."""
    episode = drawn(items, EPISODE, np.random.default_rng(3))

    def work(contender: Contender) -> None:
        for _ in range(CALLS):
            contender.add(episode)

    return beside_rivals(f"add {EPISODE}, {capacity:,}", "us", items, capacity, work, prioritized=False)


def beside_rivals(  # noqa: PLR0913  (what to do, with what, and what to call it)
    name: str, unit: str, items: Items, capacity: int, work: Callable[[Contender], None], *, prioritized: bool
) -> Comparison:
    """`CALLS` calls' work on full rings, ours and each rival's; a rival has a row."""
    contenders: dict[str, Contender] = {}

    def once(repeat: int) -> list[Sample]:
        if repeat == 0:
            for who, kind in {"": Ours, **RIVALS}.items():
                contenders[who] = kind(capacity, prioritized=prioritized)
                fill(contenders[who], items, capacity, prioritized=prioritized)
        us = {who: timed(partial(work, one))[0] / CALLS * 1e6 for who, one in contenders.items()}
        return [Sample(f"{name}, {rival}", unit, us[""], us[rival]) for rival in RIVALS]

    return Comparison(name, once)


def memory(items: Items, capacity: int) -> Comparison:
    """What a full prioritised ring takes, with all room to grow, beside the bare fields in float32."""

    def once(_repeat: int) -> list[Sample]:
        ours, plain = Ours(capacity, prioritized=True), Plain(1, prioritized=True)
        fill(ours, items, capacity, prioritized=True)
        theirs = sum(array.nbytes for array in plain.arrays.values())
        size, snapshot = ours.replay.nbytes, sum(array.nbytes for array in ours.replay.state().values())
        name = f"of {capacity:,}, float32"
        return [
            Sample(f"memory {name}", "bytes/transition", size / capacity, theirs),
            Sample(f"snapshot {name}", "bytes/transition", snapshot / capacity, theirs),
        ]

    return Comparison(f"memory, {capacity:,}", once)


def comparisons(capacity: int, large: int) -> Sequence[Comparison]:
    """All that is measured."""
    items = real_transitions(LEVELS)
    return [
        drawing(items, capacity, prioritized=True),
        drawing(items, large, prioritized=True),
        drawing(items, capacity, prioritized=False),
        adding(items, capacity),
        memory(items, capacity),
        memory(items, MILLION),
    ]


def main() -> None:
    if find_spec("cpprb") is None:
        sys.exit("railctl: cpprb, which ours is compared with, is not installed: pip install cpprb")
    run("Compare the replay with cpprb and numpy.", comparisons, capacity=50_000, large=200_000)


if __name__ == "__main__":
    main()
