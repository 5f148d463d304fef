"""Policies without foresight: at random, always onward on the shortest path, and every train as if it were alone."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import kernel
from railctl.common.levels.level import Level, Schedule
from railctl.common.policy.choosing import draw_counter
from railctl.common.policy.streams import uniform
from railctl.common.rail.compiled.arrays import NOTHING, NOWHERE, Batch
from railctl.common.rail.compiled.world import Parts
from railctl.common.rail.planning.rails import action_out, any_way, shortest_way
from railctl.common.rail.world import DO_NOTHING, MOVE_FORWARD, N_ACTIONS
from railctl.common.records.course import NONE, Course
from railctl.common.seeding import stream_key
from railctl.services.evaluator.references.performing import Act, course
from railctl.services.evaluator.runner import Policy

_ONE = np.uint64(1)
COLUMNS = ("speeds", "earliest_departures", "latest_arrivals", "target_headings")  # of a schedule


def at_random(seed: int, index: int, parts: Parts) -> Act:
    """Any action where a train decides, as a network explores with epsilon 1; the draws are those of (seed, index)."""
    key = np.uint64(stream_key(seed, index, "evaluation-random"))
    actions = np.empty(parts.batch.worlds[0]["trains"], np.int8)

    def act(step: int) -> NDArray[np.int8]:
        draw(parts.deciding, key, step, actions)
        return actions

    return act


@kernel
def draw(deciding: NDArray[np.bool_], key: np.uint64, step: int, actions: NDArray[np.int8]) -> None:
    """Fill in actions [N] of slot 0, as `common.policy.choosing.epsilon_greedy` draws them."""
    for train in range(len(actions)):
        actions[train] = MOVE_FORWARD
        if deciding[0, train]:
            counter = np.uint64(draw_counter(step, len(actions), train))
            actions[train] = int(uniform(key, counter + _ONE) * N_ACTIONS)


def shortest_path(_index: int, parts: Parts) -> Act:
    """Onward on the shortest path from wherever a train is, never waiting; of equally short ways the leftmost."""
    actions = np.empty(parts.batch.worlds[0]["trains"], np.int8)

    def act(_step: int) -> NDArray[np.int8]:
        drive_on(parts.batch, actions)
        return actions

    return act


@kernel
def drive_on(batch: Batch, actions: NDArray[np.int8]) -> None:
    """Fill in actions [N] of slot 0; trains without a path do not depart."""
    codes, leads = batch.codes[0], batch.leads[0]
    for at in range(len(actions)):
        train = batch.trains[0, at]
        here = train["config"] if train["config"] != NOWHERE else train["start"]
        distance = batch.distances[0, at]
        left = (here + 3) & 3
        way = any_way(codes, here) if distance[here] == 0 else shortest_way(codes, leads, distance, here, left)
        actions[at] = DO_NOTHING if way == NOTHING else action_out(codes, here, way)


def alone(policy: Policy) -> Policy:
    """Every train plays the policy as if there were no others, and no malfunctions.

    With `shortest_path` no policy does better.
    """

    def play(index: int, level: Level) -> Course:
        solos = [policy(index, with_one_train(level, train)) for train in range(level.n_trains)]
        arrived_at = np.concatenate([solo.arrived_at for solo in solos])
        steps = max(solo.last_step for solo in solos)
        under_way = (arrived_at == NONE) | (np.arange(steps)[:, None] <= arrived_at)
        told = np.full(under_way.shape, DO_NOTHING, np.int8)
        for train, solo in enumerate(solos):
            told[: solo.last_step, train] = solo.decisions.actions
        rewards = np.where(under_way & (np.arange(steps)[:, None] != arrived_at), -1, 0).astype(np.float32)
        rewards[-1] += (arrived_at != NONE).all()
        return course(level, rewards, arrived_at, told, under_way)

    return play


def with_one_train(level: Level, train: int) -> Level:
    """A level as if the other trains were not there; the one that is never breaks down."""
    schedule = level.schedule
    if schedule is not None:
        columns = {name: getattr(schedule, name)[[train]] for name in COLUMNS}
        schedule = Schedule(**columns)
    return replace(level, starts=level.starts[[train]], targets=level.targets[[train]], schedule=schedule)
