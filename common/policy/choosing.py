# ruff: noqa: PLR0913  (compiled code takes arrays, not objects that hold them)
"""Choosing an action from a network's outputs, compiled; the rules of `common.policy.acting`.

Actions are told apart by their numbers; of those that are `allowed`, a bit each, there is at least one, and the others
are as if the network did not have them. Of equally good actions the lowest is taken. A decision has two draws of its
episode's stream of exploration, at its counter (`draw_counter`) and the one after.
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.arithmetic import Real, exp, log
from railctl.common.policy.packing import ACTOR_CRITIC, EXITS
from railctl.common.policy.streams import uniform

NOTHING = -1
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
def best(values: NDArray[np.float32], allowed: int) -> int:
    """The allowed action with the largest of values [A], the lowest of equals."""
    action = NOTHING
    for other in range(len(values)):
        if allowed >> other & 1 and (action == NOTHING or values[other] > values[action]):
            action = other
    return action


@bare_kernel
def nth(place: int, allowed: int) -> int:
    """The allowed action that has `place` others below it."""
    action = 0
    while place > 0 or not allowed >> action & 1:
        place -= allowed >> action & 1
        action += 1
    return action


@bare_kernel
def epsilon_greedy(
    values: NDArray[np.float32], allowed: int, epsilon: float, key: np.uint64, counter: np.uint64
) -> int:
    """The best of values [A], or with probability `epsilon` any action."""
    if uniform(key, counter) < epsilon:
        count = 0
        for action in range(len(values)):
            count += allowed >> action & 1
        return nth(int(uniform(key, counter + _ONE) * count), allowed)
    return best(values, allowed)


@bare_kernel
def softmax_sample(logits: NDArray[np.float32], allowed: int, key: np.uint64, counter: np.uint64) -> int:
    """An action with the probability that softmax gives it; only the first draw of the decision is used.

    Args:
        logits: [A].
        allowed: actions.
        key: of the episode's stream of exploration.
        counter: of this decision.
    """
    top = np.float64(logits[best(logits, allowed)])
    total: Real = 0.0
    for action in range(len(logits)):
        if allowed >> action & 1:
            total += exp(np.float64(logits[action]) - top)
    threshold = uniform(key, counter) * total
    reached: Real = 0.0
    last = NOTHING
    for action in range(len(logits)):
        if allowed >> action & 1:
            reached += exp(np.float64(logits[action]) - top)
            last = action
            if threshold < reached:
                break
    return last


@bare_kernel
def choose(
    header: NDArray[np.int64],
    scores: NDArray[np.float32],
    allowed: int,
    label: int,
    greedy: bool,
    epsilon: float,
    key: np.uint64,
    counter: np.uint64,
) -> int:
    """An action by scores [A]: epsilon-greedily by action values, or as softmax of logits says; or the best.

    A policy that has a teacher does as that would with the probability `epsilon`, by the second draw.

    Args:
        header: of the network, see `common.policy.packing`.
        scores: [A].
        allowed: actions.
        label: what a teacher would do, or NOTHING.
        greedy: take the best; the draws are not looked at.
        epsilon: of action values, how probable any action is; of a policy, what a teacher would do if that is allowed.
        key: of the episode's stream of exploration.
        counter: of this decision.
    """
    if greedy:
        return best(scores, allowed)
    if is_policy(header):
        is_taught = label != NOTHING and allowed >> label & 1 and uniform(key, counter + _ONE) < epsilon
        return label if is_taught else softmax_sample(scores, allowed, key, counter)
    return epsilon_greedy(scores, allowed, epsilon, key, counter)


@bare_kernel
def log_probability(logits: NDArray[np.float32], allowed: int, action: int) -> float:
    """The logarithm of the probability that softmax of logits [A] gives to an action, which is allowed."""
    top = np.float64(logits[best(logits, allowed)])
    total: Real = 0.0
    for other in range(len(logits)):
        if allowed >> other & 1:
            total += exp(np.float64(logits[other]) - top)
    return float(np.float64(logits[action]) - top - log(total))
