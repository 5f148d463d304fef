"""Playing episodes: levels and choices in, recordings out. A batch runs through one world, each episode on its own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.levels.level import Level
from common.rail.world import MOVE_FORWARD, World

Choose = Callable[[NDArray[np.float32], int, int], int]  # observation [F], step, train -> action


@dataclass
class Recording:
    """What happened in one episode; decisions are in the order of (time, train).

    Attributes:
        observations, times, trains, actions: one entry a decision.
        rewards: a row [N] a step.
        arrived_at: [N], the step (0-based) on which a train arrived, -1 for none.
        final_observations: [N, F], what trains saw that the step limit stopped; zeros for those that arrived.
    """

    level: Level
    n_features: int
    observations: list[NDArray[np.float32]] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    trains: list[int] = field(default_factory=list)
    actions: list[int] = field(default_factory=list)
    rewards: list[NDArray[np.float32]] = field(default_factory=list)
    arrived_at: NDArray[np.int32] = field(init=False)
    final_observations: NDArray[np.float32] = field(init=False)

    def __post_init__(self) -> None:
        self.arrived_at = np.full(self.level.n_trains, -1, np.int32)
        self.final_observations = np.zeros((self.level.n_trains, self.n_features), np.float32)

    @property
    def steps(self) -> int:
        return len(self.rewards)

    @property
    def normalised_return(self) -> float:
        """Sum of all rewards / (trains * max steps)."""
        return float(np.sum(self.rewards, dtype=np.float64)) / (self.level.n_trains * self.level.max_steps)

    def decide(self, observation: NDArray[np.float32], train: int, action: int) -> None:
        """Note a decision of the coming step."""
        self.observations.append(observation)
        self.times.append(self.steps)
        self.trains.append(train)
        self.actions.append(action)

    def stepped(self, rewards: NDArray[np.float32], arrived: NDArray[np.bool_]) -> None:
        """Note what a step brought, both [N]."""
        self.arrived_at[arrived & (self.arrived_at < 0)] = self.steps
        self.rewards.append(rewards)


def play(
    world: World, levels: Sequence[Level], choices: Sequence[Choose], on_step: Callable[[], None] = lambda: None
) -> list[Recording]:
    """Run one episode a level, at most `world.slots` of them, to their ends.

    Args:
        world: any engine.
        levels: a level a slot.
        choices: a policy a slot, asked for deciding trains only.
        on_step: called before every step, for signs of life; what it raises ends the play.
    """
    recordings = [Recording(level, world.n_features) for level in levels]
    for slot, level in enumerate(levels):
        world.load(slot, level)
    actions = np.full((world.slots, world.max_trains), MOVE_FORWARD, np.int8)
    while not (over := world.over())[: len(levels)].all():
        on_step()
        actions[:] = MOVE_FORWARD
        for slot, train in np.argwhere(world.deciding()).tolist():
            observation = world.observe(slot, train)
            recording = recordings[slot]
            actions[slot, train] = choices[slot](observation, recording.steps, train)
            recording.decide(observation, train, int(actions[slot, train]))
        rewards, arrived = world.step(actions), world.arrived()
        for slot in np.flatnonzero(~over[: len(levels)]).tolist():
            n = levels[slot].n_trains
            recordings[slot].stepped(rewards[slot, :n].copy(), arrived[slot, :n])
    for slot, recording in enumerate(recordings):
        for train in np.flatnonzero(recording.arrived_at < 0).tolist():
            recording.final_observations[train] = world.observe(slot, train)
    return recordings
