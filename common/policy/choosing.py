# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Choosing an action from a network's outputs, compiled; the rules of `common.policy.acting`.

A decision has two draws of its episode's stream of exploration, at its counter (`draw_counter`) and the one after. Of
equally good actions the lowest is taken.
"""

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel
from common.policy.arithmetic import Real, exp, log
from common.policy.packing import ACTOR_CRITIC, EXITS
from common.policy.streams import uniform

_ONE = np.uint64(1)


@bare_kernel
def is_policy(header: NDArray[np.int64]) -> bool:
    """Whether a network's outputs are logits and the state's value; else action values."""
    return bool(header[0] == ACTOR_CRITIC or header[0] == EXITS)


@bare_kernel
def draw_counter(step: int, n_trains: int, train: int) -> int:
    """Where the two draws of `train`'s decision at `step` lie in the episode's stream of exploration.

    Draw `draw_counter` decides whether to explore, the one after it which action. Every (step, train) has its
    own two, used or not: no decision shifts the draws of another.
    """
    return 2 * (step * n_trains + train)


@bare_kernel
def best(values: NDArray[np.float32]) -> int:
    """The index of the largest of values [A], the lowest of equals."""
    action = 0
    for other in range(1, len(values)):
        if values[other] > values[action]:
            action = other
    return action


@bare_kernel
def epsilon_greedy(values: NDArray[np.float32], epsilon: float, key: np.uint64, counter: np.uint64) -> int:
    """The best of values [A], or with probability `epsilon` any action."""
    if uniform(key, counter) < epsilon:
        return int(uniform(key, counter + _ONE) * len(values))
    return best(values)


@bare_kernel
def softmax_sample(logits: NDArray[np.float32], key: np.uint64, counter: np.uint64) -> int:
    """An action with the probability that softmax gives it; only the first draw of the decision is used.

    Args:
        logits: [A].
        key: of the episode's stream of exploration.
        counter: of this decision.
    """
    top = np.float64(logits[best(logits)])
    total: Real = 0.0
    for action in range(len(logits)):
        total += exp(np.float64(logits[action]) - top)
    threshold = uniform(key, counter) * total
    reached: Real = 0.0
    for action in range(len(logits) - 1):
        reached += exp(np.float64(logits[action]) - top)
        if threshold < reached:
            return action
    return len(logits) - 1


@bare_kernel
def choose(
    header: NDArray[np.int64],
    scores: NDArray[np.float32],
    greedy: bool,
    epsilon: float,
    key: np.uint64,
    counter: np.uint64,
) -> int:
    """An action by scores [A]: epsilon-greedily by action values, or as softmax of logits says; or the best.

    Args:
        header: of the network, see `common.policy.packing`.
        scores: [A].
        greedy: take the best; the draws are not looked at.
        epsilon: only for action values.
        key: of the episode's stream of exploration.
        counter: of this decision.
    """
    if greedy:
        return best(scores)
    if is_policy(header):
        return softmax_sample(scores, key, counter)
    return epsilon_greedy(scores, epsilon, key, counter)


@bare_kernel
def log_probability(logits: NDArray[np.float32], action: int) -> float:
    """The logarithm of the probability that softmax of logits [A] gives to an action."""
    top = np.float64(logits[best(logits)])
    total: Real = 0.0
    for other in range(len(logits)):
        total += exp(np.float64(logits[other]) - top)
    return float(np.float64(logits[action]) - top - log(total))
