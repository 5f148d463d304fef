"""Whole episodes on the compiled world, in which a policy that looks at the world itself tells every train what to do.

Trained networks are asked only where a train decides (`common.rail.decisions`); these may stop a train anywhere.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from railctl.common.levels.level import Level
from railctl.common.rail.compiled.arrays import NOTHING
from railctl.common.rail.compiled.world import CompiledWorld, Parts
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.rail.world import DO_NOTHING
from railctl.common.records.course import NONE, Course, Decisions
from railctl.common.seeding import evaluation_malfunction_seed
from railctl.services.evaluator.runner import Policy

Act = Callable[[int], NDArray[np.int8]]  # steps so far -> [N], the actions of all trains
Begin = Callable[[int, Parts], Act]  # number of the level, and the world at its start


def policy_of(world: CompiledWorld, begin: Begin) -> Policy:
    """The policy that begins anew with every level."""

    def play(index: int, level: Level) -> Course:
        world.load(0, level, evaluation_malfunction_seed(index))
        return perform(world, level, begin(index, world.parts()))

    return play


def perform(world: CompiledWorld, level: Level, act: Act) -> Course:
    """Play the episode in slot 0 from its start; all actions of trains that have not arrived count as decisions."""
    n_trains = level.n_trains
    told = np.full((level.max_steps, n_trains), DO_NOTHING, np.int8)
    under_way = np.zeros((level.max_steps, n_trains), np.bool_)
    rewards = np.zeros((level.max_steps, n_trains), np.float32)
    actions = np.full((world.slots, world.max_trains), DO_NOTHING, np.int8)
    step = 0
    while not world.over()[0]:
        under_way[step] = ~world.arrived()[0, :n_trains]
        told[step] = actions[0, :n_trains] = act(step)
        rewards[step] = world.obey(actions)[0, :n_trains]
        step += 1
    arrived = world.batch.trains[0]["arrived_at"][:n_trains]
    arrived_at, score = np.where(arrived == NOTHING, NONE, arrived - 1), world.score(0)
    return course(level, rewards[:step], arrived_at, told, under_way, None if np.isnan(score) else score)


def course(  # noqa: PLR0913  (what happened)
    level: Level,
    rewards: NDArray[np.float32],
    arrived_at: NDArray[np.int32],
    told: NDArray[np.int8],
    under_way: NDArray[np.bool_],
    score: float | None = None,
) -> Course:
    """An episode of T steps in which nobody looked at observations.

    Args:
        level: of the episode.
        rewards: [T, N].
        arrived_at: [N], see `Course`.
        told: [T, N], the actions.
        under_way: [T, N], whose actions are decisions.
        score: see `Course`.
    """
    times, trains = np.nonzero(under_way)
    nothing = np.zeros(len(times), np.float32)
    decisions = Decisions(
        observations=np.zeros((len(times), 0), np.float32),
        times=times.astype(np.int32),
        trains=trains.astype(np.int32),
        actions=told[times, trains],
        allowed=np.full(len(times), ALL_ACTIONS, np.uint8),
        log_probabilities=nothing,
        values=nothing,
        labels=np.full(len(times), NONE, np.int8),
        following=np.zeros((len(times), 0), np.float32),
    )
    return Course(
        level_hash=level.content_hash,
        max_steps=level.max_steps,
        first_step=0,
        over=True,
        decisions=decisions,
        rewards=rewards,
        arrived_at=arrived_at.astype(np.int32),
        final_observations=np.zeros((level.n_trains, 0), np.float32),
        final_allowed=np.full(level.n_trains, ALL_ACTIONS, np.uint8),
        states=np.zeros((level.n_trains, 0), np.float32),
        score=score,
    )
