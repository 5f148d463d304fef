"""An episode's transitions, from each decision of a train to its next, whole or fragment by fragment.

Between two decisions a train follows the rails, and nothing is stored. Such a transition spans a varying number of
steps and is one of a semi-Markov decision process: its reward is the discounted sum over the span, and what follows is
discounted by gamma to the power of the span (Sutton, Precup & Singh, "Between MDPs and semi-MDPs", 1999, section 3).

The text's own algorithms ignore the span, and so do transitions of decisions that were noted with what their trains saw
one step later (`dqn.transitions: step`). Each spans the one step on which it was decided, whether or not the train
decides on the next one: its reward is that step's, and what the train saw then follows, discounted by gamma. Such runs
have no interlocking, so all actions may follow.

A train's last transition ends on its arrival (terminated: nothing follows, discount 0) or at the step limit
(truncated: the value of its last observation follows, discounted as any other). A train's rewards after its arrival
belong to no transition. They are zero but for the +1 for everyone when the last train arrives, so only the trains that
arrive on that very step are taught that +1: the others can no longer do anything about it.

A transition is complete with the step that shows its end: the step of the next decision, of the arrival, or the last
one. So what is complete after a number of steps depends on those steps alone, and it does not matter where an episode
is cut into fragments.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.records.acting import Fragment
from railctl.common.records.course import Course, Decisions
from railctl.services.learner.replay.replay import Items

ROWS = ("observation_tm1", "observation_t")
COLUMNS: Mapping[str, DTypeLike] = {
    "action_tm1": Decisions.arrays()["actions"].dtype,
    "back": np.int32,
    "allowed_t": Decisions.arrays()["allowed"].dtype,
    "reward_t": np.float32,
    "discount_t": np.float32,
}
ACTION, BACK, ALLOWED, REWARD, DISCOUNT = range(5)  # where these lie among an item's numbers: integers come first
DECIDED, LAST = range(2)  # of what is pending, see `find_transitions`
REWARDED, DISCOUNTED = range(2)
Number = TypeVar("Number", bound=np.generic)

NONE = -1  # no decision pending, no transition before


@dataclass(frozen=True)
class Transitions:
    """M transitions in the order of (completed_at, train, decision).

    Attributes:
        items: what a replay keeps, see `columns`.
        completed_at: [M], environment steps of the episode that are over when the transition is known, 1..T.
    """

    items: Items
    completed_at: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.completed_at)

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """What a replay keeps, by name.

        observation_tm1 [M, F], at the decision;
        action_tm1 [M], the decision;
        reward_t [M], sum over the span of gamma^k times the k-th reward after the decision;
        discount_t [M], gamma^span, or 0 where the train arrived;
        observation_t [M, F], at the end of the span: at the next decision or one step later, or the last before
            truncation; zeros where the train arrived;
        allowed_t [M], what is allowed then, a bit an action; all after an arrival;
        back [M], how many transitions earlier the train's previous one of this episode is; 0 for its first.
        """
        integers, floats = self.items.numbers.view(np.int32), self.items.numbers.view(np.float32)
        rows = self.items.rows.view(np.float32)
        return {
            "observation_tm1": rows[:, 0],
            "action_tm1": integers[:, ACTION].astype(COLUMNS["action_tm1"]),
            "reward_t": floats[:, REWARD],
            "discount_t": floats[:, DISCOUNT],
            "observation_t": rows[:, 1],
            "allowed_t": integers[:, ALLOWED].astype(COLUMNS["allowed_t"]),
            "back": integers[:, BACK],
        }


class TransitionMaker:
    """Makes transitions of episodes, whole or in fragments; between fragments it keeps what is not complete."""

    def __init__(self, discount: float) -> None:
        """`discount` is gamma, a step."""
        self._discount = discount
        self.forget()

    def forget(self) -> None:
        """Leave the episode that is open, if there is one."""
        self._open: tuple[int, int, int] | None = None  # the next fragment: episode, number, first step
        self._made = 0  # transitions of this episode so far

    @property
    def is_open(self) -> bool:
        """An episode has begun, and its last fragment has not come."""
        return self._open is not None

    def take(self, fragment: Fragment) -> Transitions:
        """All transitions that a whole episode holds, or that become complete with its next fragment.

        Args:
            fragment: `check_order` has passed it.

        Raises:
            ValueError: the fragment is not the next one; then nothing has changed.
        """
        course, decisions = fragment.course, fragment.course.decisions
        episode, number = self._check_follows(fragment)
        if self._open is None:
            self._begin(course)
        n_trains, n_features = course.final_observations.shape
        most = len(decisions) + n_trains
        numbers, completed_at = np.empty((most, len(COLUMNS)), np.uint32), np.empty(most, np.int64)
        rows = np.empty((most, len(ROWS), n_features), np.uint32)
        count = find_transitions(
            plain(decisions.times),
            plain(decisions.trains),
            plain(decisions.actions),
            plain(decisions.allowed),
            bits(decisions.observations),
            bits(decisions.following),
            plain(course.rewards),
            plain(course.arrived_at),
            bits(course.final_observations),
            plain(course.final_allowed),
            course.first_step,
            course.over,
            self._discount,
            self._made,
            *self._pending,
            numbers,
            rows,
            completed_at,
        )
        self._made += count
        if course.over:
            self.forget()
        else:
            self._open = (episode, number + 1, course.last_step)
        return Transitions(Items(numbers[:count], rows[:count]), completed_at[:count])

    def _check_follows(self, fragment: Fragment) -> tuple[int, int]:
        """Returns episode and number of the fragment."""
        episode, number = fragment.lease.unit
        got = (episode, number, fragment.course.first_step)
        want = (episode, 0, 0) if self._open is None else self._open
        if got != want:
            raise ValueError(
                f"fragment {number} of episode {episode} begins after step {got[2]}: "
                f"fragment {want[1]} of episode {want[0]} comes next, after step {want[2]}"
            )
        if self._open is not None and self._pending[2].shape != fragment.course.final_observations.shape:
            raise ValueError(f"fragment {number} of episode {episode}: other trains or features than before")
        return episode, number

    def _begin(self, course: Course) -> None:
        """Memory for each train's pending decision, see `find_transitions`."""
        n_trains, n_features = course.final_observations.shape
        self._pending = (
            np.full((n_trains, 2), NONE),
            np.zeros((n_trains, 2)),
            np.zeros((n_trains, n_features), np.uint32),
        )


def plain(array: NDArray[Number]) -> NDArray[Number]:
    """The array, or a copy if it lies as a wire's may: for each way to lie, functions are compiled anew."""
    return array if array.flags.carray else np.array(array, order="C")


def bits(rows: NDArray[np.float32]) -> NDArray[np.uint32]:
    """As `plain`, the bits of the numbers."""
    return plain(rows).view(np.uint32)


@bare_kernel
def copy(row: NDArray[np.uint32], out: NDArray[np.uint32]) -> None:
    """Overwrite `out` [F] with a row."""
    for place in range(len(row)):
        out[place] = row[place]


@bare_kernel
def note(
    number: int,
    allowed: int,
    pending: NDArray[np.int64],
    sums: NDArray[np.float64],
    out: NDArray[np.uint32],
) -> None:
    """Write the numbers of the transition that ends what is pending, the `number`th of its episode.

    `allowed` are the actions that may follow.
    """
    out[ALLOWED] = allowed
    out[ACTION], out[BACK] = pending[DECIDED], 0 if pending[LAST] == NONE else number - pending[LAST]
    out[REWARD] = np.float32(sums[REWARDED]).view(np.uint32)
    out[DISCOUNT] = np.float32(sums[DISCOUNTED]).view(np.uint32)
    pending[DECIDED], pending[LAST] = NONE, number


@bare_kernel
def find_transitions(  # noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
    times: NDArray[np.int32],
    trains: NDArray[np.int32],
    actions: NDArray[np.int8],
    allowed: NDArray[np.uint8],
    observations: NDArray[np.uint32],
    following: NDArray[np.uint32],
    rewards: NDArray[np.float32],
    arrived_at: NDArray[np.int32],
    final_observations: NDArray[np.uint32],
    final_allowed: NDArray[np.uint8],
    first_step: int,
    over: bool,
    discount: float,
    made: int,
    pending: NDArray[np.int64],
    sums: NDArray[np.float64],
    kept: NDArray[np.uint32],
    numbers: NDArray[np.uint32],
    rows: NDArray[np.uint32],
    completed_at: NDArray[np.int64],
) -> int:
    """Walk along a fragment, step by step and train by train, and write down which decisions end and how.

    Args:
        times: [D].
        trains: [D].
        actions: [D].
        allowed: [D].
        observations: [D, F], their bits.
        following: [D, F], the bits of what is seen a step later, where transitions end; [D, 0]: they span.
        rewards: [T, N].
        arrived_at: [N].
        final_observations: [N, F], their bits.
        final_allowed: [N].
        first_step: steps before the fragment.
        over: the episode ends with it.
        discount: gamma.
        made: transitions of the episode before the fragment.
        pending: [N, 2], of the decisions whose ends are not known: the action, NONE if a train has none pending, and
            the number of the train's last transition, NONE for none; overwritten.
        sums: [N, 2], their discounted rewards so far, and gamma to the power of their steps so far; overwritten.
        kept: [N, F], what was seen at them; overwritten.
        numbers: [D + N, 5], overwritten with those of the transitions, in their order.
        rows: [D + N, 2, F], overwritten with what was seen before and after them.
        completed_at: [D + N], overwritten.

    Returns:
        How many transitions there are.
    """
    steps, n_trains = rewards.shape
    last_step = first_step + steps
    one_step = following.shape[1] > 0
    decision = count = 0  # the next of each
    for step in range(first_step, last_step):
        for train in range(n_trains):
            if decision < len(times) and times[decision] == step and trains[decision] == train:
                seen = observations[decision]
                if pending[train, DECIDED] != NONE:
                    note(made + count, allowed[decision], pending[train], sums[train], numbers[count])
                    copy(kept[train], rows[count, 0])
                    copy(seen, rows[count, 1])
                    completed_at[count] = step + 1
                    count += 1
                pending[train, DECIDED] = actions[decision]
                sums[train, REWARDED], sums[train, DISCOUNTED] = 0.0, 1.0
                copy(seen, kept[train])
                decision += 1
            if pending[train, DECIDED] == NONE:
                continue
            sums[train, REWARDED] += sums[train, DISCOUNTED] * rewards[step - first_step, train]
            sums[train, DISCOUNTED] *= discount
            arrives = arrived_at[train] == step
            if arrives or one_step or (over and step == last_step - 1):
                after = rows[count, 1]
                if arrives:
                    sums[train, DISCOUNTED] = 0.0
                    after[:] = 0
                elif one_step:
                    copy(following[decision - 1], after)
                else:
                    copy(final_observations[train], after)
                last = ALL_ACTIONS if arrives or one_step else int(final_allowed[train])
                note(made + count, last, pending[train], sums[train], numbers[count])
                copy(kept[train], rows[count, 0])
                completed_at[count] = step + 1
                count += 1
    return count


def check_order(fragment: Fragment) -> None:
    """Raises ValueError for decisions out of the order of (time, train), or after their train has arrived."""
    # In lists: a fragment is short, and each way of numpy's costs more than a column.
    course, decisions = fragment.course, fragment.course.decisions
    order = list(zip(decisions.times.tolist(), decisions.trains.tolist(), strict=True))
    if order != sorted(set(order)):
        raise ValueError(f"episode {fragment.lease.episode}: decisions are not in the order of (time, train)")
    arrived_at = course.arrived_at.tolist()
    for time, train in order:
        if 0 <= arrived_at[train] < time:
            raise ValueError(f"episode {fragment.lease.episode}: a train decides after its arrival")
