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
from numpy.typing import NDArray

from common.kernel import bare_kernel, kernel
from common.records import Episode

ROWS = ("observation_tm1", "observation_t")
COLUMNS: Mapping[str, type[np.generic]] = {
    "action_tm1": np.int8,
    "reward_t": np.float32,
    "discount_t": np.float32,
    "back": np.int32,
}
Number = TypeVar("Number", bound=np.generic)

NONE = -1  # no decision pending, no transition before, nothing that follows

_ENDS = np.dtype(
    [
        ("seen", np.int64),
        ("action", np.int8),
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
        ("seen", np.int64),  # which row holds the observation
        ("action", np.int8),
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
        self._seen = np.zeros((0, 0), np.float32)  # [N, F], what the trains saw at their pending decisions
        self._made = 0  # transitions of this episode so far

    @property
    def is_open(self) -> bool:
        """An episode has begun, and its last fragment has not come."""
        return self._open is not None

    def take(self, episode: Episode) -> Transitions:
        """All transitions that a whole episode holds, or that become complete with its next fragment.

        Args:
            episode: decisions in the order of (time, train), at most one for each.

        Raises:
            ValueError: the fragment is not the next one, the decisions are out of order, or a train decides after its
                arrival; then nothing has changed.
        """
        self._check_follows(episode)
        check_order(episode)
        if not self.is_open:
            self._begin(*episode.final_observations.shape)
        ends = np.empty(len(episode.times) + len(self._pending), _ENDS)
        count = follow(
            plain(episode.times),
            plain(episode.trains),
            plain(episode.actions),
            plain(episode.rewards),
            plain(episode.arrived_at),
            episode.first_step,
            episode.over,
            self._discount,
            self._pending,
            self._made,
            ends,
        )
        self._made += count
        made = self._gather(episode, ends[:count])
        if episode.over:
            self.forget()
        else:
            self._keep(episode)
        return made

    def _check_follows(self, episode: Episode) -> None:
        got = (episode.episode, episode.fragment, episode.first_step)
        want = (episode.episode, 0, 0) if self._open is None else self._open
        if got != want:
            raise ValueError(
                f"fragment {got[1]} of episode {got[0]} begins after step {got[2]}: "
                f"fragment {want[1]} of episode {want[0]} comes next, after step {want[2]}"
            )
        if self.is_open and self._seen.shape != episode.final_observations.shape:
            raise ValueError(f"fragment {got[1]} of episode {got[0]}: other trains or features than before")

    def _begin(self, n_trains: int, n_features: int) -> None:
        self._pending = np.zeros(n_trains, _PENDING)
        self._pending["seen"] = self._pending["last"] = NONE
        self._seen = np.zeros((n_trains, n_features), np.float32)

    def _gather(self, episode: Episode, ends: NDArray[Any]) -> Transitions:
        rows = np.concatenate((self._seen, episode.observations, episode.final_observations))
        following = rows[ends["follows"]]
        following[ends["follows"] == NONE] = 0
        columns = {
            "observation_tm1": rows[ends["seen"]],
            "action_tm1": ends["action"].copy(),
            "reward_t": ends["reward"].astype(np.float32),
            "discount_t": ends["discount"].astype(np.float32),
            "observation_t": following,
            "back": ends["back"].copy(),
        }
        return Transitions(columns, ends["completed_at"].copy())

    def _keep(self, episode: Episode) -> None:
        self._open = (episode.episode, episode.fragment + 1, episode.first_step + len(episode.rewards))
        seen, n_trains = self._pending["seen"], len(self._pending)
        new = np.flatnonzero(seen >= n_trains)
        self._seen[new] = episode.observations[seen[new] - n_trains]
        seen[new] = new


def plain(array: NDArray[Number]) -> NDArray[Number]:
    """The array, or a copy if it lies as a wire's may: for each way to lie, functions are compiled anew."""
    return np.require(array, requirements=["C", "A", "W"])


@bare_kernel
def end(now: Any, follows: int, completed_at: int, number: int, out: Any) -> int:
    """Write the transition that ends what is pending, the `number`th of its episode; returns 1, what there is of it."""
    out.seen, out.action, out.reward, out.discount = now.seen, now.action, now.reward, now.discount
    out.follows, out.completed_at = follows, completed_at
    out.back = 0 if now.last == NONE else number - now.last
    now.last, now.seen = number, NONE
    return 1


@kernel
def follow(  # noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
    times: NDArray[np.int32],
    trains: NDArray[np.int32],
    actions: NDArray[np.int8],
    rewards: NDArray[np.float32],
    arrived_at: NDArray[np.int32],
    first_step: int,
    over: bool,
    discount: float,
    pending: NDArray[Any],
    made: int,
    ends: NDArray[Any],
) -> int:
    """Walk along a fragment, step by step and train by train.

    Rows are counted through what trains saw before the fragment [N], its observations [D] and its last ones [N].

    Args:
        times: [D].
        trains: [D].
        actions: [D].
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
                now.seen, now.action = n_trains + decision, actions[decision]
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


def check_order(episode: Episode) -> None:
    """Raises ValueError for decisions out of the order of (time, train), or after their train has arrived."""
    times, trains = episode.times.astype(np.int64), episode.trains
    place = times * episode.rewards.shape[1] + trains
    if not (np.diff(place) > 0).all():
        raise ValueError(f"episode {episode.episode}: decisions are not in the order of (time, train)")
    arrived = episode.arrived_at[trains]
    if ((arrived >= 0) & (times > arrived)).any():
        raise ValueError(f"episode {episode.episode}: a train decides after its arrival")
