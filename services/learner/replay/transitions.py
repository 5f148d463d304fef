"""An episode's transitions, from each decision of a train to its next, whole or fragment by fragment.

Between two decisions a train follows the rails, and nothing is stored. Such a transition spans a varying number of
steps and is one of a semi-Markov decision process: its reward is the discounted sum over the span, and what follows is
discounted by gamma to the power of the span (Sutton, Precup & Singh, "Between MDPs and semi-MDPs", 1999, section 3).
The text's own algorithms ignore the span.

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

from common.kernel import bare_kernel, kernel
from common.records.acting import Fragment
from common.records.course import Course, Decisions

DECIDED = {"observation_tm1": "observations", "action_tm1": "actions"}  # what is learned of each decision
ROWS = ("observation_tm1", "observation_t")
COLUMNS: Mapping[str, DTypeLike] = {
    **{name: Decisions.arrays()[column].dtype for name, column in DECIDED.items() if name not in ROWS},
    "reward_t": np.float32,
    "discount_t": np.float32,
    "back": np.int32,
}
Number = TypeVar("Number", bound=np.generic)

NONE = -1  # no decision pending, no transition before, nothing that follows

_ENDS = np.dtype(
    [
        ("seen", np.int64),
        ("reward", np.float64),
        ("discount", np.float64),
        ("follows", np.int64),
        ("completed_at", np.int64),
        ("back", np.int32),
    ],
    align=True,
)
_PENDING = np.dtype(
    [
        ("seen", np.int64),  # which row holds the decision
        ("reward", np.float64),  # discounted sum so far
        ("discount", np.float64),  # gamma to the power of the steps so far
        ("last", np.int64),  # the number of the train's last transition
    ],
    align=True,
)


@dataclass(frozen=True)
class Transitions:
    """M transitions in the order of (completed_at, train, decision).

    Attributes:
        columns: what a replay keeps:
            observation_tm1 [M, F], at the decision;
            action_tm1 [M], the decision;
            reward_t [M], sum over the span of gamma^k times the k-th reward after the decision;
            discount_t [M], gamma^span, or 0 where the train arrived;
            observation_t [M, F], at the next decision, or the last before truncation; zeros where the train arrived;
            back [M], how many transitions earlier the train's previous one of this episode is; 0 for its first.
        completed_at: [M], environment steps of the episode that are over when the transition is known, 1..T.
    """

    columns: dict[str, NDArray[Any]]
    completed_at: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.completed_at)

    def __getitem__(self, part: slice) -> dict[str, NDArray[Any]]:
        return {name: column[part] for name, column in self.columns.items()}


class TransitionMaker:
    """Makes transitions of episodes, whole or in fragments; between fragments it keeps what is not complete."""

    def __init__(self, discount: float) -> None:
        """`discount` is gamma, a step."""
        self._discount = discount
        self.forget()

    def forget(self) -> None:
        """Leave the episode that is open, if there is one."""
        self._open: tuple[int, int, int] | None = None  # the next fragment: episode, number, first step
        self._pending = np.zeros(0, _PENDING)
        self._kept: dict[str, NDArray[Any]] = {}  # by column of DECIDED: [N, ...], of the trains' pending decisions
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
        self._check_follows(fragment)
        if not self.is_open:
            self._begin(course)
        ends = np.empty(len(decisions) + len(self._pending), _ENDS)
        count = find_transitions(
            plain(decisions.times),
            plain(decisions.trains),
            plain(course.rewards),
            plain(course.arrived_at),
            course.first_step,
            course.over,
            self._discount,
            self._pending,
            self._made,
            ends,
        )
        self._made += count
        made = self._gather(course, ends[:count])
        if course.over:
            self.forget()
        else:
            self._keep(fragment)
        return made

    def _check_follows(self, fragment: Fragment) -> None:
        episode, number = fragment.lease.unit
        got = (episode, number, fragment.course.first_step)
        want = (episode, 0, 0) if self._open is None else self._open
        if got != want:
            raise ValueError(
                f"fragment {number} of episode {episode} begins after step {got[2]}: "
                f"fragment {want[1]} of episode {want[0]} comes next, after step {want[2]}"
            )
        if self.is_open and self._kept["observations"].shape != fragment.course.final_observations.shape:
            raise ValueError(f"fragment {number} of episode {episode}: other trains or features than before")

    def _begin(self, course: Course) -> None:
        n_trains = course.n_trains
        self._pending = np.zeros(n_trains, _PENDING)
        self._pending["seen"] = self._pending["last"] = NONE
        for column in DECIDED.values():
            array = getattr(course.decisions, column)
            self._kept[column] = np.zeros((n_trains, *array.shape[1:]), array.dtype)

    def _gather(self, course: Course, ends: NDArray[Any]) -> Transitions:
        rows = {name: np.concatenate((kept, getattr(course.decisions, name))) for name, kept in self._kept.items()}
        following = np.concatenate((rows["observations"], course.final_observations))[ends["follows"]]
        following[ends["follows"] == NONE] = 0
        columns = {
            **{name: rows[column][ends["seen"]] for name, column in DECIDED.items()},
            "reward_t": ends["reward"].astype(np.float32),
            "discount_t": ends["discount"].astype(np.float32),
            "observation_t": following,
            "back": ends["back"].copy(),
        }
        return Transitions(columns, ends["completed_at"].copy())

    def _keep(self, fragment: Fragment) -> None:
        episode, number = fragment.lease.unit
        self._open = (episode, number + 1, fragment.course.last_step)
        seen, n_trains = self._pending["seen"], len(self._pending)
        new = np.flatnonzero(seen >= n_trains)
        for name, kept in self._kept.items():
            kept[new] = getattr(fragment.course.decisions, name)[seen[new] - n_trains]
        seen[new] = new


def plain(array: NDArray[Number]) -> NDArray[Number]:
    """The array, or a copy if it lies as a wire's may: for each way to lie, functions are compiled anew."""
    return np.require(array, requirements=["C", "A", "W"])


@bare_kernel
def end(now: Any, follows: int, completed_at: int, number: int, out: Any) -> int:
    """Write the transition that ends what is pending, the `number`th of its episode; returns 1, what there is of it."""
    out.seen, out.reward, out.discount = now.seen, now.reward, now.discount
    out.follows, out.completed_at = follows, completed_at
    out.back = 0 if now.last == NONE else number - now.last
    now.last, now.seen = number, NONE
    return 1


@kernel
def find_transitions(  # noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
    times: NDArray[np.int32],
    trains: NDArray[np.int32],
    rewards: NDArray[np.float32],
    arrived_at: NDArray[np.int32],
    first_step: int,
    over: bool,
    discount: float,
    pending: NDArray[Any],
    made: int,
    ends: NDArray[Any],
) -> int:
    """Walk along a fragment, step by step and train by train, and note which decisions end and how.

    Rows are counted through the trains' decisions before the fragment [N], its own [D] and its last observations [N].

    Args:
        times: [D].
        trains: [D].
        rewards: [T, N].
        arrived_at: [N].
        first_step: steps before the fragment.
        over: the episode ends with it.
        discount: gamma.
        pending: [N], the trains' decisions whose ends are not known; overwritten.
        made: transitions of the episode before the fragment.
        ends: [D + N], overwritten with the transitions, in their order.

    Returns:
        How many transitions are in `ends`.
    """
    steps, n_trains = rewards.shape
    decision = count = 0  # the next of each
    for step in range(first_step, first_step + steps):
        for train in range(n_trains):
            now = pending[train]
            if decision < len(times) and times[decision] == step and trains[decision] == train:
                if now.seen != NONE:
                    count += end(now, n_trains + decision, step + 1, made + count, ends[count])
                now.seen = n_trains + decision
                now.reward, now.discount = 0.0, 1.0
                decision += 1
            if now.seen == NONE:
                continue
            now.reward += now.discount * rewards[step - first_step, train]
            now.discount *= discount
            if arrived_at[train] == step:
                now.discount = 0.0
                count += end(now, NONE, step + 1, made + count, ends[count])
            elif over and step == first_step + steps - 1:
                count += end(now, n_trains + len(times) + train, step + 1, made + count, ends[count])
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
