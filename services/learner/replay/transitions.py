"""An episode's transitions, from each decision of a train to its next.

Between two decisions a train follows the rails, and nothing is stored. Such a transition spans a varying
number of steps and is one of a semi-Markov decision process: its reward is the discounted sum over the span,
and what follows is discounted by gamma to the power of the span (Sutton, Precup & Singh, "Between MDPs and
semi-MDPs", 1999, section 3). The text's own algorithms ignore the span.

A train's last transition ends on its arrival (terminated: nothing follows, discount 0) or at the step limit
(truncated: the value of its last observation follows, discounted as any other). A train's rewards after its
arrival belong to no transition. They are zero but for the +1 for everyone when the last train arrives, so
only the trains that arrive on that very step are taught that +1: the others can no longer do anything about
it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.records import Episode


@dataclass(frozen=True)
class Transitions:
    """M transitions in the order of (completed_at, train).

    Attributes:
        observation_tm1: [M, F], at the decision.
        action_tm1: [M], the decision.
        reward_t: [M], sum over the span of gamma^k times the k-th reward after the decision.
        discount_t: [M], gamma^span, or 0 where the train arrived.
        observation_t: [M, F], at the next decision, or the last before truncation; zeros where the train
            arrived.
        completed_at: [M], environment steps of the episode that are over when the transition is known, 1..T.
    """

    observation_tm1: NDArray[np.float32]
    action_tm1: NDArray[np.int8]
    reward_t: NDArray[np.float32]
    discount_t: NDArray[np.float32]
    observation_t: NDArray[np.float32]
    completed_at: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.action_tm1)

    def __getitem__(self, part: slice) -> "Transitions":
        return Transitions(
            self.observation_tm1[part],
            self.action_tm1[part],
            self.reward_t[part],
            self.discount_t[part],
            self.observation_t[part],
            self.completed_at[part],
        )


def transitions(episode: Episode, discount: float) -> Transitions:
    """All transitions of an episode: one a decision.

    Args:
        episode: decisions in the order of (time, train), at most one for each.
        discount: gamma, a step.

    Raises:
        ValueError: the decisions are out of order, or a train decides after its arrival.
    """
    check_order(episode)
    by_train = np.lexsort((episode.times, episode.trains))  # a train's decisions lie together, in time
    trains = episode.trains[by_train].astype(np.int64)
    begin = episode.times[by_train].astype(np.int64)
    end, is_last = _ends(episode, trains, begin)
    steps = episode.rewards.shape[0]
    powers = np.cumprod(np.concatenate(([1.0], np.full(steps, discount))))  # [T + 1], float64
    terminated = is_last & (episode.arrived_at[trains] >= 0)
    following = episode.observations[np.roll(by_train, -1)]
    following[is_last] = episode.final_observations[trains[is_last]]
    following[terminated] = 0

    order = np.lexsort((trains, end))
    return Transitions(
        observation_tm1=episode.observations[by_train[order]],
        action_tm1=episode.actions[by_train[order]],
        reward_t=_discounted_sums(episode.rewards, trains, begin, end, powers)[order].astype(np.float32),
        discount_t=np.where(terminated, 0.0, powers[end - begin])[order].astype(np.float32),
        observation_t=following[order],
        completed_at=end[order],
    )


def check_order(episode: Episode) -> None:
    """Raises ValueError for decisions out of the order of (time, train), or after their train has arrived."""
    times, trains = episode.times.astype(np.int64), episode.trains
    place = times * episode.rewards.shape[1] + trains
    if not (np.diff(place) > 0).all():
        raise ValueError(f"episode {episode.episode}: decisions are not in the order of (time, train)")
    arrived = episode.arrived_at[trains]
    if ((arrived >= 0) & (times > arrived)).any():
        raise ValueError(f"episode {episode.episode}: a train decides after its arrival")


def _ends(
    episode: Episode, trains: NDArray[np.int64], begin: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """When each span ends, and whether it is its train's last; decisions are grouped by train."""
    is_last = np.ones(len(trains), np.bool_)
    is_last[:-1] = trains[1:] != trains[:-1]
    arrived = episode.arrived_at[trains].astype(np.int64)
    train_end = np.where(arrived >= 0, arrived + 1, episode.rewards.shape[0])
    return np.where(is_last, train_end, np.roll(begin, -1)), is_last


def _discounted_sums(
    rewards: NDArray[np.float32],
    trains: NDArray[np.int64],
    begin: NDArray[np.int64],
    end: NDArray[np.int64],
    powers: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Sum over k of gamma^k * rewards[begin + k, train] for each span [begin, end), which is never empty."""
    if len(begin) == 0:
        return np.zeros(0)
    spans = end - begin
    first = np.cumsum(spans) - spans  # where each span starts when all are laid end to end
    k = np.arange(spans.sum()) - np.repeat(first, spans)
    step, train = np.repeat(begin, spans) + k, np.repeat(trains, spans)
    sums: NDArray[np.float64] = np.add.reduceat(rewards[step, train] * powers[k], first)
    return sums
