"""Reference policies asked as a network is: where trains decide, with what they see and an interlocking allows.

What trains do elsewhere is the world's business, so that episodes are those that a run could have acted itself.

| | |
|---|---|
| planner | plans before the first step for trains that wait only where they decide, and keeps to it |
| planner-replanned | plans anew in each step; what is not allowed is replaced, see below |
| shortest-path-planned | onward as far as is allowed, never waiting otherwise |

Where no plan is there, or what it says is not allowed, a train stops; if it may not, it takes its shortest way.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import kernel
from railctl.common.levels.level import Level
from railctl.common.rail.compiled.decisions import CELLS
from railctl.common.rail.compiled.world import CompiledWorld, Parts
from railctl.common.rail.planning.advising import Desk, advise, desk_for
from railctl.common.rail.planning.rails import shortest_allowed
from railctl.common.rail.play import Choose, Decision, Stage
from railctl.common.rail.world import DO_NOTHING, STOP_MOVING
from railctl.common.records.course import NONE, Course
from railctl.common.requests import Demonstrator
from railctl.common.seeding import stream_key
from railctl.services.evaluator.references.planner import actions_of_best_plan

Play = Callable[[int, Level, int], Course]  # number of the episode, its level, the seed of its malfunctions
NO_STATE = 0


def demonstrator(name: Demonstrator, world: CompiledWorld, seed: int, orders: int) -> Play:
    """The policy of a name, in slot 0 of a world; what it draws is of the seed and the number of the episode."""
    stage = Stage(world)

    def play(episode: int, level: Level, malfunction_seed: int) -> Course:
        stage.begin(level, malfunction_seed, np.zeros(0, np.int8), 0)
        choose = _choice(name, world.parts(), seed, orders, episode)
        return stage.advance(choose, np.zeros((level.n_trains, NO_STATE), np.float32))

    return play


def _choice(name: Demonstrator, parts: Parts, seed: int, orders: int, episode: int) -> Choose:
    if name == "planner":
        return as_planned(parts, actions_of_best_plan(seed, orders, episode, parts, anywhere=parts.decisions != CELLS))
    if name == "planner-replanned":
        return as_advised(parts, orders, stream_key(seed, episode, "planner-orders"))
    return onward(parts)


def as_planned(parts: Parts, actions: NDArray[np.int8]) -> Choose:
    """As actions [T, N] say; who is to do nothing, which is before it departs, stops."""

    def choose(_seen: NDArray[np.float32], step: int, train: int, allowed: int, _label: int = NONE) -> Decision:
        action = int(actions[step, train])
        return Decision(heeded(parts, train, allowed, STOP_MOVING if action == DO_NOTHING else action))

    return choose


def as_advised(parts: Parts, orders: int, key: int) -> Choose:
    """As the best of so many plans says that is made in the step."""
    desk = desk_for(parts.batch, int(parts.batch.worlds[0]["max_steps"]))
    labels = np.empty(parts.batch.worlds[0]["trains"], np.int8)
    planned_at = NONE

    def choose(_seen: NDArray[np.float32], step: int, train: int, allowed: int, _label: int = NONE) -> Decision:
        nonlocal planned_at
        if step != planned_at:
            advise_all(parts, orders, np.uint64(key), desk, labels)
            planned_at = step
        return Decision(heeded(parts, train, allowed, int(labels[train])))

    return choose


def onward(parts: Parts) -> Choose:
    """The shortest way of those allowed."""

    def choose(_seen: NDArray[np.float32], _step: int, train: int, allowed: int, _label: int = NONE) -> Decision:
        return Decision(heeded(parts, train, allowed, int(shortest_allowed(parts.batch, 0, train, allowed))))

    return choose


def heeded(parts: Parts, train: int, allowed: int, wanted: int) -> int:
    """What a train does that wants to take an action, or knows none."""
    for action in (wanted, STOP_MOVING, int(shortest_allowed(parts.batch, 0, train, allowed))):
        if action != NONE and allowed >> action & 1:
            return action
    return (allowed & -allowed).bit_length() - 1  # the lowest: no way leads to its target


@kernel
def advise_all(parts: Parts, orders: int, key: np.uint64, desk: Desk, labels: NDArray[np.int8]) -> None:
    """Fill in labels [N] for the deciding trains of slot 0."""
    advise(parts.batch, 0, parts.deciding[0], parts.decisions, orders, key, desk, labels)
